"""What else may be true: departures of the world from the model, each a named nuisance with a prior.

A fit that trusts masses, instruments and laws to the last digit is surer than anyone can be. Here the same recordings
are described by the model and by what a laboratory seldom excludes: masses that are stated a little wrong, gain, delay
and drift of the channels, a sensor on soft tissue, springs that relax, constants that follow the load, and a leg that
rocks. Each has a prior, a row of the least-squares problem, and all are estimated together with the foot.

The branch is the sign of rho, ln k_T = sigma + (rho + ln a) / 2 and ln k_F = sigma - (rho + ln a) / 2 with
a = m_S / (m_S + m_F) of the stated masses: each branch has its own constrained optimum, which at worst lies at rho = 0.
The response is even in c_13 and c_23, so their squares are the variables.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.parameters import Parameter
from fasbody.foot.two_dof import NAMES
from fasbody.recording.known import Known
from fasbody.recording.recording import Recording, gain_and_delay
from identification.branches import EXCHANGED
from identification.engines.compiled import Orbits
from identification.engines.engine import MALLEOLUS, Engine, Excitation, stated
from identification.engines.twin import Twin
from identification.periodic import Line, PeriodicProblem
from identification.search import UNSTABLE
from identification.space import DELAY, MASSES, Space


@dataclass(frozen=True)
class Nuisance:
    """One thing that may be true beside the model.

    Attributes:
        name: of the variable. group: what is excluded together (`Known`). unit: of its value, "" for a share.
        mean, std: of the prior. lower, upper: bounds; a half-normal prior has its mean at its lower bound.
        source: where the prior comes from. does: to the recordings.
        logarithmic: mean, std and bounds are of the natural logarithm of the value.
    """

    name: str
    group: str
    unit: str
    mean: float
    std: float
    lower: float
    upper: float
    source: str
    does: str
    logarithmic: bool = False

    def value(self, x: float) -> float:
        """The value in its unit."""
        return float(np.exp(x)) if self.logarithmic else float(x)


_SEGMENTS = "body-segment tables differ by 5 to 11 % between samples"
_NOBODY = "no body mass was given; adults differ by 20 %, segments by another 10 %"
_MOUNT = "a skin-mounted sensor overestimates bone by 12 % at 15 to 30 Hz, J Biomech Eng 115:47 (1993)"
_ROCK = "transverse sensitivity of accelerometers up to 5 %, and a lever arm"
_PAD = "the heel pad loses 30 % of its energy a cycle, Ker (1996)"
#: Default uncertainty of segment masses and gain (shares), and of the delay in samples.
MASS_STD, GAIN_STD, DELAY_STD_SAMPLES = 0.10, 0.01, 0.1
#: The same of the masses where no body mass was given: adults differ by a fifth, and the tables on top. Bounds with it.
UNKNOWN_STD, UNKNOWN_END = 0.30, 1.2
#: Standard deviation of a constant's change under 2.3 kg (share). A pad that stiffens as walkers' heels do (power 2.6)
#: would change by 0.29 from the leg's weight alone, which is 2.6 of these.
LOAD_STD, LOAD_KG = 0.10, 2.3

NUISANCES = (
    Nuisance("shank mass", "masses", "", 0.0, MASS_STD, -0.5, 0.5, _SEGMENTS, "multiplies m_S, without the load", True),
    Nuisance("foot mass", "masses", "", 0.0, MASS_STD, -0.5, 0.5, _SEGMENTS, "multiplies m_F", True),
    Nuisance(
        "gain", "gain", "", 0.0, GAIN_STD, -0.2, 0.2, "calibration certificates state 1 to 3 %",
        "of the malleolus' channel against the base's",
    ),
    Nuisance("delay", "delay", "s", 0.0, 1e-4, -2e-3, 2e-3, "a multiplexed converter", "of the malleolus' channel"),
    Nuisance("drift", "drift", "", 0.0, 0.01, -0.2, 0.2, "as the gain", "of the gain from first to last recording"),
    Nuisance("mount", "mount", "s^2", 0.0, 1e-4, 0.0, 3e-3, _MOUNT, "1 / f^2 of the sensor on its tissue"),
    Nuisance("mount damping", "mount", "", 0.2, 0.1, 0.02, 0.6, _MOUNT, "damping ratio of the sensor on its tissue"),
    Nuisance("relaxing k_T", "relaxation", "", 0.0, 0.35, 0.0, 3.0, _PAD, "share of k_T beside it that relaxes"),
    Nuisance("relaxing k_F", "relaxation", "", 0.0, 0.35, 0.0, 3.0, _PAD, "share of k_F beside it that relaxes"),
    Nuisance(
        "relaxation time", "relaxation", "s", float(np.log(5e-3)), float(np.log(2)), float(np.log(5e-4)),
        float(np.log(5e-2)), "where 10 to 50 Hz see one element", "of both springs", True,
    ),
    Nuisance("rocking", "rocking", "", 0.0, 0.03, -0.5, 0.5, _ROCK, "share of the base that rotation adds"),
    Nuisance(
        "rocking frequency", "rocking", "Hz", float(np.log(60)), 0.2, float(np.log(30)), float(np.log(150)),
        "legs rock at tens of hertz; no measurement is known to us", "of the leg's rotation", True,
    ),
    Nuisance("rocking damping", "rocking", "", 0.1, 0.05, 0.01, 0.5, "as soft tissue", "ratio of the leg's rotation"),
)  # fmt: skip
#: Bends of the dampers, 1/m, and their squares: proper and weak.
_BEND = 200.0
#: How sharply a damper ends where a relaxing spring is all the damping there is.
_SHARP = 20.0
#: Constants of each joint.
_JOINTS = (("k_T", "c_11", "c_12", "c_13"), ("k_F", "c_21", "c_22", "c_23"))
#: Bend of a damper from where a descent is tried, 1/m, and the ways that both may bend.
_BENT = 60.0
_WAYS = ((True, True), (True, False), (False, True), (False, False))
#: Below this square [1/m^2] a damper's c_13 is no different from zero.
_LEAST = 1e-2


def under(name: str, load_kg: float) -> str:
    """Name of the nuisance by which a constant follows a load."""
    return f"{name} under {load_kg:g} kg"


def _of(kind: str, person: str) -> str:
    """Name of the nuisance by which a person's mass is off, where several are pooled."""
    return f"{kind} of {person or 'unnamed'}"


