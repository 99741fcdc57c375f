"""Each published number in turn left out: does an arch under a leg that was fitted to the others predict it?

The rule: a number is met independently if a model that never saw it predicts it. The 14 constants that nobody measured
are fitted to all measured numbers but one, within the bounds of the literature, and the one left out is read from those
legs. Numbers that came from other people's models, from people who stand, or from a second drop, are fitted to in no
case.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import Array
from fasbody.presentation import Presented, Sheet
from reproduction.arch_validation.evidence import BOUNDS, NUMBERS, Feet, Number, Statics, of
from simulator.mounted import SHIPPED

#: Legs of each fit, their moves, and the draws within the bounds from which they start.
WALKERS, STEPS, DRAWS = 64, 2400, 20000


@dataclass(frozen=True)
class Prediction:
    """One number, predicted by legs that were fitted to the others.

    Attributes:
        number: which.
        before: share of the legs within the bounds, fitted to nothing, that meet it.
        low, middle, high: 2.5, 50 and 97.5 % of the fitted legs, each (n,).
        inside: share of the fitted legs that meet it.
        shipped: what the shipped set gives, (n,); fitted to it unless `number.fitted` is false.
    """

    number: Number
    before: float
    low: Array
    middle: Array
    high: Array
    inside: float
    shipped: Array

    @property
    def verdict(self) -> str:
        """predicted: the middle and half of the legs lie within the limits. open: some of the 95 % do. missed: none."""
        if self.number.holds(self.middle) and self.inside >= 0.5:
            return "predicted"
        overlap = (self.high >= self.number.low) & (self.low <= self.number.high)
        return "open" if overlap.all() else "missed"

    @property
    def shipped_meets(self) -> bool:
        """The shipped set lies within the limits."""
        return bool(self.number.holds(self.shipped))

    @property
    def basis(self) -> str:
        """geometry: the same for all legs of the bounds. tissue: no free constant enters. independent: left out."""
        spread = float(np.max(self.high - self.low)) if self.before in (0.0, 1.0) else np.inf
        if spread > 0.02 * float(np.max(np.abs(self.middle))):
            return "independent"
        return "tissue" if "fascia" in self.number.name else "geometry"


@dataclass(frozen=True, repr=False)
class Validation(Presented):
    """All published numbers, each predicted without itself.

    Attributes:
        predictions: in the order of `NUMBERS`. legs: of each fit.
    """

    predictions: tuple[Prediction, ...]
    legs: int

    figures: ClassVar[str] = "reproduction.arch_validation.figures"
    plots: ClassVar[tuple[str, ...]] = ("validation",)

    def records(self) -> list[dict[str, Any]]:
        """One row a number, lists where several stand together."""
        return [
            {
                "source": p.number.source, "number": p.number.name, "unit": p.number.unit, "basis": p.basis,
                "fitted_when_shipped": p.number.fitted, "limits": [list(p.number.low), list(p.number.high)],
                "limits_from": p.number.limits, "meet_it_before": p.before, "low": p.low.tolist(),
                "middle": p.middle.tolist(), "high": p.high.tolist(), "inside": p.inside, "verdict": p.verdict,
                "shipped": p.shipped.tolist(), "shipped_meets": p.shipped_meets,
            }
            for p in self.predictions
        ]  # fmt: skip

    def sheet(self) -> Sheet:
        """Published, predicted, shipped."""
        rows = [
            (f"{p.number.name} ({p.number.source})", _range(p.number.low, p.number.high, p.number.unit),
             f"{_some(p.middle)} ({_range(p.low, p.high)})", f"{p.inside:.2f} ({p.before:.2f})", p.verdict,
             f"{_some(p.shipped)}{'' if p.shipped_meets else ' NOT'}{', fitted' if p.number.fitted else ''}")
            for p in self.predictions
        ]  # fmt: skip
        columns = ("number", "published", "predicted without it (95 %)", "inside (unfitted)", "verdict", "shipped")
        words = [p.verdict for p in self.predictions if p.basis == "independent"]
        counts = ", ".join(f"{words.count(word)} {word}" for word in ("predicted", "open", "missed"))
        without = [f"{p.number.name} ({p.verdict})" for p in self.predictions if p.basis != "independent"]
        notes = [f"Independent: {counts}. Numbers of the two drops and of the heel share two constants.",
                 f"Given without a free constant: {'; '.join(without)}."]  # fmt: skip
        return Sheet(f"Each number without itself, {self.legs} legs a fit", columns, rows, notes)


def validate(
    arch: Arch | None = None,
    walkers: int = WALKERS,
    steps: int = STEPS,
    draws: int = DRAWS,
    seed: int = 0,
    points: int = 36,
    tick: Callable[[], None] = lambda: None,
) -> Validation:
    """Leave out each number in turn. About two minutes of processor time.

    Args:
        arch: whose bones; None is `Arch.nominal()`.
        walkers: legs of each fit that walk at once.
        steps: of each; the first half is forgotten.
        draws: legs within the bounds from which the first ones are chosen, and that show what was known before.
        seed: of the random numbers.
        points: of the grid of the tissue's constants, each way.
        tick: called after each step.
    """
    arch = arch or Arch.nominal()
    statics = Statics(arch, points)
    problems = [None, *(i for i, number in enumerate(NUMBERS) if number.fitted)]
    shares, _, first = fit(statics, problems, walkers, steps, seed, draws, tick)
    before, shipped = Feet(statics, of(first[:5000])), ship(arch)
    feet = [Feet(statics, of(some)) for some in shares]
    found = []
    for i, number in enumerate(NUMBERS):
        legs = feet[problems.index(i) if number.fitted else 0]
        values = number.predict(legs)
        low, middle, high = np.percentile(values, [2.5, 50, 97.5], axis=0)
        found.append(Prediction(number, float(number.holds(number.predict(before)).mean()), low, middle, high,
                                float(number.holds(values).mean()), number.predict(shipped)[0]))  # fmt: skip
    return Validation(tuple(found), shares.shape[1])


def ship(arch: Arch | None = None) -> Feet:
    """The shipped set, one leg; `arch` has the bones, None is `Arch.nominal()`."""
    values = np.array([getattr(SHIPPED, field.name) for field in fields(SHIPPED)], float)
    return Feet(Statics(arch or Arch.nominal(), legs=SHIPPED), values[None])


def fit(
    statics: Statics,
    left_out: Sequence[int | None],
    walkers: int,
    steps: int,
    seed: int,
    draws: int,
    tick: Callable[[], None] = lambda: None,
) -> tuple[Array, Array, Array]:
    """Legs fitted to all measured numbers but one, for several numbers at once.

    Differential evolution Markov chains (ter Braak 2006): each leg moves along the difference of two others.

    Args:
        statics: of the arch.
        left_out: index into `NUMBERS` for each problem, None for none.
        walkers: legs of each problem.
        steps: moves of each; the first half is forgotten.
        seed: of the random numbers.
        draws: legs within the bounds from which the first ones are chosen.
        tick: called after each step.

    Returns:
        Legs of each problem, (problems, kept, 14); their half chi-square, (problems, kept); the draws, (draws, 14).
    """
    rng = np.random.default_rng(seed)
    weight = np.array([[number.fitted and i != out for i, number in enumerate(NUMBERS)] for out in left_out])

    def misfit(shares: Array) -> Array:
        outside = ((shares < 0) | (shares > 1)).any(axis=-1)
        feet = Feet(statics, of(np.clip(shares, 0, 1)))
        with np.errstate(invalid="ignore"):
            each = [n.misfit(n.predict(feet)) if n.fitted else np.zeros(len(shares)) for n in NUMBERS]
        return np.where(outside, np.inf, 0)[:, None] + np.stack(each, axis=-1)

    first = rng.random((draws, len(BOUNDS)))
    each = np.concatenate([misfit(part) for part in np.array_split(first, max(1, draws // 2000))])
    P, n = len(left_out), len(BOUNDS)
    cost = np.stack([np.where(w, each, 0).sum(axis=-1) for w in weight])  # (P, draws)
    chosen = np.argsort(cost, axis=-1)[:, :walkers]
    x, c = first[chosen], np.take_along_axis(cost, chosen, -1)
    kept_x, kept_c = [], []
    for step in range(steps):
        a = (np.arange(walkers) + rng.integers(1, walkers, (P, walkers))) % walkers
        b = (np.arange(walkers) + rng.integers(1, walkers, (P, walkers))) % walkers
        moved = rng.random((P, walkers, n)) < rng.choice([0.3, 0.6, 1.0], (P, walkers, 1))
        size = np.where(step % 10 == 9, 1.0, 2.38 / np.sqrt(2 * np.maximum(moved.sum(axis=-1, keepdims=True), 1)))
        rows = np.arange(P)[:, None]
        proposal = x + moved * (size * (x[rows, a] - x[rows, b]) + 1e-3 * rng.standard_normal(x.shape))
        each = misfit(proposal.reshape(-1, n)).reshape(P, walkers, -1)
        new = np.where(weight[:, None], each, 0).sum(axis=-1)
        take = np.log(rng.random((P, walkers))) < c - new
        x, c = np.where(take[..., None], proposal, x), np.where(take, new, c)
        tick()
        if step >= steps // 2 and step % 5 == 0:
            kept_x.append(x)
            kept_c.append(c)
    return np.concatenate(kept_x, axis=1), np.concatenate(kept_c, axis=1), first


def _some(values: Sequence[float] | Array) -> str:
    return ", ".join(f"{v:.3g}" for v in values)


def _range(low: Sequence[float] | Array, high: Sequence[float] | Array, unit: str = "") -> str:
    pairs = dict.fromkeys(f"{a:.3g} to {b:.3g}" for a, b in zip(low, high, strict=True))
    return f"{'; '.join(pairs)} {unit}".strip()
