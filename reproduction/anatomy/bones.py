"""The bones of a left foot as shapes: x towards the toes, y to the little toe, z up, in millimetres.

The frame is that of the five-body arch: the joint of talus and navicular at x = 0, heel and metatarsal heads at z = 0
(Table 4.1), the table at z = TABLE. Each bone belongs to the segment of the arch that carries it.
"""

import numpy as np

from reproduction.anatomy.field import Shape, below, cut, ellipsoid, round_cone, union
from viz.anatomy.rest import METATARSALS, SEGMENTS

#: Where tibia and fibula are cut off.
KNEE = 172.0


def calcaneus() -> Shape:
    """Heel bone: tuberosity with its plantar tubercles, body, anterior process, sustentaculum."""
    body = union(
        ellipsoid((-77, 5, 17), (15, 14.5, 21), -10),
        round_cone((-73, 5, 15), (-42, 6, 20), 15, 13),
        round_cone((-44, 6, 20), (-13, 9, 16), 13.5, 11.5),
        ellipsoid((-12, 10, 16), (8, 11, 11)),
        ellipsoid((-69, 1, 3), (13, 8, 7)),
        ellipsoid((-68, 11, 4), (10, 6, 6)),
        blend=9,
    )
    hollow = round_cone((-52, -21, 8), (-24, -19, 4), 9, 9)
    body = cut(body, hollow, blend=10)
    shelf = union(round_cone((-37, -3, 27), (-24, -11, 29), 6, 5), blend=6)
    return union(body, shelf, blend=7)


def talus() -> Shape:
    """Ankle bone: trochlea with its groove, neck, head, posterior process."""
    body = union(
        ellipsoid((-34, 1, 42), (20, 15, 17), 6),
        round_cone((-26, -2, 40), (-8, -7, 38), 12, 10.5),
        ellipsoid((-5, -8, 37.5), (9.5, 12.5, 12)),
        ellipsoid((-52, 1, 36), (9, 8, 6)),
        ellipsoid((-33, 14, 38), (9, 5, 8)),
        blend=7,
    )
    return cut(body, round_cone((-54, 1, 66), (-12, 1, 65), 4, 4), blend=7)


def navicular() -> Shape:
    """Boat-shaped bone before the talus, with its tuberosity on the inner side."""
    body = union(ellipsoid((8, -9, 35), (7, 20, 15), 18), ellipsoid((7, -26, 29), (7, 7, 8)), blend=7)
    return cut(body, ellipsoid((-5.5, -8, 37.5), (11, 14, 13.5)), blend=3)


def _wedge(back: tuple[float, float, float], front: tuple[float, float, float], width: float, tall: float) -> Shape:
    a, b = np.asarray(back, float), np.asarray(front, float)
    return union(*[ellipsoid(a + (b - a) * t, (8.5, width, tall), 24) for t in (0.16, 0.5, 0.84)], blend=5)


def cuneiforms() -> dict[str, Shape]:
    """The three wedges and the cuboid."""
    cuboid = union(ellipsoid((5, 22, 17), (15, 12, 12), 10), ellipsoid((16, 22, 17), (11, 12, 12), 10), blend=7)
    return {
        "medial_cuneiform": _wedge((15, -21, 31), (37, -22, 24), 8.6, 14),
        "intermediate_cuneiform": _wedge((15, -7, 37), (32, -7, 31), 7.6, 11),
        "lateral_cuneiform": _wedge((14, 6, 34), (35, 7, 27), 8.0, 11.5),
        "cuboid": cuboid,
    }


def metatarsals() -> dict[str, Shape]:
    """Metatarsals and sesamoids: the last segment of the arch."""
    parts = {}
    for i, (base, head, width, thickness, knob) in enumerate(METATARSALS):
        a, b = np.asarray(base, float), np.asarray(head, float)

        def at(t: float, lift: float = 0.0, a: np.ndarray = a, b: np.ndarray = b) -> np.ndarray:
            return a + (b - a) * t + (0, 0, lift)

        pieces = [
            ellipsoid(at(0.05), (7.5, 0.8 * width, width), 22),
            round_cone(at(0.05), at(0.36, 1.2), 0.75 * width, thickness),
            round_cone(at(0.3, 1.2), at(0.72, 1.8), thickness, thickness * 1.02),
            round_cone(at(0.7, 1.8), at(0.96), thickness, 0.85 * knob),
            ellipsoid(at(1.0), (knob, 0.88 * knob, knob), 20),
        ]
        if i == 4:  # the styloid process of the fifth
            pieces.append(round_cone((24, 34, 9), (12, 38, 6), 5.5, 3.5))
        parts[f"metatarsal_{i + 1}"] = union(*pieces, blend=5)
    sesamoids = [ellipsoid((96, y, -7.5), (5.5, 4, 3.2)) for y in (-32.5, -21.5)]
    return parts | {f"sesamoid_{side}": shape for side, shape in zip(("medial", "lateral"), sesamoids, strict=True)}


