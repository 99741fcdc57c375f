"""A virtual laboratory: synthetic recordings with known truth, to learn on and to test against.

`python -m fasbody.laboratory FOLDER` makes a study of one synthetic subject at the nine frequencies of the thesis. The
foot is the two-mass model of Eq. (4.29), integrated by DOP853 at tight tolerance (neither of the engines that the fit
uses); the instrument adds what real ones add: shaker harmonics, sensor noise, 12-bit quantisation, a delay between the
multiplexed channels. Everything it writes says that it is synthetic, and `truth.json` holds the parameters.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from scipy.integrate import solve_ivp

from fasbody import shaker
from fasbody.console import command_line, console, progress_bar, to_json, write_whole
from fasbody.exceptions import SettingError
from fasbody.recording import Condition, Recording
from fasbody.shaker import BaseMotion
from fasbody.subjects import SUBJECTS, foot_mass, shank_mass
from fasbody.two_dof import TwoDof

#: Frequencies of section 2.2.2 [Hz].
FREQUENCIES_HZ = tuple(float(f) for f in range(10, 55, 5))
#: A foot with visibly nonlinear dampers: invented, within what chapters 2 and 4 of the thesis describe.
TRUTH = {"k_T": 1.31e5, "k_F": 9.4e4, "c_11": 380.0, "c_12": 90.0, "c_13": 140.0, "c_21": 760.0, "c_22": -120.0}
TRUTH |= {"c_23": 180.0}


@dataclass(frozen=True)
class Instrument:
    """What the shaker and the data acquisition add to the motion.

    Attributes:
        rate_hz: sampling rate. noise_base, noise_malleolus: standard deviation of the sensor noise [m/s^2].
        bits, range_m_s2: the converter spans +-range in 2^bits steps.
        delay_s: the malleolus channel lags the base channel by this much (filters, converter).
        distortion: amplitude of the shaker's second and third harmonic over the first.
    """

    rate_hz: float = 1000.0
    noise_base: float = 0.03
    noise_malleolus: float = 0.05
    bits: int = 12
    range_m_s2: float = 39.2
    delay_s: float = 2e-4
    distortion: tuple[float, float] = (0.015, 0.008)

    def motion(self, frequency_hz: float, duration_s: float, rng: np.random.Generator) -> BaseMotion:
        """Shaker motion of 17.9 m/s^2 peak to peak with its harmonics at random phases."""
        phases = rng.uniform(0, 2 * np.pi, 3)
        sizes = 0.5 * shaker.PEAK_TO_PEAK * np.array([1.0, *self.distortion])
        return shaker.harmonics(frequency_hz, -1j * sizes * np.exp(1j * phases), duration_s)

    def measure(self, values: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
        """Add noise and quantise; (n,) [m/s^2]."""
        step = 2 * self.range_m_s2 / 2**self.bits
        noisy = values + rng.normal(0, noise, values.size)
        return np.clip(np.round(noisy / step) * step, -self.range_m_s2, self.range_m_s2 - step)

    def observe(self, exact: Recording, rng: np.random.Generator) -> Recording:
        """A recording as the instrument gives it: noise and quantisation on both channels."""
        return replace(
            exact,
            base_m_s2=self.measure(exact.base_m_s2, self.noise_base, rng),
            malleolus_m_s2=self.measure(exact.malleolus_m_s2, self.noise_malleolus, rng),
        )


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
            raise SettingError(f"{f:g} Hz cannot be recorded at {instrument.rate_hz:g} Hz (valid: 0.5 to 100 Hz).")
        if seconds * f < 3:
            raise SettingError(f"{seconds:g} s hold fewer than 3 periods of {f:g} Hz; record longer.")
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
    truth = {"origin": "synthetic", "seed": seed, "parameters": TRUTH, "instrument": asdict(instrument)}
    write_whole(folder / "truth.json", to_json(truth) + "\n")
    write_whole(folder / "study.toml", _STUDY.format(subject=subject, body=body, seed=seed, rate=instrument.rate_hz))
    return folder


_STUDY = '''[study]
name = "synthetic subject {subject}"
origin = "synthetic"
description = """
Made by python -m fasbody.laboratory (seed {seed}) from a two-mass foot with the body mass of subject {subject},
{body:g} kg. Nobody was measured: truth.json holds the parameters."""
sampling_rate_hz = {rate:g}

[channels.base]
unit = "m/s^2"

[channels.malleolus]
unit = "m/s^2"
'''

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    study: Annotated[Path, typer.Argument(help="folder to write")],
    subject: Annotated[int, typer.Option(help="subject of Table 2.1 whose body mass is used")] = 16,
    added_mass: Annotated[list[float], typer.Option(help="mass on the knee in kg; repeat for several")] = [0.0],  # noqa: B006
    frequency: Annotated[
        list[float] | None, typer.Option(help="excitation in Hz; repeat (default 10, 15 ... 50)")
    ] = None,
    seconds: Annotated[float, typer.Option(help="length of each recording in s")] = 4.0,
    seed: Annotated[int, typer.Option(help="seed of phases and noise")] = 16,
) -> None:
    """Make a synthetic study with known truth.

    Example: python -m fasbody.laboratory my_study --added-mass 0 --added-mass 2.3 --seconds 10
    """
    if (study / "recordings.csv").exists() and not (study / "truth.json").exists():
        raise SettingError(f"{study} holds a study that was not made here; name another folder.")
    made = make_study(study, subject, frequency or FREQUENCIES_HZ, added_mass, seconds, seed)
    count = len((made / "recordings.csv").read_text().splitlines()) - 1
    console.print(f"{count} synthetic recordings in {made}; the truth is in {made / 'truth.json'}")


if __name__ == "__main__":
    command_line(app)
