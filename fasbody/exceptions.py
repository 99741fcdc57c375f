"""Errors that a user can mend: each builds one sentence from the facts, naming what would be valid."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path


class FasError(Exception):
    """Base of all errors whose cause is the input; commands print it and exit with 2."""

    def __reduce__(self) -> tuple[Callable[..., "FasError"], tuple[type["FasError"], tuple[object, ...]]]:
        # a worker process pickles the sentence alone, not the facts that it was built from
        return _remade, (type(self), self.args)


def _remade(kind: type[FasError], args: tuple[object, ...]) -> FasError:
    error = kind.__new__(kind)
    error.args = args
    return error


class Stopped(Exception):
    """Ctrl-C, with a sentence on what is kept; commands print it and exit with 130."""


class InputFileError(FasError):
    """A file or folder cannot be used as requested.

    Args:
        path: the file or folder.
        problem: what is wrong with it, continuing the sentence after its name.
        valid: what would be valid instead, if that needs saying.
        line: line number in the file, from 1.
    """

    def __init__(self, path: Path | str, problem: str, valid: str = "", line: int | None = None) -> None:
        place = f"{path}, line {line}" if line else f"{path}"
        super().__init__(f"{place}: {problem}" + (f"; {valid}" if valid else "") + ".")


class ModelError(FasError):
    """An MJCF model is broken or lacks something that a command needs."""


class MeshError(FasError):
    """A cell mesh or surface cannot be analysed (inverted elements, open surface, no clamped base, ...)."""


class MissingPackageError(FasError):
    """A request needs a package of an optional extra.

    Args:
        package: the package that is missing or does not load.
        extra: the extra of fasbody that brings it.
        reason: why it does not load, if it is there but broken.
        remedy: what to install then.
        otherwise: what can be done without it.
    """

    def __init__(self, package: str, extra: str, reason: str = "", remedy: str = "", otherwise: str = "") -> None:
        state = f"does not load ({reason})" if reason else "is not installed"
        alternative = f", or {otherwise}" if otherwise else ""
        super().__init__(f"{package} {state}: {remedy or pip_install(extra)}{alternative}.")


def pip_install(extra: str) -> str:
    """The command that brings an extra to an installed fasbody, and the one to type in a clone."""
    return f"pip install 'fasbody[{extra}]' (in a clone: pip install -e '.[{extra}]')"


class RecordingError(FasError):
    """A recording cannot serve as measured data (too short, clipped, NaN, ...)."""


@contextmanager
def by_name(file: str) -> Iterator[None]:
    """Whatever goes wrong with one recording becomes a sentence that names it, so that a study goes on without it.

    Args:
        file: what to call the recording.

    Raises:
        RecordingError: with the name before it; or in place of an error that no check foresaw, which is its cause.
    """
    try:
        yield
    except FasError as error:
        if isinstance(error, RecordingError) and not str(error).startswith(file):
            raise RecordingError(f"{file}: {error}") from None
        raise
    except Exception as bug:
        short = " ".join(str(bug).split())[:120]
        raise RecordingError(
            f"{file}: cannot be used, for an unforeseen {type(bug).__name__} ({short}); leave it out, and please "
            "report it with the file."
        ) from bug


class SettingError(FasError):
    """An option or argument has an invalid value.

    Args:
        sentence: what is wrong, and what would be valid.
        setting: its name in Python, "" where there is none; a command that was given it names the option.
    """

    setting = ""  # of one that comes from another process, too

    def __init__(self, sentence: str, setting: str = "") -> None:
        super().__init__(sentence)
        self.setting = setting


class SimulationError(FasError):
    """A simulation became unstable or non-finite."""


class PeriodicMotionError(SimulationError):
    """No periodic motion was computed.

    Args:
        model: its name.
        frequency_hz: of the excitation.
        share: of the excitation up to which there is one.
    """

    def __init__(self, model: str, frequency_hz: float, share: float) -> None:
        self.model, self.frequency_hz, self.share = model, frequency_hz, share
        reached = f"from rest it was followed up to {share:.2g} of the amplitude" if share else "not even a small one"
        super().__init__(f"{model}: no periodic motion was found at {frequency_hz:g} Hz ({reached}).")


class NotSmoothError(PeriodicMotionError):
    """A periodic motion is not smooth enough for a Fourier series: something touches, stops or slips.

    Args:
        model: its name.
        frequency_hz: of the excitation.
        harmonics: that were balanced.
        left: share of the acceleration in the highest of them.
        changes: instants of a period between which a constraint opens or closes.
    """

    def __init__(self, model: str, frequency_hz: float, harmonics: int, left: float, changes: int = 0) -> None:
        super().__init__(model, frequency_hz, 1.0)
        self.harmonics, self.left, self.changes = harmonics, left, changes
        reason = (
            f"a contact, limit or dry friction changes its state {changes} times a period"
            if changes
            else f"{left:.1e} of its acceleration is in the highest of {harmonics} harmonics"
        )
        self.args = (
            f"{model}: the motion at {frequency_hz:g} Hz is not smooth enough for harmonic balance ({reason}); "
            "simulate it in the time domain.",
        )


class AcquisitionError(FasError):
    """A board, generator or serial line does not do what a recording needs."""


class EngineError(FasError):
    """The installed physics engine does not behave as the native callbacks need."""


def unknown(kind: str, name: str, valid: Iterable[str]) -> str:
    """The clause for a name that does not exist: the name, the nearest one, and the valid ones."""
    choices = list(valid)
    near = get_close_matches(name, choices, n=1)
    hint = f", did you mean {near[0]!r}?" if near else ""
    listed = ", ".join(choices) if choices else "none"
    return f"unknown {kind} {name!r}{hint} (valid: {listed})"


def shown(text: str) -> str:
    """A cell or a list of names for a message: printable and short."""
    clean = "".join(c if c.isprintable() else "?" for c in text)
    return clean if len(clean) <= 120 else clean[:117] + "..."
