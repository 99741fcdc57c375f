"""The model that is shown as text: its file, what is typed over it, and where that is saved."""

import hashlib
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import mjcf
from fasbody.console import write_whole
from fasbody.exceptions import FasError, SettingError
from fasbody.foot.model import Foot
from viz.feet import MODEL, Show
from viz.load import files_of, load_foot

Document = dict[str, Any]


class ModelText:
    """The MJCF of a show's first model.

    Args:
        show: what is shown.
        folder: where a model without a file of its own is compiled.

    Attributes:
        draft: whether what is shown was typed and not saved.
    """

    def __init__(self, show: Show, folder: Path) -> None:
        self.show, self.draft, self._folder = show, False, folder
        self._user_models = [self.name] if self.file is not None else []

    @property
    def name(self) -> str:
        """The model that is shown, by name or file."""
        now = self.show.models[0]
        return now.name if isinstance(now, Foot) else str(now)

    @property
    def file(self) -> Path | None:
        """The file of the model, None of a shipped one."""
        now = self.show.models[0]
        return None if isinstance(now, Foot) or is_shipped(now) else Path(now.partition("@")[0])

    @property
    def text(self) -> str:
        """The model's MJCF as its file has it."""
        file, shipped = self.file, self.name.partition("@")[0]
        if file is None:
            return mjcf.text(shipped) if shipped in mjcf.names() else ""
        return file.read_text(errors="replace") if file.is_file() else ""

    @property
    def digest(self) -> str:
        """Digest of the text."""
        return _digest(self.text)

    @property
    def whole(self) -> str:
        """Digest of the text with all files that it includes: what a fit is of."""
        digest = hashlib.sha256(self.text.encode())
        for file in sorted(files_of(self.name)) if self.file is not None else []:
            digest.update(f"\0{file}\0".encode() + (file.read_bytes() if file.is_file() else b""))
        return digest.hexdigest()

    def document(self) -> Document:
        """What the chooser offers, and the text of the model that is shown."""
        names = [name for name in mjcf.names() if _loads(name)]
        names += [name for name in self._user_models if name not in names]
        about = {"names": names, "now": self.name, "file": str(self.file or ""), "copy": str(self._copy())}
        return {"type": "models", **about, "text": self.text, "digest": self.digest, "draft": self.draft}

    def choose(self, name: str) -> None:
        """Show another model, a shipped one or a user's file.

        Raises:
            FasError: it cannot be shown; the one before stays.
        """
        foot = load_foot(name)
        before = self.show.models[0]
        self.show.models[0] = name
        try:
            self.show.settings = replace(self.show.settings, values={}, delay_s=0.0)
            self.show.show({**self.show.feet, MODEL: foot})
        except FasError:
            self.show.models[0] = before
            raise
        if self.file is not None and name not in self._user_models:
            self._user_models.append(name)
        self.draft = False

    def check(self, text: str) -> Document:
        """Compile what is being typed, show it where it is sound, and say what is wrong where it is not."""
        file = Path(self.name)
        called = file.name if file.suffix else self.name
        folder = file.resolve().parent if file.is_file() else self._folder  # whose files it may include
        draft = folder / f".{file.stem or 'model'}.draft.xml"
        try:
            write_whole(draft, text)
            self.show.show({**self.show.feet, MODEL: load_foot(str(draft), called)})
            self.draft = text != self.text
        except FasError as error:
            text = error.on_page(called if error.file == str(draft) else "")
            return {"type": "checked", "text": text, "line": error.line}
        finally:
            draft.unlink(missing_ok=True)
        return {"type": "checked", "text": "", "line": None}

    def _copy(self) -> Path:
        """Where a shipped model is saved: a copy with its name in this folder, never over another file."""
        name = self.name.partition("@")[0]
        names = (Path(f"my_{name}{number}.xml") for number in ("", *(f"_{k}" for k in range(2, 1000))))
        return next(file for file in names if not file.exists())

    def save(self, text: str, digest: str) -> Document:
        """Write the text to the model's file, or that of a shipped model to a copy in this folder.

        Args:
            text: the MJCF.
            digest: of what was opened in the editor; a file that is another by now is not written over.

        Raises:
            SettingError: the model was handed over in Python, or a copy of a shipped model is not sound.
        """
        if isinstance(self.show.models[0], Foot):
            raise SettingError("a model made in Python has no file to save.")
        source = self.file
        if source is not None and source.is_file() and digest != self.digest:
            return {"type": "saved", "file": "", "text": f"{source.name} was changed by another program meanwhile."}
        if source is None and (problem := self.check(text)["text"]):
            raise SettingError(f"not saved, for a copy has to be sound: {problem}")
        file = source or self._copy()
        write_whole(file, text)
        return {"type": "saved", "file": str(file), "text": "", "digest": _digest(text)}


def is_shipped(name: str) -> bool:
    """Whether a model comes with the package, of any height of the arch."""
    return name.partition("@")[0] in mjcf.names()


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def _loads(name: str) -> bool:
    try:
        load_foot(name)
    except FasError:
        return False
    return True
