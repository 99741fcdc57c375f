"""A virtual laboratory: synthetic recordings with known truth, to learn on and to test against.

`python -m fasbody.laboratory FOLDER --subjects 20` makes a whole study (virtual_study.py). Without `--subjects` it
makes recordings of one foot with constant parameters, the two-mass model of Eq. (4.29) integrated by DOP853 at tight
tolerance (neither of the engines that the fit uses); the instrument adds what real ones add: shaker harmonics, sensor
noise, 12-bit quantisation, a delay between the multiplexed channels. Everything it writes says that it is synthetic,
and `truth.json` holds the parameters.
"""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from scipy.integrate import solve_ivp

from fasbody.console import command_line, console, progress_bar, to_json, write_whole
from fasbody.exceptions import SettingError
from fasbody.instrument import STRAPPED, Instrument
from fasbody.recording import Condition, Recording
from fasbody.shaker import BaseMotion
from fasbody.subjects import ADDED_MASSES_KG, SUBJECTS, foot_mass, shank_mass
from fasbody.trials import listed
from fasbody.two_dof import TwoDof
from fasbody.virtual_study import CONSTANTS, EXCITATIONS, FREQUENCIES_HZ, Plan, make
from fasbody.virtual_subject import POSTURES

#: A foot with visibly nonlinear dampers: invented, within what chapters 2 and 4 of the thesis describe.
TRUTH = {"k_T": 1.31e5, "k_F": 9.4e4, "c_11": 380.0, "c_12": 90.0, "c_13": 140.0, "c_21": 760.0, "c_22": -120.0}
TRUTH |= {"c_23": 180.0}


def record(
    foot: TwoDof,
    motion: BaseMotion,
    seconds: float,
    instrument: Instrument,
    rng: np.random.Generator,
    settle: float = 1.0,
) -> Recording:
    """One synthetic recording of a foot on the shaker.

    Args:
        foot: true parameters. motion: base motion. seconds: length [s]. instrument: what it adds. rng: noise source.
        settle: the shaker runs this long before the recording starts [s]; 0 records the transient from rest.
    """
    return instrument.observe(exact(foot, motion, seconds, instrument, settle), rng)


def exact(foot: TwoDof, motion: BaseMotion, seconds: float, instrument: Instrument, settle: float = 1.0) -> Recording:
    """The same without noise and quantisation: what happened at the samples, the channel delay included."""
    t = np.arange(round(seconds * instrument.rate_hz)) / instrument.rate_hz
    late = np.maximum(t + settle - instrument.delay_s, 0.0)  # at rest until the shaker starts
    solution = solve_ivp(
        lambda time, x: foot.rates(time, x, float(motion.acceleration(np.array([time]))[0])),
        (0.0, late[-1]), np.zeros(4), method="DOP853", t_eval=late, rtol=1e-9, atol=1e-12, max_step=5e-3,
    )  # fmt: skip
    return Recording(t, motion.acceleration(t + settle), foot.output(solution.y), origin="synthetic")


def make_study(
    folder: Path,
    subject: int = 16,
    frequencies_hz: Sequence[float] = FREQUENCIES_HZ,
    added_masses_kg: Sequence[float] = (0.0,),
    seconds: float = 4.0,
    seed: int = 16,
    instrument: Instrument | None = None,
) -> Path:
    """Write a synthetic study folder with `truth.json` beside it; see the module's docstring.

    Raises:
        SettingError: no such subject, or a length or frequency that makes no recording.
    """
    instrument = instrument or Instrument()
    if subject not in SUBJECTS:
        raise SettingError(f"there is no subject {subject}; Table 2.1 has 1 to {len(SUBJECTS)}.")
    for f in frequencies_hz:
        if not 0.5 <= f <= instrument.rate_hz / 10:
            raise SettingError(
                f"a frequency of {f:g} cannot be recorded at {instrument.rate_hz:g} Hz (valid: 0.5 to 100 Hz)."
            )
        if not 3 <= seconds * f <= 3600 * f:
            raise SettingError(f"a length of {seconds:g} is no recording of {f:g} Hz (valid: {3 / f:.3g} to 3600 s).")
    body = SUBJECTS[subject].mass_kg
    rng = np.random.default_rng(seed)
    rows = ["file,subject,posture,added_mass_kg,frequency_hz"]
    trials = [(added, f) for added in added_masses_kg for f in frequencies_hz]
    with progress_bar() as progress:
        for added, f in progress.track(trials, description="recording"):
            foot = TwoDof(**TRUTH, m_S=shank_mass(body, added), m_F=foot_mass(body))
            made = record(foot, instrument.motion(f, seconds + 2, rng), seconds, instrument, rng)
            condition = Condition(str(subject), "midstance", added, body, f)
            name = f"recordings/{f:g}hz_{added:g}kg.csv"
            replace(made, condition=condition).write(folder / name)
            rows.append(f"{name},{subject},midstance,{added:g},{f:g}")
    person = SUBJECTS[subject]
    subjects = f"subject,age_yr,height_m,mass_kg\n{subject},{person.age_yr},{person.height_m},{person.mass_kg}\n"
    write_whole(folder / "subjects.csv", subjects)
    write_whole(folder / "recordings.csv", "\n".join(rows) + "\n")
    known = {name: value for name, value in asdict(instrument).items() if name not in STRAPPED}
    truth = {"origin": "synthetic", "seed": seed, "parameters": TRUTH, "instrument": known}
    write_whole(folder / "truth.json", to_json(truth) + "\n")
    for table in ("truth.csv", CONSTANTS):  # of a whole study that was here before
        (folder / table).unlink(missing_ok=True)
    write_whole(folder / "study.toml", _STUDY.format(subject=subject, body=body, seed=seed, instrument=instrument))
    return folder


