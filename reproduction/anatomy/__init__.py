"""The shapes of bones and soft parts, and the meshes of mjcf/assets made of them; `fasbody anatomy`."""
