"""The meshes of bones and soft parts, and the bodies of a model that carry them."""
