"""The arch under load: sag against Arangio's measurements, the fascia's share, and the resonance under added mass."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from fasbody.arch import SPRINGS, Arch
from fasbody.arch_model import read_arch
from fasbody.arch_statics import G, equilibrium, loaded
from fasbody.console import command_line, console, make_folder, print_json, write_whole
from fasbody.exceptions import SettingError
from fasbody.kinematics import Array
from fasbody.linear import linearise, response

#: Arangio 1998, load on the arch [N]; arch height [m] -> sag [m] with and without fascia.
ARANGIO_LOAD = 683.0
ARANGIO_SAG = {0.020: (11.8e-3, 13.5e-3), 0.060: (5.5e-3, 7.5e-3)}
#: The same, fascia cut at 60 mm: increase of sag and of elongation.
ARANGIO_CUT = (0.36, 0.40)
#: Kim & Voloshin, in the thesis: part of the compression that the calcaneus carries.
HEEL = 0.63
#: Chapter 2: added mass [kg] -> range of the resonance [Hz] at the malleolus (section 2.3.1).
MEASURED_HZ = {0.0: (15.0, 25.0), 2.3: (30.0, 35.0), 4.5: (35.0, 40.0)}


@dataclass(frozen=True)
class SagStudy:
    """Sag against arch height under one load; arrays of shape (n,), SI units."""

    load: float
    height: Array
    sag: Array
    sag_cut: Array
    elongation: Array
    elongation_cut: Array
    share: Array
    heel: Array


def sag_study(arch: Arch, height: Array, load: float = ARANGIO_LOAD) -> SagStudy:
    """The same bones spread to each rest height [m], with their aponeurosis and with it cut."""
    whole = [equilibrium(arch.with_height(h), load) for h in height]
    cut = [equilibrium(replace(arch.with_height(h), k_11=0.0, k_12=0.0), load) for h in height]
    return SagStudy(
        load, np.asarray(height), *(np.array(values) for values in (
            [e.sag for e in whole], [e.sag for e in cut],
            [e.elongation for e in whole], [e.elongation for e in cut], [e.share for e in whole],
            [e.heel for e in whole],
        ))
    )  # fmt: skip


@dataclass(frozen=True)
class LoadCase:
    """One added mass.

    Attributes:
        added_mass: on the knee [kg].
        transmissibility: |T| at the malleolus about the loaded pose, shape (n,).
        peak_hz: frequency of its largest value [Hz].
        arch_stiffness: tangent stiffness of the relaxed arch under the weight [N/m].
        factor: by which all springs must be multiplied for the peak to lie in the middle of the measured range.
    """

    added_mass: float
    transmissibility: Array
    peak_hz: float
    arch_stiffness: float
    factor: float


@dataclass(frozen=True)
class LoadStudy:
    """The arch under the added masses of Chapter 2, its constants unchanged."""

    frequency_hz: Array
    cases: list[LoadCase]


def load_study(arch: Arch) -> LoadStudy:
    """Resonance and stiffness of `arch` under 0, 2.3 and 4.5 kg on the knee."""
    frequency = np.arange(2.0, 80.0, 0.05)
    cases = []
    for added_mass, measured in MEASURED_HZ.items():
        heavy = replace(arch, m_T=arch.m_T + added_mass)
        T = np.abs(response(loaded(heavy), frequency))
        stiffness = equilibrium(heavy, heavy.m_T * G).stiffness
        peak = float(frequency[T.argmax()])
        cases.append(LoadCase(added_mass, T, peak, stiffness, _factor(heavy, float(np.mean(measured)))))
    return LoadStudy(frequency, cases)


def _factor(arch: Arch, wanted_hz: float) -> float:
    """Bisect for the common factor of all springs that puts the peak at `wanted_hz`, about the rest pose."""
    frequency, low, high = np.arange(2.0, 120.0, 0.05), 0.1, 100.0
    for _ in range(40):
        factor = float(np.sqrt(low * high))
        stiff = replace(arch, **{name: factor * getattr(arch, name) for name in SPRINGS})
        peak = frequency[np.abs(response(linearise(stiff), frequency)).argmax()]
        low, high = (factor, high) if peak < wanted_hz else (low, factor)
    return factor


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    model: Annotated[str, typer.Option(help="shipped arch or MJCF file")] = "foot_arch",
    load: Annotated[float, typer.Option(help="static load on the arch [N]")] = ARANGIO_LOAD,
    figures: Annotated[Path | None, typer.Option(help="folder for sag.png and load.png")] = None,
    json: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Sag of the arch under a static load, and its resonance under the added masses of Chapter 2.

    Examples:
      python -m fasbody.static_load --figures docs/figures
    """
    if not 0 < load < 1e5:
        raise SettingError(f"--load is {load:g} N, but must be above 0 and below 100000 N.")
    if figures is not None:
        make_folder(figures)
    arch, name = read_arch(model), "Nominal arch" if model == "foot_arch" else Path(model).name
    sag, masses = sag_study(arch, np.array([0.02, 0.03, 0.04, 0.05, 0.06]), load), load_study(arch)
    console.print(_sag_table(sag, name))
    console.print(_load_table(masses, name))
    if figures is not None:
        from fasbody.figures import arch_sag, load_resonance, png

        smooth = sag_study(arch, np.linspace(0.02, 0.06, 41), load)
        measured = ARANGIO_SAG if load == ARANGIO_LOAD else {}
        ranges = np.array(list(MEASURED_HZ.values()))
        pictures = {"sag": arch_sag(smooth, measured), "load": load_resonance(masses, ranges)}
        for name, picture in pictures.items():
            console.print(f"written: {write_whole(figures / f'{name}.png', png(picture))}")
    if json:
        rows = [{key: value for key, value in vars(case).items() if key != "transmissibility"} for case in masses.cases]
        print_json({"model": model, "sag": vars(sag), "load": rows})


