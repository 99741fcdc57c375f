"""Data that several rows share: the virtual study of Chapter 2, the bundled subject, measured recordings if any."""

import tempfile
from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.findings_by_seed import study
from fasbody import shaker
from fasbody.recording import Recording, Study, StudyFolder
from fasbody.subjects import ADDED_MASSES_KG, foot_mass, shank_mass
from fasbody.transmissibility.findings import Finding, findings
from fasbody.transmissibility.table import Table
from fasbody.two_dof import TwoDof, trajectory
from fasbody.virtual_study import FREQUENCIES_HZ, Plan, make
from identification.blackbox.data import Series, from_recording
from identification.fit import BUNDLED

#: Seconds of each virtual recording: 20 periods at 10 Hz; `python -m fasbody.laboratory` makes 10 s by default.
SECONDS = 2.0
#: Virtual studies made with other seeds, as transfer functions, to say how lucky the default seed is.
OTHER_STUDIES = 20
#: The command that makes and analyses the same study.
STUDY_COMMAND = "python -m fasbody.laboratory S --subjects 20 --seconds 2 && python -m fasbody.transmissibility S"


@cache
def study_table() -> Table:
    """900 virtual recordings, made, written, read and analysed as a user's would be."""
    with tempfile.TemporaryDirectory() as folder:
        made = make(Path(folder) / "study", Plan(seconds=SECONDS), processes=1)
        return Table.of(StudyFolder.open(made), processes=1)


@cache
def study_findings() -> list[Finding]:
    """Every statement of sections 2.3 and 2.4 that the code judges, on that study."""
    return findings(study_table())


@cache
def share_elsewhere() -> dict[str, float]:
    """Share of other virtual studies in which each statement comes out."""
    held: Counter[str] = Counter()
    for seed in range(100, 100 + OTHER_STUDIES):
        held.update({finding.says: int(finding.holds is True) for finding in findings(study(seed))})
    return {says: count / OTHER_STUDIES for says, count in held.items()}


@cache
def bundled() -> tuple[Recording, ...]:
    """The nine recordings of the synthetic subject 16, 10 to 50 Hz without added mass."""
    recordings = Study.read(BUNDLED).recordings
    return tuple(sorted(recordings, key=lambda r: r.condition.frequency_hz or 0.0))


@cache
def bundled_series() -> tuple[Series, ...]:
    """The same for the black-box models."""
    return tuple(from_recording(recording) for recording in bundled())


def measured_recordings() -> int:
    """Recordings of people among the studies that come with the package: the thesis' own were never published."""
    folders = [file.parent for file in BUNDLED.parent.rglob("study.toml")]
    return sum(len(s.trials) for s in map(StudyFolder.open, folders) if s.origin == "measured")


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
