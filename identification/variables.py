"""The variables of the one problem: constants of the foot and nuisances, their priors, and what they make of a foot.

The branch is the sign of rho: ln k_T = sigma + (rho + ln a) / 2 and ln k_F = sigma - (rho + ln a) / 2 with
a = m_S / (m_S + m_F) of the stated masses, so that each mirror image has its own half of the space. The response is
even in c_13 and c_23, whose squares are the variables. A relaxing spring is searched by its dynamic stiffness at the
reference frequency, the geometric mean of the recorded ones, which is what recordings know best.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fasbody.foot.two_mass import PARAMETERS
from fasbody.recording.recording import Recording
from identification.branches import EXCHANGED, SPRING_OF
from identification.nuisances import Nuisance
from identification.parameters import MASSES, Space

#: Bends of the dampers [1/m] that a foot may have, one standard deviation.
_BEND = 200.0
#: A damper's size, one standard deviation of its logarithm about the model's own.
_DAMPER_STD = 1.5
#: Least c_13 [1/m]: the response is even in it, so its slope to the square is taken here.
_LEAST_BEND = 0.1
_SHANK = ("m_S", "m_T")
_STEP = 1e-7


@dataclass(frozen=True, eq=False)
class Variables:
    """Search variables (n,): the constants first, then the nuisances, each in units of its scale.

    Attributes:
        space: the free constants, with bounds, and the values of the others.
        nuisances: what else may be true.
        recordings: in the order of the session.
        model_values: the model's own values, masses among them.
        two_mass: the model is the two-mass foot.
        ratio: a of the mirror image, None where there is none.
    """

    space: Space
    nuisances: tuple[Nuisance, ...]
    recordings: Sequence[Recording]
    model_values: Mapping[str, float]
    two_mass: bool
    ratio: float | None

    # what they are

    @cached_property
    def constants(self) -> tuple[str, ...]:
        """Names of the free constants, in the order of the variables."""
        return self.space.names

    @cached_property
    def index(self) -> dict[str, int]:
        """Place of each constant; k_T and k_F stand for sigma and rho where there is a mirror."""
        return {name: i for i, name in enumerate(self.constants)}

    @property
    def size(self) -> int:
        """Number n of variables."""
        return len(self.constants) + len(self.nuisances)

    def place(self, nuisance: Nuisance) -> int:
        """Where a nuisance stands among the variables."""
        return len(self.constants) + self.nuisances.index(nuisance)

    @cached_property
    def numbered(self) -> list[tuple[int, Nuisance]]:
        """Each nuisance with its place among the variables."""
        return list(enumerate(self.nuisances, len(self.constants)))

    @cached_property
    def _places(self) -> dict[tuple[str, str, str], int]:
        return {(item.kind, item.constant, item.sensor): i for i, item in self.numbered}

    def of_kind(self, kind: str, constant: str = "", sensor: str = "") -> int | None:
        """Where the nuisance of a kind stands that belongs to a constant or to a sensor; None where it is held."""
        return self._places.get((kind, constant, sensor))

    @cached_property
    def _squared(self) -> frozenset[str]:
        return frozenset({"c_13", "c_23"} & set(self.constants)) if self.two_mass else frozenset()

    @cached_property
    def _item(self) -> dict[str, int]:
        return {item.name: i for i, item in enumerate(self.space.free)}

    @cached_property
    def scale(self) -> np.ndarray:
        """(n,) what one unit of each variable is, of the value or of its logarithm."""
        scale = [
            1.0 if self.space.free[i].logarithmic else _BEND**2 if name in self._squared
            else _BEND if self.two_mass else float(self.space.scale[i])
            for name in self.constants for i in [self._item[name]]
        ]  # fmt: skip
        return np.array([*scale, *(item.std for item in self.nuisances)])

    @cached_property
    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (n,), (n,) of each variable; infinite where nothing is known before."""
        mean, std = np.zeros(self.size), np.full(self.size, np.inf)
        for name, i in self.index.items() if self.two_mass else ():
            if name in ("c_11", "c_21"):
                mean[i], std[i] = np.log(self.model_values[name]), _DAMPER_STD
            elif name in ("c_12", "c_22", *self._squared):
                std[i] = 1.0
        for i, item in self.numbered:
            mean[i], std[i] = item.mean / item.std, 1.0
        return mean, std

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (n,); sigma and rho may go where k_T and k_F may."""
        low, high = np.empty(self.size), np.empty(self.size)
        for name, i in self.index.items():
            ends = np.array([self.space.lower[self._item[name]], self.space.upper[self._item[name]]])
            if name in self._squared:
                low[i] = 0.0 if ends[0] <= 0 else ends[0] ** 2 / self.scale[i]
                high[i] = ends.max() ** 2 / self.scale[i]
            elif self.space.free[self._item[name]].logarithmic:
                low[i], high[i] = np.log(ends)
            else:
                low[i], high[i] = ends / self.scale[i]
        if self.ratio is not None:
            T, F, la = self.index["k_T"], self.index["k_F"], np.log(self.ratio)
            (l_T, h_T), (l_F, h_F) = (low[T], high[T]), (low[F], high[F])
            low[T], high[T] = 0.5 * (l_T + l_F), 0.5 * (h_T + h_F)  # sigma
            low[F], high[F] = l_T - h_F - la, h_T - l_F - la  # rho
        for i, item in self.numbered:
            low[i], high[i] = item.lower / item.std, item.upper / item.std
        return low, high

    def outside(self, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far the logarithms of k_T and k_F lie outside their bounds (C, k) at Q (C, n), and derivatives (C, k, n).

        Nothing, k = 0, where they are searched themselves: their bounds are then those of the search variable.
        """
        if self.ratio is None:
            return np.zeros((len(Q), 0)), np.zeros((len(Q), 0, self.size))
        beyond, slopes = np.zeros((len(Q), 2)), np.zeros((len(Q), 2, self.size))
        for row, (name, half) in enumerate((("k_T", 0.5), ("k_F", -0.5))):
            ends = np.log([limit[self._item[name]] for limit in (self.space.lower, self.space.upper)])
            x = np.log(self._constant(Q, name))
            beyond[:, row] = x - np.clip(x, *ends)
            slopes[:, row, [self.index["k_T"], self.index["k_F"]]] = (beyond[:, row] != 0)[:, None] * [1.0, half]
        return beyond, slopes

    def side(self, sign: int) -> tuple[np.ndarray, np.ndarray]:
        """The bounds (n,) of one side of the mirror: rho above zero for 1, below for -1, all for 0."""
        low, high = (limit.copy() for limit in self.bounds)
        if sign:
            (low if sign > 0 else high)[self.index["k_F"]] = 0.0
        return low, high

    def held(self, kinds: Sequence[str]) -> np.ndarray:
        """(n,) which nuisances of these kinds are held at the mean of their priors."""
        mask = np.zeros(self.size, bool)
        mask[len(self.constants) :] = [item.kind in kinds for item in self.nuisances]
        return mask

    # what a recording is made under

    @cached_property
    def loads(self) -> np.ndarray:
        """(R,) load on the knee [kg]."""
        return np.array([recording.condition.added_mass_kg for recording in self.recordings])

    @cached_property
    def omega(self) -> np.ndarray:
        """(R,) angular frequency [rad/s]."""
        return 2 * np.pi * np.array([recording.condition.frequency_hz or np.nan for recording in self.recordings])

    @cached_property
    def reference_hz(self) -> float:
        """Geometric mean of the recorded frequencies [Hz], at which dynamic stiffness and damping are reported."""
        return float(np.exp(np.mean(np.log(self.omega))) / (2 * np.pi))

    @cached_property
    def place_in_session(self) -> np.ndarray:
        """(R,) from -0.5 for the first recording to 0.5 for the last."""
        count = len(self.recordings)
        return np.arange(count) / max(1, count - 1) - 0.5

    @cached_property
    def stated(self) -> dict[str, np.ndarray]:
        """(R,) masses [kg] that the model declares, without the load; the model's own where nobody stated any."""
        bare = [replace(recording.condition, added_mass_kg=0.0).masses for recording in self.recordings]
        names = [name for name in MASSES if name in self.model_values and name != "added_mass"]
        return {name: np.array([m.get(name, self.model_values[name]) for m in bare]) for name in names}

    def _acts(self, item: Nuisance) -> np.ndarray:
        """(R,) in which recordings a nuisance acts."""
        acts = np.ones(len(self.recordings), bool)
        if item.person is not None:
            acts &= [recording.condition.subject == item.person for recording in self.recordings]
        if item.load_kg is not None:
            acts &= self.loads == item.load_kg
        if item.seating:
            acts &= [recording.condition.seating == item.seating for recording in self.recordings]
        return acts

    # what they make of a foot

    def value(self, Q: np.ndarray, i: int | None, rest: float = 0.0) -> np.ndarray:
        """A variable (...,) of Q (..., n), in its unit or its logarithm; `rest` where it is held."""
        return np.full(Q.shape[:-1], rest) if i is None else Q[..., i] * self.scale[i]

    def _constant(self, Q: np.ndarray, name: str) -> np.ndarray:
        """A constant (...,) as it is searched: under the smallest load, at the reference frequency."""
        i = self.index.get(name)
        if i is None:
            return np.full(Q.shape[:-1], float(self.space.fixed[name]))
        if self.ratio is not None and name in ("k_T", "k_F"):
            half = 0.5 if name == "k_T" else -0.5
            sigma, rho = Q[..., self.index["k_T"]], Q[..., self.index["k_F"]]
            return np.asarray(np.exp(sigma + half * (rho + np.log(self.ratio))))
        if name in self._squared:
            return np.sqrt(np.maximum(Q[..., i] * self.scale[i], 0.0) + _LEAST_BEND**2)
        if self.space.free[self._item[name]].logarithmic:
            return np.asarray(np.exp(Q[..., i]))
        return np.asarray(Q[..., i] * self.scale[i])

    def relaxation(self, Q: np.ndarray) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
        """Shares (...,) of k_T and k_F that relax, their time (...,) [s], and the part stiff at mid-band."""
        shares = {k: self.value(Q, self.of_kind("relaxing", k)) for k in ("k_T", "k_F")}
        tau = np.exp(self.value(Q, self.of_kind("relaxation time"), np.log(5e-3)))
        x = 2 * np.pi * self.reference_hz * tau
        return shares, tau, x * x / (1 + x * x)

    @cached_property
    def motion_names(self) -> tuple[str, ...]:
        """Parameters of a motion: all of the two-mass foot, or the free constants and the masses of any model."""
        if self.two_mass:
            return PARAMETERS
        load = ("added_mass",) if "added_mass" in self.model_values else ()
        return (*self.constants, *self.stated, *load)

    def theta(self, Q: np.ndarray) -> np.ndarray:
        """(..., R, P) parameters of each recording's foot, of Q (..., n)."""
        R = len(self.recordings)
        values: dict[str, np.ndarray] = {}
        if self.two_mass:
            shares, tau, stiffer = self.relaxation(Q)
            for name in PARAMETERS[:8]:
                values[name] = self._constant(Q, name)[..., None]
                if name in EXCHANGED:
                    values[name] = values[name] * np.exp(Q @ self._follows[name])
            for k, r in (("k_T", "r_T"), ("k_F", "r_F")):
                values[k] = values[k] / (1 + shares[k] * stiffer)[..., None]
                values[r] = np.broadcast_to(shares[k][..., None], (*Q.shape[:-1], R))
            values["tau"] = np.broadcast_to(tau[..., None], (*Q.shape[:-1], R))
        else:
            for name in self.constants:
                values[name] = np.broadcast_to(self._constant(Q, name)[..., None], (*Q.shape[:-1], R))
        values |= self.masses(Q)
        return np.stack([np.broadcast_to(values[name], (*Q.shape[:-1], R)) for name in self.motion_names], -1)

    @cached_property
    def seated(self) -> tuple[str, ...]:
        """Free springs and dampers, which differ from one seating to the next."""
        if self.two_mass:
            return tuple(name for name in EXCHANGED if name in self.index)
        return tuple(name for name in self.constants if self.space.free[self._item[name]].logarithmic)

    def _in_recordings(self, items: Sequence[Nuisance]) -> np.ndarray:
        """(n, R) by how much a unit of each variable, if it is one of these, moves what it acts on."""
        rows = np.zeros((self.size, len(self.recordings)))
        for item in items:
            i = self.place(item)
            rows[i] = self.scale[i] * self._acts(item)
        return rows

    @cached_property
    def _follows(self) -> dict[str, np.ndarray]:
        """(n, R) logarithm of what load and seating make of a constant."""
        following = [item for item in self.nuisances if item.group in ("load", "seating")]
        return {name: self._in_recordings([i for i in following if i.constant == name]) for name in EXCHANGED}

    @cached_property
    def _weighs(self) -> dict[str, np.ndarray]:
        """(n, R) logarithm of what the masses' errors make of the shank and of the foot."""
        masses = [item for item in self.nuisances if item.group == "masses"]
        return {
            kind: self._in_recordings([i for i in masses if i.kind == kind]) for kind in ("shank mass", "foot mass")
        }

    @cached_property
    def _carries(self) -> np.ndarray:
        """(n, R) share of the load that the leg carries."""
        return self._in_recordings([item for item in self.nuisances if item.group == "share"])

    def masses(self, Q: np.ndarray) -> dict[str, np.ndarray]:
        """(..., R) masses [kg] with the load that the leg carries."""
        share = np.where(self._carries.any(0), Q @ self._carries, 1.0)
        factor = {kind: np.exp(Q @ by) for kind, by in self._weighs.items()}
        weights = {}
        for name, kg in self.stated.items():
            grown = kg * factor["foot mass" if name == "m_F" else "shank mass"]
            weights[name] = grown + share * self.loads if name in _SHANK else grown
        if "added_mass" in self.model_values:
            weights["added_mass"] = share * self.loads
        return weights

    @cached_property
    def of_channel(self) -> np.ndarray:
        """Where the nuisances stand that change what sensors read, not what moves."""
        kinds = ("gain", "delay", "drift", "mount", "rocking")
        return np.array([self.place(item) for item in self.nuisances if item.group in kinds], int)

    @cached_property
    def of_motion(self) -> np.ndarray:
        """Where the variables stand that change what moves."""
        return np.setdiff1d(np.arange(self.size), self.of_channel)

    def slopes(self, function, Q: np.ndarray, of: np.ndarray):  # type: ignore[no-untyped-def]
        """Derivatives (..., k) of what a function makes of Q (C, n), an array (C, ...), to k of the variables.

        Differences to one side, inside the bounds, all in one array.
        """
        C, k = len(Q), len(of)
        low, high = (limit[of] for limit in self.bounds)
        step = np.where(Q[:, of] + _STEP > high, -_STEP, _STEP)  # (C, k)
        moved = Q + step.T[..., None] * np.eye(self.size)[of][:, None]  # (k, C, n)
        values = function(np.concatenate([Q[None], moved]).reshape((k + 1) * C, -1))
        values = values.reshape(k + 1, C, *values.shape[1:])
        difference = np.moveaxis(values[1:] - values[0], 0, -1)
        slope = np.where(high > low, 1 / step, 0.0)  # of what cannot change there is none
        return difference * slope.reshape(C, *[1] * (difference.ndim - 2), k)

    # what is reported

    def dynamic(self, Q: np.ndarray) -> dict[str, np.ndarray]:
        """Free constants (...,) by name under the smallest load: dynamic ones at the reference frequency."""
        values = {name: self._constant(Q, name) for name in self.constants}
        if self.two_mass:
            shares, tau, stiffer = self.relaxation(Q)
            for c, k in SPRING_OF.items():
                if c in values:  # Im K(i w) / w: the damper and what the spring relaxes
                    rest = self._constant(Q, k) / (1 + shares[k] * stiffer)
                    values[c] = values[c] + rest * shares[k] * tau * (1 - stiffer)
        return values

    def at_rest(self, Q: np.ndarray) -> dict[str, np.ndarray]:
        """Springs and dampers (...,) by name without what relaxes; nothing where no spring may relax."""
        if not self.two_mass or self.of_kind("relaxation time") is None:
            return {}
        shares, _, stiffer = self.relaxation(Q)
        values = {}
        for c, k in SPRING_OF.items():
            if k in self.index:
                values[k] = self._constant(Q, k) / (1 + shares[k] * stiffer)
            if c in self.index:
                values[c] = self._constant(Q, c)
        return values

    # where to begin

    def start(self, values: Mapping[str, float]) -> np.ndarray:
        """(n,) constants by name, with every nuisance where its prior is centred."""
        mean, _ = self.prior
        q = mean.copy()
        for name, i in self.index.items():
            item = self._item[name]
            x = float(
                np.clip(values.get(name, self.model_values[name]), self.space.lower[item], self.space.upper[item])
            )
            if name in self._squared:
                q[i] = (x * x - _LEAST_BEND**2) / self.scale[i]
            else:
                q[i] = np.log(x) if self.space.free[item].logarithmic else x / self.scale[i]
        if self.ratio is not None:
            T, F = self.index["k_T"], self.index["k_F"]
            ankle, pad = q[T], q[F]
            q[T], q[F] = 0.5 * (ankle + pad), ankle - pad - np.log(self.ratio)
        return np.clip(q, *self.bounds)

    def image(self, Q: np.ndarray) -> np.ndarray:
        """The mirror image (..., n): ankle and pad change places, with what is theirs."""
        assert self.ratio is not None
        Q, old, la = Q.copy(), Q, np.log(self.ratio)
        Q[..., self.index["k_F"]] = -old[..., self.index["k_F"]]
        for one, other, shift in (("c_11", "c_21", la), ("c_12", "c_22", 0.0), ("c_13", "c_23", 0.0)):
            i, j = self.index.get(one), self.index.get(other)
            if i is not None and j is not None:
                Q[..., i], Q[..., j] = old[..., j] + shift, old[..., i] - shift
        partner = {"k_T": "k_F", "k_F": "k_T", "c_11": "c_21", "c_21": "c_11"}
        for item in self.nuisances:
            if item.constant:
                twin = replace(item, constant=partner[item.constant])
                match = [other for other in self.nuisances if replace(other, does="") == replace(twin, does="")]
                if match:
                    Q[..., self.place(item)] = old[..., self.place(match[0])]
        return np.clip(Q, *self.bounds)
