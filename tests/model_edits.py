# ruff: noqa: E501 - the changes of an edit are read on one line
"""Edits of the shipped models as a modeller would make them, and what each must come to: one table, `EDITS`.

Every edit meets every way in which the project reads a model (`READERS`). Each either follows it, to the number that
an independent calculation gives, or refuses it in one sentence that names the element. The calculations are written
down here: masses in absolute coordinates for chains, the equations of the arch with constants that are stated here.
"""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from arch_copies import reshaped

import mjcf
from fasbody.arch.bones import Arch
from fasbody.arch.linear import transmissibility
from fasbody.exceptions import SimulationError
from fasbody.foot.hysteresis import cycle
from fasbody.foot.linear import Linear
from fasbody.foot.model import Foot, load
from fasbody.foot.shaker import harmonics
from fasbody.foot.simulate import simulate
from fasbody.foot.steady_state import Balance
from fasbody.foot.two_mass import orbits, parameters
from fasbody.leg.chain import Leg
from identification.engines.twin import SHANK as ON_SHANK
from identification.engines.twin import carriers
from simulator import mount
from simulator.mounted import SHANK_KG, SHIPPED
from viz.load import load_foot
from viz.motion import periodic_motion
from viz.settings import Settings

Array = np.ndarray
#: Table of all comparisons [Hz], and its acceleration [m/s^2]: so small that every law is what it is at rest.
HZ, PEAK = float(os.environ.get("EDITS_HZ", "20")), 0.02
S = 2j * np.pi * HZ
G = 9.81


@dataclass(frozen=True)
class Link:
    """One mass [kg] on the mass below it (-1: the table), by an impedance k + s c [N/m]; s at `HZ`."""

    mass: float
    on: int
    k: complex
    c: float = 0.0

    def z(self, s: complex) -> complex:
        return self.k + s * self.c


#: two_dof.xml and leg.xml, link by link from the table up; the load is one with the tissue.
FOOT, SHANK = Link(1.052265, -1, 1e5, 800), Link(3.374505, 0, 1.5e5, 430)
PAD, HINDFOOT, ANKLE = Link(1.05, -1, 1.633e5, 47.6), Link(0.695, 0, 1.669e5, 40.6), Link(2.705, 1, 1.162e4, 362)
THIGH, TISSUE = Link(2.06, 2, 2.792e4, 971), Link(0.2, 2, 7.043e4, 555)
LEG = (PAD, HINDFOOT, ANKLE, THIGH, TISSUE)


@dataclass(frozen=True)
class Truth:
    """What must come out.

    Attributes:
        T: malleolus over table, complex.
        pad: force of the fat pad per acceleration of the table [N s^2/m], complex, None where nobody asks.
        dissipated: in the pad's damper a cycle per squared acceleration of the table [J s^4/m^2], likewise.
        singular: how far s is from a natural frequency, zero at one; None likewise.
    """

    T: complex
    pad: complex | None = None
    dissipated: float | None = None
    singular: Callable[[complex], float] | None = None


def chain(*links: Link, at: int, pad: int = 0, more: tuple[tuple[int, int, complex], ...] = ()) -> Truth:
    """D y = f in absolute coordinates.

    Args:
        links: from the table up. at: mass of the malleolus. pad: link of the fat pad.
        more: impedances [N/m] at `HZ` between two masses besides (-1: the table, -2: the world).
    """

    def D(s: complex) -> tuple[Array, Array]:
        full = np.diag([0j] + [s**2 * link.mass for link in links])  # the table comes first
        for i, on, z in (*((i, link.on, link.z(s)) for i, link in enumerate(links)), *more):
            if on == -2:
                full[i + 1, i + 1] += z
                continue
            full[np.ix_([i + 1, on + 1], [i + 1, on + 1])] += z * np.array([[1, -1], [-1, 1]])
        return full[1:, 1:], -full[1:, 0]

    y = np.linalg.solve(*D(S))
    z, stretch = links[pad].z(S), (y[pad] - (y[links[pad].on] if links[pad].on >= 0 else 1)) / S**2

    def singular(s: complex) -> float:
        smallest = [np.linalg.svd(D(x)[0], compute_uv=False)[-1] for x in (s, 1.02 * s)]
        return float(smallest[0] / smallest[1])

    return Truth(complex(y[at]), z * stretch, np.pi * (z / S).real * abs(S) * abs(stretch) ** 2,
                 None if more else singular)  # fmt: skip


def arch(**constants: float) -> Truth:
    """The equations of the arch with some of the nominal constants changed."""
    return Truth(complex(transmissibility(replace(Arch.nominal(), **constants), np.array(HZ))))


# --- the ways in which a model is read --------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def _read(file: Path, text: str) -> Foot:
    return load(file)


def opened(file: Path) -> Foot:
    """The foot of a file, read once for all readers, which leave it as it is."""
    return _read(file, file.read_text())


@lru_cache(maxsize=1)
def _viewed(file: Path, text: str) -> Foot:
    return load_foot(str(file))


def _first(values: Array, step: float) -> complex:
    """First harmonic of what the last two periods are, by least squares: they need not be whole steps."""
    n = round(2 / HZ / step)
    turns = S * step * np.arange(len(values) - n, len(values))
    lines = [np.ones(n), *(part(np.exp(k * turns)) for k in (1, 2, 3) for part in (np.real, np.imag))]
    fitted = np.linalg.lstsq(np.stack(lines, axis=1), values[-n:], rcond=None)[0]
    return complex(fitted[1], -fitted[2])


def stepped(file: Path) -> dict[str, complex]:
    """`simulate`, from the pose of the file until the start has faded."""
    foot = opened(file)
    thigh = any(foot.model.joint(j).name == "thigh" for j in range(foot.model.njnt))
    if foot.step < 2e-4:  # an arch
        fading, step = 0.6 if thigh else 0.2, 1e-4  # a thigh on its seat goes on for long
    else:
        try:
            slowest = -Linear(foot).eigenvalues().real.max()
        except SimulationError:  # it rests nowhere, or touches there
            slowest = 0.0
        fading, step = 12 / max(slowest, 11.0), 5e-4
    run = simulate(foot, harmonics(HZ, [PEAK], fading + 2 / HZ), step=step)
    return {"T": _first(run.malleolus[0], step) / _first(run.base[0], step)}


def balanced(file: Path) -> dict[str, complex]:
    """Harmonic balance on the engine's inverse dynamics."""
    return {"T": complex(Balance(opened(file)).orbit(HZ, [PEAK]).harmonics()[0] / PEAK)}


def fitted(file: Path) -> dict[str, complex]:
    """The motion that a fit begins from: the two-mass foot in closed form where it is this model."""
    foot = opened(file)
    if carriers(foot).get("malleolus") != ON_SHANK:
        return balanced(file)
    found = orbits(parameters(foot.values())[None], np.array([2 * np.pi * HZ]), PEAK * np.eye(1, 6, dtype=complex))
    return {"T": complex(found.shank[0, 0] / PEAK)}


def energies(file: Path) -> dict[str, complex]:
    """What a fit says of the energy in the pad."""
    foot = opened(file)
    found = cycle(foot, HZ, [PEAK], foot.values(), carriers(foot).get("malleolus") == ON_SHANK)
    return {"dissipated": found.fat_pad.dissipated_j / PEAK**2}


def swings(file: Path) -> dict[str, complex]:
    """Natural frequencies that a fit reports."""
    return {"singular": Linear(opened(file)).eigenvalues()}


def drawn(file: Path) -> dict[str, complex]:
    """The curve of the viewer, of small motion."""
    foot = _viewed(file, file.read_text())
    return {"T": complex(Linear(foot).transmissibility(np.array([HZ]))[0])}


def shown(file: Path) -> dict[str, complex]:
    """The motion of the viewer, and its loop of the pad."""
    foot = _viewed(file, file.read_text())
    motion = periodic_motion(foot, Settings(frequency=HZ, peak_to_peak=2 * PEAK))
    found = {"T": complex(motion.ratio * np.exp(1j * np.radians(motion.phase)))}
    if "fat pad" in motion.loops:
        base, force = (2 / len(x) * np.fft.rfft(x)[1] for x in (motion.base, motion.loops["fat pad"][1]))
        found["pad"] = complex(force / base)
    return found


def as_leg(file: Path) -> dict[str, complex]:
    """`fasbody.leg`: the equations of a chain."""
    foot = opened(file)
    return {"T": complex(Leg.from_model(foot.model, foot.name).at("malleolus", np.array([HZ]))[0])}


def as_arch(file: Path) -> dict[str, complex]:
    """`fasbody.arch`: the equations of the five bodies."""
    return {"T": complex(transmissibility(Arch.read(file), np.array(HZ)))}


READERS: Mapping[str, Callable[[Path], dict[str, complex]]] = {
    "simulate": stepped, "balance": balanced, "fit": fitted, "energy": energies, "modes": swings, "curve": drawn, "viewer": shown,
    "leg": as_leg, "arch": as_arch,
}  # fmt: skip
#: What no edit of a model changes: it is a chain, or an arch.
NO_LEG = {"leg": "is not a slide along y|is not in the equations of a leg|several joints"}
NO_ARCH = {"arch": "there is no joint 'apex'|has gravity"}
NO_TREE = {"arch": "there is no tendon 'heel_pad'"}
USUAL = {"two_dof": NO_ARCH, "leg": NO_ARCH, "foot_arch": NO_LEG, "mounted_arch": NO_LEG | NO_TREE}
#: Readers of each model.
OF: Mapping[str, tuple[str, ...]] = {
    "two_dof": tuple(READERS), "leg": tuple(name for name in READERS if name != "energy"), "foot_arch": ("simulate", "balance", "fit", "curve", "viewer", "leg", "arch"),
    "mounted_arch": ("simulate", "balance", "fit", "curve", "viewer", "leg", "arch"),
}  # fmt: skip


@dataclass(frozen=True)
class Edit:
    """One edit.

    Attributes:
        model: shipped. says: for people. changes: (old, new) texts. truth: what must come out, None where every reader
            refuses it. refused: reader -> words of its refusal; "load" where all refuse it.
    """

    model: str
    says: str
    changes: tuple[tuple[str, str], ...]
    truth: Truth | None
    refused: Mapping[str, str]
    text: str = ""

    def write(self, folder: Path) -> Path:
        """The edited copy."""
        text = self.text or mjcf.text(self.model)
        for old, new in self.changes:
            assert old in text, old
            text = text.replace(old, new)
        file = folder / "copy.xml"
        file.write_text(text)
        return file