def of_sensor(kind: str, sensor: str) -> str:
    """Name of a nuisance of one accelerometer; that of the malleolus has none to its name."""
    return kind if sensor in MALLEOLUS else f"{kind} of {sensor}"


#: What each sensor has for itself. The leg rocks as one body, so that frequency and damping of its rotation are common
#: to all sensors; how much of it one feels is its lever arm, which is unknown in size and sign and is its own.
_EACH = ("gain", "delay", "drift", "mount", "mount damping", "rocking")


def assumed(recordings: Sequence[Recording], person: str) -> bool:
    """Whether nobody said what a person weighs, so that the model's own masses stand in."""
    return any(r.condition.body_mass_kg is None for r in recordings if r.condition.subject == person)


def nuisances(
    recordings: Sequence[Recording],
    known: Known,
    declared: Sequence[str],
    twin: bool,
    sensors: Sequence[str] = MALLEOLUS,
) -> tuple[Nuisance, ...]:
    """What may be true of these recordings, with what is known of it.

    Args:
        recordings: in the order of the session. known: what a laboratory or a user has said.
        declared: masses that the model declares. twin: the compiled two-mass model stands for the model.
        sensors: that are fitted; all but the malleolus have priors of the same size under names of their own.
    """
    sample = DELAY_STD_SAMPLES / min(r.rate_hz for r in recordings)
    found: list[Nuisance] = []
    for sensor in sensors:
        stated = np.array([gain_and_delay(r, sensor, "base") for r in recordings]).max(axis=0)
        gain, delay = (float(s) if s > 0 else usual for s, usual in zip(stated, (GAIN_STD, sample), strict=True))
        sizes = {
            "masses": MASS_STD if known.mass_std is None else known.mass_std,
            "gain": gain if known.gain_std is None else known.gain_std,
            "delay": delay if known.delay_std_s is None else known.delay_std_s,
        }
        its = NUISANCES if sensor in MALLEOLUS else [each for each in NUISANCES if each.name in _EACH]
        found += [
            replace(
                each, name=of_sensor(each.name, sensor) if each.name in _EACH else each.name,
                std=sizes.get(each.group, each.std), does=each.does.replace("malleolus'", f"{sensor}'"),
            )
            for each in its
        ]  # fmt: skip
    if not twin:  # without the twin's equations only the instrument and the masses can be told
        found = [each for each in found if each.group != "relaxation"]
    shank, foot = bool({"m_S", "m_T"} & set(declared)), "m_F" in declared
    segments = [each for each in found if each.group == "masses" and (shank if "shank" in each.name else foot)]
    people = list(dict.fromkeys(r.condition.subject for r in recordings))
    of_each = []
    for each in segments:
        for person in people:  # a scale and a table are wrong for one person at a time
            own = each if len(people) == 1 else replace(each, name=_of(each.name, person))
            if known.mass_std is None and assumed(recordings, person):
                own = replace(own, std=UNKNOWN_STD, lower=-UNKNOWN_END, upper=UNKNOWN_END, source=_NOBODY)
            of_each.append(own)
    found = of_each + [each for each in found if each.group != "masses"]
    first, *others = sorted({r.condition.added_mass_kg for r in recordings})
    if twin:
        for load in others:
            std = LOAD_STD * (load - first) / LOAD_KG
            text = f"force on a heel grows as deformation to the power 2.6, against {first:g} kg"
            found += [
                Nuisance(under(name, load), "load", "", 0.0, std, -1.0, 1.0, text, f"multiplies {name}", True)
                for name in EXCHANGED
            ]
    return tuple(each for each in found if each.std > 0 and each.group not in known.excluded)


