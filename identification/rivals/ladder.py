"""The ladder: what each rival frees or holds of the constants of `steady`, with priors from literature.

Every rung has the foot's eight constants (the linear one four), the masses and the instrument's gain, delay and drift
with the priors of the wide fit, so that a mass stated a little wrong or a gain of 1 % chooses no rival. A rung adds
what it is named after.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from identification.rivals.result import MODEL
from identification.rivals.steady import CONSTANTS, INDEX
from identification.world import LOAD_STD, NUISANCES, Nuisance


@dataclass(frozen=True)
class Variable:
    """One free constant of a rung.

    Attributes:
        name: of the constant (`steady.CONSTANTS`). kind: "log" (the search is for its logarithm), "plain", "root" (for
            its square, of which the response is even).
        mean, std: of the prior, of what is searched for; infinite where nothing is known. lower, upper: of the same.
        unit, says: for people. source: of the prior. rival: it is the rung's own, and counts as a parameter in BIC.
        start: values to start from, of what is searched for.
    """

    name: str
    kind: str
    mean: float
    std: float
    lower: float
    upper: float
    unit: str
    says: str
    source: str
    rival: bool = False
    start: tuple[float, ...] = ()

    @property
    def size(self) -> float:
        """One unit of the search variable."""
        return self.std if np.isfinite(self.std) else 1.0

    def constant(self, x: float) -> tuple[float, float]:
        """Value of the constant, and its derivative to x, which is searched for."""
        if self.kind == "log":
            return float(np.exp(x)), float(np.exp(x))
        if self.kind == "root":
            root = float(np.sqrt(max(x, _LEAST)))
            return root, 0.5 / root
        return x, 1.0


#: Square below which a damper's c_3 is no different from zero [1/m^2], and a bend that is as likely as not [1/m].
_LEAST, _BEND = 1e-2, 200.0
_FORCE = "a heel's force grows as deformation to the power 2.6, which is -600 to -1600 1/m at 1 to 3 mm"
_TISSUE = "soft tissue of the leg rings at frequencies of running impacts, J Appl Physiol 90:412 (2001)"
_FLAT = "bounds of the model"


def _like(name: str, constant: str, says: str, **changed: object) -> Variable:
    """A variable with the prior of the wide fit's nuisance."""
    found: Nuisance = next(each for each in NUISANCES if each.name == name)
    kind = "log" if found.logarithmic else "plain"
    made = Variable(
        constant, kind, found.mean, found.std, found.lower, found.upper, found.unit, says, found.source, rival=True
    )
    return replace(made, **changed)  # type: ignore[arg-type]


_RELAX = (
    _like("relaxing k_T", "r_T", "share of k_T beside it that relaxes", start=(0.3,)),
    _like("relaxing k_F", "r_F", "share of k_F beside it that relaxes", start=(0.3,)),
    _like("relaxation time", "tau", "relaxation time", start=(float(np.log(5e-3)),)),
)
_MOUNT = (
    _like("mount", "u", "1 / f² of the sensor on its tissue", start=(1 / 110**2,)),
    _like("mount damping", "zeta_u", "damping ratio of that", start=(0.2,)),
)
_BENT = tuple(
    Variable(
        f"b_{joint}", "plain", 0.0, 1000.0, -3000.0, 3000.0, "1/m", f"k_{joint} grows as exp(b x)", _FORCE, True, start
    )
    for joint, start in (("T", (0.0, 200.0, -200.0)), ("F", (0.0, 200.0, -200.0)))
)
_CURVED = tuple(
    Variable(f"{letter}_{joint}", "plain", 0.0, std, -20 * std, 20 * std, unit, says.format(joint), _FORCE, True, start)
    for letter, std, unit, says, start in (
        ("p", 500.0, "1/m", "force of k_{} bends by p z²", (0.0, 0.0, 0.0)),
        ("d", 1e6, "1/m²", "force of k_{} bends by d z³", (0.0, 1e5, -1e5)),
    )
    for joint in ("T", "F")
)
_THIRD = (
    Variable("w", "plain", 0.0, 0.3, 0.0, 0.8, "", "share of the shank that swings", _TISSUE, True, (0.2,)),
    Variable(
        "f_w", "log", float(np.log(25)), 0.5, float(np.log(8)), float(np.log(70)), "Hz", "its natural frequency",
        _TISSUE, True, (float(np.log(25)),),
    ),
    Variable("zeta_w", "plain", 0.2, 0.1, 0.02, 0.8, "", "its damping ratio", _TISSUE, True, (0.2,)),
)  # fmt: skip
_FOLLOW = tuple(
    Variable(
        f"e_{joint}", "plain", 0.0, LOAD_STD, -1.0, 1.0, "", f"k_{joint} and its damper grow by exp(e) under 2.3 kg",
        "a heel's force grows as deformation to the power 2.6", True, (0.0,),
    )
    for joint in ("T", "F")
)  # fmt: skip


