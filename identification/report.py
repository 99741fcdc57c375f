"""report.html: everything a fit found on one self-contained page, with its figures and their numbers beside it."""

import math
from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path
from shlex import join
from typing import Any

from markupsafe import Markup

from fasbody import console
from fasbody.page import templates
from fasbody.presentation import csv_table, readable
from fasbody.recording.condition import FOOT_MASS_FRACTION, SHANK_MASS_FRACTION
from identification import figures
from identification.derived_quantities import Row, derived
from identification.estimates import IF_TRUE, RULE, WHATEVER, Allowance, Estimate, label
from identification.parameters import DELAY
from identification.result import FitResult, chance

#: Parts of chi-square that the page lists.
_WORST = 5
#: A nuisance below this share of what was held possible is none.
_NOTHING = 1e-4


def html(result: FitResult, drawn: dict[str, str] | None = None, folder: Path | None = None) -> str:
    """The page as text; no outside address is needed to read it.

    Args:
        result: the fit.
        drawn: its figures as SVG, by name, where they are drawn already.
        folder: that the page lies in, as a command would call it; None for this one.
    """
    environment = templates("identification", trim_blocks=True, lstrip_blocks=True)
    texts = captions(result)
    drawn = drawn or {name: figures.svg(getattr(figures, name)(result)) for name in texts}
    quantities = derived(result)
    key = "chi_square" if result.departures else "chi_square_if_model_true"
    worst = sorted((row for row in quantities.chi_square if row[key] is not None), key=lambda row: -row[key])
    return environment.get_template("report.html").render(
        result=result, label=label, chance=chance, interval=interval, allowed=allowed, energies=_energies(result),
        day=date.today().isoformat(), found=quantities, key=key, rule=RULE, bases=(WHATEVER, IF_TRUE), rests=rests,
        readable=readable,
        hits={start["branch"]: start["hits"] for start in result.starts if "hits" in start},
        pictures={name: {"svg": Markup(drawn[name][drawn[name].index("<svg") :]), "caption": texts[name]}
                  for name in texts},
        worst=worst[:_WORST],
        methods=methods(result), loads=_loads(result), moving=moving(result, folder),
    )  # fmt: skip


#: Figures that a paper prints; of the others a PNG would take longer than the fit.
_PRINTED = ("chi_square", "parameters", "transmissibility", "modes", "dampers", "energies")


def write(result: FitResult, folder: Path, called: Path | None = None) -> list[Path]:
    """Write result.json, parameters.csv, report.html and figures/ into a folder, each file whole or not at all.

    Each figure is there as SVG with a CSV file of what it draws, and those that a paper prints as PNG, too.

    Args:
        result: the fit.
        folder: to write into.
        called: how the report calls the folder, if it will lie elsewhere.
    """
    pictures = {name: getattr(figures, name)(result) for name in captions(result)}
    drawn = {name: figures.save(figure, "svg") for name, figure in pictures.items()}
    files: dict[str, str | bytes] = {
        "result.json": console.to_json(result.document()) + "\n",
        "parameters.csv": result.csv(),
        "report.html": html(result, {name: text.decode() for name, text in drawn.items()}, called or folder),
    }
    for name, figure in pictures.items():
        files[f"figures/{name}.svg"] = drawn[name]
        if name in _PRINTED:
            files[f"figures/{name}.png"] = figures.save(figure, "png")
    for name, rows in tables(result).items():
        files[f"figures/{name}.csv"] = csv_table(rows)
    return [console.write_whole(folder / name, text) for name, text in files.items()]


def moving(result: FitResult, folder: Path | None = None) -> str:
    """The command that shows this fit as a moving foot; with a recording where one lies where its label says."""
    model = str(result.provenance.get("model") or result.model)
    command = ["fasbody", "view", "--model", model, "--result", str((folder or Path()) / "result.json")]
    beside = next((r.file for r in result.recordings if Path(r.file).is_file()), "")
    options = ["--study", str(result.provenance["study"])] if "study" in result.provenance else []
    return join([*command, "--recording", beside, *options] if beside else command)


