"""The search space: which parameters are free, how they are scaled and where they may lie, and how that is written."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fasbody.constants import Z95
from fasbody.exceptions import SettingError, unknown
from fasbody.foot.model import Foot
from fasbody.foot.parameters import Parameter

#: Delay of the malleolus channel behind the base channel: a parameter of the instrument, so of no model.
DELAY = Parameter("delay", "s", -2e-3, 2e-3, (), "channels of a multiplexed converter are sampled one after another")


def delay_of(sensor: str) -> Parameter:
    """The delay of an accelerometer's channel behind the base's."""
    return DELAY if sensor == "malleolus" else replace(DELAY, name=f"{DELAY.name}_{sensor}")


#: Parameters that a fit never frees: masses come from the recording's condition.
MASSES = ("m_S", "m_F", "m_T", "added_mass")


@dataclass(frozen=True)
class Space:
    """Free parameters, in order, with the delays last if they are free.

    The search variable q is the logarithm of a parameter whose bounds are positive (stiffness, damping amplitude) and a
    multiple of its range for the others, so that all steps are alike in size.

    Attributes:
        free: the free parameters.
        lower, upper: their bounds in their units.
        fixed: values of all others by name.
    """

    free: tuple[Parameter, ...]
    lower: np.ndarray
    upper: np.ndarray
    fixed: Mapping[str, float]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters, without the delay."""
        return tuple(item.name for item in self.free if item.places)

    @property
    def has_delay(self) -> bool:
        """Whether delays of channels are estimated; a parameter of the instrument stands nowhere in the model."""
        return bool(self.free) and not self.free[-1].places

    @property
    def delays(self) -> tuple[str, ...]:
        """Names of the delays that are free, the last of the parameters."""
        return tuple(item.name for item in self.free if not item.places)

    @cached_property
    def scale(self) -> np.ndarray:
        """(p,) size of one unit of q for the linear parameters; 1 for the logarithmic ones."""
        return np.array([1.0 if item.logarithmic else _unit(item) for item in self.free])

    @cached_property
    def _log(self) -> np.ndarray:
        return np.array([item.logarithmic for item in self.free])

    def to_q(self, theta: np.ndarray) -> np.ndarray:
        """Search variable (p,) of parameter values (p,)."""
        inside = np.clip(theta, self.lower, self.upper)
        return np.where(self._log, np.log(np.where(self._log, inside, 1.0)), inside / self.scale)

    def to_theta(self, q: np.ndarray) -> np.ndarray:
        """Parameter values (p,) of a search variable (p,)."""
        return np.where(self._log, np.exp(np.where(self._log, q, 0.0)), q * self.scale)

    def slope(self, theta: np.ndarray) -> np.ndarray:
        """D theta / d q (p,)."""
        return np.where(self._log, theta, self.scale)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of q, each (p,)."""
        return self.to_q(self.lower), self.to_q(self.upper)

    def values(self, theta: np.ndarray) -> dict[str, float]:
        """All parameter values by name, the free ones (p,) and the fixed."""
        values = {item.name: float(value) for item, value in zip(self.free, theta, strict=True)}
        return {**self.fixed, **values}

    def theta(self, values: Mapping[str, float]) -> np.ndarray:
        """Free values (p,) from named ones, clipped to the bounds; a missing delay is zero."""
        theta = np.array([values.get(item.name, 0.0) for item in self.free])
        return np.clip(theta, self.lower, self.upper)

    def random(self, rng: np.random.Generator) -> np.ndarray:
        """A wild start (p,): log-uniform over the bounds, but inside what any foot could be; linear ones near zero."""
        low, high = self.bounds
        q = low + (high - low) * rng.uniform(0.1, 0.9, low.size)
        return np.where(self._log, q, np.clip(rng.normal(0, 0.3, low.size), low, high))

    def at_bound(self, theta: np.ndarray) -> np.ndarray:
        """Which parameters (p,) rest on a bound."""
        q, (low, high) = self.to_q(theta), self.bounds
        return np.minimum(q - low, high - q) < 1e-4 * (high - low)

    def snapped(self, theta: np.ndarray) -> np.ndarray:
        """Parameter values (p,), exactly at the bound where they rest on one."""
        nearer = np.where(theta - self.lower < self.upper - theta, self.lower, self.upper)
        return np.where(self.at_bound(theta), nearer, theta)

    def interval(self, theta: np.ndarray, std_q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """95 % confidence limits (p,), (p,): symmetric in q, cut at the bounds."""
        q = self.to_q(theta)
        low, high = self.bounds
        finite = np.where(np.isfinite(std_q), std_q, np.inf)
        return self.to_theta(np.maximum(q - Z95 * finite, low)), self.to_theta(np.minimum(q + Z95 * finite, high))


def _unit(item: Parameter) -> float:
    return 1e-4 if not item.places else max(abs(item.lower), abs(item.upper)) / 6.0


def space_of(
    foot: Foot,
    free: Sequence[str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    delay: bool = True,
    sensors: Sequence[str] = ("malleolus",),
) -> Space:
    """The search space of a model.

    Args:
        foot: the model.
        free: names to estimate, default all declared but the masses.
        bounds: name -> (lower, upper) in place of the declared ones.
        delay: estimate the delay of each channel, too.
        sensors: what the channels are.

    Raises:
        SettingError: an unknown name, or a bound that is not one.
    """
    bounds = dict(bounds or {})
    estimable = [name for name in foot.parameters if name not in MASSES]
    chosen = list(free) if free is not None else list(estimable)
    late = {item.name: item for item in map(delay_of, sensors)}
    for name in chosen:
        if name not in estimable and name not in late:
            why = " (masses come from the recording's condition)" if name in MASSES else ""
            raise SettingError(f"{unknown('parameter to estimate', name, estimable)} in model {foot.name}{why}.")
    if delay:
        chosen += [name for name in late if name not in chosen]
    items = [late[name] if name in late else foot.parameters[name] for name in dict.fromkeys(chosen)]
    items.sort(key=lambda item: list(late).index(item.name) if item.name in late else -1)
    if not [item for item in items if item.places]:
        raise SettingError(f"no parameter is free (valid: {', '.join(estimable)}).")
    lower, upper = np.array([i.lower for i in items]), np.array([i.upper for i in items])
    for name, (low, high) in bounds.items():
        item = late[name] if name in late else foot.parameters[name]
        if item not in items:
            raise SettingError(f"bounds are given for {name}, which is not free (free: {', '.join(chosen)}).")
        if not (np.isfinite([low, high]).all() and low < high) or (item.logarithmic and low <= 0):
            kind = "two positive numbers" if item.logarithmic else "two finite numbers"
            raise SettingError(f"bounds of {name} are {low:g}:{high:g}; give {kind}, the lower one first.")
        lower[items.index(item)], upper[items.index(item)] = low, high
    fixed = {name: value for name, value in foot.values().items() if name not in chosen}
    return Space(tuple(items), lower, upper, fixed)


def without_delay(space: Space) -> Space:
    """A space whose delays, the last of its parameters, are left out."""
    kept = [i for i, item in enumerate(space.free) if item.places]
    return Space(tuple(space.free[i] for i in kept), space.lower[kept], space.upper[kept], space.fixed)


def names(text: str | None) -> tuple[str, ...] | None:
    """Names with commas between them, None where there is no such option."""
    return None if text is None else tuple(name.strip() for name in text.split(",") if name.strip())


def limits(texts: Iterable[str] | None, option: str = "--bounds") -> dict[str, tuple[float, float]]:
    """Limits by name, in the order of the names, from any number of NAME=LOWER:UPPER.

    Raises:
        SettingError: one of them cannot be read.
    """
    return dict(sorted(_limit(text, option) for text in texts or ()))


def _limit(text: str, option: str) -> tuple[str, tuple[float, float]]:
    name, _, bounds = text.partition("=")
    try:
        low, high = (float(part) for part in bounds.split(":"))
    except ValueError:
        raise SettingError(f"{option} {text!r} is not NAME=LOWER:UPPER, for example k_F=3e3:1e6.") from None
    return name.strip(), (low, high)
