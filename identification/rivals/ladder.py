"""The ladder: what each rival frees or holds beside the foot, with priors from literature.

Every rung has the foot's eight constants (the linear one four), the masses, the share of a load and
the instrument with the priors of the fit, so that a mass stated a little wrong or a gain of 1 %
chooses no rival. A rung adds what it is named after: nuisances of the fit, here one kind at a time,
or constants that only rivals have.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import log

import numpy as np

from fasbody.foot.model import Foot
from fasbody.recording.known import Known
from fasbody.recording.recording import Recording
from identification import branches
from identification.harmonics import Line, Measured
from identification.motion import TwoMassMotion
from identification.nuisances import OF_SENSOR, OF_SPRINGS, Nuisance, nuisances
from identification.parameters import MASSES, space_of
from identification.residual import Problem
from identification.rivals.motion import AT, EXTRA, FOLLOWING, HARMONICS, LOAD_KG, RivalMotion
from identification.rivals.result import LOAD, MODEL
from identification.sensors import MALLEOLUS
from identification.steady import problem_of
from identification.variables import Variables

#: Departures that rungs stand for, or that none allows for.
EXCLUDED = ("mount", "relaxation", "load", "rocking")
#: Constants of the model: what frees more is more than it.
_OF_MODEL = 8
_FORCE = "a pad whose force grows as deformation^2.6 has -1600 to -530 1/m at 1 to 3 mm"
_TISSUE = "soft tissue rings at frequencies of running impacts, J Appl Physiol 90:412 (2001)"


@dataclass(frozen=True)
class Rung:
    """One rival.

    Attributes:
        name: for options and files.
        title: for people.
        constants: what it frees beside the foot, by the symbol of `AT_REST`.
        held: what it holds at zero.
        loads: recorded loads that it takes to tell it from the model.
    """

    name: str
    title: str
    constants: Mapping[str, Nuisance] = field(default_factory=dict)
    held: tuple[str, ...] = ()
    loads: int = 1


def _of_joints(
    kind: str, letter: str, unit: str, std: float, bound: float, does: str
) -> dict[str, Nuisance]:  # fmt: skip
    item = Nuisance(kind, "rival", unit, 0.0, std, -bound, bound, _FORCE, does)
    return {
        f"{letter}_{j}": replace(item, does=does.format(j), constant=f"k_{j}") for j in "TF"
    }  # fmt: skip


_RELAX = dict(zip(("r_T", "r_F", "tau"), OF_SPRINGS, strict=True))
_SOFT = (replace(item, sensor=MALLEOLUS[0]) for item in OF_SENSOR if item.group == "mount")
_MOUNT = dict(zip(("u", "zeta_u"), _SOFT, strict=True))
_THIRD = {
    "w": Nuisance("swinging", "rival", "", 0.0, 0.3, 0.0, 0.8, _TISSUE,
                  "share of the shank that swings"),
    "f_w": Nuisance("swinging frequency", "rival", "Hz", log(25), 0.5, log(8), log(70), _TISSUE,
                    "its natural frequency", logarithmic=True),
    "zeta_w": Nuisance("swinging damping", "rival", "", 0.2, 0.1, 0.02, 0.8, _TISSUE,
                       "its damping ratio"),
}  # fmt: skip
_CURVED = _of_joints("quadratic", "p", "1/m", 500.0, 1e4, "force of k_{} bends by p z²")
_CURVED |= _of_joints("cubic", "d", "1/m²", 1e6, 2e7, "force of k_{} bends by d z³")
_BENT = _of_joints("exponential", "b", "1/m", 1000.0, 3000.0, "k_{} grows as exp(b x)")
_FOLLOW = _of_joints("following", "e", "", 0.1, 1.0, "k_{} and damper grow by exp(e) under 2.3 kg")
LINEAR = "linear"
LADDER = (
    Rung(LINEAR, "linear dampers", held=("c_12", "c_13", "c_22", "c_23")),
    Rung(MODEL, "the two-mass foot"),
    Rung("exponential", "springs that stiffen, exponential", _BENT),
    Rung("polynomial", "springs that stiffen, polynomial", _CURVED),
    Rung("relaxing", "springs that relax", _RELAX),
    Rung("mount", "sensor on soft tissue", _MOUNT),
    Rung("third", "a third mass", _THIRD),
    Rung(LOAD, "constants that change with the load", _FOLLOW, loads=2),
)
#: Constants of all rungs, where nothing departs from the model.
AT_REST = dict.fromkeys((*AT, "e_T", "e_F", "u", "gain", "drift", "delay"), 0.0)
AT_REST |= {"tau": 5e-3, "f_w": 25.0, "zeta_w": 0.2, "zeta_u": 0.2}


@dataclass(frozen=True, eq=False)
class RungVariables(Variables):
    """Variables of a rung: those of the fit, and what only rivals have.

    Attributes:
        rung: the rival.
    """

    rung: Rung = LADDER[0]

    def _rung_constant(self, Q: np.ndarray, symbol: str) -> np.ndarray:
        """A constant (...,) of the rung in its unit, at rest if it has none of this symbol."""
        item = self.rung.constants.get(symbol)
        if item is None:
            return np.full(Q.shape[:-1], AT_REST[symbol])
        x = self.value(Q, self.place(item))
        return np.exp(x) if item.logarithmic else x

    def _carried(self, Q: np.ndarray) -> np.ndarray:
        """(..., R) mass of the load that the leg carries [kg]."""
        return self.value(Q, self.of_kind("load share"), 1.0)[..., None] * self.loads

    def theta(self, Q: np.ndarray) -> np.ndarray:
        """(..., R, P) parameters of each recording's foot, `EXTRA` last if the rung has any."""
        theta = super().theta(Q)
        for symbol, names in FOLLOWING.items():
            grown = np.exp(self._rung_constant(Q, symbol)[..., None] * self.loads / LOAD_KG)
            theta[..., [AT[name] for name in names]] *= grown[..., None]
        if not set(EXTRA) & set(self.rung.constants):
            return theta
        alike = np.ones(theta.shape[:-1])  # in all recordings, but for the share of what swings
        more = {name: self._rung_constant(Q, name)[..., None] * alike for name in EXTRA}
        more["w"] *= 1 - self._carried(Q) / theta[..., AT["m_S"]]
        return np.concatenate([theta, np.stack(list(more.values()), -1)], -1)

    def named(self, q: np.ndarray) -> dict[str, float]:
        """All constants by name at q (n,), springs at rest and masses without load."""
        theta, carried = super().theta(q)[0], self._carried(q)[0]
        values = AT_REST | {name: float(theta[i]) for name, i in AT.items() if i < theta.size}
        values["m_S"] -= float(carried)
        for item in self.nuisances:
            if item.kind in ("gain", "delay", "drift"):
                values[item.kind] = item.value(q[self.place(item)] * item.std)
        return values | {symbol: float(self._rung_constant(q, symbol)) for symbol in self.rung.constants}

    def carried_over(self, q: np.ndarray, of: Variables) -> np.ndarray:
        """(n,) a place of another rung; what that has not is where its prior is centred."""
        old = dict(zip((*of.constants, *of.nuisances), q, strict=True))
        new = zip((*self.constants, *self.nuisances), self.prior[0], strict=True)
        return np.clip([old.get(what, x) for what, x in new], *self.bounds)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A rung, or a user's model in its place, and its problem."""

    rung: Rung
    problem: Problem

    @property
    def free(self) -> int:
        """Parameters that BIC counts: all but the nuisances, which every rival has."""
        return len(self.problem.variables.constants) + len(self.rung.constants)

    @property
    def extra(self) -> bool:
        """It frees more than the model."""
        return self.free > _OF_MODEL


