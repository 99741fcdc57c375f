"""Recordings of one foot with constant parameters, and a study folder of them.

The two-mass model of Eq. (4.29) is integrated by DOP853 at tight tolerance (neither of the engines that the fit uses);
the instrument adds what real ones add: shaker harmonics, sensor noise, 12-bit quantisation, a delay between the
multiplexed channels. Everything it writes says that it is synthetic, and `truth.json` holds the parameters.
"""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from fasbody.console import progress_bar, to_json, write_whole
from fasbody.exceptions import SettingError
from fasbody.foot.shaker import BaseMotion
from fasbody.foot.two_dof import TwoDof
from fasbody.laboratory.instrument import STRAPPED, Instrument
from fasbody.laboratory.study import CONSTANTS, FREQUENCIES_HZ, once
from fasbody.recording.condition import SUBJECTS, foot_mass, plausible, shank_mass
from fasbody.recording.recording import Condition, Recording

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
    second: bool = False,
) -> Recording:
    """One synthetic recording of a foot on the shaker.

    Args:
        foot: true parameters.
        motion: base motion.
        seconds: length [s].
        instrument: what it adds.
        rng: noise source.
        settle: the shaker runs this long before the recording starts [s]; 0 records the transient
            from rest.
        second: a sensor on the foot writes the channel foot, as late and as noisy as that of the
            malleolus.
    """
    return instrument.observe(exact(foot, motion, seconds, instrument, settle, second), rng)


def exact(
    foot: TwoDof,
    motion: BaseMotion,
    seconds: float,
    instrument: Instrument,
    settle: float = 1.0,
    second: bool = False,
) -> Recording:
    """The same without noise and quantisation: what happened at the samples, the channel delay included."""
    t = np.arange(round(seconds * instrument.rate_hz)) / instrument.rate_hz
    late = np.maximum(t + settle - instrument.delay_s, 0.0)  # at rest until the shaker starts
    solution = solve_ivp(
        # plain numbers, as NumPy's take twice the time
        lambda time, x: foot.rates(time, x.tolist(), float(motion.acceleration(np.array([time]))[0])),
        (0.0, late[-1]), np.zeros(4), method="DOP853", t_eval=late, rtol=1e-9, atol=1e-12, max_step=5e-3,
    )  # fmt: skip
    others = {"foot": foot.foot_output(solution.y)} if second else {}
    return Recording(t, motion.acceleration(t + settle), foot.output(solution.y), origin="synthetic", others=others)


