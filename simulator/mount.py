"""The arch under a leg (`mounted.py`) as MJCF, about the pose in which it stands: the numbers of mounted_arch.xml.

The tree is that of foot_arch.xml on a body of its own, the sole, which the fat pad carries; two equalities keep heel
and metatarsal heads on the sole. The load on the apex is an actuator of constant force, and each ligament has the
tension of the pose, so that the stepped model has the stiffness of the springs *and* of the load's geometry.
"""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import Array, arms, closing_angle, deformations, gradients
from fasbody.arch.lagrange import mass_matrix
from fasbody.arch.load import tangent
from fasbody.constants import MODEL_GRAVITY
from fasbody.exceptions import SimulationError
from mjcf import path
from simulator.mounted import FOOT_KG, SEATED_N, SHANK_KG, SHIPPED, THIGH_KG, TISSUE_KG, Mounted, pad, poses

#: Coordinates of `matrices`, in order.
COORDINATES = ("z_F", "z_T", "theta_2", "theta_3", "theta_4", "z_H", "z_A")
_STEP = 1e-30
_BONES = ("calcaneus_talus", "navicular", "cuneiforms", "metatarsals")
_JOINTS = ("spring_ligament", "short_plantar_ligament", "long_plantar_ligament")
#: Numbers of more digits than anybody means.
_LONG = re.compile(r"\d+\.\d{12,}(?:e-?\d+)?")


def pose(mounted: Mounted, arch: Arch, weight: float) -> Array:
    """Coordinates (6,) of the arch under a load [N].

    Raises:
        SimulationError: the arch collapses under it.
    """
    q, stands = poses(arch, np.array(weight), mounted.tissue)
    if not stands:
        raise SimulationError(f"the arch collapses under {weight:g} N.")
    return q


def matrices(
    mounted: Mounted = SHIPPED, arch: Arch | None = None, weight: float = SEATED_N, added_kg: float = 0.0
) -> tuple[Array, Array, Array, Array]:
    """Mass, damping and stiffness (7, 7) about the pose, and rows (2, 7) of malleolus and tuberosity.

    In the coordinates of `COORDINATES`. Dampers of the arch are `lag` times the stiffness of its tissue; `Mounted`
    takes `lag` times the whole stiffness, the load's geometry among it.

    Args:
        mounted: the leg.
        arch: the bones, None for `Arch.nominal()`.
        weight: on the arch [N].
        added_kg: on the knee.
    """
    arch = arch or Arch.nominal()
    q = pose(mounted, arch, weight)
    a, g, unit = arms(arch, q), gradients(arch, q), np.eye(7)
    apex = np.array([1, 0, -a.l_2, -a.l_3, -a.l_4, 0, 0])
    shank, flesh = apex + unit[1], FOOT_KG - arch.m_F
    M, C, K = np.zeros((7, 7)), np.zeros((7, 7)), np.zeros((7, 7))
    M[:5, :5] = mass_matrix(replace(arch, m_T=1e-12), q)[:5, :5]
    carried = (
        (flesh * (1 - mounted.up), unit[0]), (flesh * mounted.up + SHANK_KG * mounted.share, apex),
        (SHANK_KG * (1 - mounted.share), shank), (THIGH_KG, shank + unit[5]), (TISSUE_KG + added_kg, shank + unit[6]),
    )  # fmt: skip
    for mass, row in carried:
        M += mass * np.outer(row, row)
    K[2:5, 2:5] = -tangent(arch, q, weight, mounted.tissue)
    for (_, k, _), slope in zip(_ligaments(mounted, arch, q), (g.d_2, g.d_3, g.d_4), strict=True):
        C[:5, :5] += mounted.lag * k * np.outer(slope[:5], slope[:5])
    k_11 = float(mounted.tissue.tangent(deformations(arch, q).e))
    C[:5, :5] += mounted.lag * k_11 * np.outer(g.e[:5], g.e[:5])
    m = mounted
    for i, k, c in ((0, pad(m.k_F, weight), m.c_F), (1, m.k_T, m.c_T), (5, m.k_H, m.c_H), (6, m.k_A, m.c_A)):
        K[i, i] += k
        C[i, i] += c
    return M, C, K, np.stack([apex, shank])


def response(frequency_hz: Array, mass: Array, damping: Array, stiffness: Array, rows: Array) -> Array:
    """Accelerations (r, f) of rows (r, 7) over that of the table, from the matrices (7, 7), at (f,) [Hz]."""
    s = 2j * np.pi * np.asarray(frequency_hz, float).reshape(-1, 1, 1)
    push = np.broadcast_to(-mass[:, :1], (s.shape[0], len(mass), 1))  # the first coordinate moves all as the table does
    x = np.linalg.solve(s**2 * mass + s * damping + stiffness, push)[..., 0]
    ratios: Array = (1 + s[:, 0] ** 2 * (x @ rows.T)).T
    return ratios


