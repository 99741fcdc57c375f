"""The shapes of bones and soft parts, and the meshes made of them; `fasbody anatomy`."""