def make_study(
    folder: Path,
    subject: int = 16,
    frequencies_hz: Sequence[float] = FREQUENCIES_HZ,
    added_masses_kg: Sequence[float] = (0.0,),
    seconds: float = 4.0,
    seed: int = 16,
    instrument: Instrument | None = None,
    second: bool = False,
    loaded_frequencies_hz: Sequence[float] | None = None,
) -> Path:
    """Write a synthetic study folder with `truth.json` beside it; see the module's docstring.

    Args:
        folder: to write.
        subject: of Table 2.1, for the body mass.
        frequencies_hz: of the sines.
        added_masses_kg: on the knee.
        seconds: length of each recording.
        seed: of phases and noise.
        instrument: what it adds.
        loaded_frequencies_hz: of the sines under the second and further added masses, as without
            where none are given.
        second: a sensor on the foot writes the channel foot.

    Raises:
        SettingError: no such subject, a length or frequency that makes no recording, or a value twice.
        RecordingError: a mass is not plausible.
    """
    instrument = instrument or Instrument()
    if subject not in SUBJECTS:
        raise SettingError(f"there is no subject {subject}; Table 2.1 has 1 to {len(SUBJECTS)}.")
    for added in added_masses_kg:
        plausible(added, "added", "--added-mass")
    once("--added-mass", added_masses_kg)
    for option, values in (("--frequency", frequencies_hz), ("--loaded-frequency", loaded_frequencies_hz or ())):
        once(option, values)
        for f in values:
            if not 0.5 <= f <= instrument.rate_hz / 10:
                raise SettingError(
                    f"{option}: a frequency of {f:g} cannot be recorded at {instrument.rate_hz:g} Hz "
                    f"(valid: 0.5 to {instrument.rate_hz / 10:g} Hz)."
                )
            if not 3 <= seconds * f <= 3600 * f:
                raise SettingError(
                    f"--seconds: a length of {seconds:g} is no recording of {f:g} Hz (valid: {3 / f:.3g} to 3600 s)."
                )
    body = SUBJECTS[subject].mass_kg
    rng = np.random.default_rng(seed)
    rows = ["file,subject,posture,added_mass_kg,frequency_hz"]
    loaded = loaded_frequencies_hz or frequencies_hz
    trials = [(added, f) for i, added in enumerate(added_masses_kg) for f in (loaded if i else frequencies_hz)]
    with progress_bar() as progress:
        for added, f in progress.track(trials, description="recording"):
            foot = TwoDof(**TRUTH, m_S=shank_mass(body, added), m_F=foot_mass(body))
            made = record(foot, instrument.motion(f, seconds + 2, rng), seconds, instrument, rng, second=second)
            condition = Condition(str(subject), "midstance", added, body, f)
            name = f"recordings/{f:g}hz_{added:g}kg.csv"
            replace(made, condition=condition).write(folder / name)
            rows.append(f"{name},{subject},midstance,{added:g},{f:g}")
    person = SUBJECTS[subject]
    subjects = f"subject,age_yr,height_m,mass_kg\n{subject},{person.age_yr},{person.height_m},{person.mass_kg}\n"
    write_whole(folder / "subjects.csv", subjects)
    write_whole(folder / "recordings.csv", "\n".join(rows) + "\n")
    known = {name: value for name, value in asdict(instrument).items() if name not in STRAPPED}
    masses = {"m_S": round(shank_mass(body), 9), "m_F": round(foot_mass(body), 9), "added_kg": list(added_masses_kg)}
    command = _command(subject, frequencies_hz, added_masses_kg, seconds, seed, loaded_frequencies_hz)
    truth = {"origin": "synthetic", "command": command, "seed": seed, "parameters": TRUTH, "masses": masses}
    truth |= {"instrument": known}
    write_whole(folder / "truth.json", to_json(truth) + "\n")
    for table in ("truth.csv", CONSTANTS):  # of a whole study that was here before
        (folder / table).unlink(missing_ok=True)
    loads = " and ".join(f"{added:g} kg" for added in added_masses_kg)
    text = _STUDY.format(subject=subject, body=body, command=command, loads=loads, instrument=instrument)
    text += _FOOT.format(instrument=instrument) if second else ""
    write_whole(folder / "study.toml", text)
    return folder


def _command(
    subject: int,
    frequencies_hz: Sequence[float],
    added_masses_kg: Sequence[float],
    seconds: float,
    seed: int,
    loaded_frequencies_hz: Sequence[float] | None,
) -> str:
    """What makes the same study again, byte by byte."""
    words = [f"--subject {subject}", *(f"--added-mass {m:g}" for m in added_masses_kg)]
    if tuple(frequencies_hz) != FREQUENCIES_HZ:
        words += [f"--frequency {f:g}" for f in frequencies_hz]
    words += [f"--loaded-frequency {f:g}" for f in loaded_frequencies_hz or ()]
    return " ".join(["fasbody laboratory FOLDER", *words, f"--seconds {seconds:g} --seed {seed}"])


_STUDY = '''[study]
name = "synthetic subject {subject}"
origin = "synthetic"
description = """
A two-mass foot with the body mass of subject {subject}, {body:g} kg, and {loads} on the knee. Made by
{command}
Nobody was measured: truth.json holds the parameters."""
sampling_rate_hz = {instrument.rate_hz:g}

[channels.base]
unit = "m/s^2"

[channels.malleolus]
unit = "m/s^2"
delay_std_s = {instrument.delay_s:g}
'''
_FOOT = """
[channels.foot]
unit = "m/s^2"
delay_std_s = {instrument.delay_s:g}
"""