def _edit(model: str, says: str, *changes: tuple[str, str], truth: Truth | None = None, text: str = "",
          **refused: str) -> Edit:  # fmt: skip
    usual = USUAL[model]
    return Edit(model, says, changes, truth, refused if truth is None else {**usual, **refused}, text)


# two_dof.xml
FAT_PAD = 'name="fat_pad" stiffness="1.0e5" damping="800" user="4.25 800 -50 100"'
TALOCRURAL = 'name="talocrural" stiffness="1.5e5" damping="430"'
IN_FOOT = '<body name="foot" childclass="bone">'
BODY = '<body name="{0}"><joint name="{0}" stiffness="{1}" damping="{2}"/>'
BODY += '<inertial pos="0 0 0" mass="{3}" diaginertia="1e-3 1e-3 1e-3"/>'
SITE = '<site name="malleolus" pos="0 0.09 0.03" size="0.008" rgba="0.8 0.1 0.1 1"/>'
ACTUATORS, TENDONS = "  </actuator>", "  <actuator>"
HEAVY = ('gravity="0 0 0"', 'gravity="0 -9.81 0"')


def _relaxing(A: float, B: float, c: float, tau_1: float, tau_2: float, h: float, e0: float) -> complex:
    """Impedance of a pad of law 4.22 for small motion: its spectrum c/tau from tau_1 to tau_2, integrated by hand."""
    relaxed = A * B * np.exp(B * e0) / h
    return relaxed * (1 + c * np.log((1 + S * tau_2) / (1 + S * tau_1))) / (1 + c * np.log(tau_2 / tau_1))


def _sticking(mass: float) -> complex:
    """Impedance of a joint's dry friction that does not slip, by MuJoCo's defaults, between the table and a mass."""
    share, rate = 0.1 / 0.9 / mass, 2 / (0.95 * 0.02)  # (1 - d)/d of the inverse mass, and how fast it comes to rest
    return (S**2 + rate * S) / share


BOTH = ('<tendon><fixed name="both" stiffness="3e4" damping="20"{0}><joint joint="fat_pad" coef="1"/>'
        '<joint joint="talocrural" coef="1"/></fixed></tendon>')  # fmt: skip