def _sag_table(study: SagStudy, name: str) -> Table:
    table = Table(title=f"{name} under {study.load:g} N; measured in brackets (Arangio 1998; heel: Kim & Voloshin)")
    for column in (
        "height [mm]", "sag [mm]", "sag, fascia cut [mm]", "more sag [%]", "more elongation [%]",
        "fascia's share [%]", "heel's share [%]",
    ):  # fmt: skip
        table.add_column(column, justify="right")
    for i, height in enumerate(study.height):
        measured = ARANGIO_SAG.get(round(float(height), 3)) if study.load == ARANGIO_LOAD else None
        cut = ARANGIO_CUT if measured and height > 0.05 else None
        values = (study.sag[i], study.sag_cut[i])
        more = (values[1] / values[0] - 1, study.elongation_cut[i] / study.elongation[i] - 1)
        nothing = (None, None)
        cells = [_beside(v, m, lambda x: f"{1e3 * x:.1f}") for v, m in zip(values, measured or nothing, strict=True)]
        cells += [_beside(v, m, lambda x: f"{100 * x:+.0f}") for v, m in zip(more, cut or nothing, strict=True)]
        shares = [_beside(v, m, lambda x: f"{100 * x:.0f}") for v, m in ((study.share[i], None), (study.heel[i], HEEL))]
        table.add_row(f"{1e3 * height:.0f}", *cells, *shares)
    return table


def _beside(model: float, measured: float | None, show: Callable[[float], str]) -> str:
    return show(model) if measured is None else f"{show(model)} ({show(measured)})"


def _load_table(study: LoadStudy, name: str) -> Table:
    table = Table(title=f"{name} under added mass, constants unchanged")
    for column in (
        "added [kg]", "peak [Hz]", "measured [Hz]", "|T| at peak [1]", "arch [kN/m]", "springs x to meet it [1]",
    ):  # fmt: skip
        table.add_column(column, justify="right")
    for case in study.cases:
        low, high = MEASURED_HZ[case.added_mass]
        table.add_row(
            f"{case.added_mass:g}", f"{case.peak_hz:.1f}", f"{low:.0f}-{high:.0f}",
            f"{case.transmissibility.max():.2f}", f"{case.arch_stiffness / 1e3:.1f}", f"{case.factor:.2f}",
        )  # fmt: skip
    return table


if __name__ == "__main__":
    command_line(app)
