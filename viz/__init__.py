"""The vibrating foot in a browser."""