TWO_DOF = (
    _edit("two_dof", "softer pad", ('"1.0e5"', '"8e4"'), truth=chain(replace(FOOT, k=8e4), SHANK, at=1)),
    _edit("two_dof", "stronger damper of the ankle", ('damping="430" user="4.25 430', 'damping="900" user="4.25 900'),
          truth=chain(FOOT, replace(SHANK, c=900), at=1)),
    _edit("two_dof", "a damper for fasbody alone", (TALOCRURAL, TALOCRURAL.replace(' damping="430"', "")),
          truth=chain(FOOT, SHANK, at=1)),
    _edit("two_dof", "a damping beside another law", ('damping="430"', 'damping="900"'), load="joint 'talocrural' has damping=900"),
    _edit("two_dof", "heavier foot", ('mass="1.052265"', 'mass="1.6"'), truth=chain(replace(FOOT, mass=1.6), SHANK, at=1)),
    _edit("two_dof", "a shoe, fixed to the foot",
          ('<body name="shank">', '<body name="shoe"><inertial pos="0 0 0" mass="0.4" diaginertia="1e-3 1e-3 1e-3"/>'
           '</body><body name="shank">'), truth=chain(replace(FOOT, mass=1.452265), SHANK, at=1)),
    _edit("two_dof", "a shoe of a geom",
          ('<body name="shank">', '<body name="shoe"><geom name="shoe" size="0.05" mass="0.4"/></body><body name="shank">'),
          truth=chain(replace(FOOT, mass=1.452265), SHANK, at=1)),
    _edit("two_dof", "a shoe of a dense geom in a class without mass",
          ('<body name="shank">', '<body name="shoe"><geom name="shoe" size="0.05" density="600"/></body><body name="shank">'),
          load="geom 'shoe' has the density 600, which counts for nothing, as its mass is written"),
    _edit("two_dof", "a density beside an inertial", ('<geom name="foot" ', '<geom name="foot" density="600" '),
          load="geom 'foot' has the density 600, which counts for nothing, as body 'foot' has an <inertial>"),
    _edit("two_dof", "a shoe of a geom as dense as water",
          ('<body name="shank">', '<body name="shoe">\n<!-- of leather -->\n<geom\nname="shoe" size="0.05" density="1000"/></body><body name="shank">'),
          load="geom 'shoe' has the density 1000, which counts for nothing, as its mass is written"),
    _edit("two_dof", "a shoe of a mass and a density",
          ('<body name="shank">', '<body name="shoe"><geom name="shoe" size="0.05" mass="0.4" density="600"/></body><body name="shank">'),
          load="geom 'shoe' has the density 600, which counts for nothing, as its mass is written, too: mass=\"0.4\""),
    _edit("two_dof", "the density of water beside an inertial", ('<geom name="foot" ', '<geom name="foot" density="1e3" '),
          load="geom 'foot' has the density 1000, which counts for nothing, as body 'foot' has an <inertial>"),
    _edit("two_dof", "masses by the geoms", ('angle="radian"', 'angle="radian" inertiafromgeom="true"'),
          ('<geom name="foot" ', '<geom name="foot" mass="1.6" '), truth=chain(replace(FOOT, mass=1.6), SHANK, at=1)),
    _edit("two_dof", "a total of all masses", ('angle="radian"', 'angle="radian" settotalmass="7"'), load="settotalmass"),
    _edit("two_dof", "a pad of cubic stiffness", (FAT_PAD, FAT_PAD.replace("1.0e5", "1.0e5 0 1e12")),
          truth=chain(FOOT, SHANK, at=1), leg="joint 'fat_pad' has a polynomial law"),
    _edit("two_dof", "an insole, a body of its own",
          (IN_FOOT, BODY.format("insole", 9e4, 70, 0.3) + IN_FOOT), ("  </worldbody>", "</body>  </worldbody>"),
          truth=chain(Link(0.3, -1, 9e4, 70), replace(FOOT, on=0), replace(SHANK, on=1), at=2, pad=1)),
    _edit("two_dof", "an insole of the table's class",
          (IN_FOOT, '<body name="insole" childclass="base"><joint name="insole" stiffness="9e4"/>'
           '<inertial pos="0 0 0" mass="0.3" diaginertia="1e-3 1e-3 1e-3"/>' + IN_FOOT),
          ("  </worldbody>", "</body>  </worldbody>"), load="joint 'insole' has the armature 1e.09"),
    _edit("two_dof", "calf on soft tissue", (SITE, SITE + BODY.format("calf", 2e4, 50, 1.0) + "</body>"),
          truth=chain(FOOT, SHANK, Link(1.0, 1, 2e4, 50), at=1)),
    _edit("two_dof", "another place of the malleolus' sensor", (SITE, ""),
          ('<site name="foot" ', SITE + '<site name="foot" '), truth=chain(FOOT, SHANK, at=0)),
    _edit("two_dof", "an accelerometer in place of framelinacc",
          ('<framelinacc name="malleolus" objtype="site" objname="malleolus"/>',
           '<accelerometer name="malleolus" site="malleolus"/>'), truth=chain(FOOT, SHANK, at=1)),
    _edit("two_dof", "armature at the ankle", (TALOCRURAL, TALOCRURAL + ' armature="0.5"'),
          truth=chain(FOOT, SHANK, at=1, more=((1, 0, S**2 * 0.5),)), leg="joint 'talocrural' has an armature"),
    _edit("two_dof", "a strap from table to shank",
          ("<body name=\"foot\"", '<site name="floor"/><body name="foot"'),
          (TENDONS, '<tendon><spatial name="strap" stiffness="3e4" damping="20"><site site="floor"/>'
           '<site site="top"/></spatial></tendon>' + TENDONS), (SITE, SITE + '<site name="top" pos="0 0.3 0"/>'),
          truth=chain(FOOT, SHANK, at=1, more=((1, -1, 3e4 + 20 * S),)), leg="tendon 'strap' is not in the equations"),
    _edit("two_dof", "a strap that is slack for 5 mm",
          ("<body name=\"foot\"", '<site name="floor"/><body name="foot"'),
          (TENDONS, '<tendon><spatial name="strap" stiffness="3e4" springlength="0.295 0.305"><site site="floor"/>'
           '<site site="top"/></spatial></tendon>' + TENDONS), (SITE, SITE + '<site name="top" pos="0 0.3 0"/>'),
          truth=chain(FOOT, SHANK, at=1), leg="tendon 'strap' is not in the equations"),
    _edit("two_dof", "a servo at the ankle",
          (ACTUATORS, '<general name="servo" joint="talocrural" gainprm="0" biastype="affine" biasprm="0 -5e4 -30"/>'
           + ACTUATORS), truth=chain(FOOT, SHANK, at=1, more=((1, 0, 5e4 + 30 * S),)),
          leg="actuator 'servo' is not in the equations"),
    _edit("two_dof", "a servo at the pad",
          (ACTUATORS, '<general name="servo" joint="fat_pad" gainprm="0" biastype="affine" biasprm="0 -5e4 -30"/>'
           + ACTUATORS), truth=replace(chain(replace(FOOT, k=1.5e5, c=830), SHANK, at=1), singular=None),
          leg="actuator 'servo' is not in the equations"),
    _edit("two_dof", "pad of law 4.24", (FAT_PAD, 'name="fat_pad" user="4.24 2000 80 0.02 0.3"'),
          truth=chain(Link(FOOT.mass, -1, 1e5, 80 * 0.3 / 0.02), SHANK, at=1)),
    _edit("two_dof", "pad of law 4.23", (FAT_PAD, 'name="fat_pad" user="4.23 900 1.5 50 0.9 1 0.02 0.2"'),
          truth=chain(Link(FOOT.mass, -1, 900 * 1.5 * 0.2**0.5 / 0.02, 50 * 0.2**0.9 / 0.02), SHANK, at=1)),
    _edit("two_dof", "pad of law 4.23 whose damper is not linear",
          (FAT_PAD, 'name="fat_pad" user="4.23 900 1.5 1 0.9 0.8 0.02 0.2"'), leg="'fat_pad' has the law 4.23 with n = 0.8"),
    _edit("two_dof", "pad of law 1, loaded by 43 N", (FAT_PAD, 'name="fat_pad" user="1 1.2e5 43 2.5 2 43 -1"'),
          truth=chain(Link(FOOT.mass, -1, 1.2e5, 86), SHANK, at=1)),
    _edit("two_dof", "pad of law 2, loaded by 43 N", (FAT_PAD, 'name="fat_pad" user="2 2e4 300 2 43 -1"'),
          truth=chain(Link(FOOT.mass, -1, 2e4 + 300 * 43, 86), SHANK, at=1)),
    _edit("two_dof", "pad of law 4.22, which relaxes", (FAT_PAD, 'name="fat_pad"'),
          (ACTUATORS, '<general name="gel" joint="fat_pad" dyntype="user" actdim="8" gainprm="0" biastype="user" '
           'biasprm="4.22 400 5 0.8 0.004 1.5 0.02 0.2"/>' + ACTUATORS),
          *((line, "") for line in mjcf.text("two_dof").splitlines() if '<text name="c_2' in line
            or '<text name="k_F"' in line),
          truth=replace(chain(Link(FOOT.mass, -1, _relaxing(400, 5, 0.8, 0.004, 1.5, 0.02, 0.2)), SHANK, at=1),
                        singular=None), leg="actuator 'gel' is not in the equations"),
    _edit("two_dof", "a spring that stiffens, polynomial", (FAT_PAD, FAT_PAD.replace("1.0e5", "1.0e5 2e7 3e9")),
          truth=chain(FOOT, SHANK, at=1), leg="joint 'fat_pad' has a polynomial law"),
    _edit("two_dof", "a damper that is a polynomial",
          (TALOCRURAL + ' user="4.25 430 50 100"', TALOCRURAL.replace('"430"', '"430 300"')),
          truth=chain(FOOT, SHANK, at=1), leg="joint 'talocrural' has a polynomial law"),
    _edit("two_dof", "gravity", HEAVY, (FAT_PAD, 'name="fat_pad" stiffness="1.0e5" damping="800"'),
          (' user="4.25 430 50 100"', ""), truth=chain(FOOT, SHANK, at=1)),
    _edit("two_dof", "gravity on dampers that know where they stand", HEAVY,
          truth=chain(replace(FOOT, c=800 * np.exp(-50 * (x := (FOOT.mass + SHANK.mass) * G / 1e5)) * np.cos(100 * x)),
                      replace(SHANK, c=430 * np.exp(50 * (x := SHANK.mass * G / 1.5e5)) * np.cos(100 * x)), at=1),
          leg="gravity"),
    _edit("two_dof", "a stop of the pad at 3 mm", (FAT_PAD, FAT_PAD + ' range="-0.003 0.003"'),
          truth=chain(FOOT, SHANK, at=1), leg="joint 'fat_pad' has a limit"),
    _edit("two_dof", "a spring whose rest is elsewhere", (TALOCRURAL, TALOCRURAL + ' springref="0.001"'),
          (' user="4.25 430 50 100"', ""),
          truth=chain(FOOT, SHANK, at=1), leg="joint 'talocrural' has a springref"),
    _edit("two_dof", "up is z", *((f'pos="0 {y} 0"', f'pos="0 0 {y}"') for y in ("-0.03", "0.04", "0.25")),
          ('axis="0 1 0"', 'axis="0 0 1"'), truth=chain(FOOT, SHANK, at=1),
          viewer="is drawn with y up", curve="is drawn with y up", leg="is not a slide along y"),
    _edit("two_dof", "only the base goes up", ('<joint name="base" class="base"/>', '<joint name="base" class="base" '
          'axis="0 0 1"/>'), load="joint 'base' moves along 0 0 1"),
    _edit("two_dof", "negative stiffness", ('"1.0e5"', '"-1e5"'), load="joint 'fat_pad' has the stiffness -100000"),
    _edit("two_dof", "a law without numbers", ("4.25 430 50 100", "4.25"), load="joint 'talocrural' names the law 4.25"),
    _edit("two_dof", "an unknown law", ("4.25 430 50 100", "4.35 430"), load="joint 'talocrural' names the law 4.35"),
    _edit("two_dof", "fewer numbers a law", ('nuser_jnt="8"', 'nuser_jnt="4"'), load="joint user fields have 4 numbers"),
    _edit("two_dof", "a lighter table", ('armature="1e9"', 'armature="1e8"'), load="the shaker has gear 1e.09"),
    _edit("two_dof", "no sensor", ('<framelinacc name="malleolus" objtype="site" objname="malleolus"/>', ""),
          load="there is no sensor 'malleolus'"),
    _edit("two_dof", "a parameter of a joint that is gone", ("joint fat_pad stiffness", "joint pad stiffness"),
          load="parameter 'k_F': unknown joint 'pad'"),
    _edit("two_dof", "a parameter in an unknown unit", ("N/m | 1e4", "kN/m | 1e4"), load="parameter 'k_T' has the unit"),
    _edit("two_dof", "springs switched off", ('gravity="0 0 0"/>', 'gravity="0 0 0"><flag spring="disable"/></option>'),
          load='<flag spring="disable"/>'),
    _edit("two_dof", "gravity switched off", ('gravity="0 0 0"/>', 'gravity="0 -9.81 0"><flag gravity="disable"/></option>'),
          load='<flag gravity="disable"/>'),
    _edit("two_dof", "a shaker of little range", ('biasprm="1"/>', 'biasprm="1" ctrllimited="true" ctrlrange="-1 1"/>'),
          load="actuator 'shaker' has a range"),
    _edit("two_dof", "a shaker of little force", ('biasprm="1"/>', 'biasprm="1" forcelimited="true" forcerange="-1 1"/>'),
          load="actuator 'shaker' has a range"),
    _edit("two_dof", "the shaker's group is off",
          ('gravity="0 0 0"/>', 'gravity="0 0 0" actuatorgroupdisable="0"/>'), load="actuator 'shaker' is switched off"),
    _edit("two_dof", "base sensed on the foot", ('objname="base"/>', 'objname="foot"/>'), load="sensor 'base' sits on 'foot'"),
    _edit("two_dof", "malleolus sensed elsewhere", ('<framelinacc name="malleolus" objtype="site" objname="malleolus"/>',
          '<framelinacc name="malleolus" objtype="site" objname="foot"/>'), load="sensor 'malleolus' sits on 'foot'"),
    _edit("two_dof", "a ball joint", (TALOCRURAL, '<joint name="tilt" type="ball"/><joint ' + TALOCRURAL),
          ("<joint <joint", "<joint"), load="joint 'tilt'"),
    _edit("two_dof", "an implicit integrator", ("RK4", "implicitfast"), load="sensor 'malleolus_velocity'"),
    _edit("two_dof", "a mass where an inertial rules", ('<geom name="foot" ', '<geom name="foot" mass="2" '),
          load="geom 'foot'"),
    _edit("two_dof", "one parameter, two numbers", ("joint fat_pad stiffness |", "joint fat_pad stiffness, joint talocrural stiffness |"),
          load="parameter 'k_F'"),
    _edit("two_dof", "a spring that yields", (FAT_PAD, FAT_PAD + ' springyield="0.01"'), load="joint 'fat_pad' .* 'springyield'"),
    _edit("two_dof", "a servo's damper at the pad", (ACTUATORS, '<general name="servo" joint="fat_pad" gainprm="0" damping="50"/>' + ACTUATORS),
          load="actuator 'servo' .* 'damping'"),
    _edit("two_dof", "a servo's armature at the pad", (ACTUATORS, '<general name="servo" joint="fat_pad" gainprm="0" armature="0.5"/>' + ACTUATORS),
          truth=replace(chain(FOOT, SHANK, at=1, more=((0, -1, S**2 * 0.5),)), pad=None, dissipated=None),
          leg="actuator 'servo' is not in the equations"),
    _edit("two_dof", "oil about it", ('gravity="0 0 0"', 'gravity="0 0 0" viscosity="1e-9"'), truth=chain(FOOT, SHANK, at=1),
          leg="viscosity"),
    _edit("two_dof", "a shank that floats", HEAVY, ('<body name="shank">', '<body name="shank" gravcomp="1">'),
          truth=chain(replace(FOOT, c=800 * np.exp(-50 * (x := FOOT.mass * G / 1e5)) * np.cos(100 * x)), SHANK, at=1),
          leg="gravity"),
    _edit("two_dof", "no body lighter than 2 kg", ('angle="radian"', 'angle="radian" boundmass="2"'),
          load="body 'base' has the mass 1, and <compiler boundmass> makes it 2"),
    _edit("two_dof", "a shank welded to the foot",
          (TENDONS, '<equality><weld name="weld" body1="shank" body2="foot" solref="-1e7 -1e4" solimp="0.9999 0.9999 0.001"/>'
           '</equality>' + TENDONS), truth=replace(chain(replace(FOOT, mass=FOOT.mass + SHANK.mass), at=0), singular=None),
          leg="equality 'weld'"),
    _edit("two_dof", "a fixed tendon along both joints", (TENDONS, BOTH.format("") + TENDONS),
          truth=chain(FOOT, SHANK, at=1, more=((1, -1, 3e4 + 20 * S),)), leg="tendon 'both'"),
    _edit("two_dof", "a fixed tendon with an armature", (TENDONS, BOTH.format(' armature="0.5"') + TENDONS),
          truth=chain(FOOT, SHANK, at=1, more=((1, -1, 3e4 + 20 * S + 0.5 * S**2),)), leg="tendon 'both'"),
    _edit("two_dof", "a position servo before the shaker", (TENDONS, TENDONS + '<position name="servo" joint="talocrural" kp="5e4" kv="30"/>'),
          truth=chain(FOOT, SHANK, at=1, more=((1, 0, 5e4 + 30 * S),)), leg="actuator 'servo'"),
    _edit("two_dof", "a position servo with a filter", (ACTUATORS, '<position name="servo" joint="talocrural" kp="5e4" timeconst="0.02"/>' + ACTUATORS),
          truth=replace(chain(FOOT, SHANK, at=1, more=((1, 0, 5e4),)), singular=None), leg="actuator 'servo'"),
    _edit("two_dof", "a velocity servo", (ACTUATORS, '<velocity name="servo" joint="talocrural" kv="30"/>' + ACTUATORS),
          truth=chain(FOOT, SHANK, at=1, more=((1, 0, 30 * S),)), leg="actuator 'servo'"),
    _edit("two_dof", "a servo with a gear", (ACTUATORS, '<general name="servo" joint="talocrural" gear="2" gainprm="0" biastype="affine" '
          'biasprm="0 -1e4 0"/>' + ACTUATORS), truth=chain(FOOT, SHANK, at=1, more=((1, 0, 4e4),)), leg="actuator 'servo'"),
    _edit("two_dof", "a damper without a control", (ACTUATORS, '<damper name="servo" joint="talocrural" kv="30" ctrlrange="0 1"/>' + ACTUATORS),
          truth=chain(FOOT, SHANK, at=1), leg="actuator 'servo'"),
    _edit("two_dof", "30 N on the shank", (ACTUATORS, '<general name="push" joint="talocrural" gainprm="0" biastype="affine" '
          'biasprm="-30 0 0"/>' + ACTUATORS), truth=chain(FOOT, replace(SHANK, c=430 * np.exp(50 * 2e-4) * np.cos(100 * 2e-4)), at=1),
          leg="actuator 'push'"),
    _edit("two_dof", "slanting gravity", ('gravity="0 0 0"', 'gravity="1 -9.81 2"'), (' user="4.25 800 -50 100"', ""),
          (' user="4.25 430 50 100"', ""), truth=chain(FOOT, SHANK, at=1)),
    _edit("two_dof", "a spring and damper by time and ratio", (TALOCRURAL, 'name="talocrural" springdamper="0.05 1"'),
          load="joint 'talocrural' has damping="),
    _edit("two_dof", "an armature at the pad", (FAT_PAD, FAT_PAD + ' armature="0.5"'),
          truth=replace(chain(FOOT, SHANK, at=1, more=((0, -1, S**2 * 0.5),)), pad=None, dissipated=None), leg="joint 'fat_pad' has an armature"),
    _edit("two_dof", "an axis of two in place of one", (FAT_PAD, FAT_PAD + ' axis="0 2 0"'), truth=chain(FOOT, SHANK, at=1)),
    _edit("two_dof", "a pad whose axis points down", (FAT_PAD, FAT_PAD + ' axis="0 -1 0"'),
          truth=replace(chain(FOOT, SHANK, at=1), pad=None), leg="joint 'fat_pad' is not a slide along y"),
    _edit("two_dof", "a turned frame in place of none", (IN_FOOT, '<frame euler="0 0.5 0">' + IN_FOOT),
          ("    </body>\n  </worldbody>", "    </frame></body>\n  </worldbody>"), truth=chain(FOOT, SHANK, at=1)),
    _edit("two_dof", "springs of a class, the table's too", ('<joint type="slide" axis="0 1 0"/>', '<joint type="slide" axis="0 1 0" stiffness="5"/>'),
          load="joint 'base' has the attribute 'stiffness'"),
    _edit("two_dof", "a sole that may touch, contacts off", ('<geom name="foot" ', '<geom name="foot" contype="1" conaffinity="1" '),
          ('<geom name="table" class="base"', '<geom name="table" class="base" contype="1" conaffinity="1"'),
          ('gravity="0 0 0"/>', 'gravity="0 0 0"><flag contact="disable"/></option>'), truth=chain(FOOT, SHANK, at=1), leg="can touch"),
    _edit("two_dof", "a stop that is switched off", (FAT_PAD, FAT_PAD + ' range="-1e-6 1e-6"'),
          ('gravity="0 0 0"/>', 'gravity="0 0 0"><flag limit="disable"/></option>'), truth=chain(FOOT, SHANK, at=1),
          leg="joint 'fat_pad' has a limit"),
    _edit("two_dof", "a pad with dry friction", (FAT_PAD, FAT_PAD + ' frictionloss="1"'),
          truth=replace(chain(FOOT, SHANK, at=1, more=((0, -1, _sticking(FOOT.mass)),)), pad=None, dissipated=None),
          leg="joint 'fat_pad' has dry friction"),
    _edit("two_dof", "a site that is nowhere", ('pos="0 0.09 0.03"', 'pos="0 nan 0.03"'), load="site 'malleolus' has something"),
    _edit("two_dof", "a step that is no number", ('timestep="5e-4"', 'timestep="nan"'), load="timestep"),
)  # fmt: skip

