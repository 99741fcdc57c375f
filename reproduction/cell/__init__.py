"""Chapter 5: sweeps over shapes and moduli, and the finite elements against bodies whose frequencies are known."""
