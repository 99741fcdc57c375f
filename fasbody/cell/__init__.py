"""Modal analysis of an adherent bone cell (Chapter 5): mesh, materials, modes, sweeps, and what lies beyond.

Needs the extra ``cell`` (gmsh, scikit-fem, meshio, trimesh). The command is ``fasbody cell``.
"""