def tables(result: FitResult) -> dict[str, Sequence[Row]]:
    """Name -> rows of each CSV file beside the figures; a figure of two kinds of rows has two files."""
    quantities = derived(result)
    masses = [vars(mass) for mass in result.departures.masses] if result.departures else []
    rows: dict[str, Sequence[Row]] = {
        "transmissibility_data": quantities.data,
        "transmissibility_curves": quantities.curves,
        "chi_square": quantities.chi_square,
        "modes": quantities.modes,
        "dampers": quantities.dampers,
        "dampers_reached": quantities.reached,
        "energies": quantities.energies,
        "masses": masses, "scale": quantities.scale, "sensors": figures.sensor_rows(result),
        "contact": figures.contact_rows(result),
        "traces": figures.trace_rows(result), "residuals": figures.residual_rows(result),
        "parameters": result.records(), "waterfall": [dict(start) for start in result.starts],
        "correlation": [
            {"parameter": key, **dict(zip(result.parameters, row, strict=True))}
            for key, row in zip(result.parameters, result.best.correlation, strict=True)
        ],
    }  # fmt: skip
    return {name: value for name, value in rows.items() if value}


def captions(result: FitResult) -> dict[str, str]:
    """What each figure that this fit can fill shows, and of how many recordings."""
    quantities, best = derived(result), result.best
    n = _counted(result)
    basis = result.intervals[0].removeprefix("95 % CI, ")
    interval = f"95 % intervals, {basis}"
    other = f" Dashed: {result.mirror.name}. Where there is no dashed line, both coincide." if result.mirror else ""
    texts: dict[str, str] = {}
    if quantities.chi_square:
        harmonics = len(quantities.chi_square)
        texts["chi_square"] = (
            f"Where chi-square comes from: {harmonics} harmonics of {n}, {basis}. Noise alone gives 2 a harmonic on "
            "average. Parts above the dashed line, or many large ones at one load or frequency, show where the model "
            "does not fit."
        )
    at = ""
    if result.departures and result.relaxes:
        at = f" Stiffness and damping are at {result.departures.reference_frequency_hz:.3g} Hz; diamonds: at rest."
    if result.offered:
        texts["parameters"] = (
            f"Estimates of each branch from {n}; {interval}."
            + at
            + (" The dotted line is the truth." if result.truth else "")
        )
    if quantities.data or any(recording.frequency_hz is None for recording in result.recordings):
        curve = (
            f"Solid: {best.name}.{other} Curves include the estimated sensor errors, at the recorded amplitude. "
            if quantities.curves else ""
        )  # fmt: skip
        texts["transmissibility"] = (
            f"Acceleration of the malleolus over that of the base, and its phase lag ({n}). Marks: data with 95 % "
            f"limits by {_scatter(result)}, often smaller than the marks. {curve}Above the dotted line the ankle moves "
            "more than the base."
        )
    if quantities.modes:
        texts["modes"] = (
            f"Natural frequencies and damping ratios of small motion about rest under each load, from {n}; errors "
            "propagated linearly. A mode with a damping ratio above one is overdamped: it does not oscillate. Filled "
            "marks: model assumed exact"
            + ("; open ones: model and sensor errors included." if result.departures else ".")
        )
    if quantities.dampers:
        texts["dampers"] = (
            f"Damping over the relative displacement that {n} reached (bars, by load); extension is positive. Bands of "
            "95 % at each displacement, errors propagated linearly."
            + (" Damping by relaxing springs is not shown, but is included in c_11 and c_21." if result.relaxes else "")
        )
    if quantities.energies:
        texts["energies"] = (
            f"Energy that ankle and fat pad dissipate in one cycle, one mark a recording ({n}); {interval}."
            if all(math.isfinite(row["upper_j"]) for row in quantities.energies)
            else f"Energy that ankle and fat pad dissipate in one cycle, one mark a recording ({n})."
        )
    texts["traces"] = f"Acceleration of the malleolus over three periods, data and model ({best.name}); {n}."
    texts["residuals"] = f"Amplitude spectrum of the residuals, beside that of the data; {n}."
    if result.offered:
        texts["correlation"] = (
            f"Correlation of the {len(result.parameters)} estimates, {basis}. Near ±1 only a combination of two is "
            "determined."
        )
    if result.starts and result.domain != "periodic":
        texts["waterfall"] = (
            f"Final sum of squares of the {len(result.starts)} starts. A flat beginning means that several of them "
            "found the same minimum."
        )
    if result.by_sensor:
        texts["sensors"] = (
            f"Each sensor over the base ({n}): data as points, the {best.name} branch as lines. "
            f"{'; '.join(result.by_sensor)}."
        )
    if result.contact:
        texts["contact"] = (
            f"Force between table and foot over a cycle ({n}, {best.name} branch), and the "
            "static force (dashed). Below zero a real foot would lift off the table."
        )
    return texts