# leg.xml
LOAD = '<inertial pos="0 0.6 0" mass="0" diaginertia="0 0 0"/>'
IN_LEG = '<site name="tuberosity"'
TUBEROSITY = '<site name="tuberosity" pos="0.03 0.39 0" size="0.008" rgba="0.8 0.1 0.1 1"/>'
SENSOR, TABLE = '<framelinacc name="malleolus"', '<joint name="base" class="base"'
LEGS = (
    _edit("leg", "stiffer ankle", ('"1.162e4"', '"2e4"'),
          truth=chain(PAD, HINDFOOT, replace(ANKLE, k=2e4), THIGH, TISSUE, at=1)),
    _edit("leg", "heavier thigh", ('mass="2.06"', 'mass="3"'),
          truth=chain(PAD, HINDFOOT, ANKLE, replace(THIGH, mass=3.0), TISSUE, at=1)),
    _edit("leg", "a brace on the shank", (IN_LEG, BODY.format("brace", 5e4, 30, 0.5) + "</body>" + IN_LEG),
          truth=chain(*LEG, Link(0.5, 2, 5e4, 30), at=1)),
    _edit("leg", "an insole", (IN_FOOT, BODY.format("insole", 9e4, 70, 0.3) + IN_FOOT),
          ("  </worldbody>", "</body>  </worldbody>"),
          truth=chain(Link(0.3, -1, 9e4, 70), *(replace(x, on=x.on + 1) for x in LEG), at=2, pad=1)),
    _edit("leg", "gravity", HEAVY, truth=chain(*LEG, at=1)),
    _edit("leg", "gravity on a pad of law 4.24", HEAVY,
          ('name="fat_pad" stiffness="1.633e5" damping="47.6"', 'name="fat_pad" user="4.24 3000 60 0.02 0.3"'),
          *((line, "") for line in mjcf.text("leg").splitlines() if '<text name="k_F"' in line
            or '<text name="c_F"' in line),
          truth=chain(Link(1.05, -1, 1.5e5, 3000 * (0.3 + (x := sum(m.mass for m in LEG) * G / 3000)) * 60 / 3000 / 0.02),
                      *LEG[1:], at=1), leg="gravity"),
    _edit("leg", "a stop of the thigh", ('name="thigh" stiffness', 'name="thigh" range="-0.02 0.02" stiffness'),
          truth=chain(*LEG, at=1), leg="joint 'thigh' has a limit"),
    _edit("leg", "springs that stiffen", ('name="tissue" stiffness="7.043e4', 'name="tissue" stiffness="7.043e4 1e7'),
          truth=chain(*LEG, at=1), leg="joint 'tissue' has a polynomial"),
    _edit("leg", "a servo at the knee", (ACTUATORS, '<general name="servo" joint="thigh" gainprm="0" biastype="affine" '
          'biasprm="0 -1e4 0"/>' + ACTUATORS), truth=chain(*LEG, at=1, more=((3, 2, 1e4),)), leg="actuator 'servo'"),
    _edit("leg", "a law of the thigh's damper in place of none", ('name="thigh" stiffness="2.792e4" damping="971"',
          'name="thigh" stiffness="2.792e4" damping="971" user="4.25 971 5 20"'), truth=chain(*LEG, at=1)),
    _edit("leg", "added mass at two places", ("body load mass |", "body load mass, body tissue mass |"), load="added_mass must stand at one place"),
    _edit("leg", "armature", ('name="thigh" stiffness', 'name="thigh" armature="1" stiffness'),
          truth=chain(*LEG, at=1, more=((3, 2, S**2),)), leg="joint 'thigh' has an armature"),
    _edit("leg", "a sideways thigh", ('name="thigh" stiffness', 'name="thigh" axis="1 0 0" stiffness'),
          truth=chain(PAD, HINDFOOT, replace(ANKLE, mass=ANKLE.mass + 2.06), replace(TISSUE, on=2), at=1),
          leg="joint 'thigh' is not a slide along y"),
    _edit("leg", "under water", ('gravity="0 0 0"', 'gravity="0 0 0" density="1e3"'),
          truth=chain(*LEG, at=1), leg="density"),
    _edit("leg", "geoms that touch", ("  <actuator>", '<contact><pair geom1="foot" geom2="load"/></contact>  <actuator>'),
          truth=chain(*LEG, at=1), leg="can touch"),
    _edit("leg", "a joint tied to another", ("  <actuator>", '<equality><joint name="tied" joint1="thigh" joint2="tissue" '
          'solref="-1e6 -1e3" solimp="0.9999 0.9999 0.001"/></equality>  <actuator>'),
          truth=replace(chain(PAD, HINDFOOT, ANKLE, Link(2.26, 2, 9.835e4, 1526), at=1), singular=None),
          leg="equality 'tied'"),
    _edit("leg", "two joints of one body", ('<joint name="hindfoot"', '<joint name="more" stiffness="1e6" armature="0.5"/><joint name="hindfoot"'),
          truth=replace(chain(PAD, Link(0.695, 0, 1 / (1 / (1e6 + 0.5 * S**2) + 1 / HINDFOOT.z(S))), *LEG[2:], at=1),
                        singular=None), leg="'malleolus' has several joints"),
    _edit("leg", "added mass and m_S", ('name="m_K"', 'name="m_S"'), load="declares added_mass and m_S"),
    _edit("leg", "added mass in the place of the thigh", ("body load mass", "body thigh mass"), load="added_mass"),
    _edit("leg", "added mass on the table", ("body load mass", "body base mass"), load="added_mass"),
    _edit("leg", "added mass that is none", ("body load mass", "joint thigh damping"), load="added_mass"),
    _edit("leg", "dry friction", ('name="thigh" stiffness', 'name="thigh" frictionloss="1" stiffness'), truth=None,
          leg="joint 'thigh' has dry friction"),
    _edit("leg", "4.5 kg on the knee", (LOAD, '<inertial pos="0 0.6 0" mass="4.5" diaginertia="1e-3 1e-3 1e-3"/>'),
          truth=chain(*LEG[:4], replace(TISSUE, mass=4.7), at=1)),
    _edit("leg", "a mass beside the table", ("  </worldbody>", BODY.format("post", 1e4, 20, 1) + "</body>  </worldbody>"),
          truth=replace(chain(*LEG, at=1), singular=None), leg="body 'post' does not stand on the table"),
    _edit("leg", "a tuberosity that stands still", (TUBEROSITY, ""), ("  </worldbody>", TUBEROSITY + "  </worldbody>"),
          truth=chain(*LEG, at=1), leg="site 'tuberosity' is on 'world'"),
    _edit("leg", "a tuberosity sensed at the knee", ('objname="tuberosity"/>', 'objname="malleolus"/>'), truth=chain(*LEG, at=1),
          leg="sensor 'tuberosity' sits on 'malleolus'"),
    _edit("leg", "a malleolus on the table", (SITE, ""), ('<site name="base"/>', '<site name="base"/>' + SITE),
          load="site 'malleolus' is on 'base'"),
    _edit("leg", "a camera in place of the malleolus' site", (SITE, SITE + '<camera name="eye"/>'),
          ('objtype="site" objname="malleolus"/>', 'objtype="camera" objname="eye"/>'), truth=chain(*LEG, at=1)),
    _edit("leg", "a ref without its springref", ('name="hindfoot" stiffness', 'name="hindfoot" ref="0.01" stiffness'),
          truth=chain(*LEG, at=1), leg="joint 'hindfoot' has a springref that is not its ref"),
    _edit("leg", "a ref and springref in place of zero", ('name="hindfoot" stiffness', 'name="hindfoot" ref="0.01" springref="0.01" stiffness'),
          truth=chain(*LEG, at=1)),
    _edit("leg", "a sensor that is cut off", (SENSOR, SENSOR + ' cutoff="0.005"'), load="sensor 'malleolus' .* 'cutoff'"),
    _edit("leg", "a sensor that is late", (SENSOR, SENSOR + ' delay="0.01" nsample="100"'), load="sensor 'malleolus' .* 'delay'"),
    _edit("leg", "a shaker that is late", ('name="shaker" joint', 'name="shaker" delay="0.01" nsample="100" joint'),
          load="actuator 'shaker' .* 'delay'"),
    _edit("leg", "a shaker with an armature", ('name="shaker" joint', 'name="shaker" armature="1e-9" joint'),
          load="actuator 'shaker' .* 'armature'"),
    _edit("leg", "a table of little force", (TABLE, TABLE + ' actuatorfrcrange="-1 1"'), load="joint 'base' .* 'actuatorfrcrange'"),
    _edit("leg", "a table tied to the world", (TENDONS, '<equality><joint name="tie" joint1="base"/></equality>' + TENDONS),
          load="equality 'tie' holds the table"),
    _edit("leg", "a table on a strap of its own weight", ("<worldbody>", '<worldbody><site name="floor" pos="0 -1 0"/>'),
          (TENDONS, '<tendon><spatial name="strap" stiffness="1e13"><site site="floor"/><site site="base"/></spatial></tendon>' + TENDONS),
          load="tendon 'strap' holds the table"),
    _edit("leg", "a table on a spring", (TABLE, TABLE + ' stiffness="1e14"'), load="joint 'base' .* 'stiffness'"),
    _edit("leg", "a table with a servo", (ACTUATORS, '<general name="servo" joint="base" gainprm="0" biastype="affine" '
          'biasprm="0 -1e13 0"/>' + ACTUATORS), load="actuator 'servo' acts on the joint 'base'"),
    _edit("leg", "a control that pushes by itself", ('name="shaker_a0" joint="base" gainprm="0"', 'name="shaker_a0" joint="base" gear="1e9"'),
          load="actuator 'shaker_a0' .* 'gainprm'"),
    _edit("leg", "bodies that sleep", ('gravity="0 0 0"/>', 'gravity="0 0 0"><flag sleep="enable"/></option>'), load='<flag sleep="enable"/>'),
)  # fmt: skip