def toes() -> dict[str, Shape]:
    """The phalanges."""
    return {name: shape for i in range(len(METATARSALS)) for name, shape in _toe(i).items()}


def toe_line(i: int) -> list[np.ndarray]:
    """Joints of toe `i`, 0 the great toe: base, joints and tip, each (3,)."""
    head = np.asarray(METATARSALS[i][1], float)
    if i == 0:
        return [head + np.array([7, -0.3, 0]), np.array([131.0, -25, -1.5]), np.array([153.0, -22.5, -6])]
    reach, aside = np.array([(31, 43, 53), (29, 40, 49), (27, 37, 45), (24, 32, 39)][i - 1]), -0.7 * i
    heights = (2.5, -4.0, -8.5)
    joints = [head + np.array([x, 0.06 * x * aside, z - 0.3 * i]) for x, z in zip(reach, heights, strict=True)]
    return [head + np.array([6.5, 0, 1.2]), *joints]


def _toe(i: int) -> dict[str, Shape]:
    line = toe_line(i)
    base, waist, knuckle, tip = ((8.2, 5.9, 7.6, 5.2), (4.8, 3.2, 4.4, 3.5), (4.6, 3.1, 4.2, 3.4), (4.4, 3.0, 4.0, 3.3),
                                 (4.1, 2.9, 3.7, 3.2))[i]  # fmt: skip
    names = ("proximal", "distal") if i == 0 else ("proximal", "middle", "distal")
    parts = {}
    for k, name in enumerate(names):
        a, b = line[k], line[k + 1]
        gap = (b - a) / np.linalg.norm(b - a)
        start, end = a + (0 if k == 0 else 0.62 * knuckle) * gap, b - 0.62 * knuckle * gap
        middle = (start + end) / 2
        first = base if k == 0 else 0.85 * knuckle
        last = 0.85 * knuckle if k < len(names) - 1 else tip
        end = b if k == len(names) - 1 else end
        parts[f"{name}_phalanx_{i + 1}"] = union(
            ellipsoid(start, (0.62 * first, first, 0.95 * first)),
            round_cone(start, middle, 0.8 * first, waist),
            round_cone(middle, end, waist, last),
            blend=4,
        )
    return parts


def leg() -> dict[str, Shape]:
    """Tibia with its malleolus and plafond, and fibula."""
    tibia = union(
        round_cone((-33, 0, 74), (-35, 0, 98), 20, 14),
        round_cone((-35, 0, 96), (-37, -1, KNEE + 30), 14, 12),
        round_cone((-31, -15, 75), (-31, -17.5, 53), 9, 6.3),
        blend=10,
    )
    tibia = cut(tibia, ellipsoid((-34, 2, 42), (22.5, 17, 19.6), 6), blend=4)
    fibula = union(
        round_cone((-40, 22.5, 44), (-41, 24, 66), 6.5, 8.5),
        round_cone((-41, 24, 66), (-42, 21, 100), 8.5, 6),
        round_cone((-42, 21, 98), (-43, 20, KNEE + 30), 6, 5.5),
        blend=7,
    )
    return {"tibia": sawn(tibia), "fibula": sawn(fibula)}


def sawn(shape: Shape, blend: float = 3.0) -> Shape:
    """The shape cut off under the knee, its edge rounded by about `blend` [mm]."""
    keep = below(KNEE)
    high = np.minimum(shape.high, (np.inf, np.inf, KNEE))
    inverse = Shape(lambda p: -keep.distance(p), keep.low, keep.high)
    return Shape(cut(shape, inverse, blend=blend).distance, shape.low, high)


def bones() -> dict[str, tuple[str, Shape]]:
    """Every bone by name: the segment that carries it, and its shape."""
    hind = {"calcaneus": calcaneus(), "talus": talus()}
    groups = (hind, {"navicular": navicular()}, cuneiforms(), metatarsals(), toes(), leg())
    return {n: (segment, shape) for segment, group in zip(SEGMENTS, groups, strict=False) for n, shape in group.items()}
