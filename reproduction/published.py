"""The orders and fits printed in Table 3.2 and Tables A.1 to A.9, and what single sines can and cannot say of them."""

from dataclasses import dataclass
from importlib.resources import files

import numpy as np
import pandas as pd

from identification.blackbox.polynomial import STRUCTURES

#: Coefficients that a sine without harmonics determines, and one with its second and third, as the bundled series have.
SINE_RANK = 2
HARMONICS_RANK = 6


def table() -> pd.DataFrame:
    """270 rows: subject, frequency_hz, added_mass_kg, then orders and fit of each structure (e.g. `arx_na`)."""
    with (files(__package__) / "published.csv").open() as file:
        return pd.read_csv(file)


def plant_parameters(data: pd.DataFrame, structure: str) -> np.ndarray:
    """Number of coefficients of the plant G, shape (rows,): of B and A F; 2 n + 1 for a state-space model."""
    if structure == "ss":
        return 2 * data["ss_order"].to_numpy() + 1
    return sum(
        data[f"{structure}_{name}"].to_numpy() for name in STRUCTURES[structure] if name in ("na", "nb", "nf")
    )  # fmt: skip


@dataclass(frozen=True)
class Plausibility:
    """What the printed table says about itself.

    Attributes:
        rows: number of recordings.
        fewest_parameters: least number of plant coefficients over all printed models.
        above_rank: share of printed models with more plant coefficients than one pure sine determines.
        above_harmonics: the same share, of a sine with its second and third harmonics.
        best_share: structure -> share of the recordings in which it has the highest printed fit (ties count for all).
        median_fit: structure -> median printed fit in percent.
        spread_median: median over recordings of best minus worst linear fit, in points.
        delays: standard deviation of the printed n_k between recordings of one subject, in samples, mean over subjects.
    """

    rows: int
    fewest_parameters: int
    above_rank: float
    above_harmonics: float
    best_share: dict[str, float]
    median_fit: dict[str, float]
    spread_median: float
    delays: float

    def __str__(self) -> str:
        best = ", ".join(f"{name.upper()} {100 * share:.0f} %" for name, share in self.best_share.items())
        return (
            f"{self.rows} recordings printed; the smallest plant has {self.fewest_parameters} coefficients, and "
            f"{100 * self.above_rank:.0f} % of the printed models have more than the {SINE_RANK} numbers that one pure "
            f"sine determines, {100 * self.above_harmonics:.0f} % more than the {HARMONICS_RANK} of a sine with its "
            f"second and third harmonics; what the recordings determine is not known.\n"
            f"Share of recordings with the highest printed fit (ties count for each): {best}.\n"
            "Median difference between the best and the worst structure: "
            f"{self.spread_median:.1f} points.\nThe delay n_k of one subject scatters by {self.delays:.1f} samples "
            "from recording to recording; a travel time through a foot would not. The printed orders describe the "
            "selection procedure and the harmonics of each recording, not the plant."
        )


def plausibility() -> Plausibility:
    """Statistics of the printed tables against what the excitation allows."""
    data = table()
    structures = (*STRUCTURES, "ss")
    counts = np.column_stack([plant_parameters(data, name) for name in structures])
    fits = np.column_stack([data[f"{name}_fit"].to_numpy() for name in structures])
    best = fits == fits.max(axis=1, keepdims=True)
    return Plausibility(
        rows=len(data),
        fewest_parameters=int(counts.min()),
        above_rank=float(np.mean(counts > SINE_RANK)),
        above_harmonics=float(np.mean(counts > HARMONICS_RANK)),
        best_share={name: float(best[:, k].mean()) for k, name in enumerate(structures)},
        median_fit={name: float(np.median(fits[:, k])) for k, name in enumerate(structures)},
        spread_median=float(np.median(fits.max(axis=1) - fits.min(axis=1))),
        delays=float(data.groupby("subject")["arx_nk"].std().mean()),
    )
