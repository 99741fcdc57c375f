"""Where the numbers of contour lines stand, so that each can be read."""

from typing import Any

import numpy as np


def label_lines(axis: Any, lines: Any, width: float, height: float) -> None:
    """A number on each contour line, within the panel and apart from the others; where there is no room, none."""
    placed: list[np.ndarray] = []
    every = [np.concatenate([*paths, np.empty((0, 2))]) / (width, height) for paths in lines.allsegs]
    for i, level in enumerate(lines.levels):
        inside = ((every[i] > (0.045, 0.06)) & (every[i] < 0.94)).all(axis=1)
        if not inside.any():  # a line along the edge, such as that of 1 at a low frequency
            inside = ((every[i] > (0.025, 0.06)) & (every[i] < 0.94)).all(axis=1)
        points = every[i][inside][::3]
        if not len(points):
            continue
        others = np.concatenate([*every[:i], *every[i + 1 :], np.full((1, 2), 9.0)])[::3]
        lone = np.hypot(*(points[:, None] - others).transpose(2, 0, 1)).min(axis=1)
        apart = np.min([np.hypot(*((points - other) * (1, 1.3)).T) for other in [*placed, np.full(2, 9.0)]], axis=0)
        best = points[np.argmax(np.minimum(apart, 0.2) + 2 * np.minimum(lone, 0.1))]
        if placed and apart.max() < 0.075:
            continue
        placed.append(best)
        box = {"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.85}
        axis.text(*(best * (width, height)), f"{level:g}", fontsize=6.5, ha="center", va="center", bbox=box)
