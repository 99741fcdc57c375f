"""Recordings and studies: what a file holds, under which condition it was made, and whether it can serve."""