def _scatter(result: FitResult) -> str:
    """What limits a measured transmissibility, in words."""
    if result.departures is None or result.departures.repeatability < 5e-4:
        return "noise"
    return f"noise and scatter between recordings ({100 * result.departures.repeatability:.2g} %)"


def rests(result: FitResult) -> dict[str, str]:
    """Constants that are another number at rest than at the reference frequency, with their 95 % intervals there."""
    pairs = {key: (e.interval(), e.at_rest.interval()) for key, e in result.parameters.items() if e.at_rest}
    return {key: rest for key, (dynamic, rest) in pairs.items() if rest != dynamic}


def interval(value: float, lower: float, upper: float, scale: float = 1.0) -> str:
    """Value and half width of a 95 % interval, rounded to what is known; the value alone where there is none."""
    if not math.isfinite(upper - lower):
        return f"{scale * value:.3g}"
    std = (upper - lower) / 3.92
    return Estimate(scale * value, scale * std, scale * lower, scale * upper, False, "").interval()


def allowed(allowance: Allowance) -> str:
    """What else may be true as the recordings have it; at the bound of a half-normal prior, as that."""
    size = max(abs(allowance.prior_upper), abs(allowance.prior_lower))
    if allowance.prior == allowance.prior_lower and abs(allowance.value - allowance.prior_lower) < _NOTHING * size:
        return f"{allowance.prior_lower:g} (bound)"
    return "0" if abs(allowance.value) < _NOTHING * size else readable(allowance.value, 2)


def _counted(result: FitResult) -> str:
    count = len(result.recordings)
    return f"n = {count} recording{'s' if count > 1 else ''}"


def _loads(result: FitResult) -> dict[float, list[Any]]:
    """Added mass [kg] -> its recordings."""
    by_load: dict[float, list[Any]] = {}
    for recording in result.recordings:
        by_load.setdefault(recording.added_mass_kg, []).append(recording)
    return dict(sorted(by_load.items()))


def _energies(result: FitResult) -> list[tuple[Row, Row]]:
    """Ankle and pad of each recording and open branch, on the wider basis."""
    rows = [row for row in derived(result).energies if row["basis"] == result.intervals[0]]
    return list(zip(rows[::2], rows[1::2], strict=True))


def methods(result: FitResult) -> list[str]:
    """A methods section with the numbers of this fit, paragraph by paragraph."""
    return [text for text in (part(result) for part in _PARTS) if text]


def _data(result: FitResult) -> str:
    groups = []
    for load, mine in _loads(result).items():
        frequencies = sorted(r.frequency_hz for r in mine if r.frequency_hz is not None)
        at = (
            f"{frequencies[0]:.3g} to {frequencies[-1]:.3g} Hz"
            if len(frequencies) > 1
            else f"{frequencies[0]:.3g} Hz"
            if frequencies
            else ""
        )
        at = at if len(frequencies) == len(mine) else f"{at} and broadband" if at else "broadband"
        groups.append(f"{len(mine)} with {load:g} kg on the knee ({at})")
    first = result.recordings[0].time_s
    rate = (first.size - 1) / (first[-1] - first[0])
    seconds = sorted({round(float(r.time_s[-1] - r.time_s[0] + 1 / rate), 2) for r in result.recordings})
    length = f"{seconds[0]:g} s" if len(seconds) == 1 else f"{seconds[0]:g} to {seconds[-1]:g} s"
    parts = [f"{r.file}, {r.part_s[0]:g} to {r.part_s[1]:g} s" for r in result.recordings if r.part_s]
    kind = {"synthetic": "Synthetic", "measured": "Measured"}.get(result.origin, "The given")
    return (
        f"{kind} accelerations of base and medial malleolus were used, {_counted(result)}: {', '.join(groups)}; "
        f"{length} each, sampled at {rate:.4g} Hz." + (f" Parts used: {'; '.join(parts)}." if parts else "")
    )


