"""The study folders and files of a command, with masses from its options."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from fasbody.exceptions import InputFileError, SettingError
from fasbody.recording.condition import plausible
from fasbody.recording.file_names import body_mass_in_name, load_in_name
from fasbody.recording.recording import UNSTATED, Recording, with_masses
from fasbody.recording.study import Study, read_file, read_truth


def gather(
    data: Sequence[Path],
    body_mass: Sequence[float] | None,
    added_mass: Sequence[float] | None,
    mapping: Path | None = None,
) -> tuple[str, list[Recording], dict[str, float]]:
    """Recordings of study folders and files, with masses from the command line, and the truth of a synthetic study.

    Raises:
        InputFileError: nothing of that name, or it cannot be read.
        SettingError: several masses, and not one for each of the files; or a study.toml for a folder that has one;
            a mass that is implausible, or another than a study states.
    """
    if mapping is not None and any(path.is_dir() for path in data):
        raise SettingError("--study is for files; a study folder has a study.toml of its own.")
    bodies = _for_each_file(data, body_mass, "--body-mass")
    loads = _for_each_file(data, added_mass, "--added-mass")
    for option, name, masses in (("--body-mass", "body", bodies), ("--added-mass", "added", loads)):
        for mass in (mass for mass in masses if mass is not None):
            plausible(mass, name, option)
    sources: list[str] = []
    recordings: list[Recording] = []
    truth: dict[str, float] = {}
    named: dict[str, float | None] = {}
    for path, body, load in zip(data, bodies, loads, strict=True):
        if path.is_dir():
            study = Study.read(path)
            sources.append(study.name)
            for recording in study.recordings:
                _agree_with_study(recording, body, load)
                recordings.append(with_masses(recording, body, load))
            truth = read_truth(path) if len(data) == 1 else {}
        elif path.exists():
            sources.append(path.name)
            recording = read_file(path, mapping)
            if recording.origin != UNSTATED:
                _agree_with_study(recording, body, load)
            else:
                named |= {path.name: load_in_name(path.name)} if load is None else {}
                body = _mass_of(path, "--body-mass", body, body_mass_in_name(path.name))
                load = _mass_of(path, "--added-mass", load, load_in_name(path.name))
            recordings.append(with_masses(recording, body, load))
        else:
            raise InputFileError(path, "no such file or folder", "give a study folder or CSV recordings")
    if any(named.values()):
        warnings = (*recordings[0].warnings, _loads_of_names(named))
        recordings[0] = replace(recordings[0], warnings=warnings)
    return together(sources), recordings, truth


def _loads_of_names(stated: Mapping[str, float | None]) -> str:
    """The sentence on loads [kg] that files' names state, or do not."""
    loads = sorted({load for load in stated.values() if load is not None})
    named = {load: together([name for name, kg in stated.items() if kg == load]) for load in loads}
    parts = [f"{load:g} kg for {names}" for load, names in named.items()]
    unnamed = [name for name, load in stated.items() if load is None]
    none = f" None is named in {together(unnamed)}: 0 kg." if unnamed else ""
    return f"Loads on the knee are those of the files' names: {', '.join(parts)}.{none}"


def _mass_of(path: Path, option: str, option_kg: float | None, named: float | None) -> float | None:
    """A mass [kg] as the option or the file's name states it; refused where they disagree."""
    _agree(path.name, "its name says", named, option, option_kg, f"rename the file, or leave out {option}")
    return named if option_kg is None else option_kg


def _agree_with_study(recording: Recording, body: float | None, load: float | None) -> None:
    """Refuse a mass that is another than the study of the recording states."""
    c = recording.condition
    for option, table, name, says, stated in (
        ("--body-mass", "subjects.csv", "body mass", c.body_mass_kg, body),
        ("--added-mass", "recordings.csv", "added mass", c.added_mass_kg, load),
    ):
        remedy = f"leave out {option}, or correct {table}"
        _agree(recording.file, f"{table} says that the {name} is", says, option, stated, remedy)


def _agree(file: str, source: str, kg: float | None, option: str, option_kg: float | None, remedy: str) -> None:
    """Refuse a mass [kg] that a source and an option state differently."""
    if kg is not None and option_kg is not None and abs(option_kg - kg) > 1e-6:
        raise SettingError(f"{file}: {source} {kg:g} kg, and {option} says {option_kg:g} kg; {remedy}.")


def together(names: Sequence[str]) -> str:
    """What several files or studies are called in one title."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _for_each_file(data: Sequence[Path], masses: Sequence[float] | None, option: str) -> list[float | None]:
    """The mass for each of the files: none, one for all, or one each."""
    if not masses:
        return [None] * len(data)
    if len(masses) not in (1, len(data)) or (len(masses) > 1 and any(path.is_dir() for path in data)):
        listed = ", ".join(f"{mass:g}" for mass in masses)
        raise SettingError(
            f"{option} is given {len(masses)} times ({listed}) for {len(data)} files or folders; valid: once for all, "
            "or once for each file in their order."
        )
    return list(masses) if len(masses) > 1 else [masses[0]] * len(data)