# What a fresh pair of eyes brought.
SERVO = 'name="servo" joint="talocrural"'
#: Small motion of a shank whose height over the foot is 0.3 of the foot's, by an equality that yields next to nothing.
_D = S**2 * (FOOT.mass + 1.3**2 * SHANK.mass) + FOOT.z(S) + 0.3**2 * SHANK.z(S)
TIED = Truth(complex(1 - 1.3 * S**2 * (FOOT.mass + 1.3 * SHANK.mass) / _D))
GLUE = '<equality><weld name="glue" body1="base" body2="foot" solref="-2e4 -100" solimp="0.5 0.5 0.001"/></equality>'
LEVELS = '<site name="anchor" pos="0 0.05 0"/><site name="foot" '
BENT = ' user="4.25 430 50 100"'
SENSED = '<framelinacc name="malleolus" objtype="site" objname="malleolus"/>'
LEVEL = '<accelerometer name="malleolus" site="malleolus"/>'


IN_SHOE = (IN_FOOT, IN_FOOT + '<body name="shoe"><geom size="0.1"/></body>')
WHEEL = '<body name="wheel"><joint name="spin" type="hinge" axis="0 0 1"/><inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/></body><site name="foot" '
WALL = '<geom name="wall" type="box" size="0.01 0.3 0.1" pos="-0.11 0 0"/>'
HEEL = '<geom name="heel" type="sphere" size="0.04" pos="-0.06 0.02 0"/><site name="foot" '


def _glue() -> complex:
    """Impedance of a soft weld of the foot to the table: MuJoCo's inertia of a body is a mean of three axes."""
    share = 1 / (3 * FOOT.mass)  # times (1 - d)/d at d = 0.5
    return (S**2 + 100 / 0.5 * S + 2e4 / 0.5) / share


def _geared() -> complex:
    """Impedance of a tendon twice the pad and once the ankle that is tied fast, at solimp="0.9 0.9 0.001"."""
    weight = 1 / FOOT.mass + 1 / SHANK.mass  # J M^-1 J' of J = (2, 1)
    return (S**2 + 3e3 / 0.9 * S + 2e6 / 0.9) * 9 / weight


def _rubbing() -> complex:
    """Impedance of a heel on a wall that does not slip: friction by the defaults, at solimp="0.9 0.9 0.001"."""
    share = (1 / FOOT.mass + 1 / (FOOT.mass + SHANK.mass)) / 27  # a mean of three axes, one of which is held
    return (S**2 + 2 / (0.9 * 0.02) * S) / share


def _without(*parameters: str) -> tuple[tuple[str, str], ...]:
    lines = mjcf.text("two_dof").splitlines()
    return tuple((line + "\n", "") for line in lines if any(f'<text name="{name}"' in line for name in parameters))


def _loose(words: str) -> dict[str, str]:
    """What needs a pose of rest says these words."""
    return dict.fromkeys(("balance", "fit", "energy", "modes", "curve", "viewer"), words)


