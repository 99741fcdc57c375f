"""Errors that a user can mend: each is facts, of which its class writes one sentence.

The facts are attributes, for whoever wants to act on them: no other module searches a sentence.
"""

import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from fasbody.sentences import Sentence, called


class FasError(Exception):
    """Base of all errors whose cause is the input; commands print it and exit with 2.

    Attributes:
        code: the kind of problem, alike for all its values; the line that raises it, where it has no name.
        file: that it is about, a path or the name of a recording; "" where it is none.
        line: in the file, from 1.
        setting: its name in Python or study.toml ("draws", "channels.base.unit"); "" where it is none.
        quantity: what has a wrong value.
        value: that it has.
        problem: what is wrong, as it continues a sentence behind the file; of quantity and value unless given.
        valid: what would be valid.
        remedy: what to do, as it continues a sentence.

    Example:
        >>> print(SettingError(setting="draws", quantity="the number of draws", value=1, valid="2 or more"))
        the number of draws is 1; give 2 or more.
    """

    code: str = ""
    file: str = ""
    line: int | None = None
    setting: str = ""
    quantity: str = ""
    value: object = None
    problem: str = ""
    valid: str = ""
    remedy: str = ""

    def __init__(self, sentence: str = "", **facts: Any) -> None:
        """An error of a sentence that is at hand, or of facts alone.

        Args:
            sentence: for people; written of the facts unless given.
            facts: attributes.
        """
        if strange := facts.keys() - FasError.__annotations__.keys():
            raise TypeError(f"an error has no attribute {', '.join(sorted(strange))}")
        vars(self).update(facts)
        self.problem = self.problem or (f"{self.quantity} is {self.value}" if self.quantity else "")
        self.code = self.code or _raising_line()
        self._stated, self._is_prefixed = sentence, False
        super().__init__(self._sentence(self.file))

    def _sentence(self, file: str) -> Sentence:
        if self._stated:
            return Sentence(f"{file}: " if self._is_prefixed and file else "", self._stated, code=self.code)
        place = ", ".join(filter(None, (file, f"line {self.line}" if self.line else "")))
        remedy = self.remedy or (f"give {self.valid}" if self.valid else "")
        place += ": " if place else ""
        return Sentence(place, self.problem, "; " if remedy else "", remedy, ".", code=self.code)

    @property
    def sentence(self) -> Sentence:
        """The sentence with its code."""
        return Sentence(str(self), code=self.code, on_page=self.on_page(), reason=self.reason)

    @property
    def reason(self) -> str:
        """The sentence without the file's name."""
        return self._sentence("")

    def named(self, file: str) -> "FasError":
        """The same error with the name of the file that it is about before its sentence."""
        error = _remade(type(self), (), vars(self) | {"file": file, "_is_prefixed": True})
        error.args = (error._sentence(file),)
        return error

    def on_page(self, file: str = "") -> str:
        """The sentence in the words of the page.

        Args:
            file: what the page calls the file, if not as the error does.
        """
        return self._sentence(file or self.file).on_page

    def __reduce__(self) -> tuple[object, ...]:
        # across processes go sentence and facts, not the arguments that they were built from
        return _remade, (type(self), self.args, vars(self))


def _remade(kind: type[FasError], args: tuple[object, ...], facts: Mapping[str, object]) -> FasError:
    error = kind.__new__(kind)
    error.args = args
    vars(error).update(facts)
    return error


def _raising_line() -> str:
    """Module and line that raise an error: the first ones below the errors' own."""
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__") == __name__:
        frame = frame.f_back
    return f"{frame.f_globals.get('__name__')}:{frame.f_lineno}"


class Stopped(Exception):
    """Ctrl-C, with a sentence on what is kept; commands print it and exit with 130."""


class InputFileError(FasError):
    """A file or folder cannot be used as requested.

    Args:
        path: the file or folder.
        problem: what is wrong with it, continuing the sentence after its name.
        remedy: what would be valid instead, if that needs saying.
        line: line number in the file, from 1.
        facts: further attributes.
    """

    def __init__(self, path: Path | str, problem: str, remedy: str = "", line: int | None = None, **facts: Any) -> None:
        super().__init__(file=f"{path}", problem=problem, remedy=remedy, line=line, **facts)


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
        problem = f"{package} {f'does not load ({reason})' if reason else 'is not installed'}"
        remedy = (remedy or pip_install(extra)) + (f", or {otherwise}" if otherwise else "")
        super().__init__(f"{problem}: {remedy}.", problem=problem, remedy=remedy)


@contextmanager
def required(package: str, extra: str) -> Iterator[None]:
    """The imports of the block need a package of an optional extra.

    Raises:
        MissingPackageError: it is not installed.
    """
    try:
        yield
    except ImportError as error:
        raise MissingPackageError(package, extra) from error


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
        if isinstance(error, RecordingError) and not error.file:
            raise error.named(file) from None
        raise
    except Exception as bug:
        short = " ".join(str(bug).split())[:120]
        raise RecordingError(
            code="unforeseen",
            file=file,
            problem=f"cannot be used, for an unforeseen {type(bug).__name__} ({short})",
            remedy="leave it out, and please report it with the file",
        ) from bug


class SettingError(FasError):
    """An option or argument has an invalid value.

    Args:
        sentence: what is wrong, and what would be valid; written of the facts unless given.
        setting: its name in Python, "" where there is none; a command that was given it names the option.
        facts: further attributes.
    """

    def __init__(self, sentence: str = "", setting: str = "", **facts: Any) -> None:
        super().__init__(sentence, setting=setting, **facts)


class SimulationError(FasError):
    """A simulation became unstable, does not settle, or errs."""


class UnstableError(SimulationError):
    """A simulation became non-finite."""


#: What to do without harmonic balance.
_OTHERWISE = "Simulate it in the time domain, which takes longer (in a fit: "


class PeriodicMotionError(SimulationError):
    """No periodic motion was computed.

    Args:
        model: its name.
        frequency_hz: of the excitation.
        share: of the excitation up to which there is one.
    """

    def __init__(self, model: str, frequency_hz: float, share: float, sentence: str = "") -> None:
        self.model, self.frequency_hz, self.share = model, frequency_hz, share
        upto = f"only up to {100 * share:.2g} % of" if share else "at not even a small part of"
        text = (
            f"{model}: at {frequency_hz:.4g} Hz a periodic motion was found {upto} the amplitude of the base. "
            f"{_OTHERWISE}"
        )
        super().__init__(sentence or Sentence(text, called("domain", "time"), ")."))


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
        self.harmonics, self.left, self.changes = harmonics, left, changes
        reason = (
            f"a contact, limit or dry friction changes its state {changes} times a period"
            if changes
            else f"{left:.1e} of its acceleration is in the highest of {harmonics} harmonics"
        )
        text = f"{model}: the motion at {frequency_hz:.4g} Hz is not smooth enough for harmonic balance ({reason}). "
        sentence = Sentence(text, _OTHERWISE, called("domain", "time"), ").")
        super().__init__(model, frequency_hz, 1.0, sentence)


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
