"""The parameter studies of section 5.4: cell shape (Figure 5.9) and elastic modulus (Figures 5.10 and 5.11)."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import curve_fit

from fasbody.cell.analysis import Analysis, analyse, assemblies
from fasbody.cell.dome import SHAPES, Dome
from fasbody.cell.materials import MODULI_PA, Preset
from fasbody.cell.mesh import MeshSize
from fasbody.exceptions import SettingError
from fasbody.presentation import Tabled
from reproduction.cell.tracking import Match, track_along

#: Modulus of the yeast cells that section 5.5 extrapolates to [Pa].
YEAST_PA = 0.75e6

Advance = Callable[[], object]


@dataclass(frozen=True)
class Sweep(Tabled):
    """Analyses in the order of the sweep, each mode traced back to the first of them, step by step.

    Args:
        analyses: one for each shape or modulus.
        matches: for each analysis, the partners of the first one's modes.
    """

    analyses: tuple[Analysis, ...]
    matches: tuple[Match, ...]

    @property
    def frequencies_hz(self) -> NDArray[np.float64]:
        """Frequencies (points, modes) in rising order [Hz]."""
        return np.array([a.frequencies_hz for a in self.analyses])

    def without_last(self) -> "Sweep":
        """The sweep but for its last point."""
        return Sweep(self.analyses[:-1], self.matches[:-1])

    def document(self) -> list[dict[str, Any]]:
        """One entry a point, ready for JSON."""
        return [a.document() | m.document() for a, m in zip(self.analyses, self.matches, strict=True)]

    def __str__(self) -> str:
        return "\n".join(str(a) for a in self.analyses)


@dataclass(frozen=True)
class PowerLaw(Tabled):
    """f = a E^b, fitted to first frequencies over the modulus.

    Args:
        a: factor [Hz/Pa^b].
        b: exponent; 0.5 if the whole cell had one modulus.
        way: "log" is a straight line through the logarithms, every relative deviation alike; "linear" is least squares
            in Hz, which the largest frequencies rule.
    """

    a: float
    b: float
    way: str

    def __call__(self, E: float) -> float:
        """Frequency [Hz] at the modulus `E` [Pa]."""
        return self.a * E**self.b

    def __str__(self) -> str:
        return f"f1 = {self.a:.4g} E^{self.b:.4f} ({self.way}), {self(YEAST_PA):.0f} Hz at {YEAST_PA / 1e6:g} MPa"


@dataclass(frozen=True)
class Summary:
    """The numbers that sections 5.4 and 5.5 quote.

    Args:
        mean_hz, std_hz: mean and sample standard deviation (c,) of each mode over the shapes [Hz].
        laws: power laws of f1 by both ways of fitting, over the moduli of the figures.
        direct_hz: what the model gives at `YEAST_PA`, where the thesis extrapolates [Hz].
    """

    mean_hz: NDArray[np.float64]
    std_hz: NDArray[np.float64]
    laws: tuple[PowerLaw, PowerLaw]
    direct_hz: float

    def document(self) -> dict[str, Any]:
        """Ready for JSON."""
        laws = [vars(law) | {"extrapolated_hz": law(YEAST_PA)} for law in self.laws]
        modes = {"mode_means_hz": self.mean_hz, "mode_stds_hz": self.std_hz}
        return modes | {
            "power_laws": laws,
            "direct_hz": self.direct_hz,
            "extrapolated_modulus_pa": YEAST_PA,
        }

    def __str__(self) -> str:
        pairs = enumerate(zip(self.mean_hz, self.std_hz, strict=True), start=1)
        means = (f"f{i} {m:.2f} +- {s:.3f} Hz" for i, (m, s) in pairs)
        return "\n".join(
            [
                "means over the shapes: " + ", ".join(means),
                *map(str, self.laws),
                f"the model itself at {YEAST_PA / 1e6:g} MPa: {self.direct_hz:.4g} Hz",
            ]
        )


def summarise(by_shape: Sweep, by_modulus: Sweep) -> Summary:
    """Summary of both sweeps; the last modulus is `YEAST_PA` and takes no part in the fits."""
    f = by_shape.frequencies_hz
    first = by_modulus.frequencies_hz[:, 0]
    E = np.array([a.model.materials[0].E for a in by_modulus.analyses])
    return Summary(f.mean(axis=0), f.std(axis=0, ddof=1), power_laws(E[:-1], first[:-1]), float(first[-1]))


def sweep_shapes(
    preset: Preset, *, shapes: Iterable[tuple[float, float]] = SHAPES, size: MeshSize | None = None, count: int = 10,
    cache: Path | None = None, advance: Advance = lambda: None,
) -> Sweep:  # fmt: skip
    """Figure 5.9: the same materials in several base shapes; `advance` is called after each."""
    analyses = []
    for length, width in shapes:
        dome = Dome(length, width, preset.height_um)
        analyses.append(analyse(*assemblies(dome, size, cache), preset, count=count, dome=dome))
        advance()
    return _sweep(analyses)


def sweep_moduli(
    preset: Preset, dome: Dome, *, moduli: Iterable[float] = MODULI_PA, size: MeshSize | None = None, count: int = 10,
    cache: Path | None = None, advance: Advance = lambda: None,
) -> Sweep:  # fmt: skip
    """Figures 5.10 and 5.11: one shape, one mesh, one assembly, several moduli of the cytoplasm."""
    fine, coarse = assemblies(dome, size, cache)
    analyses = []
    for E in sorted(moduli):
        analyses.append(analyse(fine, coarse, preset.with_modulus(E), count=count, dome=dome))
        advance()
    return _sweep(analyses)


def power_laws(moduli_pa: NDArray[np.float64], first_hz: NDArray[np.float64]) -> tuple[PowerLaw, PowerLaw]:
    """Both ways of fitting Figure 5.11, moduli [Pa] to frequencies [Hz]: by logarithms and by least squares in Hz.

    Raises:
        SettingError: fewer than three moduli.
    """
    if len(moduli_pa) < 3:
        raise SettingError(f"a power law needs at least 3 moduli, not {len(moduli_pa)}.")
    slope, intercept = np.polyfit(np.log(moduli_pa), np.log(first_hz), 1)
    log = PowerLaw(float(np.exp(intercept)), float(slope), "log")
    (a, b), _ = curve_fit(lambda E, a, b: a * E**b, moduli_pa, first_hz, p0=(log.a, log.b))
    return log, PowerLaw(float(a), float(b), "linear")


def _sweep(analyses: list[Analysis]) -> Sweep:
    return Sweep(tuple(analyses), track_along([(a.model, a.modes) for a in analyses]))
