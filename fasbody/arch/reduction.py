"""Is the arch a two-mass foot? Transmissibility of the five bodies against their two-mass reduction, 1-100 Hz."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import Array
from fasbody.arch.linear import transmissibility, two_mass_transmissibility
from fasbody.presentation import Presented, Sheet


@dataclass(frozen=True, repr=False)
class Reduction(Presented):
    """Differences of two transmissibilities at the malleolus.

    Attributes:
        frequency_hz: shape (n,).
        examples: name, |T| of five bodies and of two masses, shape (n,) each.
        differences: lever arm [m] or None -> | |T_5| - |T_2| | / |T_2|, shape (draws, n).
    """

    frequency_hz: Array
    examples: list[tuple[str, Array, Array]]
    differences: dict[float | None, Array]

    figures: ClassVar[str] = "fasbody.arch.figures"
    plots: ClassVar[tuple[str, ...]] = ("reduction",)

    def records(self) -> list[dict[str, Any]]:
        """One row an example and frequency."""
        return [
            {"arch": name, "frequency_hz": float(f), "five_bodies": float(a), "two_masses": float(b)}
            for name, five, two in self.examples
            for f, a, b in zip(self.frequency_hz, five, two, strict=True)
        ]

    def summary(self) -> list[dict[str, Any]]:
        """Differences over the frequencies: of each reading of the random draws, and of each example."""
        rows: list[dict[str, Any]] = [
            {
                "lever_arm_m": lever_arm_m, "median": np.median(errors),
                "median_of_worst": np.median(errors.max(axis=1)), "worst": errors.max(),
            }
            for lever_arm_m, errors in self.differences.items()
        ]  # fmt: skip
        for name, five, two in self.examples:
            error = np.abs(five - two) / two
            rows.append({"arch": name, "median": np.median(error), "worst": error.max()})
        return rows

    def sheet(self) -> Sheet:
        """The same as a table."""
        rows = []
        for row in self.summary():
            arm = row.get("lever_arm_m")
            reading = "literal" if arm is None else f"lever arm {arm * 1e3:g} mm"
            name = row.get("arch") or f"{len(self.differences[arm])} draws, {reading}"
            keys = ("median", "median_of_worst", "worst")
            rows.append((name, *(f"{100 * row[key]:.3g}" if key in row else "" for key in keys)))
        ends = f"{self.frequency_hz[0]:g} to {self.frequency_hz[-1]:g} Hz"
        columns = ("arch, rotational constants", "median [%]", "median of worst [%]", "worst [%]")
        return Sheet(f"Five bodies against two masses, |T| at the malleolus, {ends}", columns, rows)


def reduce(
    draws: int = 30,
    seed: int = 0,
    lever_arms_m: tuple[float | None, ...] = (None, 0.1, 0.015),
    arch: Arch | None = None,
    name: str = "nominal",
) -> Reduction:
    """Compare both models for one arch, for its bones in the middle of Table 4.2 and for random draws of that table.

    Args:
        draws: random arches per lever arm.
        seed: of the random numbers, the same for each lever arm.
        lever_arms_m: readings of the rotational constants, see `Arch.draw`.
        arch: whose bones everything has; None is `Arch.nominal()`.
        name: what to call it.
    """
    arch = arch or Arch.nominal()
    frequency = np.linspace(1, 100, 199)

    def responses(one: Arch) -> tuple[Array, Array]:
        return np.abs(transmissibility(one, frequency)), np.abs(two_mass_transmissibility(one, frequency))

    differences = {}
    for lever_arm_m in lever_arms_m:
        rng = np.random.default_rng(seed)
        pairs = [responses(arch.drawn(rng, lever_arm_m)) for _ in range(draws)]
        differences[lever_arm_m] = np.array([np.abs(five - two) / two for five, two in pairs])
    examples = [(name, *responses(arch)), ("middle of Table 4.2", *responses(arch.middle()))]
    return Reduction(frequency, examples, differences)
