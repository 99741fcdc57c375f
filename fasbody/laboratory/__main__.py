"""`fasbody laboratory FOLDER`: synthetic recordings with known truth, to learn on and to test against.

`--subjects 20` makes a whole study (study.py); without it, recordings of one foot with constant parameters (foot.py).
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from fasbody.console import command_line, console
from fasbody.exceptions import SettingError
from fasbody.laboratory.instrument import EXCITATIONS
from fasbody.recording.condition import ADDED_MASSES_KG, POSTURES
from fasbody.recording.trials import listed

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    study: Annotated[Path, typer.Argument(help="folder to write")],
    subjects: Annotated[
        int | None, typer.Option(help="make a whole study of this many virtual subjects, with tuberosity and scatter")
    ] = None,
    subject: Annotated[int, typer.Option(help="for one foot: subject of Table 2.1 whose body mass is used")] = 16,
    added_mass: Annotated[
        list[float] | None, typer.Option(help="mass on the knee in kg; repeat (default 0, for studies 0, 2.3, 4.5)")
    ] = None,
    posture: Annotated[
        list[str] | None, typer.Option(help=f"{', '.join(POSTURES)}; repeat (studies; default all, unloaded)")
    ] = None,
    frequency: Annotated[
        list[float] | None, typer.Option(help="excitation in Hz; repeat (default 10, 15 ... 50)")
    ] = None,
    loaded_frequency: Annotated[
        list[float] | None,
        typer.Option(help="for one foot: excitation in Hz under its second and further added masses; repeat"),
    ] = None,
    excitation: Annotated[str, typer.Option(help=f"{', '.join(EXCITATIONS)} (studies)")] = "sine",
    peak_to_peak: Annotated[float, typer.Option(help="base acceleration in m/s^2 (studies)")] = 17.9,
    seconds: Annotated[
        float | None, typer.Option(help="length of each recording in s (default 4, for studies 10)")
    ] = None,
    file_format: Annotated[str, typer.Option("--format", help="csv, mat, h5, uff or tdms (studies)")] = "csv",
    foot_sensor: Annotated[
        bool, typer.Option("--foot-sensor", help="a second sensor, on the foot: the channel foot (one foot)")
    ] = False,
    seed: Annotated[int | None, typer.Option(min=0, help="seed of subjects, phases and noise")] = None,
    jobs: Annotated[int, typer.Option(help="processes; 0 for all cores")] = 0,
) -> None:
    """Make a synthetic study with known constants.

    Examples:
      fasbody laboratory my_study --subjects 20

      fasbody laboratory two_sensors --foot-sensor

      fasbody laboratory one_foot --added-mass 0 --added-mass 2.3 --seconds 10

      fasbody laboratory small --added-mass 0 --added-mass 2.3 --loaded-frequency 10 --loaded-frequency 40
    """
    from fasbody.laboratory.foot import make_study
    from fasbody.laboratory.study import FREQUENCIES_HZ, Plan, make

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
            second=foot_sensor,
            loaded_frequencies_hz=loaded_frequency,
        )
    elif foot_sensor:
        raise SettingError("--foot-sensor records one foot; leave --subjects out.")
    else:
        if loaded_frequency:
            raise SettingError("--loaded-frequency is for one foot; a study (--subjects) has the same at every load.")
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
    message = f"{len(after)} synthetic {noun} in {made}; the truth is in {made / 'truth.json'}"
    console.print(message, markup=False, soft_wrap=True)


def _written(folder: Path) -> set[Path]:
    """The recordings that a study made here lists."""
    if not (folder / "recordings.csv").is_file():
        return set()
    return {trial.path for trial in listed(folder)}


if __name__ == "__main__":
    command_line(app)