_STUDY = '''[study]
name = "synthetic subject {subject}"
origin = "synthetic"
description = """
Made by python -m fasbody.laboratory (seed {seed}) from a two-mass foot with the body mass of subject {subject},
{body:g} kg. Nobody was measured: truth.json holds the parameters."""
sampling_rate_hz = {instrument.rate_hz:g}

[channels.base]
unit = "m/s^2"

[channels.malleolus]
unit = "m/s^2"
delay_std_s = {instrument.delay_s:g}
'''

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    study: Annotated[Path, typer.Argument(help="folder to write")],
    subjects: Annotated[
        int | None, typer.Option(help="a whole study of so many virtual subjects, with tuberosity and scatter")
    ] = None,
    subject: Annotated[int, typer.Option(help="else: subject of Table 2.1 whose body mass one foot has")] = 16,
    added_mass: Annotated[
        list[float] | None, typer.Option(help="mass on the knee in kg; repeat (default 0, for studies 0, 2.3, 4.5)")
    ] = None,
    posture: Annotated[
        list[str] | None, typer.Option(help=f"{', '.join(POSTURES)}; repeat (studies; default all, unloaded)")
    ] = None,
    frequency: Annotated[
        list[float] | None, typer.Option(help="excitation in Hz; repeat (default 10, 15 ... 50)")
    ] = None,
    excitation: Annotated[str, typer.Option(help=f"{', '.join(EXCITATIONS)} (studies)")] = "sine",
    peak_to_peak: Annotated[float, typer.Option(help="base acceleration in m/s^2 (studies)")] = 17.9,
    seconds: Annotated[
        float | None, typer.Option(help="length of each recording in s (default 4, for studies 10)")
    ] = None,
    file_format: Annotated[str, typer.Option("--format", help="csv, mat, h5, uff or tdms (studies)")] = "csv",
    seed: Annotated[int | None, typer.Option(min=0, help="seed of subjects, phases and noise")] = None,
    jobs: Annotated[int, typer.Option(help="processes; 0 for all cores")] = 0,
) -> None:
    """Make a synthetic study with known truth.

    Examples:
      python -m fasbody.laboratory my_study --subjects 20

      python -m fasbody.laboratory one_foot --added-mass 0 --added-mass 2.3 --seconds 10
    """
    if (study / "recordings.csv").exists() and not (study / "truth.json").exists():
        raise SettingError(f"{study} holds a study that was not made here; name another folder.")
    before = _written(study)
    frequencies = tuple(frequency or FREQUENCIES_HZ)
    if subjects is None:
        if posture or excitation != "sine":
            raise SettingError("postures and excitations other than sines need --subjects.")
        made = make_study(
            study,
            subject,
            frequencies,
            added_mass or [0.0],
            4.0 if seconds is None else seconds,
            16 if seed is None else seed,
        )
    else:
        conditions = tuple((p, m) for p in posture or ["midstance"] for m in added_mass or ADDED_MASSES_KG)
        plan = Plan(
            subjects=subjects, conditions=conditions if posture or added_mass else (), frequencies_hz=frequencies,
            excitation=excitation, peak_to_peak=peak_to_peak, file_format=file_format.removeprefix("."),
        )  # fmt: skip
        plan = replace(
            plan, seconds=plan.seconds if seconds is None else seconds, seed=plan.seed if seed is None else seed
        )
        made = make(study, plan, jobs)
    after = _written(made)
    for old in before - after:
        old.unlink(missing_ok=True)
    if before:
        console.print(f"replaced the study that was there, {len(before)} recordings", markup=False, soft_wrap=True)
    noun = "recording" if len(after) == 1 else "recordings"
    told = f"{len(after)} synthetic {noun} in {made}; the truth is in {made / 'truth.json'}"
    console.print(told, markup=False, soft_wrap=True)


def _written(folder: Path) -> set[Path]:
    """The recordings that a study made here lists."""
    if not (folder / "recordings.csv").is_file():
        return set()
    return {trial.path for trial in listed(folder)}


if __name__ == "__main__":
    command_line(app)