FRESH = (
    _edit("two_dof", "an ankle of a spatial tendon", (TALOCRURAL + BENT, 'name="talocrural"'), ('<site name="foot" ', LEVELS),
          (SITE, SITE + '<site name="top" pos="0.02 0.3 0"/>'),
          (TENDONS, '<tendon><spatial name="ankle" stiffness="1.5e5" damping="430"><site site="anchor"/><site site="top"/>'
           '</spatial></tendon>' + TENDONS), ("joint talocrural stiffness", "tendon ankle stiffness"), *_without("c_11", "c_12", "c_13"),
          truth=chain(FOOT, replace(SHANK, k=1.5e5 * (w := 0.25**2 / (0.25**2 + 0.02**2)), c=430 * w), at=1), leg="tendon 'ankle'"),
    _edit("two_dof", "a malleolus up and out in place of its own", ('pos="0 0.09 0.03"', 'pos="0.05 0.3 -0.1"'), truth=chain(FOOT, SHANK, at=1)),
    _edit("two_dof", "a keyframe of another pose in place of none", ("</mujoco>", '<keyframe><key qpos="0 0.01 -0.02" qvel="0 1 1"/></keyframe></mujoco>'),
          truth=chain(FOOT, SHANK, at=1)),
    _edit("two_dof", "a poor solver and a stop", ('integrator="RK4"', 'integrator="RK4" solver="CG" iterations="1" tolerance="1e-2" cone="elliptic"'),
          (FAT_PAD, FAT_PAD + ' range="-3e-4 3e-4" solreflimit="0.002 1"'), truth=chain(FOOT, SHANK, at=1), leg="joint 'fat_pad' has a limit"),
    _edit("two_dof", "a foot softly welded to the table", (TENDONS, GLUE + TENDONS),
          truth=replace(chain(FOOT, SHANK, at=1, more=((0, -1, _glue()),)), pad=None, dissipated=None, singular=None), leg="equality 'glue'"),
    _edit("two_dof", "a stiff equality that is quadratic", (TENDONS, '<equality><joint name="tie" joint1="talocrural" joint2="fat_pad" '
          'polycoef="0 0.3 50 0 0" solref="-1e7 -1e4" solimp="0.9999 0.9999 0.001"/></equality>' + TENDONS),
          truth=TIED, leg="equality 'tie'"),
    _edit("two_dof", "a rope from the world to the knee", (SITE, SITE + '<site name="top" pos="0 0.3 0"/>'),
          ("<worldbody>", '<worldbody><site name="ceiling" pos="0 1.3 0"/>'),
          (TENDONS, '<tendon><spatial name="rope" stiffness="3e4" damping="50"><site site="ceiling"/><site site="top"/></spatial></tendon>' + TENDONS),
          truth=replace(chain(FOOT, SHANK, at=1, more=((1, -2, 3e4 + 50 * S),)), singular=None), leg="tendon 'rope'"),
    _edit("two_dof", "a servo of a speed that is integrated", (ACTUATORS, f'<intvelocity {SERVO} kp="5e4" kv="30" actrange="-1 1"/>' + ACTUATORS),
          load="actuator 'servo' integrates its control"),
    _edit("two_dof", "a cylinder, which fills", (ACTUATORS, f'<cylinder {SERVO} timeconst="0.05" area="1" bias="0 -3e4 -20"/>' + ACTUATORS),
          truth=replace(chain(FOOT, SHANK, at=1, more=((1, 0, 3e4 + 20 * S),)), singular=None), leg="actuator 'servo'"),
    _edit("two_dof", "a servo whose controls leave out zero", (ACTUATORS, f'<position {SERVO} kp="5e4" kv="30" ctrlrange="1e-3 2e-3"/>' + ACTUATORS),
          truth=chain(FOOT, replace(SHANK, c=430 * np.exp(-50 * 2.5e-4) * np.cos(100 * 2.5e-4)), at=1, more=((1, 0, 5e4 + 30 * S),)),
          leg="actuator 'servo'"),
    _edit("two_dof", "a constant force whose number is that of a law",
          (ACTUATORS, f'<general {SERVO} gainprm="0" biastype="affine" biasprm="3 -3e4 -50"/>' + ACTUATORS),
          truth=chain(FOOT, replace(SHANK, c=430 * np.exp(-50 * (x := 3 / 1.8e5)) * np.cos(100 * x)), at=1,
                      more=((1, 0, 3e4 + 50 * S),)), leg="actuator 'servo'"),
    _edit("two_dof", "gravity upwards on dampers", ('gravity="0 0 0"', 'gravity="0 9.81 0"'),
          truth=chain(replace(FOOT, c=800 * np.exp(50 * (x := (FOOT.mass + SHANK.mass) * G / 1e5)) * np.cos(100 * x)),
                      replace(SHANK, c=430 * np.exp(-50 * (x := SHANK.mass * G / 1.5e5)) * np.cos(100 * x)), at=1), leg="gravity"),
    _edit("two_dof", "bodies fused, a shoe among them", ('angle="radian"', 'angle="radian" fusestatic="true"'),
          ('<body name="shank">', '<body name="shoe"><inertial pos="0 0 0" mass="0.4" diaginertia="1e-3 1e-3 1e-3"/></body><body name="shank">'),
          truth=chain(replace(FOOT, mass=1.452265), SHANK, at=1)),
    _edit("two_dof", "three toes, replicated", ('<body name="shank">', '<replicate count="3" offset="0.02 0 0"><body name="toe" pos="0.1 0 0">'
          '<joint name="toe" stiffness="2e4" damping="10"/><geom size="0.01" mass="0.05"/></body></replicate><body name="shank">'),
          truth=chain(FOOT, SHANK, *[Link(0.05, 0, 2e4, 10)] * 3, at=1)),
    _edit("two_dof", "dampers and armature of a class", ('<default class="bone">', '<default class="bone"><joint armature="0.2" damping="100"/>'),
          (FAT_PAD, 'name="fat_pad" stiffness="1.0e5"'), (TALOCRURAL + BENT, 'name="talocrural" stiffness="1.5e5"'), *_without("c_12", "c_13", "c_22", "c_23"),
          truth=replace(chain(replace(FOOT, c=100), replace(SHANK, c=100), at=1, more=((0, -1, 0.2 * S**2), (1, 0, 0.2 * S**2))), pad=None),
          leg="has an armature"),
    _edit("two_dof", "a damper of third power beside a law", ('damping="430" user', 'damping="430 0 1e4" user'), truth=chain(FOOT, SHANK, at=1),
          leg="joint 'talocrural' has a polynomial law"),
    _edit("two_dof", "dry friction switched off", (FAT_PAD, FAT_PAD + ' frictionloss="5"'),
          ('gravity="0 0 0"/>', 'gravity="0 0 0"><flag frictionloss="disable"/></option>'), truth=chain(FOOT, SHANK, at=1), leg="'fat_pad' has dry friction"),
    _edit("two_dof", "contacts that are excluded", ('contype="0" conaffinity="0" mass="0"', 'mass="0"'),
          (TENDONS, '<contact><exclude body1="base" body2="foot"/><exclude body1="foot" body2="shank"/></contact>' + TENDONS),
          truth=chain(FOOT, SHANK, at=1), leg="can touch"),
    _edit("two_dof", "sensors of other kinds in place of none", ("<sensor>", '<sensor><jointpos joint="fat_pad"/><clock/><gyro site="malleolus"/><e_kinetic/>'),
          truth=chain(FOOT, SHANK, at=1)),
    _edit("two_dof", "a servo of the shank's height, which stands too far", (ACTUATORS, '<general name="servo" site="malleolus" refsite="base" '
          'gear="0 1 0 0 0 0" gainprm="0" biastype="affine" biasprm="0 -5e4 -30"/>' + ACTUATORS),
          **dict.fromkeys(("simulate", "balance", "curve", "viewer"), "joint '(fat_pad|talocrural)' stands .* damper is negative")),
    _edit("two_dof", "a servo in the parent of its joint", (ACTUATORS, '<general name="servo" jointinparent="talocrural" gainprm="0" '
          'biastype="affine" biasprm="0 -5e4 -30"/>' + ACTUATORS), truth=chain(FOOT, SHANK, at=1, more=((1, 0, 5e4 + 30 * S),)),
          leg="actuator 'servo'"),
    _edit("two_dof", "a sensor that leans by 0.35 rad", (SENSED, LEVEL), ('pos="0 0.09 0.03"', 'pos="0 0.09 0.03" euler="0.35 0 0"'),
          truth=replace(CHAIN := chain(FOOT, SHANK, at=1), T=np.cos(0.35) * CHAIN.T), leg="sensor 'malleolus' leans"),
    _edit("two_dof", "a dashpot from the world to the knee", (SITE, SITE + '<site name="top" pos="0 0.3 0"/>'),
          ("<worldbody>", '<worldbody><site name="ceiling" pos="0 1.3 0"/>'),
          (TENDONS, '<tendon><spatial name="dash" damping="300"><site site="ceiling"/><site site="top"/></spatial></tendon>' + TENDONS),
          truth=replace(chain(FOOT, SHANK, at=1, more=((1, -2, 300 * S),)), singular=None), leg="tendon 'dash'"),
    _edit("two_dof", "a brake of the table", ("<worldbody>", '<worldbody><site name="ceiling" pos="0 1.3 0"/>'),
          (TENDONS, '<tendon><spatial name="brake" damping="1e11"><site site="ceiling"/><site site="base"/></spatial></tendon>' + TENDONS),
          load="tendon 'brake' holds the table"),
    _edit("two_dof", "a ball without a name", ("  </worldbody>", '<body name="ball"><freejoint/><geom size="0.01" mass="0.1"/></body></worldbody>'),
          load="joint number 4 of body 'ball' is a ball or free"),
    _edit("two_dof", "a table whose ref is in place of zero", ('<joint name="base" class="base"/>', '<joint name="base" class="base" ref="0.1"/>'),
          truth=chain(FOOT, SHANK, at=1)),
    _edit("two_dof", "a soft equality without a name", (TENDONS, '<equality><joint joint1="talocrural" joint2="fat_pad" active="false"/></equality>' + TENDONS),
          truth=chain(FOOT, SHANK, at=1), leg="equality number 1"),
    _edit("foot_arch", "a sensor that leans by 20 degrees", (SENSED, LEVEL), ('class="bone" pos="0 0 0.03"', 'class="bone" pos="0 0 0.03" euler="20 0 0"'),
          load="sensor 'malleolus' leans"),
    _edit("leg", "a load that is fused", ('angle="radian"', 'angle="radian" fusestatic="true"'), load="parameter 'added_mass': unknown body 'load'"),
    _edit("leg", "a load of a geom", (LOAD, ""), ('<geom name="load" ', '<geom name="load" mass="2.3" '),
          truth=chain(*LEG[:4], replace(TISSUE, mass=2.5), at=1)),
    _edit("leg", "an absorber on the tissue", ('<body name="load">', BODY.format("absorber", 2e4, 1, 0.3) + '</body><body name="load">'),
          truth=chain(*LEG, Link(0.3, 4, 2e4, 1), at=1)),
    _edit("leg", "a hard stop of the thigh", ('name="thigh" stiffness', 'name="thigh" range="-5e-4 5e-4" solreflimit="0.002 1" stiffness'),
          truth=chain(*LEG, at=1), leg="joint 'thigh' has a limit"),
    _edit("two_dof", "a tendon tied fast, stiffer than the step allows", (TENDONS, '<tendon><fixed name="geared"><joint joint="fat_pad" coef="2"/>'
          '<joint joint="talocrural" coef="1"/></fixed></tendon><equality><tendon name="tie" tendon1="geared" solref="-2e6 -3e3" '
          'solimp="0.9 0.9 0.001"/></equality>' + TENDONS),
          truth=replace(chain(FOOT, SHANK, at=1, more=((1, -1, 2 * _geared()), (0, -1, 2 * _geared()), (1, 0, -_geared()))), singular=None),
          leg="tendon 'geared'"),
    _edit("two_dof", "a heel lightly pressed against a wall", ('<site name="base"/>', '<site name="base"/>' + WALL), ('<site name="foot" ', HEEL),
          ('<joint name="fat_pad"', '<joint name="press" axis="1 0 0" stiffness="2e3" damping="20" springref="-1e-4"/><joint name="fat_pad"'),
          (TENDONS, '<contact><pair geom1="heel" geom2="wall" friction="0.8 0.8" solimp="0.9 0.9 0.001"/></contact>' + TENDONS),
          ('integrator="RK4"', 'integrator="RK4" cone="elliptic"'),
          truth=replace(chain(FOOT, SHANK, at=1, more=((0, -1, _rubbing()),)), pad=None, dissipated=None), leg="geoms can touch"),
    _edit("two_dof", "a heel that just touches a wall", ('<site name="base"/>', '<site name="base"/>' + WALL), ('<site name="foot" ', HEEL),
          ('<joint name="fat_pad"', '<joint name="press" axis="1 0 0" stiffness="2e3" damping="20"/><joint name="fat_pad"'),
          (TENDONS, '<contact><pair geom1="heel" geom2="wall" friction="0.8 0.8"/></contact>' + TENDONS),
          **dict.fromkeys(("curve", "viewer"), "the contact of geom 'heel' and geom 'wall' touches, stops or slips as soon")),
    _edit("two_dof", "a bound below all masses in place of none", ('angle="radian"', 'angle="radian" boundmass="0.5"'), truth=chain(FOOT, SHANK, at=1)),
    _edit("two_dof", "inertias raised", ('angle="radian"', 'angle="radian" boundinertia="5e-3"'),
          load="body 'foot' has the inertia 0.001 0.001 0.001, and <compiler boundinertia> makes it 0.005"),
    _edit("two_dof", "an inertia that is balanced", ('angle="radian"', 'angle="radian" balanceinertia="true"'),
          ('"1e-3 1e-3 1e-3"', '"1e-3 1e-3 5e-3"'), load="body 'foot': inertia must satisfy .*, where <compiler balanceinertia> takes mass 1.05227 and inertia 0.00233333 0.00233333"),
    _edit("two_dof", "a shoe of a geom without mass", IN_SHOE, load="body 'shoe' weighs nothing"),
    _edit("two_dof", "a shoe that is only drawn in place of none", (IN_SHOE[0], IN_SHOE[1].replace("size", 'density="0" size')), truth=chain(FOOT, SHANK, at=1)),
    _edit("two_dof", "a wheel that turns freely", ('<site name="foot" ', WHEEL),
          truth=chain(replace(FOOT, mass=FOOT.mass + 0.1), SHANK, at=1), leg="joint 'spin'", **_loose("brings joint 'spin' back")),
    _edit("two_dof", "a foot without a spring", (FAT_PAD, 'name="fat_pad" damping="800"'), *_without("k_F", "c_21", "c_22", "c_23"),
          simulate="nothing carries joint 'fat_pad'", **_loose("nothing carries joint 'fat_pad'")),
    _edit("two_dof", "a state that nothing brings back", (ACTUATORS, '<general name="exo" joint="talocrural" dyntype="user" actdim="1"/>' + ACTUATORS),
          truth=chain(FOOT, SHANK, at=1), leg="actuator 'exo'", **_loose("brings actuator 'exo' back")),
    _edit("two_dof", "a Maxwell element at the pad", (ACTUATORS, '<general name="relax" joint="fat_pad" dyntype="user" actdim="1" gainprm="0" '
          'biastype="user" biasprm="3 7e4 0.006"/>' + ACTUATORS), ("</custom>", '<text name="tau" data="s | 1e-3 | 1 | actuator relax biasprm 2 | made"/></custom>'),
          truth=replace(chain(replace(FOOT, k=1e5 + 7e4 * 6e-3 * S / (1 + 6e-3 * S)), SHANK, at=1), singular=None), leg="actuator 'relax'"),
    _edit("two_dof", "a servo that drives the ankle away", (ACTUATORS, f'<general {SERVO} gainprm="0" biastype="affine" biasprm="0 2e5 0"/>' + ACTUATORS),
          simulate="topples about joint 'talocrural': actuator 'servo' drives"),
    _edit("foot_arch", "a fascia that is slack", ('name="plantar_aponeurosis" stiffness="15e3"', 'name="plantar_aponeurosis" stiffness="15e3" springlength="0 0.17"'),
          arch="tendon 'plantar_aponeurosis' is slack over a part"),
    _edit("foot_arch", "a step of 1 ms", ('timestep="1e-4"', 'timestep="1e-3"'), truth=arch()),
)  # fmt: skip