@dataclass(frozen=True)
class Rung:
    """One rival.

    Attributes:
        name: for options and files. title: for people. own: what it frees beside the foot. held: what it holds at zero.
        loads: recorded loads that it takes to be told from the model.
    """

    name: str
    title: str
    own: tuple[Variable, ...] = ()
    held: tuple[str, ...] = ()
    loads: int = 1

    @property
    def nested(self) -> bool:
        """It is the model with something held."""
        return bool(self.held)


LINEAR = "linear"
LADDER = (
    Rung(LINEAR, "linear dampers", held=("c_12", "c_13", "c_22", "c_23")),
    Rung(MODEL, "the model"),
    Rung("exponential", "springs that stiffen, exponential", _BENT),
    Rung("polynomial", "springs that stiffen, polynomial", _CURVED),
    Rung("relaxing", "springs that relax", _RELAX),
    Rung("mount", "sensor on soft tissue", _MOUNT),
    Rung("third", "a third mass", _THIRD),
    Rung("load", "constants that follow the load", _FOLLOW, loads=2),
)
#: Rungs that say the same of the world, by what they say.
KINDS = {"exponential": "stiffening", "polynomial": "stiffening"}


@dataclass(frozen=True, eq=False)
class RungSpace:
    """Search space of a rung: the foot's constants (k_T and k_F as sigma and rho), the rung's own, the nuisances.

    Attributes:
        rung: the rival. limits: bounds of the foot's constants by name, in their units. ratio: a of the mirror image.
        m_S, m_F: stated masses without load [kg]. nuisances: of masses and instrument.
    """

    rung: Rung
    limits: Mapping[str, tuple[float, float]]
    ratio: float
    m_S: float
    m_F: float
    nuisances: tuple[Variable, ...]

    @cached_property
    def variables(self) -> tuple[Variable, ...]:
        """All, in order; the first two are sigma and rho."""
        (T, F), la = (np.log(self.limits[name]) for name in ("k_T", "k_F")), float(np.log(self.ratio))
        found = [
            Variable("k_T", "log", 0, np.inf, 0.5 * (T[0] + F[0]), 0.5 * (T[1] + F[1]), "N/m", "", _FLAT, True),
            Variable("k_F", "log", 0, np.inf, T[0] - F[1] - la, T[1] - F[0] - la, "N/m", "", _FLAT, True),
        ]
        for name in ("c_11", "c_12", "c_13", "c_21", "c_22", "c_23"):
            low, high = self.limits[name]
            if name in self.rung.held:
                continue
            if name in ("c_11", "c_21"):
                low, high = float(np.log(low)), float(np.log(high))
                found.append(Variable(name, "log", 0, np.inf, low, high, "N s/m", "", _FLAT, True))
            elif name in ("c_13", "c_23"):
                found.append(Variable(name, "root", 0, _BEND**2, 0, high**2, "1/m", "", _FLAT, True))
            else:
                found.append(Variable(name, "plain", 0, _BEND, low, high, "1/m", "", _FLAT, True))
        return (*found, *self.rung.own, *self.nuisances)

    @cached_property
    def size(self) -> np.ndarray:
        """(n,) one unit of each search variable."""
        return np.array([v.size for v in self.variables])

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,), (n,) of the search variable."""
        limits = np.array([(v.lower, v.upper) for v in self.variables], float) / self.size[:, None]
        return limits[:, 0], limits[:, 1]

    def side(self, sign: int) -> tuple[np.ndarray, np.ndarray]:
        """The bounds of one branch: rho above zero (a stiff ankle), or below."""
        low, high = (limit.copy() for limit in self.bounds)
        (low if sign > 0 else high)[1] = 0.0
        return low, high

    @cached_property
    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """Indices (k,) of variables with a prior, and its mean (k,) in units of its width."""
        has = np.array([i for i, v in enumerate(self.variables) if np.isfinite(v.std)], int)
        return has, np.array([self.variables[i].mean / self.variables[i].std for i in has])

    @property
    def counted(self) -> int:
        """Parameters that BIC counts: all but the nuisances, which every rung has."""
        return sum(v.rival for v in self.variables)

    @cached_property
    def at_rest(self) -> np.ndarray:
        """(29,) constants where nothing is free."""
        c = np.zeros(len(CONSTANTS))
        for name, value in (("tau", 5e-3), ("f_w", 25.0), ("zeta_w", 0.2), ("zeta_u", 0.2)):
            c[INDEX[name]] = value
        c[INDEX["m_S"]], c[INDEX["m_F"]] = self.m_S, self.m_F
        return c

    def constants(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Constants (29,) at q (n,), and their derivatives (29, n)."""
        c, slope = self.at_rest.copy(), np.zeros((len(CONSTANTS), q.size))
        x = q * self.size
        for sign, name in ((0.5, "k_T"), (-0.5, "k_F")):
            i = INDEX[name]
            c[i] = np.exp(x[0] + sign * (x[1] + np.log(self.ratio)))
            slope[i, 0], slope[i, 1] = c[i], sign * c[i]
        for j, v in enumerate(self.variables[2:], start=2):
            i = INDEX[v.name]
            value, by = v.constant(x[j])
            if v.name in ("m_S", "m_F"):
                value, by = c[i] * value, c[i] * by
            c[i], slope[i, j] = value, by * self.size[j]
        return c, slope

    def search(self, values: Mapping[str, float], start: int = 0) -> np.ndarray:
        """Search variable (n,) of constants by name; the rung's own at one of their starts, nuisances as expected."""
        q = np.array([v.mean if np.isfinite(v.std) else 0.0 for v in self.variables])
        q[0] = 0.5 * np.log(values["k_T"] * values["k_F"])
        q[1] = np.log(values["k_T"] / values["k_F"] / self.ratio)
        for j, v in enumerate(self.variables[2:], start=2):
            if v.name in ("m_S", "m_F"):
                q[j] = np.log(values.get(v.name, self.at_rest[INDEX[v.name]]) / self.at_rest[INDEX[v.name]])
            elif v.start:
                q[j] = v.start[start % len(v.start)]
            elif v.name in values:
                value = values[v.name]
                q[j] = np.log(value) if v.kind == "log" else value**2 if v.kind == "root" else value
        return np.clip(q / self.size, *self.bounds)

    def named(self, q: np.ndarray) -> dict[str, float]:
        """Constants by name at q (n,)."""
        return dict(zip(CONSTANTS, map(float, self.constants(q)[0]), strict=True))


def nuisances(sizes: Mapping[str, float]) -> tuple[Variable, ...]:
    """Masses, gain, delay and drift with their priors.

    Args:
        sizes: standard deviation of each group ("masses", "gain", "delay", "drift"); what is known exactly is left out.
    """
    names = {"shank mass": "m_S", "foot mass": "m_F", "gain": "gain", "delay": "delay", "drift": "drift"}
    found: Sequence[Nuisance] = [each for each in NUISANCES if each.name in names and sizes.get(each.group, 1.0) > 0]
    return tuple(
        Variable(
            names[each.name], "log" if each.logarithmic else "plain", each.mean, sizes.get(each.group, each.std),
            each.lower, each.upper, each.unit, each.does, each.source,
        )
        for each in found
    )  # fmt: skip