def rungs_of(
    foot: Foot, data: Sequence[Recording], known: Known, rungs: Sequence[Rung]
) -> list[Candidate]:  # fmt: skip
    """The rungs that recordings of one person can tell."""
    measured, values = Measured.of([Line.of(r) for r in data], MALLEOLUS), foot.values()
    masses = [name for name in values if name in MASSES]
    items = nuisances(data, known.overruled_by(exclude=EXCLUDED), masses, True)
    ratio = branches.ratio([r.condition.masses for r in data], values)
    loads = {r.condition.added_mass_kg for r in data}
    candidates = []
    for rung in rungs:
        if len(loads) < rung.loads:
            continue
        names = [name for name in foot.parameters if name not in (*MASSES, *rung.held)]
        space = space_of(foot, names, delay=False)
        space = replace(space, fixed={**space.fixed, **dict.fromkeys(rung.held, 0.0)})
        variables = RungVariables(space, (*items, *rung.constants.values()), data, values, True, ratio, rung)
        kind = RivalMotion if set(EXTRA) & set(rung.constants) else TwoMassMotion
        motion = kind(measured, variables.omega, (False,), HARMONICS)
        candidates.append(Candidate(rung, Problem.of(measured, variables, motion)))
    return candidates


def edited(foot: Foot, data: Sequence[Recording], known: Known) -> Candidate:
    """A user's model beside the rungs, by harmonic balance on MuJoCo's dynamics."""
    space = space_of(foot, delay=False)
    problem = problem_of(data, foot, space, known.overruled_by(exclude=EXCLUDED), carriers=None)
    return Candidate(Rung(foot.name, foot.name), problem)
