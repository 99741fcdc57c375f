"""The same recordings against a ladder of rival models: each at its best, ranked by BIC and by what it foretells."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fasbody.exceptions import ModelError, RecordingError, SettingError, unknown
from fasbody.foot.model import Foot, load
from fasbody.recording.checks import apart, checked
from fasbody.recording.known import Known
from fasbody.recording.recording import Recording, gain_and_delay
from fasbody.recording.study import Study
from identification.domains import steady
from identification.engines.twin import twin_applies
from identification.periodic import Line
from identification.result import Estimate, identifiability
from identification.rivals.edited import edited
from identification.rivals.ladder import LADDER, LINEAR, Rung, RungSpace, nuisances
from identification.rivals.problem import Measured, RungProblem
from identification.rivals.result import MODEL, Own, Point, Rival, Rivals, preferred
from identification.rivals.search import Side, climb, held_out
from identification.search import inverse_of_gram
from identification.world import DELAY_STD_SAMPLES, GAIN_STD, MASS_STD

_Z95 = 1.959963984540054
Advance = Callable[[str, int, int], None]


def compare_rivals(
    study: Study | Recording | Iterable[Recording],
    foot: Foot | None = None,
    *,
    rungs: Sequence[str] | None = None,
    files: Sequence[Path | str] = (),
    mass_std: float | None = None,
    gain_std: float | None = None,
    delay_std_s: float | None = None,
    source: str = "",
    advance: Advance = lambda what, done, total: None,
) -> Rivals:
    """Compare rival models on recordings of one foot in steady vibration.

        compare_rivals(study).first

    Args:
        study: a study, or one or more recordings of one person, at one or more frequencies and loads.
        foot: the two-mass model, default the shipped one; its bounds hold for all rivals.
        rungs: names of rivals to compare beside the linear foot and the model, default all (`ladder.LADDER`).
        files: edited MJCF models to compare, too.
        mass_std, gain_std, delay_std_s: what masses, gain and delay may be off, as in `fit_foot`.
        source: name of the data, if not that of the study. advance: called with what is done, how many of how many.

    Raises:
        RecordingError: a recording is not steady, or they are of several persons. ModelError: the model is not the
            two-mass foot. SettingError: an unknown rung.
    """
    began = time.perf_counter()
    foot = foot or load("two_dof")
    chosen = _rungs(rungs)
    if not twin_applies(foot):
        raise ModelError(
            f"{foot.name}: the ladder of rivals is known for the two-mass foot only; leave --model out and give this "
            "file as --rival."
        )
    models = [load(file) for file in files]
    given = [study] if isinstance(study, Recording) else list(study)
    data = _checked(given)
    known = Known.of_all([r.known for r in data]).told(mass_std=mass_std, gain_std=gain_std, delay_std_s=delay_std_s)
    lines = [Line.of(r) for r in data]
    measured = Measured.of(lines)
    spaces = _spaces(foot, data, measured, known, chosen)
    advance("climbing the ladder", 0, len(spaces) + len(models))
    measured, ends = climb(measured, spaces)
    found = []
    for number, space in enumerate(spaces):
        advance(space.rung.title, number + 1, len(spaces) + len(models))
        found.append(_rival(measured, space, ends[space.rung.name]))
    for number, model in enumerate(models):
        advance(model.name, len(spaces) + number, len(spaces) + len(models))
        found.append(edited(model, data, lines, measured, known))
    return Rivals(
        source=source or (study.name if isinstance(study, Study) else data[0].file),
        model=foot.name,
        rivals=tuple(preferred(found)),
        points=tuple(
            Point(line.recording.file, line.base.frequency_hz, line.recording.condition.added_mass_kg,
                  line.base.amplitudes, line.malleolus.amplitudes, line.malleolus.std)
            for line in lines
        ),
        warnings=tuple(dict.fromkeys(text for r in data for text in r.warnings)),
        seconds=time.perf_counter() - began,
    )  # fmt: skip


def _rungs(names: Sequence[str] | None) -> list[Rung]:
    known = [rung.name for rung in LADDER]
    for name in names or ():
        if name not in known:
            raise SettingError(f"{unknown('rung', name, known)}.")
    return [rung for rung in LADDER if names is None or rung.name in (LINEAR, MODEL, *names)]


def _checked(given: Sequence[Recording]) -> list[Recording]:
    """Steady recordings of one person.

    Raises:
        RecordingError: see `compare_rivals`.
    """
    if not given:
        raise RecordingError("there is no recording to compare rivals on.")
    apart(given)
    data = [checked(recording) for recording in given]
    for r in data:
        if r.condition.frequency_hz is None:
            raise RecordingError(f"{r.file}: is not periodic; rivals are compared on steady vibration, one sine each.")
    if not steady(data):
        raise RecordingError(
            f"{data[0].file} or one beside it is not steady (its amplitude drifts or beats); rivals are compared on "
            "steady vibration."
        )
    people = {(r.condition.subject, r.condition.body_mass_kg) for r in data}
    if len(people) > 1:
        named = ", ".join(sorted(f"{who or 'unnamed'} {mass or '?'} kg" for who, mass in people)[:4])
        raise RecordingError(f"the recordings are of several persons ({named}); compare rivals for one at a time.")
    if len({r.condition.frequency_hz and round(r.condition.frequency_hz, 1) for r in data}) < 3:
        raise RecordingError(
            f"{data[0].file}: rivals are told apart by how they depend on frequency; give recordings of at least three "
            "frequencies."
        )
    return data


def _spaces(
    foot: Foot, data: Sequence[Recording], measured: Measured, known: Known, rungs: Sequence[Rung]
) -> list[RungSpace]:
    """The search spaces of the rungs that these recordings can tell."""
    limits = {name: (item.lower, item.upper) for name, item in foot.parameters.items()}
    bare = replace(data[0].condition, added_mass_kg=0.0).masses
    m_S, m_F = (float(bare.get(name, foot.values()[name])) for name in ("m_S", "m_F"))
    ratio = float(np.mean((m_S + measured.loads_kg) / (m_S + m_F + measured.loads_kg)))
    sizes = uncertainties(data, known)
    loads = np.unique(measured.loads_kg).size
    return [
        RungSpace(rung, limits, ratio, m_S, m_F, nuisances(sizes)) for rung in rungs if loads >= rung.loads
    ]  # fmt: skip


def uncertainties(data: Sequence[Recording], known: Known) -> dict[str, float]:
    """Standard deviations of masses, gain, delay and drift: as told, else as calibrated, else the usual."""
    stated = np.array([gain_and_delay(r, "malleolus", "base") for r in data]).max(axis=0)
    usual = (GAIN_STD, DELAY_STD_SAMPLES / min(r.rate_hz for r in data))
    gain, delay = (float(s) if s > 0 else u for s, u in zip(stated, usual, strict=True))
    sizes = {
        "masses": MASS_STD if known.mass_std is None else known.mass_std,
        "gain": gain if known.gain_std is None else known.gain_std,
        "delay": delay if known.delay_std_s is None else known.delay_std_s,
    }
    return sizes | ({"drift": 0.0} if "drift" in known.excluded else {})


def _rival(measured: Measured, space: RungSpace, ends: Sequence[Side]) -> Rival:
    """A rung with its intervals, and what it foretells."""
    best, other = ends[0], ends[1] if len(ends) > 1 else None
    problem = RungProblem(measured, space)
    chi_square = problem.chi(best.q)
    dof = max(1, measured.size - space.counted)
    told, error = held_out(measured, space, best)
    k_T, k_F, ratio = _springs(problem, best.q, dof)
    across = _springs(problem, other.q, dof)[:2] if other else None
    problem.evaluate(best.q)
    return Rival(
        name=space.rung.name, title=space.rung.title, free=space.counted, chi_square=chi_square, dof=dof,
        bic=best.objective + space.counted * float(np.log(measured.size)), held_out=told, error=error,
        branch=best.branch, log_odds=0.5 * (other.objective - best.objective) if other else None,
        k_T=k_T, k_F=k_F, log_ratio=ratio, other=across, own=_own(problem, best.q, dof),
        values=space.named(best.q), predicted=tuple(problem.predict(best.q)), converged=best.converged,
        nested=space.rung.nested, extra=bool(space.rung.own),
    )  # fmt: skip


def _covariance(problem: RungProblem, q: np.ndarray, dof: int) -> np.ndarray:
    """Of the search variable, widened by the misfit."""
    return inverse_of_gram(problem.evaluate(q)[1]) * max(1.0, problem.chi(q) / dof)


def _springs(problem: RungProblem, q: np.ndarray, dof: int) -> tuple[Estimate, Estimate, tuple[float, float]]:
    C, space = _covariance(problem, q, dof)[:2, :2], problem.space
    la, found = np.log(space.ratio), []
    for sign, name in ((0.5, "k_T"), (-0.5, "k_F")):
        row = np.array([1.0, sign])
        log, std = q[0] + sign * (q[1] + la), float(np.sqrt(row @ C @ row))
        value, (low, high) = float(np.exp(log)), space.limits[name]
        lower, upper = (float(np.clip(value * np.exp(z * std), low, high)) for z in (-_Z95, _Z95))
        bound = value < 1.001 * low or value > 0.999 * high
        found.append(Estimate(value, value * std, lower, upper, bound, identifiability(value, value * std, 0.0, bound)))
    return found[0], found[1], (float(q[1] + la), float(np.sqrt(C[1, 1])))


def _own(problem: RungProblem, q: np.ndarray, dof: int) -> tuple[Own, ...]:
    """The rung's own constants; 1 / f^2 of a mount is told as its frequency."""
    C, space, found = _covariance(problem, q, dof), problem.space, []
    at = {v.name: i for i, v in enumerate(space.variables)}
    for v in space.rung.own:
        x, std = q[at[v.name]] * v.size, float(np.sqrt(C[at[v.name], at[v.name]])) * v.size
        ends = [float(np.clip(x + z * std, v.lower, v.upper)) for z in (0.0, -_Z95, _Z95)]
        value, lower, upper = (float(np.exp(e)) if v.kind == "log" else e for e in ends)
        if v.name == "u":
            value, upper, lower = (e**-0.5 if e > 0 else np.inf for e in (value, lower, upper))
            found.append(Own("f_u", "frequency of the sensor on its tissue", "Hz", value, lower, upper, v.source))
        else:
            found.append(Own(v.name, v.says, v.unit, value, lower, upper, v.source))
    return tuple(found)
