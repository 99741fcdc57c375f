"""Engines that carry a motion and its sensitivities: the compiled twin, MuJoCo, and both together."""
