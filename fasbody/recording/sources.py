"""The study folders and files of a command, with masses from its options."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from fasbody.exceptions import InputFileError, SettingError
from fasbody.recording.condition import plausible
from fasbody.recording.proposal import load_in_name
from fasbody.recording.recording import Recording, with_masses
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
    bodies, loads = _each(data, body_mass, "--body-mass"), _each(data, added_mass, "--added-mass")
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
                _agree(recording, body, load)
            recordings += study.recordings
            truth = read_truth(path) if len(data) == 1 else {}
        elif path.exists():
            sources.append(path.name)
            recording = read_file(path, mapping)
            _agree(recording, body, load)
            recordings.append(with_masses(recording, body, _load_of(path, recording, load)))
            if load is None and recording.condition.body_mass_kg is None:
                named[path.name] = load_in_name(path.name)
        else:
            raise InputFileError(path, "no such file or folder", "give a study folder or CSV recordings")
    if any(named.values()):
        recordings[0] = replace(recordings[0], warnings=(*recordings[0].warnings, _of_names(named)))
    return together(sources), recordings, truth


def _of_names(named: Mapping[str, float | None]) -> str:
    """The sentence on loads [kg] that files' names state, or do not."""
    loads = sorted({load for load in named.values() if load is not None})
    parts = [f"{load:g} kg for {together([n for n, kg in named.items() if kg == load])}" for load in loads]
    unnamed = [name for name, load in named.items() if load is None]
    none = f" None is named in {together(unnamed)}: 0 kg." if unnamed else ""
    return f"Loads on the knee are those of the files' names: {', '.join(parts)}.{none}"


def _load_of(path: Path, recording: Recording, load: float | None) -> float | None:
    """The load [kg] as given, or as the file's name states it; that of a study stands in its tables."""
    named = load_in_name(path.name) if recording.condition.body_mass_kg is None else None
    if named is None:
        return load
    if load is not None and abs(load - named) > 1e-6:
        raise SettingError(
            f"{path.name}: its name says {named:g} kg, and --added-mass says {load:g} kg; rename the file, or leave "
            "out --added-mass."
        )
    return named


def _agree(recording: Recording, body: float | None, load: float | None) -> None:
    """Refuse a mass that is another than the study of the recording states; a bare file states none."""
    condition = recording.condition
    if condition.body_mass_kg is None:
        return
    for option, table, name, says, stated in (
        ("--body-mass", "subjects.csv", "body mass", condition.body_mass_kg, body),
        ("--added-mass", "recordings.csv", "added mass", condition.added_mass_kg, load),
    ):
        if stated is not None and abs(stated - says) > 1e-6:
            raise SettingError(
                f"{recording.file}: {table} says that the {name} is {says:g} kg, and {option} says {stated:g} kg; "
                f"leave out {option}, or correct {table}."
            )


def together(names: Sequence[str]) -> str:
    """What several files or studies are called in one title."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _each(data: Sequence[Path], masses: Sequence[float] | None, option: str) -> list[float | None]:
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
