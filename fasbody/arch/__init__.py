"""The five-body foot with its arch: equations of Chapter 4, the MJCF that carries them, and what follows from both."""
