"""Physics of the vibrating human foot and ankle: models, shaker, recordings, simulation.

Heavy imports (MuJoCo, numba, matplotlib) stay in the modules that need them.
"""
