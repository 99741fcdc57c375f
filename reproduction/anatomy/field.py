"""Shapes as signed distances, and their meshes: smooth unions of round cones and ellipsoids, meshed by surface nets.

Millimetres throughout. A surface-nets vertex sits in every grid cell that the surface crosses; Newton steps along the
gradient then put it on the surface, so the normals can be those of the field itself.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Array = np.ndarray
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Shape:
    """A solid: signed distance of points (..., 3) [mm], negative inside, and the box that holds its surface."""

    distance: Callable[[Array], Array]
    low: Array
    high: Array


@dataclass(frozen=True)
class Mesh:
    """Vertices (n, 3) [mm], faces (m, 3), outward unit normals (n, 3)."""

    vertices: Array
    faces: Array
    normals: Array


def round_cone(a: Vector | Array, b: Vector | Array, radius_a: float, radius_b: float) -> Shape:
    """A capsule from `a` to `b` whose radius changes linearly."""
    start, end = np.asarray(a, float), np.asarray(b, float)
    axis = end - start

    def distance(p: Array) -> Array:
        t = np.clip((p - start) @ axis / (axis @ axis), 0, 1)
        return np.linalg.norm(p - start - t[..., None] * axis, axis=-1) - (radius_a + (radius_b - radius_a) * t)

    low, high = np.minimum(start - radius_a, end - radius_b), np.maximum(start + radius_a, end + radius_b)
    return Shape(distance, low, high)


def ellipsoid(centre: Vector | Array, radii: Vector, tilt: float = 0.0) -> Shape:
    """An ellipsoid, turned about the transverse axis by `tilt` [deg], nose down positive."""
    c, r = np.asarray(centre, float), np.asarray(radii, float)
    sin, cos = np.sin(np.radians(tilt)), np.cos(np.radians(tilt))
    R = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])

    def distance(p: Array) -> Array:
        q = (p - c) @ R.T
        near, slope = np.linalg.norm(q / r, axis=-1), np.linalg.norm(q / r**2, axis=-1)
        return near * (near - 1) / np.maximum(slope, 1e-9)

    reach = np.sqrt((R.T**2) @ r**2)
    return Shape(distance, c - reach, c + reach)


def _smooth_minimum(a: Array, b: Array, width: float) -> Array:
    h = np.maximum(width - np.abs(a - b), 0) / width
    return np.minimum(a, b) - h**3 * width / 6


def union(*parts: Shape, blend: float = 6.0) -> Shape:
    """All parts, their seams filled over `blend` [mm]."""

    def distance(p: Array) -> Array:
        total = parts[0].distance(p)
        for part in parts[1:]:
            total = _smooth_minimum(total, part.distance(p), blend)
        return total

    low, high = np.min([part.low for part in parts], 0), np.max([part.high for part in parts], 0)
    return Shape(distance, low - blend / 3, high + blend / 3)


def cut(shape: Shape, *tools: Shape, blend: float = 4.0) -> Shape:
    """`shape` without the tools, the edges rounded over `blend` [mm]."""

    def distance(p: Array) -> Array:
        left = shape.distance(p)
        for tool in tools:
            left = -_smooth_minimum(-left, tool.distance(p), blend)
        return left

    return Shape(distance, shape.low, shape.high)


def above(height: float) -> Shape:
    """The half space over `height` [mm]: a tool to cut with."""
    return Shape(lambda p: height - p[..., 2], np.full(3, -np.inf), np.full(3, np.inf))


def below(height: float) -> Shape:
    """The half space under `height` [mm]."""
    return Shape(lambda p: p[..., 2] - height, np.full(3, -np.inf), np.full(3, np.inf))


def inflated(shape: Shape, by: float) -> Shape:
    """The shape grown by `by` [mm]."""
    return Shape(lambda p: shape.distance(p) - by, shape.low - by, shape.high + by)


def gradient(shape: Shape, p: Array, step: float = 0.05) -> Array:
    """Unit gradient of the distance at points (n, 3)."""
    slope = np.stack([shape.distance(p + step * e) - shape.distance(p - step * e) for e in np.eye(3)], -1)
    return slope / np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-9)


def mesh(shape: Shape, spacing: float) -> Mesh:
    """Closed triangle mesh of the surface with edges of about `spacing` [mm]."""
    low = shape.low - 2.5 * spacing
    count = np.ceil((shape.high + 2.5 * spacing - low) / spacing).astype(int) + 1
    axes = [low[i] + spacing * np.arange(count[i]) for i in range(3)]
    inside = shape.distance(np.stack(np.meshgrid(*axes, indexing="ij"), -1)) < 0
    vertices, faces = _surface_net(inside, low, spacing)
    for _ in range(4):
        value = np.clip(shape.distance(vertices), -0.5 * spacing, 0.5 * spacing)
        vertices = vertices - value[:, None] * gradient(shape, vertices)
    return Mesh(vertices, faces, gradient(shape, vertices))


def _surface_net(inside: Array, low: Array, spacing: float) -> tuple[Array, Array]:
    """One vertex in each cell whose corners disagree, one quad around each grid edge whose ends disagree."""
    near, far = slice(None, -1), slice(1, None)
    corners = [inside[x, y, z] for x in (near, far) for y in (near, far) for z in (near, far)]
    filled = np.sum(corners, axis=0, dtype=np.int8)
    cells = np.argwhere((filled > 0) & (filled < 8))
    number = np.full(filled.shape, -1)
    number[tuple(cells.T)] = np.arange(len(cells))
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        first = np.take(inside, range(inside.shape[axis] - 1), axis)
        second = np.take(inside, range(1, inside.shape[axis]), axis)
        edges = np.argwhere(first != second)
        quad = []
        for back_u, back_v in ((1, 1), (0, 1), (0, 0), (1, 0)):
            cell = edges.copy()
            cell[:, u] -= back_u
            cell[:, v] -= back_v
            quad.append(number[tuple(cell.T)])
        corner = np.stack(quad, 1)
        outward = ~first[tuple(edges.T)]
        corner[outward] = corner[outward][:, ::-1]
        faces += [corner[:, [0, 1, 2]], corner[:, [0, 2, 3]]]
    return low + spacing * (cells + 0.5), np.vstack(faces)