# foot_arch.xml
ARCH = mjcf.text("foot_arch")
CLOSURE = 'name="closure" tendon1="heel_pad" tendon2="forefoot_pad"'
HEADS = '<site name="heads" class="bone" pos="0 -0.06527 0"/>'
HIND = '<joint name="hindfoot"/>'
TOES = '<inertial pos="0 0 0" mass="0.02" diaginertia="1e-6 1e-6 1e-6"/></body>'
VELOCITY = '<framelinvel name="malleolus_velocity" objtype="site" objname="malleolus"/>'
APEX = '<body name="apex" pos="0 0.0400075598688415 0" childclass="vertical">'
SOLE = '<body name="insole"><joint type="slide" axis="0 1 0" name="insole" stiffness="9e4" damping="50"/>'


def _line(part: str) -> str:
    return next(line for line in ARCH.splitlines() if part in line)


FOLLOWED = (
    (
        "k_2",
        "stiffer spring ligament",
        ('<joint name="spring_ligament"/>', '<joint name="spring_ligament" stiffness="9000"/>'),
        9000.0,
    ),
    ("k_F", "stiffer pads", ('stiffness="5e4"', 'stiffness="8e4"'), 1.6e5),
    (
        "c_T",
        "stronger damper of the ankle",
        ('damping="430" user="4.25 430 0 0"', 'damping="900" user="4.25 900 0 0"'),
        900.0,
    ),
    ("c_1", "stiffer dashpot of the fascia", ('resistance="3.3333333333333333e-3"', 'resistance="1e-3"'), 1000.0),
    ("c_T", "an ankle without its law", ('damping="430" user="4.25 430 0 0"', 'damping="700"'), 700.0),
    ("m_T", "mass on the knee", ('mass="2.36"', 'mass="4.36"'), 4.36),
    ("m_3", "heavier cuneiforms", ('mass="0.025"', 'mass="0.25"'), 0.25),
    (
        "I_1",
        "inertia of the hindfoot",
        ('diaginertia="28.00e-5 28.00e-6 28.00e-5"', 'diaginertia="9e-4 28.00e-6 9e-4"'),
        9e-4,
    ),
)
REFUSED = (
    ("heel pad by another name", (('name="heel_pad" class', 'name="heel" class'), ('tendon1="heel_pad"', 'tendon1="heel"'), ("0.5 tendon heel_pad", "0.5 tendon heel"),), "there is no tendon 'heel_pad'"),
    ("hindfoot by another name", (('joint name="hindfoot"', 'joint name="hind"'),), "there is no joint 'hindfoot', did you mean 'hind'"),
    ("centre of mass off the bone", (('pos="0 -0.032635 0"', 'pos="0 -0.03 0"'),), "the centre of mass of metatarsals lies 2.635 mm off"),
    ("no closure", ((_line(CLOSURE), ""),), "put the equality closure of foot_arch"),
    ("closure switched off", ((CLOSURE, CLOSURE + ' active="false"'),), "no active equality between the tendons 'heel_pad' and"),
    ("closure with a ratio", ((CLOSURE, CLOSURE + ' polycoef="0 2 0 0 0"'),), "equality 'closure' must keep both pads"),
    ("a second equality", ((CLOSURE, 'name="tied" joint1="spring_ligament" joint2="short_plantar_ligament"/>\n    <tendon ' + CLOSURE), ('<tendon name="tied"', '<joint name="tied"'),), "equality 'tied' is none of the arch's"),
    ("a soft weld without a name", (("  <tendon>", '  <equality><weld body1="tibia" body2="navicular" solref="-1e3 -10"/></equality>\n  <tendon>',),), "equality number [12] is none of the arch's"),
    ("toes, fixed", ((HEADS, HEADS + '<body name="toes">' + TOES),), "body 'toes' has a mass or joint of its own"),
    ("toes on a joint", ((HEADS, HEADS + '<body name="toes"><joint name="toe"/>' + TOES),), "body 'toes' has a mass or joint"),
    ("an insole under the pads", ((APEX, SOLE + '<inertial pos="0 0 0" mass="0.3" diaginertia="1e-3 1e-3 1e-3"/>' + APEX), ("  </worldbody>", "</body>  </worldbody>"),), "body 'insole'"),
    ("a tibia that tilts", (('<joint name="talocrural"', '<joint name="tilt" type="hinge" axis="0 0 1"/><joint name="talocrural"'),), "body 'tibia' has a mass or joint of its own"),
    ("an apex with mass", (('mass="1e-14"', 'mass="1e-3"'),), "body 'apex' and what is fixed to it weigh 0.001 kg"),
    ("armature of the hindfoot", ((HIND, '<joint name="hindfoot" armature="1e-5"/>'),), "'hindfoot' has the armature 1e-05"),
    ("armature of the ankle", (('<joint name="talocrural" ', '<joint name="talocrural" armature="0.1" '),), "'talocrural' has the armature"),
    ("a slanting axis", ((HIND, '<joint name="hindfoot" axis="0 0.1 1"/>'),), 'must be a hinge with axis="0 0 1"'),
    ("an axis the other way", ((HIND, '<joint name="hindfoot" axis="0 0 -1"/>'),), "joint 'hindfoot' must be a hinge"),
    ("a spring of the hindfoot", ((HIND, '<joint name="hindfoot" stiffness="5"/>'),), "'hindfoot' has a spring or damper"),
    ("a polynomial of the hindfoot", ((HIND, '<joint name="hindfoot" stiffness="0 5"/>'),), "'hindfoot' has a spring or"),
    ("a fascia that pulls at rest", (('stiffness="15e3" ', 'stiffness="15e3" springlength="0.1" '),), "remove its springlength"),
    ("a damper of the fascia", (('stiffness="15e3" ', 'stiffness="15e3" damping="9" '),), "'plantar_aponeurosis' has a damper"),
    ("an ankle that stiffens", (('stiffness="1e6"', 'stiffness="1e6 5e6"'),), "joint 'talocrural' has a stiffness that changes"),
    ("a pad whose damper is a polynomial", (('damping="1500"', 'damping="1500 3"'),), "tendon 'heel_pad' has a damping that changes"),
    ("a fascia that stiffens", (('stiffness="15e3" ', 'stiffness="15e3 1e5" '),), "tendon 'plantar_aponeurosis' has a stiffness that"),
    ("pads of law 4.23", (('damping="1500" user="4.25 1500 0 0"', 'user="4.23 900 1.5 30 0.9 0.8 0.02 0.2"'),), "'heel_pad' has the law 4.23 with n = 0.8"),
    ("pads without stiffness", (('stiffness="5e4" damping="1500" user="4.25 1500 0 0"', ""),), "'heel_pad' and 'forefoot_pad' have no"),
    ("an ankle without stiffness", (('stiffness="1e6" ', ""),), "joint 'talocrural' has no stiffness"),
    ("a pad that relaxes", (("  <tendon>", '    <actuator><general name="gel" tendon="heel_pad" dyntype="user" actdim="8" gainprm="0" ' 'biastype="user" biasprm="4.22 40 5 0.8 0.004 1.5 0.02 0.2"/></actuator>\n  <tendon>',),), "actuator 'gel' acts on the arch"),
    ("a stop of a ligament", (('<joint name="spring_ligament"/>', '<joint name="spring_ligament" range="-1 1"/>'),), "joint 'spring_ligament' has a limit"),
    ("dry friction", (('<joint name="spring_ligament"/>', '<joint name="spring_ligament" frictionloss="0.1"/>'),), "joint 'spring_ligament' has dry friction"),
    ("a fascia with a limit", (('stiffness="15e3" ', 'stiffness="15e3" range="0 1" '),), "tendon 'plantar_aponeurosis' has a limit"),
    ("bones that touch the table", (('<geom name="metatarsals"', '<geom name="metatarsals" contype="1" conaffinity="1"'),), "geoms can touch"),
    ("under water", (('gravity="0 0 0"', 'gravity="0 0 0" density="1e3"'),), "density"),
    ("gravity", (HEAVY,), "<option> has gravity"),
    ("a malleolus on the hindfoot", (('<site name="malleolus" class="bone" pos="0 0 0.03"/>', ""), ('<site name="heel" ', '<site name="malleolus"/><site name="heel" '),), "site 'malleolus' is on 'calcaneus_talus'"),
    ("a fascia that is heavy", (('stiffness="15e3" ', 'stiffness="15e3" armature="5" '),), "tendon 'plantar_aponeurosis' has an armature"),
    ("a fascia that runs along the bones", (('<site site="heel"/><site site="heads"/>\n', '<site site="heel"/><site site="way"/><site site="heads"/>\n',), (HEADS, HEADS + '<site name="way" pos="0 -0.03 0"/>'),), "tendon 'plantar_aponeurosis' must run straight from 'heel' to 'heads'"),
    ("a tendon from heel to hindfoot", ((HEADS, HEADS + '<site name="way" pos="0 -0.03 0"/>'), ("  </tendon>", '<spatial name="tape" stiffness="2e4"><site site="heel"/><site site="way"/></spatial></tendon>',),), "tendon 'tape' pulls, and the equations lack it"),
    ("an inertia without mass on the hindfoot", (('<site name="heel" ', '<body name="wheel"><inertial pos="0 0 0" mass="0" diaginertia="1e-3 1e-3 1e-3"/></body><site name="heel" ',),), "body 'wheel' has a mass or joint of its own"),
    ("pads that lean", (('pos="-0.06845655 -1000 0"', 'pos="-0.03845655 -0.03 0"'), ('pos="0.09819040 -1000 0"', 'pos="0.12819040 -0.03 0"'),), "tendon 'heel_pad' leans, .* put site 'heel_ground' below 'heel'"),
    ("a navicular 10 mm ahead of the talus", (('<body name="navicular" ', '<body name="navicular" pos="0.00504570 0.00863370 0" '),), "joint 'spring_ligament' lies 10.000 mm off joint 'hindfoot'"),
    ("toes out by 30 degrees", ((APEX, APEX.replace(" childclass", ' euler="0 30 0" childclass')),), "joint 'hindfoot' must be a hinge .* in the world's axes, not 0.5 0 0.866025; turn it or its body"),
    ("toes the other way", ((APEX, APEX.replace(" childclass", ' euler="0 180 0" childclass')), ('pos="-0.06845655 -', 'pos="0.06845655 -'), ('pos="0.09819040 -', 'pos="-0.09819040 -'),), "joint 'hindfoot' must be a hinge .*, not 0 0 -1;"),
    ("a tibia that leans by 10 degrees", (('<body name="tibia" pos="0 0.03 0"', '<body name="tibia" pos="0 0.03 0" euler="0 0 10"'),), "joint 'talocrural' must be a slide .* in the world's axes"),
    ("a branch with a gear", (('input="none"', 'gear="2" input="none"'),), "'aponeurosis_branch' has another gear"),
    ("a branch of another motor", (('motorconst="1 1"', 'motorconst="2 2"'),), "'aponeurosis_branch' has another motor"),
    ("a branch that cogs", (('input="none"', 'input="none" cogging="1 2 0"'),), "'aponeurosis_branch' has another"),
    ("a soft closure", (('solref="-2.5e7 -1e4"', 'solref="0.02 1"'),), "'closure' gives way"),
    ("a closure that gives way", (('solimp="0.9999 0.9999 0.001"', 'solimp="0 0.01 0.001"'),), "'closure' gives way"),
    ("a closure that gives way by a quarter per cent", (('solref="-2.5e7 -1e4"', 'solref="-1e6 -2e3"'),), "'closure' gives way"),
    ("a tibia that floats", (('<body name="tibia" ', '<body name="tibia" gravcomp="1" '),), "body 'tibia' has a gravcomp"),
)  # fmt: skip
LOADED = (
    ("a fascia of little force", (('stiffness="15e3" ', 'stiffness="15e3" actuatorfrcrange="-1e-6 1e-6" '),), "tendon 'plantar_aponeurosis' .* 'actuatorfrcrange'"),
    ("a branch that is switched off", (('gravity="0 0 0"', 'gravity="0 0 0" actuatorgroupdisable="3"'), ('input="none"', 'group="3" input="none"')), "actuator 'aponeurosis_branch' is switched off"),
    ("a velocity against the table", ((VELOCITY, VELOCITY.replace("/>", ' reftype="site" refname="base"/>')),), "sensor 'malleolus_velocity' .* 'refname'"),
    ("a velocity in the axes of its site", ((VELOCITY, '<velocimeter name="malleolus_velocity" site="malleolus"/>'),), "sensor 'malleolus_velocity' is read in the world's axes"),
    ("a velocity at another place of a bone that turns", (('<site name="malleolus" class="bone" pos="0 0 0.03"/>', ""), ('<site name="heel" ', '<site name="malleolus" pos="0 -0.02 0"/><site name="heel" '), (VELOCITY, VELOCITY.replace('objname="malleolus"', 'objname="heel"')),), "sensor 'malleolus_velocity' sits at another place of 'calcaneus_talus' than sensor 'malleolus'"),
    ("one pad stiffer than its share", (('<spatial name="heel_pad" class="pad"', '<spatial name="heel_pad" class="pad" stiffness="9e4"'),), "parameter 'k_F' is 180000 N/m at the first place .* and 100000 at another"),
    ("an arch that is open", (('euler="0 0 3.4"', 'euler="0 0 8"'),), "'closure' ties the tendons 'heel_pad' and 'forefoot_pad'"),
    ("equalities switched off", (('iterations="20"/>', 'iterations="20"><flag equality="disable"/></option>'),), '<flag equality="disable"/>'),
    ("negative ligaments", (('joint stiffness="230"', 'joint stiffness="-230"'),), "joint 'spring_ligament' has the stiffness -230"),
    ("a damping that is no number", (('damping="2"', 'damping="nan"'),), "joint 'spring_ligament' has the damping nan"),
    ("a negative law", (('user="4.25 430 0 0"', 'user="4.25 -430 0 0"'),), "joint 'talocrural' has the damping -430"),
    ("a negative fascia", (('stiffness="15e3"', 'stiffness="-15e3"'),), "tendon 'plantar_aponeurosis' has the stiffness -15000"),
)  # fmt: skip
ARCHES = (
    *(_edit("foot_arch", says, change, truth=arch(**{name: value})) for name, says, change, value in FOLLOWED),
    _edit("foot_arch", "longer metatarsals", text=reshaped(L_4=0.075), truth=arch(L_4=0.075)),
    _edit("foot_arch", "a higher arch", text=reshaped(theta_4=60.0), truth=arch(theta_40=np.radians(60.0))),
    _edit("foot_arch", "a cast on the tibia", ('<geom name="tibia"', '<body name="cast"><inertial pos="0 0.1 0" mass="0.5" '
          'diaginertia="1e-3 1e-3 1e-3"/></body><geom name="tibia"'), truth=arch(m_T=2.86)),
    _edit("foot_arch", "the solver's tolerance gone", (' tolerance="1e-10" iterations="20"', ' iterations="1"'), truth=arch()),
    _edit("foot_arch", "Euler's integrator", ("implicitfast", "Euler"), truth=arch()),
    _edit("foot_arch", "the implicit integrator", ('"implicitfast"', '"implicit"'), truth=arch()),
    _edit("foot_arch", "a parameter less", (_line('name="k_12"'), ""), truth=arch()),
    _edit("foot_arch", "short pads", ("-1000 0", "-0.02 0"), truth=arch()),
    *(_edit("foot_arch", says, *changes, arch=words) for says, changes, words in REFUSED),
    *(_edit("foot_arch", says, *changes, load=words) for says, changes, words in LOADED),
)  # fmt: skip


