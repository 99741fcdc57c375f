"""Eight explanations of the resonance that rises with the load, searched for what meets the thesis."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fasbody.constants import MODEL_GRAVITY
from fasbody.leg.statements import ADDED_KG, RANGES_HZ, STATEMENTS, Curves, judge, ranges_met
from fasbody.transmissibility.findings import FREQUENCIES_HZ
from identification.rivals import pad_balance
from identification.rivals.mechanisms import (
    ABOVE,
    ANKLE,
    ANY_ANKLE,
    FOOT,
    LINEAR_PAD,
    MASS,
    MECHANISMS,
    PRESSED_PAD,
    Mechanism,
    pressed,
    second_mode,
    standing_chain,
    two_masses,
)
from identification.rivals.pad_balance import TABLE_M_S2
from reproduction.load_effect.lift_off import steady

Array = np.ndarray
Response = Callable[[Array, dict[str, Array]], tuple[Array, Array]]
#: Grid on which the highest MB is sought [Hz].
FINE_HZ = np.arange(10.0, 51.0, 1.0)
_F = np.array(FREQUENCIES_HZ)
_LOADS = np.array(ADDED_KG)[:, None]
#: Feet that are judged between two steps of a progress bar.
_AT_ONCE = 20


def linear(mechanism: Mechanism) -> Response:
    """MB and TM under the loads of Chapter 2, complex, (d, 3, f), of constants (d,)."""
    assert mechanism.response is not None
    response = mechanism.response

    def responses(frequency_hz: Array, values: dict[str, Array]) -> tuple[Array, Array]:
        columns = {name: value[:, None, None] for name, value in values.items()}
        MB, TM = response(frequency_hz, columns, _LOADS)
        return MB, TM

    return responses


def lift_off(frequency_hz: Array, values: dict[str, Array]) -> tuple[Array, Array]:
    """One mass on a pad that cannot pull, stepped in time; it has no tibia, so TM is NaN."""
    share = values.get("share", np.zeros_like(values["m"]))
    static = values["rest"][:, None] + MODEL_GRAVITY * np.array(ADDED_KG)  # its weight presses in either case
    mass = values["m"][:, None] + share[:, None] * ADDED_KG
    pads = [np.broadcast_to(values[n][:, None], static.shape) for n in ("k", "exponent", "c")]
    k, exponent, c = (pad.ravel() for pad in pads)
    MB = steady(frequency_hz, mass.ravel(), static.ravel(), k, exponent, c).response
    MB = MB.reshape(*static.shape, -1)
    return MB, np.full_like(MB, np.nan)


def both(frequency_hz: Array, values: dict[str, Array]) -> tuple[Array, Array]:
    """The chain on a pad that cannot pull; motions of one period, NaN where there is none."""
    columns = {name: value[:, None, None] for name, value in values.items()}
    mass, MF, TM = standing_chain(frequency_hz, columns, _LOADS)
    systems = pressed(frequency_hz, columns, mass, _LOADS, TABLE_M_S2)
    x, balanced = pad_balance.solve(systems)
    a = np.where(balanced, systems.acceleration(x)[:, 0], np.nan).reshape(MF.shape[:-1])
    return a / TABLE_M_S2 * MF[..., 0], TM[..., 0]


#: Explanations with their responses, in the order of docs/load.md.
EXPLANATIONS: dict[str, tuple[Mechanism, Response]] = {
    mechanism.name: (mechanism, response or linear(mechanism))
    for mechanism, response in (
        (Mechanism("constant", (*FOOT, *LINEAR_PAD, *ANKLE), two_masses), None),
        (Mechanism("constant, any ankle", MECHANISMS["constant"].constants, two_masses), None),
        (MECHANISMS["stiffening"], None),
        (MECHANISMS["second mode"], None),
        (
            Mechanism("second mode, any ankle", (*FOOT, *LINEAR_PAD, *ANY_ANKLE, *ABOVE), second_mode),
            None,
        ),
        (Mechanism("lift-off", (MASS, *PRESSED_PAD)), lift_off),
        (Mechanism("lift-off, load moves along", MECHANISMS["lift-off"].constants), lift_off),
        (MECHANISMS["both"], both),
    )
}


@dataclass(frozen=True)
class Judged:
    """Draws against the statements.

    Attributes:
        held: which statements each draw meets, (d, statements).
        peak_hz: where MB is highest, by load, (d, 3).
    """

    held: Array
    peak_hz: Array

    def __getitem__(self, at: int) -> "Judged":
        """One draw."""
        return Judged(self.held[at : at + 1], self.peak_hz[at : at + 1])

    @property
    def ranges(self) -> Array:
        """How many of the three ranges each draw meets, (d,)."""
        return ranges_met(self.peak_hz).sum(axis=-1)

    @property
    def count(self) -> Array:
        """How many statements each draw meets, (d,)."""
        return self.held.sum(axis=-1)

    @property
    def score(self) -> Array:
        """Ranges count as three statements each, distance from them breaks ties, (d,)."""
        low, high = np.array(RANGES_HZ).T
        off = np.maximum(low - self.peak_hz, 0) + np.maximum(self.peak_hz - high, 0)
        return 3 * self.ranges + self.count - 0.02 * off.sum(axis=-1)


@dataclass(frozen=True)
class Searched:
    """One mechanism's space: even draws, and the best set of a search that starts from them.

    Attributes:
        name: of the explanation.
        drawn: how many draws.
        judged: the draws.
        best: constants of the best set, by name.
        best_judged: that one set, as one draw.
    """

    name: str
    drawn: int
    judged: Judged
    best: dict[str, float]
    best_judged: Judged

    @property
    def MB(self) -> tuple[Array, Array]:
        """Frequencies from 10 to 50 Hz (f,) and |MB| (3, f) of the best set."""
        f = np.arange(10.0, 50.25, 0.5)
        values = {name: np.array([value]) for name, value in self.best.items()}
        return f, np.abs(EXPLANATIONS[self.name][1](f, values)[0][0])

    @property
    def statements(self) -> int:
        """How many statements it says anything about: one mass has no tibia."""
        about_mb = sum(s.pair == "MB" for s in STATEMENTS)
        return about_mb if self.name.startswith("lift-off") else len(STATEMENTS)

    def share(self, ranges: int) -> float:
        """Share of the space that meets at least so many of the three ranges."""
        return float((self.judged.ranges >= ranges).mean())


def feet(draws: int, rounds: int) -> int:
    """How many feet `search` judges."""
    return draws + rounds * max(20, draws // 10)


def search(
    name: str,
    draws: int,
    seed: int = 0,
    rounds: int = 20,
    advance: Callable[[int], object] = lambda feet: None,
) -> Searched:
    """Draw a mechanism's space evenly, then look for its best set: ranges first, then statements.

    Args:
        name: of an explanation.
        draws: even draws; each later round has a tenth of them.
        seed: of the random numbers.
        rounds: of normal steps about the best so far, half as wide where one brings nothing.
        advance: called with how many feet were judged since.
    """
    mechanism, response = EXPLANATIONS[name]

    def judged(shares: Array) -> Judged:
        parts = []
        for part in np.split(shares, range(_AT_ONCE, len(shares), _AT_ONCE)):
            parts.append(judged_at_once(part))
            advance(len(part))
        return Judged(*(np.concatenate([getattr(p, key) for p in parts]) for key in ("held", "peak_hz")))

    def judged_at_once(shares: Array) -> Judged:
        MB, TM = response(np.concatenate([_F, FINE_HZ]), mechanism.values(shares))
        held = judge(Curves(MB[..., : _F.size], TM[..., : _F.size]))
        return Judged(held, FINE_HZ[np.nan_to_num(np.abs(MB[..., _F.size :])).argmax(axis=-1)])

    rng, n = np.random.default_rng(seed), len(mechanism.constants)
    shares = rng.random((draws, n))
    drawn, spread = judged(shares), 0.2
    at = int(drawn.score.argmax())
    top, best = shares[at], drawn[at]
    for _ in range(rounds):
        near = np.clip(top + spread * rng.standard_normal((max(20, draws // 10), n)), 0, 1)
        later = judged(near)
        at = int(later.score.argmax())
        if later.score[at] > best.score[0]:
            top, best = near[at], later[at]
        else:
            spread = max(0.6 * spread, 0.01)
    values = {name: float(value[0]) for name, value in mechanism.values(top[None]).items()}
    return Searched(name, draws, drawn, values, best)