@dataclass(frozen=True, eq=False)
class WorldSpace:
    """Search space of a foot and what else may be true: the constants first, then the nuisances.

    Attributes:
        feet: space of the foot's constants. nuisances: what else may be true. recordings: their conditions count.
        own: values of the model's constants. masses: those where a condition has none. twin: the compiled model stands
            for it, so that its constants may differ from one recording to the next. ratio: of the mirror image, None
            where there is none.
    """

    feet: Space
    nuisances: tuple[Nuisance, ...]
    recordings: Sequence[Recording]
    own: Mapping[str, float]
    masses: Mapping[str, float]
    twin: bool
    ratio: float | None

    @cached_property
    def base(self) -> list[str]:
        """Names of the constants' variables: k_T and k_F are sigma and rho where a mirror is known."""
        return list(self.feet.names)

    @cached_property
    def index(self) -> dict[str, int]:
        """Place of each variable."""
        return {name: i for i, name in enumerate([*self.base, *(each.name for each in self.nuisances)])}

    @cached_property
    def squared(self) -> list[str]:
        """Constants of which the response is even, so that their squares are searched."""
        return [name for name in ("c_13", "c_23") if self.twin and name in self.base]

    @cached_property
    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (n,), (n,) of each variable; infinite where nothing is known before."""
        mean, std = np.zeros(len(self.index)), np.full(len(self.index), np.inf)
        for name in self.base if self.twin else []:
            if name in self.squared:
                std[self.index[name]] = 1.0
            elif name in ("c_12", "c_22"):
                std[self.index[name]] = _BEND / self._scale[self.index[name]]
        for each in self.nuisances:
            mean[self.index[each.name]], std[self.index[each.name]] = each.mean / each.std, 1.0
        return mean, std

    @cached_property
    def _scale(self) -> np.ndarray:
        """What one unit of each variable is: of the logarithm, or in the unit of the constant."""
        scale = self.feet.scale[: len(self.base)]
        own: list[float] = [_BEND**2 if name in self.squared else s for name, s in zip(self.base, scale, strict=True)]
        return np.array([*own, *(each.std for each in self.nuisances)])

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds (n,) of the search variable; sigma and rho may go where k_T and k_F may."""
        p = len(self.base)
        low, high = (limit[:p].copy() for limit in self.feet.bounds)
        for name in self.squared:
            i = self.index[name]
            ends = np.array([self.feet.lower[i], self.feet.upper[i]]) ** 2 / self._scale[i]
            low[i], high[i] = 0.0 if self.feet.lower[i] <= 0 else ends.min(), ends.max()
        if self.ratio is not None:
            T, F, la = self.index["k_T"], self.index["k_F"], np.log(self.ratio)
            (l_T, h_T), (l_F, h_F) = (low[T], high[T]), (low[F], high[F])
            low[T], high[T] = 0.5 * (l_T + l_F), 0.5 * (h_T + h_F)  # sigma
            low[F], high[F] = l_T - h_F - la, h_T - l_F - la  # rho
        scale = self._scale[p:]
        ends_of = np.array([(each.lower, each.upper) for each in self.nuisances]).reshape(-1, 2).T / scale
        return np.concatenate([low, ends_of[0]]), np.concatenate([high, ends_of[1]])

    def side(self, sign: int) -> tuple[np.ndarray, np.ndarray]:
        """The bounds (n,) of one branch: rho above zero (a stiff ankle), or below."""
        low, high = (limit.copy() for limit in self.bounds)
        rho = self.index["k_F"]
        (low if sign > 0 else high)[rho] = 0.0
        return low, high

    # what a problem needs (identification.space.SearchSpace)

    @property
    def lower(self) -> np.ndarray:
        """Lower bounds (n,) of the search variable."""
        return self.bounds[0]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Parameters of a recording's foot: all of the twin's, and the masses where they are estimated."""
        weighed = tuple(self._weighed) if any(each.group == "masses" for each in self.nuisances) else ()
        return (*(NAMES if self.twin else self.feet.names), *weighed)

    @cached_property
    def _weighed(self) -> dict[str, str]:
        """Masses that the model declares -> the nuisance that multiplies them."""
        kinds = {"m_S": "shank mass", "m_T": "shank mass", "m_F": "foot mass"}
        return {name: kinds[name] for name in MASSES if name in kinds and name in self.masses}

    @cached_property
    def kinds(self) -> dict[str, list[str]]:
        """Masses that the model declares -> the nuisance that multiplies them in each recording, one a person."""
        people = [recording.condition.subject for recording in self.recordings]
        several = len(set(people)) > 1
        return {
            name: [_of(kind, person) if several else kind for person in people] for name, kind in self._weighed.items()
        }

    @cached_property
    def _its(self) -> dict[str, dict[str, np.ndarray]]:
        """Of each mass, the recordings (R,) that each nuisance multiplies it in."""
        return {
            name: {kind: np.array([kind == each for each in kinds]) for kind in dict.fromkeys(kinds)}
            for name, kinds in self.kinds.items()
        }

    has_delay = False

    def stated(self, number: int) -> dict[str, float]:
        """Masses of one recording as they were stated, without the load [kg]; the model's own where none were."""
        condition = self.recordings[number].condition
        bare = replace(condition, added_mass_kg=0.0).masses
        return {name: bare.get(name, self.masses[name]) for name in self._weighed}

    def of(self, q: np.ndarray, name: str) -> float:
        """A nuisance at q (n,): its value, or its logarithm; where it is left out, what the model says of it."""
        i = self.index.get(name)
        return 0.0 if i is None else float(q[i] * self._scale[i])

    def limits(self, name: str) -> tuple[float, float]:
        """Bounds of a nuisance, of its logarithm where it has one."""
        return next((each.lower, each.upper) for each in self.nuisances if each.name == name)

    def slope(self, name: str) -> float:
        """Its derivative to the search variable."""
        return float(self._scale[self.index[name]])

    @cached_property
    def _about(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Of each recording (R,): place of its load, angular frequency [rad/s], load [kg], masses without load [kg]."""
        conditions = [recording.condition for recording in self.recordings]
        loads = [c.added_mass_kg for c in conditions]
        rank = {load: i for i, load in enumerate(sorted(set(loads)))}
        each = [self.stated(i) for i in range(len(conditions))]
        stated = {name: np.array([masses[name] for masses in each]) for name in self._weighed}
        on_knee = np.array([load if c.masses else 0.0 for load, c in zip(loads, conditions, strict=True)])
        w = np.array([2 * np.pi * (c.frequency_hz or 0.0) for c in conditions])
        return np.array([rank[load] for load in loads]), w, on_knee, stated

    def _unloaded(self, q: np.ndarray) -> dict[str, tuple[float, np.ndarray]]:
        """The foot's constants by name under the smallest load, and their derivatives (n,) to q."""
        found: dict[str, tuple[float, np.ndarray]] = {}
        for name in NAMES if self.twin else self.base:
            i, row = self.index.get(name), np.zeros(q.size)
            if i is None:
                found[name] = float(self.feet.fixed[name]), row
                continue
            if self.ratio is not None and name in ("k_T", "k_F"):
                half = 0.5 if name == "k_T" else -0.5
                sigma, rho = self.index["k_T"], self.index["k_F"]
                value = float(np.exp(q[sigma] + half * (q[rho] + np.log(self.ratio))))
                row[sigma], row[rho] = value, half * value
            elif name in self.squared:
                value = float(np.sqrt(max(q[i] * self._scale[i], _LEAST)))
                row[i] = 0.5 / value * self._scale[i]
            elif self.feet.free[i].logarithmic:
                value = float(np.exp(q[i]))
                row[i] = value
            else:
                value, row[i] = float(q[i] * self._scale[i]), self._scale[i]
            found[name] = value, row
        for k, c, *_ in _JOINTS if "relaxation time" in self.index else ():
            if k in self.index and c in self.index:
                self._rest(q, k, c, found)
        return found

    def _rest(self, q: np.ndarray, k: str, c: str, found: dict[str, tuple[float, np.ndarray]]) -> None:
        """Replace stiffness and damping of a relaxing joint in the middle of the band, as searched, by those at rest.

        What the recordings know best is then a variable of its own, whatever the spring's share that relaxes. The
        damper is what that leaves, and more than none.
        """
        (K, dK), (C, dC), name = found[k], found[c], f"relaxing {k}"
        r, tau, w = self.of(q, name), np.exp(self.of(q, "relaxation time")), self._middle
        by_r, by_tau = np.zeros((2, q.size))
        by_r[self.index[name]], by_tau[self.index["relaxation time"]] = self.slope(name), self.slope("relaxation time")
        x = w * tau
        real, imaginary = x * x / (1 + x * x), tau / (1 + x * x)
        dreal, dimaginary = 2 * x * x / (1 + x * x) ** 2, imaginary * (1 - x * x) / (1 + x * x)  # to ln tau
        above = 1 + r * real
        rest = K / above
        drest = dK / above - rest / above * (real * by_r + r * dreal * by_tau)
        added = rest * r * imaginary
        dadded = drest * r * imaginary + rest * (imaginary * by_r + r * dimaginary * by_tau)
        share = 1 - added / C
        left = max(float(np.logaddexp(0.0, _SHARP * share)) / _SHARP, 1e-9)
        dleft = (added / C**2 * dC - dadded / C) / (1 + np.exp(-np.clip(_SHARP * share, -500, 500)))
        found[k], found[c] = (rest, drest), (C * left, dC * left + C * dleft)

    @cached_property
    def _middle(self) -> float:
        """Middle of the recorded band [rad/s]."""
        return float(np.exp(np.mean(np.log(np.maximum(self._about[1], 1e-9)))))

    def constants(self, q: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """The foot's constants (R,) by name under the load of each recording, and their derivatives (R, n) to q."""
        at_load = self._about[0]
        loads = sorted({recording.condition.added_mass_kg for recording in self.recordings})
        found: dict[str, np.ndarray] = {}
        slopes: dict[str, np.ndarray] = {}
        for name, (value, row) in self._unloaded(q).items():
            more = np.exp([self.of(q, under(name, load)) for load in loads])
            values, rows = value * more, more[:, None] * row
            for k, load in enumerate(loads):
                if under(name, load) in self.index:
                    rows[k, self.index[under(name, load)]] += values[k] * self.slope(under(name, load))
            found[name], slopes[name] = values[at_load], rows[at_load]
        return found, slopes

    def weights(self, q: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """The segments' masses (R,) of each recording, with its load [kg], and their derivatives (R, n) to q."""
        _, _, on_knee, stated = self._about
        found = {}
        for name, each in stated.items():
            segment, slope = each.copy(), np.zeros((each.size, q.size))
            for kind, its in self._its[name].items():
                segment[its] *= np.exp(self.of(q, kind))
                if kind in self.index:
                    slope[its, self.index[kind]] = segment[its] * self.slope(kind)
            found[name] = (segment if name == "m_F" else segment + on_knee, slope)
        return found

    def everywhere(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters (R, p) of each recording's foot, and their derivatives (R, p, n) to q."""
        key = q.tobytes()
        if key not in self._kept:
            found, slopes = self.constants(q)
            if "relaxation time" in self.index:
                for joint in _JOINTS:
                    self._relax(q, joint, found, slopes)
            for name, (mass, slope) in self.weights(q).items():
                found[name], slopes[name] = mass, slope
            self._kept.clear()
            theta, slope = (np.stack([each[name] for name in self.names], axis=1) for each in (found, slopes))
            self._kept[key] = theta, slope
        return self._kept[key]

    def all_of(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All the twin's constants and both masses (R, 10) of each recording, and their derivatives (R, 10, n)."""
        theta, slope = self.everywhere(q)
        if theta.shape[1] > len(NAMES):
            return theta, slope
        masses = [self.weights(q)[name] for name in ("m_S", "m_F")]
        return (
            np.column_stack([theta, *(mass for mass, _ in masses)]),
            np.concatenate([slope, *(d[:, None] for _, d in masses)], axis=1),
        )

    def at(self, number: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters (p,) of one recording's foot, and their derivatives (p, n) to q."""
        theta, slope = self.everywhere(q)
        return theta[number], slope[number]

    @cached_property
    def _kept(self) -> dict[bytes, tuple[np.ndarray, np.ndarray]]:
        return {}

    def _relax(
        self,
        q: np.ndarray,
        joint: tuple[str, str, str, str],
        found: dict[str, np.ndarray],
        slopes: dict[str, np.ndarray],
    ) -> None:
        """Replace a joint whose spring relaxes by the constants that move alike at the fundamentals w.

        The spring is K(i w) = k (1 + r i w tau / (1 + i w tau)): at w it adds stiffness and damping, and the added
        damping does not bend.
        """
        (k, dk), (c, dc), (c2, d2), (c3, d3) = ((found[name], slopes[name]) for name in joint)
        name = f"relaxing {joint[0]}"
        r, by_r, by_tau = self.of(q, name), self.index[name], self.index["relaxation time"]
        tau, r_slope, tau_slope = np.exp(self.of(q, "relaxation time")), self.slope(name), self.slope("relaxation time")
        x = self._about[1] * tau
        real, imaginary = x * x / (1 + x * x), tau / (1 + x * x)
        by_log = (2 * x * x / (1 + x * x) ** 2, imaginary - 2 * x * x * imaginary / (1 + x * x))
        stiff, more = k * (1 + r * real), k * r * imaginary
        dstiff, dmore = dk * (1 + r * real)[:, None], dk * (r * imaginary)[:, None]
        dstiff[:, by_r] += k * real * r_slope
        dstiff[:, by_tau] += k * r * by_log[0] * tau_slope
        dmore[:, by_r] += k * imaginary * r_slope
        dmore[:, by_tau] += k * r * by_log[1] * tau_slope
        damp, ddamp = c + more, dc + dmore
        s, ds = c / damp, dc / damp[:, None] - ddamp * (c / damp**2)[:, None]
        bend, dbend = s * c2, s[:, None] * d2 + c2[:, None] * ds
        flat = c2**2 - c3**2
        square = bend**2 - s * flat
        wave = np.sqrt(np.maximum(square, _LEAST))
        dsquare = (
            2 * bend[:, None] * dbend - ds * flat[:, None] - (2 * s)[:, None] * (c2[:, None] * d2 - c3[:, None] * d3)
        )
        dwave = np.where((square > _LEAST)[:, None], dsquare / (2 * wave)[:, None], 0.0)
        pairs = ((stiff, dstiff), (damp, ddamp), (bend, dbend), (wave, dwave))
        for name, (value, slope) in zip(joint, pairs, strict=True):
            found[name], slopes[name] = value, slope

    def values(self, theta: np.ndarray) -> dict[str, float]:
        """All parameter values of a foot by name, from those of the space (p,)."""
        return {**self.feet.fixed, **self.masses, **dict(zip(self.names, map(float, theta), strict=True))}

    def to_q(self, theta: np.ndarray) -> np.ndarray:
        """Variables (n,) are searched as they are reported."""
        return np.clip(theta, *self.bounds)

    def to_theta(self, q: np.ndarray) -> np.ndarray:
        """Variables (n,) are reported as they are searched."""
        return q

    def at_bound(self, theta: np.ndarray) -> np.ndarray:
        """Which variables (n,) rest on a bound."""
        low, high = self.bounds
        return np.minimum(theta - low, high - theta) < 1e-4 * (high - low)

    # from the narrow fit and back

    def start(self, values: Mapping[str, float]) -> np.ndarray:
        """Search variable (n,) of constants by name, with every nuisance where its prior is centred.

        A narrow fit that a wrong model has driven to bounds is no place to start: bends are taken no larger than the
        prior has them, and what rests on a bound starts where the model itself has it.
        """
        mean, _ = self.prior
        values = {**values, **self._inside(values)}
        q = np.where(np.isfinite(mean), mean, 0.0)
        theta = np.array([values.get(item.name, 0.0) for item in self.feet.free])
        q[: len(self.base)] = self.feet.to_q(theta)[: len(self.base)]
        for name in self.squared:
            q[self.index[name]] = values[name] ** 2 / self._scale[self.index[name]]
        if self.ratio is not None:
            T, F = self.index["k_T"], self.index["k_F"]
            ankle, pad = q[T], q[F]
            q[T], q[F] = 0.5 * (ankle + pad), ankle - pad - np.log(self.ratio)
        return np.clip(q, *self.bounds)

    def _inside(self, values: Mapping[str, float]) -> dict[str, float]:
        """Better starts of constants whose values are no good ones."""
        found = {}
        theta = np.array([values.get(item.name, 0.0) for item in self.feet.free])
        for item, rests in zip(self.feet.free, self.feet.at_bound(theta), strict=True):
            if item.name in ("c_12", "c_13", "c_22", "c_23") and self.twin:
                found[item.name] = float(np.clip(values[item.name], -_BEND, _BEND))
            elif rests and item.name in self.own:
                found[item.name] = self.own[item.name]
        return found

    def heavier(self, q: np.ndarray, share: float) -> np.ndarray:
        """The same motion without load (n,) of a leg whose segments are heavier by a share (of the logarithm)."""
        q = q.copy()
        for name in {kind for kinds in self.kinds.values() for kind in kinds} & set(self.index):
            q[self.index[name]] += share / self.slope(name)
        for name in ("c_11", "c_21", *(["k_T"] if self.ratio is not None else ["k_T", "k_F"])):
            if name in self.index:
                q[self.index[name]] += share
        return np.clip(q, *self.bounds)

    def bent(self, q: np.ndarray) -> list[np.ndarray]:
        """The same leg (n,) with dampers that bend the other ways: each has a descent of its own."""
        if not self.bends:
            return []
        own = tuple(bool(q[self.index[name]] > 0) for name in ("c_12", "c_22"))
        return [self._bending(q, ways) for ways in _WAYS if ways != own]

    @property
    def bends(self) -> bool:
        """Whether it is searched how both dampers bend."""
        return self.twin and {"c_12", "c_22"} <= set(self.base)

    def _bending(self, q: np.ndarray, ways: tuple[bool, bool]) -> np.ndarray:
        q = q.copy()
        for name, up in zip(("c_12", "c_22"), ways, strict=True):
            q[self.index[name]] = (_BENT if up else -_BENT) / self._scale[self.index[name]]
        for name in self.squared:
            q[self.index[name]] = _BENT**2 / self._scale[self.index[name]]
        return np.clip(q, *self.bounds)

    def fresh(self, q: np.ndarray, rho: float) -> list[np.ndarray]:
        """Places (n,) where nothing is known but how stiff the leg is as a whole, as q has it.

        Nuisances are where their priors are centred, both dampers are alike, and bend each of the four ways.

        Args:
            q: (n,). rho: how far apart the springs are, its sign the branch.
        """
        assert self.ratio is not None
        mean, _ = self.prior
        p, q = len(self.base), q.copy()
        q[p:] = mean[p:]
        q[self.index["k_F"]] = rho
        if {"c_11", "c_21"} <= set(self.base):
            ankle, pad = self.index["c_11"], self.index["c_21"]
            q[ankle] = q[pad] = 0.5 * (q[ankle] + q[pad])
        return [self._bending(q, ways) for ways in _WAYS] if self.bends else [np.clip(q, *self.bounds)]

    def image(self, q: np.ndarray) -> np.ndarray:
        """The mirror image (n,) of q: the two joints change places, with what they do besides."""
        assert self.ratio is not None
        q, la = q.copy(), np.log(self.ratio)
        ankle, pad = self.index["c_11"], self.index["c_21"]
        q[self.index["k_F"]] *= -1
        q[ankle], q[pad] = q[pad] + la, q[ankle] - la
        pairs = [("c_12", "c_22"), ("c_13", "c_23"), ("relaxing k_T", "relaxing k_F")]
        loads = {name.split(" under ")[1] for name in self.index if " under " in name}
        for load in loads:
            pairs += [(f"k_T under {load}", f"k_F under {load}"), (f"c_11 under {load}", f"c_21 under {load}")]
        for a, b in pairs:
            if a in self.index and b in self.index:
                i, j = self.index[a], self.index[b]
                q[i], q[j] = q[j], q[i]
        return np.clip(q, *self.bounds)

    def estimates(self, q: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, ...]:
        """The foot's constants as the fit reports them, of q (n,) with the covariance C (n, n).

        Returns:
            Values (p,), standard errors (p,), limits of 95 % (p,), (p,), and the correlation (p, p). What is squared
            has limits of its own; a delay that is known to be none has neither.
        """
        feet, p = self.feet, len(self.feet.free)
        rows, z, unloaded = np.zeros((p, q.size)), np.zeros(p), self._unloaded(q)
        for i, item in enumerate(feet.free):
            j = self.index.get(item.name if item.places else _nuisance_of(item))
            if j is None:
                continue
            if item.logarithmic:
                value, slope = unloaded[item.name]
                rows[i], z[i] = slope / value, np.log(value)
            else:
                rows[i, j] = self._scale[j] / feet.scale[i] if not item.places else 1.0
                z[i] = rows[i, j] * q[j]
        known = np.isfinite(C).all(axis=1)
        blind = (rows[:, ~known] != 0).any(axis=1)
        covariance = rows[:, known] @ C[np.ix_(known, known)] @ rows[:, known].T
        std = np.where(blind, np.inf, np.sqrt(np.diag(covariance)))
        with np.errstate(invalid="ignore", divide="ignore"):
            correlation = np.nan_to_num(covariance / np.outer(std, std))
        limits: dict[int, np.ndarray] = {}
        for name in self.squared:
            i = j = self.index[name]
            square, spread = q[j] * self._scale[j], std[i] * self._scale[j]
            limits[i] = np.sqrt(np.clip([square - _Z95 * spread, square + _Z95 * spread], 0.0, feet.upper[i] ** 2))
            z[i] = 0.0 if square < 1e-2 * spread else np.sqrt(square) / feet.scale[i]
            std[i] = (limits[i][1] - limits[i][0]) / (2 * _Z95) / feet.scale[i]
        theta = np.clip(feet.to_theta(z), feet.lower, feet.upper)
        low, high = feet.interval(theta, std)
        for i, (least, most) in limits.items():
            low[i], high[i] = least, most
        return theta, std * feet.slope(theta), low, high, correlation


_Z95 = 1.959963984540054


def _nuisance_of(item: Parameter) -> str:
    """The nuisance that a delay of the narrow fit is in the wide one."""
    return of_sensor(DELAY.name, item.name.removeprefix(DELAY.name).lstrip("_") or MALLEOLUS[0])


class WorldProblem(PeriodicProblem):
    """The steady-state problem with everything else that may be true; a row of the residual for each prior.

    Args:
        lines: the measured harmonics. engine: of drives without masses, which the space gives. space: see `WorldSpace`.
        weights: the problem whose weights are taken over.
    """

    def __init__(
        self, lines: Sequence[Line], engine: Engine[Excitation], space: WorldSpace, weights: PeriodicProblem
    ) -> None:
        super().__init__(lines, engine, space, tolerance=1e-4)
        self.world = space
        self._whiten = weights._whiten

    def _shared_errors(self, amplitudes: Sequence[np.ndarray]) -> np.ndarray:
        return np.zeros((sum(2 * Y.size for Y in amplitudes), 0))  # gain and delay are estimated here

    def prior_rows(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual (k,) and derivatives (k, n) of what is known before."""
        mean, std = self.world.prior
        has = np.isfinite(std)
        return ((q - mean) / std)[has], np.diag(1 / std)[has]

    def _evaluate(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, J = super()._evaluate(q)
        rows, slopes = self.prior_rows(q)
        if (r == UNSTABLE).all():
            rows = np.full(rows.size, UNSTABLE)
        return np.concatenate([r, rows]), np.concatenate([J, slopes])

    def chi(self, q: np.ndarray) -> float:
        """Chi-square of the recordings alone, at q (n,)."""
        r = self.residual(q)[: self.size]
        return float(r @ r)

    def response(self, number: int, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Model harmonics (k H,) of one recording and their derivatives (k H, n); the third is the identity."""
        return *self.responses(z)[number], np.eye(z.size)

    def responses(self, z: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """See `PeriodicProblem`; what a sensor adds to its motion is computed for all recordings at once."""
        parts: list[dict[str, tuple[np.ndarray, np.ndarray]]] = [{} for _ in self.lines]
        for name, (Y, J) in self._motions(z).items():
            Y, J = self._sensed(name, z, Y, J)
            end = 0
            for i in self._having[name]:
                begin, end = end, end + self.lines[i].count
                parts[i][name] = Y[begin:end], J[begin:end]
        both = ([part[name] for name in line.sensors] for line, part in zip(self.lines, parts, strict=True))
        return [(np.concatenate([Y for Y, _ in each]), np.concatenate([J for _, J in each])) for each in both]

    @cached_property
    def _having(self) -> dict[str, list[int]]:
        """The recordings that have a sensor, for each sensor."""
        names = dict.fromkeys(name for line in self.lines for name in line.sensors)
        return {name: [i for i, line in enumerate(self.lines) if name in line.sensors] for name in names}

    @cached_property
    def _drives(self) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Frequencies [Hz] and base harmonics (N,) that a sensor's recordings have, and their place in the session."""
        found = {}
        for name, numbers in self._having.items():
            lines = [self.lines[i] for i in numbers]
            f = [line.base.frequency_hz * np.arange(1, line.count + 1) for line in lines]
            place = np.array(numbers) / max(1, len(self.lines) - 1) - 0.5
            U = np.concatenate([line.base.amplitudes for line in lines])
            found[name] = np.concatenate(f), U, np.repeat(place, [line.count for line in lines])
        return found

    def _sensed(self, sensor: str, z: np.ndarray, Y: np.ndarray, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What one sensor reads (N,) where the model's foot moves by Y (N,), and the derivatives (N, n)."""
        world, (f, U, place) = self.world, self._drives[sensor]
        gain, delay, drift, mount, mount_damping, rocking = (of_sensor(kind, sensor) for kind in _EACH)
        if rocking in world.index:
            size, zeta = world.of(z, rocking), world.of(z, "rocking damping")
            own = np.exp(world.of(z, "rocking frequency"))
            below = own**2 - f**2 + 2j * zeta * own * f
            Y = Y - size * U * f**2 / below
            J[:, world.index[rocking]] -= U * f**2 / below * world.slope(rocking)
            more = size * U * f**2 / below**2
            by_frequency = more * (2 * own**2 + 2j * zeta * own * f)
            J[:, world.index["rocking frequency"]] += by_frequency * world.slope("rocking frequency")
            J[:, world.index["rocking damping"]] += more * 2j * own * f * world.slope("rocking damping")
        if mount in world.index:
            u, zeta = max(world.of(z, mount), 0.0), world.of(z, mount_damping)
            above_ = 1 + 2j * zeta * f * np.sqrt(u)
            below = above_ - f**2 * u
            M = above_ / below
            J *= M[:, None]
            J[:, world.index[mount]] += Y * f**2 * (1 + 1j * zeta * f * np.sqrt(u)) / below**2 * world.slope(mount)
            by_zeta = 2j * f * np.sqrt(u) * (below - above_) / below**2
            J[:, world.index[mount_damping]] += Y * by_zeta * world.slope(mount_damping)
            Y = Y * M
        late = 2j * np.pi * f
        turn = np.exp(-late * world.of(z, delay))
        factor = (1 + world.of(z, gain) + world.of(z, drift) * place) * turn
        J *= factor[:, None]
        for name, by in ((gain, turn), (drift, place * turn), (delay, -late * factor)):
            if name in world.index:
                J[:, world.index[name]] += Y * by * world.slope(name)
        return Y * factor, J

    def start(self, q: np.ndarray) -> np.ndarray:
        """See `PeriodicProblem`."""
        if self._orbits is not None:
            self._orbits.forget()
        return super().start(q)

    @cached_property
    def _orbits(self) -> Orbits | None:
        """Orbits of all recordings at once, where the twin stands for the model."""
        if not (isinstance(self.engine, Twin) and self.world.twin):
            return None
        return Orbits(self.engine, [line.count for line in self.lines], self.tolerance)

    def _motions(self, z: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Harmonics (N,) of each sensor's recordings without what the instrument adds, and derivatives (N, n) to z."""
        counts, having = [line.count for line in self.lines], self._having
        if self._orbits is None:
            each: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {name: [] for name in having}
            for i, line in enumerate(self.lines):
                Y, DY, slope = super().response(i, z)
                J = DY @ slope.astype(complex)
                for k, name in enumerate(line.sensors):
                    rows = slice(k * line.count, (k + 1) * line.count)
                    each[name].append((Y[rows], J[rows]))
            return {n: (np.concatenate([Y for Y, _ in a]), np.concatenate([J for _, J in a])) for n, a in each.items()}
        theta, slope = self.world.all_of(z)
        found = self._orbits(theta)
        if found is None:
            first = dict(zip(self.world.names, self.world.at(0, z)[0], strict=True))
            raise SimulationError(f"no periodic motion with {stated(self.engine.foot, first)}.")
        Y, J = found[0], np.einsum("sij,ijk->sik", found[1], np.repeat(slope, counts, axis=0))
        if "relaxation time" in self.world.index:
            Y, J = self._relaxed(z, Y, J)
        engine, whose = self.engine, np.repeat(np.arange(len(counts)), counts)
        assert isinstance(engine, Twin)
        moved = {}
        for name, numbers in having.items():
            on, kept = int(engine.on_foot[engine.sensors.index(name)]), np.isin(whose, numbers)
            moved[name] = Y[on][kept], J[on][kept]
        return moved

    def _relaxed(self, z: np.ndarray, Y: np.ndarray, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Harmonics of shank and foot on springs that relax, from those on springs right at the fundamental.

        The constants of `WorldSpace.at` are right at the fundamental alone. What dampers that bend, and the base, put
        into a harmonic above it is the force that holds the motion there; the same force on the springs as they are at
        that harmonic gives the motion.

        Args:
            z: (n,). Y: (2, N) accelerations, recordings behind each other. J: (2, N, n) derivatives.
        """
        world, counts = self.world, [line.count for line in self.lines]
        whose = np.repeat(np.arange(len(counts)), counts)
        h = np.concatenate([np.arange(1, count + 1) for count in counts])
        s = 2j * np.pi * h * np.array([line.base.frequency_hz for line in self.lines])[whose]
        theta, slope = world.everywhere(z)
        mapped = {name: (theta[whose, i], slope[whose, i]) for i, name in enumerate(world.names)}
        plain, slopes = world.constants(z)
        tau, by_tau = np.exp(world.of(z, "relaxation time")), world.index["relaxation time"]
        x = s * tau
        exact, alike = [], []
        for k, c in (("k_T", "c_11"), ("k_F", "c_21")):
            k0, dk, c0, dc = plain[k][whose], slopes[k][whose], plain[c][whose], slopes[c][whose]
            name = f"relaxing {k}"
            r = world.of(z, name)
            d = (1 + r * x / (1 + x))[:, None] * dk + s[:, None] * dc
            d[:, world.index[name]] += k0 * x / (1 + x) * world.slope(name)
            d[:, by_tau] += k0 * r * x / (1 + x) ** 2 * world.slope("relaxation time")
            exact.append((k0 * (1 + r * x / (1 + x)) + c0 * s, d))
            (k1, dk), (c1, dc) = mapped[k], mapped[c]
            alike.append((k1 + c1 * s, dk + s[:, None] * dc))
        masses = [(mass[whose], slope[whose]) for mass, slope in (world.weights(z)[name] for name in ("m_S", "m_F"))]
        base = np.concatenate([line.base.amplitudes for line in self.lines])
        f, df = _force(s, alike, masses, Y - base, J)
        (a, _), (b, _) = exact
        u, v = masses[0][0] * s**2 + a, masses[1][0] * s**2 + a + b
        below = u * v - a * a
        over = np.stack([v * f[0] + a * f[1], a * f[0] + u * f[1]]) / below
        rest = df - _force(s, exact, masses, over, np.zeros_like(J))[1]
        v, a, u, below = v[:, None], a[:, None], u[:, None], below[:, None]
        return base + over, np.stack([v * rest[0] + a * rest[1], a * rest[0] + u * rest[1]]) / below


def _force(
    s: np.ndarray,
    springs: Sequence[tuple[np.ndarray, np.ndarray]],
    masses: Sequence[tuple[np.ndarray, np.ndarray]],
    y: np.ndarray,
    dy: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """s^2 times the forces (2, N) that move two masses on complex springs by y / s^2, and their derivatives (2, N, n).

    Args:
        s: (N,) i w [rad/s]. springs: stiffness (N,) and derivatives (N, n) of ankle and pad. masses: of shank and foot.
        y, dy: accelerations over the base (2, N), and their derivatives (2, N, n).
    """
    ((a, da), (b, db)), (shank, foot) = springs, masses
    m_S, m_F = shank[0] * s**2, foot[0] * s**2 + b
    apart, dapart = y[0] - y[1], dy[0] - dy[1]
    joint, djoint = a * apart, a[:, None] * dapart + apart[:, None] * da
    f = np.stack([m_S * y[0] + joint, m_F * y[1] - joint])
    df = np.stack([
        m_S[:, None] * dy[0] + (s**2 * y[0])[:, None] * shank[1] + djoint,
        m_F[:, None] * dy[1] + (s**2 * y[1])[:, None] * foot[1] + y[1][:, None] * db - djoint,
    ])  # fmt: skip
    return f, df