def mounted(*heavier: tuple[int, float], **constants: float) -> Truth:
    """The closed form of the mounted arch with constants changed, and masses added to rows (0 apex, 1 shank)."""
    M, C, K, rows = mount.matrices(replace(SHIPPED, **constants))
    for row, mass in heavier:
        M = M + mass * np.outer(rows[row], rows[row])
    return Truth(complex(mount.response(np.array([HZ]), M, C, K, rows)[0, 0]))


# mounted_arch.xml
MOUNTS = (
    _edit("mounted_arch", "stiffer ankle", ('"17300.0"', '"30000.0"'), truth=mounted(k_T=3e4)),
    _edit("mounted_arch", "weaker damper of the pad", ('"2990.0"', '"500.0"'), ("4.25 2990.0", "4.25 500.0"), truth=mounted(c_F=500.0)),
    _edit("mounted_arch", "heavier shank", (f'mass="{SHANK_KG * (1 - SHIPPED.share)!r}"', f'mass="{SHANK_KG * (1 - SHIPPED.share) + 1!r}"'), truth=mounted((1, 1.0))),
    _edit("mounted_arch", "a cast on the malleolus", ('<body name="shank">', '<body name="cast"><inertial pos="0 0 0" ' 'mass="0.5" diaginertia="1e-3 1e-3 1e-3"/></body><body name="shank">',), truth=mounted((0, 0.5))),
    _edit("mounted_arch", "gravity beside its weight", HEAVY, load="the actuator 'weight' stands for it"),
    _edit("mounted_arch", "malleolus sensed on the shank", ('<framelinacc name="malleolus" objtype="site" objname="malleolus"/>', '<framelinacc name="malleolus" objtype="site" objname="tuberosity"/>',), load="sensor 'malleolus' sits on 'shank'"),
)  # fmt: skip
EDITS = (*TWO_DOF, *LEGS, *ARCHES, *MOUNTS, *FRESH)


def section() -> str:
    """The part of benchmarks/edits.md that lists them, model by model."""
    lines = []
    for model in OF:
        mine = [edit for edit in EDITS if edit.model == model]
        usual = USUAL[model]
        equations = "arch" if "arch" in model else "leg"
        own = [(edit, {k: v for k, v in edit.refused.items() if usual.get(k) != v}) for edit in mine]
        lines += [f"**{model}.xml, {len(mine)} edits.**", ""]
        kinds = {
            "Followed by all": _list(edit for edit, refused in own if not refused),
            f"Left to MuJoCo, refused by `fasbody.{equations}`": _list(
                edit for edit, refused in own if refused and not {"load", "viewer"} & {*refused}
            ),
            "Refused by all": _list(edit for edit, refused in own if "load" in refused),
        }
        lines += [f"- {kind}: {edits}." for kind, edits in kinds.items() if edits]
        last = {
            "Followed, but not drawn": _list(edit for edit, refused in own if "viewer" in refused and edit.truth),
            "Refused by `simulate` and viewer": _list(
                edit for edit, refused in own if "simulate" in refused and not edit.truth
            ),
            "Followed by `simulate`, but not drawn": _list(
                edit for edit, refused in own if "viewer" in refused and "simulate" not in refused and not edit.truth
            ),
        }
        lines += [*(f"- {kind}: {edits}." for kind, edits in last.items() if edits), ""]
    return "\n".join(lines)


def _list(edits: Iterable[Edit]) -> str:
    return "; ".join(edit.says for edit in edits)


if __name__ == "__main__":
    print(section())
