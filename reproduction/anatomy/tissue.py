"""The soft parts as shapes: fat pads under heel and forefoot, aponeurosis, skin. Frame and units of bones.py."""

import numpy as np

from reproduction.anatomy.bones import KNEE, sawn, toe_line
from reproduction.anatomy.field import Shape, above, below, cut, ellipsoid, inflated, round_cone, union
from viz.anatomy.rest import METATARSALS, TABLE

#: The aponeurosis is made this much thicker than it is and flattened afterwards, so that the mesher sees a body.
FLATNESS = 3.5


def _not(shape: Shape) -> Shape:
    return Shape(lambda p: -shape.distance(p), shape.low, shape.high)


def standing(shape: Shape, gap: float = 0.0, blend: float = 7.0) -> Shape:
    """The shape flattened on the table."""
    floor = TABLE + gap
    low = np.maximum(shape.low, (-np.inf, -np.inf, floor))
    return Shape(cut(shape, _not(above(floor)), blend=blend).distance, low, shape.high)


def heel_pad(calcaneus: Shape) -> Shape:
    """Fat pad between calcaneus and table."""
    cushion = union(ellipsoid((-71, 5, -5), (27, 25, 17)), ellipsoid((-58, 5, -10), (28, 22, 12)), blend=10)
    cushion = cut(cushion, inflated(calcaneus, 0.6), blend=3)
    top = Shape(cushion.distance, cushion.low, np.minimum(cushion.high, (np.inf, np.inf, 16)))
    return standing(cut(top, _not(below(9)), blend=8), 0.3)


def forefoot_pad() -> Shape:
    """Fat pad under the metatarsal heads."""
    heads = [np.asarray(m[1], float) for m in METATARSALS]
    cushion = union(*[ellipsoid((h[0] - 1, h[1], -11), (20 - i, 13, 11)) for i, h in enumerate(heads)], blend=12)
    return standing(cut(cushion, _not(below(-2.5)), blend=6), 0.3)


def aponeurosis() -> Shape:
    """Five slips from the calcaneal tubercle to the toes that are one band behind; `FLATNESS` times too thick."""
    slips = []
    for i, metatarsal in enumerate(METATARSALS):
        head, narrow = np.asarray(metatarsal[1], float), -1.0 + 2.0 * (i - 2)
        points = np.array([
            (-71, 1 + 0.3 * narrow, 0.5), (-60, 0.5 + 0.8 * narrow, -3.6), (-20, -1 + 1.5 * narrow, -4.6),
            (25, -1 + 0.45 * head[1] + 1.2 * narrow, -5.2), (60, -0.5 + 0.8 * head[1], -6.6),
            (head[0] - 8, head[1], -9.5), (head[0] + 7, head[1], -9.0), (head[0] + 14, head[1], -6.5),
        ])  # fmt: skip
        points[:, 2] *= FLATNESS
        radii = np.array([3.2, 4.6, 5.0, 5.2, 5.0, 4.4, 3.4, 2.0]) * (1.1 if i == 0 else 0.95)
        slips += [round_cone(a, b, r, s) for a, b, r, s in zip(points, points[1:], radii, radii[1:], strict=False)]
    return union(*slips, blend=4)


def skin() -> Shape:
    """The outside of foot and lower leg."""
    leg = round_cone((-37, 6, 66), (-39, 5, KNEE + 30), 27, 36)
    bodies = [
        leg,
        ellipsoid((-70, 5, -2), (29, 26, 19)),
        round_cone((-68, 5, 14), (-36, 5, 30), 24, 27),
        round_cone((-80, 5, 12), (-68, 5, 80), 12, 9),
        round_cone((-68, 5, 80), (-60, 5, KNEE + 30), 9, 15),
        round_cone((-34, 4, 44), (-31, 4, 74), 29, 29),
        round_cone((-26, 1, 48), (14, -4, 33), 27, 25),
        round_cone((14, -4, 33), (54, -12, 20), 24.5, 19.5),
        round_cone((10, 22, 10), (52, 24, 6), 20, 19),
        round_cone((-40, 14, 6), (30, 25, 1), 19, 18.5),
        round_cone((54, -13, 20), (97, -27, 1), 19, 17),
        round_cone((50, 20, 10), (84, 33, -2), 20, 15),
        round_cone((54, 2, 18), (98, 4, 1), 20, 16.5),
        round_cone((58, -6, 17), (103, -10, 1), 20, 16.5),
        round_cone((52, 14, 13), (92, 20, 0), 20, 16),
        ellipsoid((-33, -17, 57), (13, 11, 13)),
        ellipsoid((-40, 29, 50), (12, 9, 14)),
        ellipsoid((7, -26, 29), (16, 11.5, 14)),
    ]
    toes = []
    for i in range(5):
        line, r = toe_line(i), (12.6, 9.0, 8.6, 8.2, 8.2)[i]
        widths = np.linspace(1.25 * r, 0.86 * r, len(line))
        back = line[0] - (16, 0, -3)
        toes += [round_cone(back, line[0], 1.45 * r, 1.25 * r)]
        toes += [round_cone(a, b, p, q) for a, b, p, q in zip(line, line[1:], widths, widths[1:], strict=False)]
    whole = union(union(*bodies, blend=22), union(*toes, blend=7), blend=14)
    return sawn(standing(whole, blend=10), blend=9)
