"""What a command is told to read: study folders and files, with masses from its options."""

from collections.abc import Sequence
from pathlib import Path

from fasbody.exceptions import InputFileError, SettingError
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
        SettingError: several masses, and not one for each of the files; or a study.toml for a folder with its own.
    """
    if mapping is not None and any(path.is_dir() for path in data):
        raise SettingError("--study is for files; a study folder has a study.toml of its own.")
    bodies, loads = _each(data, body_mass, "--body-mass"), _each(data, added_mass, "--added-mass")
    sources: list[str] = []
    recordings: list[Recording] = []
    truth: dict[str, float] = {}
    for path, body, load in zip(data, bodies, loads, strict=True):
        if path.is_dir():
            study = Study.read(path)
            sources.append(study.name)
            recordings += [with_masses(recording, body, load) for recording in study.recordings]
            truth = read_truth(path) if len(data) == 1 else {}
        elif path.exists():
            sources.append(path.name)
            recordings.append(with_masses(read_file(path, mapping), body, load))
        else:
            raise InputFileError(path, "no such file or folder", "give a study folder or CSV recordings")
    return together(sources), recordings, truth


def together(names: Sequence[str]) -> str:
    """What several files or studies are called in one title."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _each(data: Sequence[Path], masses: Sequence[float] | None, option: str) -> list[float | None]:
    """The mass for each of the files: none, one for all, or one each."""
    if not masses:
        return [None] * len(data)
    if len(masses) not in (1, len(data)) or (len(masses) > 1 and any(path.is_dir() for path in data)):
        given = ", ".join(f"{mass:g}" for mass in masses)
        raise SettingError(
            f"{option} is given {len(masses)} times ({given}) for {len(data)} files or folders; valid: once for all, "
            "or once for each file in their order."
        )
    return list(masses) if len(masses) > 1 else [masses[0]] * len(data)