def _reduction(result: FitResult) -> str:
    best, rows = result.best, derived(result).chi_square
    if result.domain != "periodic":
        return (
            "The model was compared with every sample in the time domain. The initial state of each recording was "
            "estimated."
        )
    numbers = f": {2 * len(rows)} numbers in all" if rows else ""
    return (
        "Each recording was reduced to the complex amplitudes of its harmonics (up to six, at most 100 Hz) by least "
        f"squares{numbers}. The residual was weighted by the noise of the harmonics of both channels, so that its sum "
        f"of squares follows the chi-square distribution with {best.dof} degrees of freedom where the model is exact."
    )


def _model(result: FitResult) -> str:
    free = ", ".join(label(key) for key in result.parameters)
    masses = result.departures.masses if result.departures else ()
    stated = ", ".join(f"{m.name} = {m.stated:.4g} kg ± {100 * m.prior_std:.3g} %" for m in masses)
    evidence = result.evidence
    shares = evidence is None or all("m_F" in r.condition.masses for r in evidence.recordings)
    text = f"The model {result.model} with {len(result.parameters)} free parameters was fitted ({free}). "
    if stated:
        of = (
            f"{100 * SHANK_MASS_FRACTION:.3g} % (shank) and {100 * FOOT_MASS_FRACTION:.3g} % (foot) of the body mass"
            if shares
            else "those of the model, as the body mass is unknown"
        )
        text += f"Segment masses were {of} ({stated}, standard deviation) and were estimated with the rest. "
    elif result.departures:
        text += "Segment masses were taken as exactly known. "
    return text + _searched(result)


def _searched(result: FitResult) -> str:
    """How the minimum was searched, and what was simulated in MuJoCo."""
    seed, engine = result.provenance.get("seed"), result.provenance.get("versions", {}).get("mujoco")
    mujoco = "MuJoCo" + (f" {engine}" if engine else "")
    steady = result.domain == "periodic"
    count = sum(int(start["evaluations"]) for start in result.starts) if steady else len(result.starts)
    text = f"The search had {count} starts" + (f" (seed {seed})" if seed is not None else "")
    text += "; both mirror solutions were searched. " if result.mirror else ". "
    if steady:
        apart = result.twin_mujoco_difference or 0.0
        return (
            f"{text}Periodic motion was computed by harmonic balance. Each solution was also simulated in {mujoco}; "
            f"the two differ by at most {apart:.1e} of the largest harmonic."
        )
    text += f"The reported estimate is the minimum of the simulation in {mujoco}"
    if result.twin_mujoco_difference is not None:
        text += (
            f", which differs from the equations of motion by at most {result.twin_mujoco_difference:.1e} of the peak"
        )
    return f"{text}."


def _beyond(result: FitResult) -> str:
    if not result.departures:
        return "All intervals assume that model, masses and instruments are exact."
    names = [n.name for n in result.departures.nuisances if n.group != "masses"]
    names = ["delay between the channels" if name == DELAY.name else name for name in names]
    names = (["segment masses"] if result.departures.masses else []) + names
    text = (
        f"Nuisance parameters with priors were estimated together with the constants: {', '.join(names)}. The scatter "
        f"between recordings was estimated, too: {result.departures.repeats}. For the model assumed exact, "
    )
    kept = any(n.name == DELAY.name for n in result.departures.nuisances)
    text += "the delay is estimated, and all other nuisance parameters " if kept else "all nuisance parameters "
    text += "are held at their nominal values. "
    if result.relaxes:
        text += (
            "Stiffness and damping are the real part of the joint's complex stiffness, and its imaginary part over "
            f"the angular frequency, at {result.departures.reference_frequency_hz:.3g} Hz, the geometric mean of the "
            "recorded frequencies. "
        )
    return text + (
        "Errors of derived quantities are propagated linearly. Natural frequencies and damping ratios are those of "
        "small motion about rest."
    )


def _outcome(result: FitResult) -> str:
    best = result.best
    if result.domain != "periodic" or not best.dof:
        return f"The fit is {result.fit_percent:.1f} %. Choice of branch: {result.verdict}."
    p = "" if best.p_value is None else f", {chance(best.p_value)}"
    text = f"Chi-square of the model assumed exact was {best.chi_square:.4g} for {best.dof} degrees of freedom{p}"
    if result.departures:
        text += f"; with model and sensor errors included, {result.departures.repeats}"
    return f"{text}. Choice of branch: {result.verdict}. {result.reason}"


_PARTS: tuple[Callable[[FitResult], str], ...] = (_data, _reduction, _model, _beyond, _outcome)
