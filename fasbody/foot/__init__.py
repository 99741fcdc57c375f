"""The foot as a model: MJCF files, their parameters and dampers, the engine that runs them, the shaker under them."""