def _ligaments(mounted: Mounted, arch: Arch, q: Array) -> list[tuple[float, float, float]]:
    """Moment [N m], stiffness [N m/rad] and where its spring is at rest [rad from the pose], of the three joints."""
    d, ligaments = deformations(arch, q), []
    for joint, turn in ((2, d.d_2), (3, d.d_3), (4, d.d_4)):
        moment = float(mounted.tissue.moment(joint, turn))
        k = float(mounted.tissue.moment(joint, turn + 1j * _STEP).imag / _STEP)
        ligaments.append((moment, k, -moment / k))
    return ligaments


def mjcf(
    mounted: Mounted = SHIPPED, arch: Arch | None = None, weight: float | None = None, added_kg: float = 0.0
) -> str:
    """The model as MJCF: mounted_arch.xml with the numbers of another leg or load.

    Args:
        mounted: the leg.
        arch: the bones, None for `Arch.nominal()`.
        weight: on the arch [N]; None for a seated leg with what is added.
        added_kg: on the knee.
    """
    weight = float(SEATED_N + MODEL_GRAVITY * added_kg if weight is None else weight)
    arch, m = arch or Arch.nominal(), mounted
    q = pose(m, arch, weight)
    a, e, theta_1 = arms(arch, q), deformations(arch, q).e, float(closing_angle(arch, q))
    behind, front = float(-arch.L_1 * np.sin(theta_1)), float(a.l_2 + a.l_3 + a.l_4)
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    root = ElementTree.parse(path("mounted_arch"), parser).getroot()
    named = {(element.tag, element.get("name")): element for element in root.iter() if element.get("name")}
    flesh = FOOT_KG - arch.m_F
    masses = {
        "sole": flesh * (1 - m.up), "apex": flesh * m.up + SHANK_KG * m.share, "shank": SHANK_KG * (1 - m.share),
        "thigh": THIGH_KG, "tissue": TISSUE_KG, "load": added_kg,
    }  # fmt: skip
    for body, mass in masses.items():
        _inertial(named["body", body]).set("mass", repr(float(mass)))
    springs = {
        "fat_pad": (pad(m.k_F, weight), m.c_F), "talocrural": (m.k_T, m.c_T), "thigh": (m.k_H, m.c_H),
        "tissue": (m.k_A, m.c_A),
    }  # fmt: skip
    for joint, (k, c) in springs.items():
        damper = {"damping": repr(float(c)), "user": f"4.25 {float(c)!r} 0 0"}  # each stands twice, for two engines
        named["joint", joint].attrib |= {"stiffness": repr(float(k))} | damper
    named["body", "apex"].set("pos", _upwards(float(a.E_2)))
    named["site", "heel_ground"].set("pos", f"{behind!r} -1000 0")
    named["site", "heads_ground"].set("pos", f"{front!r} -1000 0")
    named["general", "weight"].set("biasprm", f"-{weight!r} 0 0")
    angles = (theta_1, *map(float, q[2:5]))
    turns = (-theta_1, theta_1 + angles[1], angles[2] - angles[1], angles[3] - angles[2])
    for i, (bone, turn) in enumerate(zip(_BONES, turns, strict=True), 1):
        mass, L, inertia = (getattr(arch, f"{what}_{i}") for what in "mLI")
        link = named["body", bone]
        link.set("euler", f"0 0 {turn!r}")
        if i > 2:
            link.set("pos", _upwards(-getattr(arch, f"L_{i - 1}")))
        moments = " ".join([repr(inertia)] * 3)
        _inertial(link).attrib |= {"pos": _upwards(-L / 2), "mass": repr(mass), "diaginertia": moments}
        named["geom", bone].set("fromto", f"0 0 0 {_upwards(-L)}")
    for site, L in (("heel", arch.L_1), ("heads", arch.L_4)):
        named["site", site].set("pos", _upwards(-L))
    for joint, (_, k, ref) in zip(_JOINTS, _ligaments(m, arch, q), strict=True):
        numbers = {"stiffness": k, "springref": ref, "damping": float(m.lag * k)}
        named["joint", joint].attrib |= {name: repr(value) for name, value in numbers.items()}
    tension, k_11 = float(m.tissue.tension(e)), float(m.tissue.tangent(e))
    if k_11 > 0:
        numbers = {"stiffness": k_11, "springlength": front - behind - tension / k_11, "damping": float(m.lag * k_11)}
        spring = {name: repr(value) for name, value in numbers.items()}
        (tendons,) = root.findall("tendon")
        fascia = ElementTree.SubElement(tendons, "spatial", {"name": "plantar_aponeurosis"} | spring)
        for site in ("heel", "heads"):
            ElementTree.SubElement(fascia, "site", site=site)
    about = next(element for element in root if element.tag is ElementTree.Comment)
    about.text = (about.text or "").replace(f"under\n       {SEATED_N!r} N", f"under\n       {weight!r} N")
    return _rounded(ElementTree.tostring(root, encoding="unicode") + "\n")


def _rounded(text: str) -> str:
    """Numbers with twelve digits: the last ones hang on the processor."""
    return _LONG.sub(lambda number: repr(float(f"{float(number[0]):.12g}")), text)


def _inertial(body: ElementTree.Element) -> ElementTree.Element:
    (inertial,) = body.findall("inertial")
    return inertial


def _upwards(y: float) -> str:
    return f"0 {float(y)!r} 0"
