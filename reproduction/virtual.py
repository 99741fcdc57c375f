"""Data that several rows share: the virtual study of Chapter 2, the bundled subject, measured recordings if any."""

import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from fasbody.foot import shaker
from fasbody.foot.stepper import trajectory
from fasbody.foot.two_dof import TwoDof
from fasbody.laboratory.study import FREQUENCIES_HZ, Plan, make
from fasbody.recording.condition import ADDED_MASSES_KG, foot_mass, shank_mass
from fasbody.recording.recording import Recording
from fasbody.recording.study import BUNDLED, Study, StudyFolder
from fasbody.transmissibility.findings import Finding, findings
from fasbody.transmissibility.table import Table
from identification.blackbox.data import Series, from_recording
from reproduction.check import Check, at_least, exactly
from reproduction.row import Outcome
from reproduction.virtual_transfer import study

#: Seconds of each virtual recording: 20 periods at 10 Hz; `python -m fasbody.laboratory` makes 10 s by default.
SECONDS = 2.0
#: Seeds of other virtual studies, made as transfer functions: the default seed was picked, these were not.
OTHER_SEEDS = range(100, 200)
#: Share of them in which a statement must come out, too.
USUALLY = 0.8
#: Subjects of one large study: `present` asks it what is true of the virtual subjects as a whole, whatever the draw.
LARGE, LARGE_SEED = 400, 1000
#: Rows of one group share what they compute; and the command that makes and analyses the same study.
STUDY = "virtual study"
STUDY_COMMAND = "python -m fasbody.laboratory S --subjects 20 --seconds 2 && python -m fasbody.transmissibility S"


@cache
def study_table() -> Table:
    """900 virtual recordings, made, written, read and analysed as a user's would be."""
    with tempfile.TemporaryDirectory() as folder:
        made = make(Path(folder) / "study", Plan(seconds=SECONDS), processes=1)
        return Table.of(StudyFolder.open(made), processes=1)


@cache
def other_tables() -> tuple[Table, ...]:
    """The same study with other seeds."""
    return tuple(study(seed) for seed in OTHER_SEEDS)


@cache
def exact_table() -> Table:
    """The default study once more, of transfer functions alone: what its recordings should have given."""
    return study(Plan().seed)


@cache
def large_table() -> Table:
    """One study of so many virtual subjects that chance hardly moves its means."""
    return study(LARGE_SEED, LARGE)


@cache
def large_findings() -> dict[str, bool]:
    """Whether each statement that fasbody.transmissibility judges holds there."""
    return {finding.says: finding.holds is True for finding in findings(large_table())}


@cache
def study_findings() -> dict[str, Finding]:
    """Every statement of sections 2.3 and 2.4 that fasbody.transmissibility judges, on the virtual study."""
    return {finding.says: finding for finding in findings(study_table())}


@cache
def findings_elsewhere() -> tuple[dict[str, bool], ...]:
    """Whether each of them holds, study by study of the other seeds."""
    return tuple({finding.says: finding.holds is True for finding in findings(table)} for table in other_tables())


def whatever_the_seed(checks: Sequence[Check], elsewhere: Sequence[bool], in_large: bool, note: str = "") -> Outcome:
    """A statement on the virtual study that must hold in most studies with other seeds, too.

    Args:
        checks: on the virtual study. elsewhere: whether they hold in each of the others. in_large: whether they hold
            in `large_table()`; if not, the statement is not true of the virtual subjects.
    """
    share = sum(elsewhere) / len(elsewhere)
    untrue = "" if in_large else f" Not true of {LARGE} virtual subjects."
    return Outcome(
        printed=[*checks, at_least(f"share of {len(elsewhere)} other seeds with which it holds", share, USUALLY)],
        present=[exactly(f"it holds (1) or not (0) with {LARGE} virtual subjects", in_large, 1)],
        synthetic=True,
        note=(note + untrue).strip(),
    )


def judged(judge: Callable[[Table], Sequence[Check]], note: str = "") -> Outcome:
    """A statement as checks of a table, made of the virtual study and of those with other seeds."""
    elsewhere = [all(check.met for check in judge(table)) for table in other_tables()]
    in_large = all(check.met for check in judge(large_table()))
    return whatever_the_seed(judge(study_table()), elsewhere, in_large, note)


@cache
def bundled() -> tuple[Recording, ...]:
    """The nine recordings of the synthetic subject 16, 10 to 50 Hz without added mass."""
    recordings = Study.read(BUNDLED).under(0.0).recordings
    return tuple(sorted(recordings, key=lambda r: r.condition.frequency_hz or 0.0))


@cache
def bundled_series() -> tuple[Series, ...]:
    """The same for the black-box models."""
    return tuple(from_recording(recording) for recording in bundled())


#: Recordings of one subject behind a table of Chapter 3: nine frequencies under three loads.
PER_SUBJECT = len(FREQUENCIES_HZ) * len(ADDED_MASSES_KG)


def rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.abs(values) ** 2)))


@cache
def loaded_series(frequency_hz: float) -> Series:
    """Ten seconds of a strongly nonlinear foot with 4.5 kg on the knee, with noise on both channels."""
    foot = TwoDof(1.31e5, 9.4e4, 165.0, 90.0, 140.0, 310.0, -120.0, 180.0, shank_mass(70.7, 4.5), foot_mass(70.7))
    n = 10_000
    base = shaker.sine(frequency_hz, n * 1e-3)
    y, *_ = trajectory(np.zeros(4), foot.theta, foot.m_S, foot.m_F, base.half_steps(5e-4, 2 * n), 5e-4, 2, 0)
    noise = np.random.default_rng(round(frequency_hz)).standard_normal((2, n))
    return Series(base.acceleration(np.arange(n) * 1e-3) + 0.03 * noise[0], y + 0.05 * noise[1], 1e-3)
