"""The workbench behind the page: recordings that were dropped on it, their checks, the fit, and the model's text.

Everything here is what a script could do: files are read by `fasbody`, judged by its checks and fitted by
`identification.fit_foot` in a process of its own. Each call answers with documents for all pages.
"""

import io
import math
import re
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

import mjcf
from fasbody.console import write_whole
from fasbody.exceptions import FasError, SettingError
from fasbody.foot.model import Foot
from fasbody.recording.checks import understood
from fasbody.recording.files import TEXTS
from fasbody.recording.formats import READ, ending
from fasbody.recording.recording import Recording
from fasbody.recording.study import BUNDLED
from identification.engines.twin import twin_applies
from viz.excitation import Excitation
from viz.feet import MODEL, Show
from viz.fitted import fitted
from viz.load import load_foot
from viz.settings import settings_from
from viz.source import Source, script, study_files
from viz.worker import Told, Worker, job

Document = dict[str, Any]
#: What a fit is of: recordings, model, values in place of the model's own, settings.
Question = tuple[list[Source], str, dict[str, float], dict[str, Any]]
#: Largest dropped file [bytes], and how much and how many files a session may hold.
LARGEST, MOST, FILES = 64_000_000, 512_000_000, 500
#: Parts of a dropped file's name: folders, and the file.
DEEP = 4
#: Files that belong to a study beside its recordings.
_BESIDE = {"study.toml", "subjects.csv", "recordings.csv", "truth.json"}
_PART = re.compile(r"[\w(][\w .()+,=@-]{0,150}")
#: What a fit may be told, and how it is read.
_STARTS = (1, 64)


class Bench:
    """What the page can do with a show: other data, other models, a fit.

    Args:
        show: what is shown. told: gets documents that come later, from the fitting process; in a thread of its own.
        results: folder of the fit that is shown from the start, with its report.
    """

    def __init__(self, show: Show, told: Told = lambda document: None, results: Path | None = None) -> None:
        self.show = show
        self.told = told
        self._results = results
        self._folder = tempfile.TemporaryDirectory(prefix="fasbody-")
        self._size = 0
        self.sources: list[Source] = []
        self._rows: list[Document] = []
        self.shown = -1
        self._worker: Worker | None = None
        self._state: Document = {"running": False, "what": "", "done": 0, "total": 0}
        self._fit: Document = {}
        self._rivals: Document = {}
        self._compared = ""  # the lines of Python that compare the rivals
        self._draft = False  # what is shown was typed and not saved
        self._asked: Question | None = None  # what the running fit is of
        self._fitted: Question | None = None  # what the last fit was of
        recording = show.excitation.recording
        self._given = recording if isinstance(recording, Recording) else None

    @property
    def folder(self) -> Path:
        """Where the session's files lie."""
        return Path(self._folder.name)

    @property
    def results(self) -> Path:
        """Where report and numbers of the last fit lie, once they are written."""
        return self._results or self.folder / "results"

    def zipped(self) -> bytes:
        """What `FitResult.write` writes, in one file; empty where nothing is written."""
        files = [self.results / name for name in ("report.html", "result.json", "parameters.csv")]
        files = [file for file in (*files, *sorted((self.results / "figures").glob("*.*"))) if file.is_file()]
        memory = io.BytesIO()
        with zipfile.ZipFile(memory, "w", zipfile.ZIP_DEFLATED) as packed:
            for file in files:
                packed.write(file, Path("results") / file.relative_to(self.results))
        return memory.getvalue() if files else b""

    def close(self) -> None:
        """End the fitting process and delete the session's files."""
        if self._worker is not None:
            self._worker.stop()
        self._folder.cleanup()

    def documents(self) -> list[Document]:
        """What a page that opens now has to know."""
        return [self.document(), self.models(), self.progress(), *filter(None, (self._fit, self._rivals))]

    def act(self, message: Mapping[str, Any]) -> list[Document]:
        """Do what a page asks for.

        Raises:
            SettingError: nobody knows what that is. FasError: it cannot be done.
        """
        kind, number = message.get("type"), message.get("number", -1)
        number = number if isinstance(number, int) else -1
        text, name = str(message.get("text", "")), str(message.get("name", ""))
        said = message.get("said")
        said = said if isinstance(said, dict) else {}
        chosen = [n for n in message.get("numbers", []) if isinstance(n, int)] if kind in ("fit", "rivals") else []
        actions: dict[Any, Callable[[], list[Document]]] = {
            "open": lambda: self.open([str(n) for n in message.get("names", [])]), "bundled": self.bundled,
            "use": lambda: self.use(number), "sine": self.sine, "columns": lambda: self.columns(number),
            "correct": lambda: self.correct(number, said), "fit": lambda: self.fit(chosen, said), "stop": self.stop,
            "rivals": lambda: self.rivals(chosen, said),
            "report": self.report, "choose": lambda: self.choose(name), "check": lambda: self.check(text),
            "save": lambda: self.save(text, name), "take": lambda: self.take(said),
        }  # fmt: skip
        if kind not in actions:
            raise SettingError(f"the page asks for {str(kind)[:40]!r}, which it cannot do; reload it.")
        return actions[kind]()

    # ---- files -------------------------------------------------------------------------------------------------------
    def keep(self, name: str, content: bytes) -> None:
        """Keep a dropped file under its own name, for this session.

        Raises:
            SettingError: no name of a file, of no format that is read, or too large.
        """
        parts = PurePosixPath(name).parts
        if not _is_name(name):
            raise SettingError(f"{name[:80]!r} is no name for a file; use letters, digits, spaces and . _ ( ) + - @")
        end = ending(Path(name))
        if end not in (*TEXTS, *READ) and parts[-1] not in _BESIDE and end not in (".json", ".toml"):
            raise SettingError(f"{parts[-1]}: no format has the ending {end!r}; valid: {', '.join((*TEXTS, *READ))}.")
        if len(content) > LARGEST:
            raise SettingError(f"{parts[-1]} is larger than {LARGEST // 1_000_000} MB; split it into recordings.")
        self._size += len(content)
        if self._size > MOST or sum(1 for _ in self.folder.rglob("*")) > FILES:
            raise SettingError("this session holds as many files as it may; start another one.")
        write_whole(self.folder.joinpath(*parts), content)

    def open(self, names: list[str]) -> list[Document]:
        """Read dropped files, or the study among them, and show the first that can be shown."""
        kept = [name for name in names if _is_name(name) and (self.folder / name).is_file()]
        tables = [name for name in kept if PurePosixPath(name).name == "recordings.csv"]
        fresh: list[Source] = []
        for table in tables:
            inside = (self.folder / table).parent
            fresh += [Source(file, str(inside)) for file in study_files(inside)]
        if not tables:
            wanted = [n for n in kept if PurePosixPath(n).name not in _BESIDE and ending(Path(n)) in (*TEXTS, *READ)]
            fresh = [Source(name, str(self.folder)) for name in wanted]
        return self._add(fresh)

    def bundled(self) -> list[Document]:
        """The study that ships with the package."""
        return self._add([Source(file, str(BUNDLED)) for file in study_files(BUNDLED)])

    def _add(self, fresh: list[Source]) -> list[Document]:
        if not fresh:
            raise SettingError("none of these files is a recording; drop a .csv, or any format of the readers.")
        known = {(s.folder, s.file) for s in fresh}
        old = [(s, r) for s, r in zip(self.sources, self._rows, strict=True) if (s.folder, s.file) not in known]
        self.sources, self._rows, self.shown = [s for s, _ in old], [r for _, r in old], -1
        shown: list[Document] = []
        for source in fresh:
            row = self._row(source)
            self.sources.append(source)
            self._rows.append(row)
            if not shown and not row["unread"]:
                shown = self.use(len(self.sources) - 1)
                if len(fresh) > 1:  # the foot moves while the others are read
                    for document in shown:
                        self.told(document)
        self._ready()
        return shown if len(fresh) == 1 and shown else [self.document()]

    def _row(self, source: Source) -> Document:
        """What was understood of a file: the checks' sentences, and what the form needs."""
        row: Document = {"file": source.file, "unread": "", "problem": "", "warnings": [], "columns": []}
        try:
            recording = source.read()
        except FasError as error:
            row["unread"] = str(error)
        else:
            found = understood(recording)
            condition = recording.condition
            row |= {
                key: found.get(key) for key in ("problem", "warnings", "frequency_hz", "samples", "rate_hz", "seconds")
            }
            row |= {"label": recording.file, "origin": recording.origin, "subject": condition.subject}
            row |= {"body_mass_kg": condition.body_mass_kg, "added_mass_kg": condition.added_mass_kg}
        return row

    def correct(self, number: int, said: Mapping[str, Any]) -> list[Document]:
        """Read a recording again with what the form says of it."""
        source = self._source(number).corrected(said)
        self.sources[number] = source
        self._rows[number] = self._row(source)
        return [self.document()] if self._rows[number]["unread"] else self.use(number)

    def use(self, number: int) -> list[Document]:
        """Shake the foot by one of the recordings."""
        recording = self._source(number).read()
        self.show.drive(Excitation.recorded(recording))
        self.shown = number
        return [self.document(), self.show.description() | {"adopt": True}]

    def sine(self) -> list[Document]:
        """Shake the foot by a sine again."""
        self.shown = -1
        self.show.drive(Excitation())
        return [self.document(), self.show.description() | {"adopt": True}]

    def columns(self, number: int) -> list[Document]:
        """Names and units of a file's columns."""
        source = self._source(number)
        said = {"channels": source.channels, "rate_hz": source.rate_hz}
        return [{"type": "columns", "number": number, "columns": source.columns(), "said": said}]

    def _source(self, number: int) -> Source:
        if not 0 <= number < len(self.sources):
            raise SettingError("that recording is no longer here; reload the page.")
        return self.sources[number]

    def document(self) -> Document:
        """The recordings, as the page lists them."""
        return {"type": "data", "rows": self._rows, "shown": self.shown}

    # ---- the fit -----------------------------------------------------------------------------------------------------
    def _ready(self) -> None:
        if self._worker is None or not self._worker.alive:
            self._worker = Worker(self._heard)

    def fit(self, numbers: list[int], asked: Mapping[str, Any]) -> list[Document]:
        """Begin a fit of the chosen recordings.

        Raises:
            SettingError: nothing is chosen, a fit runs already, or the settings cannot be meant.
        """
        sources, model, values = self._question(numbers, asked)
        settings = _settings(asked, self.show.feet[MODEL])
        self._asked = (sources, model, values, settings)
        return self._begin(job(*self._asked))

    def rivals(self, numbers: list[int], asked: Mapping[str, Any]) -> list[Document]:
        """Begin to compare rival models on the chosen recordings.

        Raises:
            SettingError: nothing is chosen, a fit runs already, or the model has no rivals.
        """
        sources, model, values = self._question(numbers, asked)
        if not twin_applies(self.show.feet[MODEL]):
            raise SettingError("rivals are known of the two masses only; choose two_dof, or a model like it.")
        self._compared = script(sources, model, values, {}, rivals=True)
        return self._begin(job(sources, model, values, {}) | {"do": "rivals"})

    def _begin(self, asked: Document) -> list[Document]:
        self._ready()
        assert self._worker is not None
        self._worker.ask(asked)
        self._state = {"running": True, "what": "reading", "done": 0, "total": 0}
        return [self.progress()]

    def _question(self, numbers: list[int], asked: Mapping[str, Any]) -> tuple[list[Source], str, dict[str, float]]:
        """What is to be fitted: recordings, model, and values that the model has in place of its own."""
        if self._state["running"]:
            raise SettingError("a fit runs already; stop it first.")
        sources = [self._source(number) for number in numbers]
        if not sources:
            raise SettingError("choose at least one recording to fit.")
        foot, model = self.show.feet[MODEL], self.show.models[0]
        if isinstance(model, Foot):
            raise SettingError("a model that was handed over in Python is fitted there: identification.fit_foot.")
        if self._draft:
            raise SettingError("the model in the editor is not saved yet; save it first, for a fit reads its file.")
        values = {
            str(name): float(value) for name, value in dict(asked.get("values", {})).items() if name in foot.parameters
        }
        for name, value in values.items():
            if not math.isfinite(value):
                raise SettingError(f"{name} is {value}; give a number.")
        return sources, model, values

    def stop(self) -> list[Document]:
        """End the running fit."""
        if self._worker is not None and self._state["running"]:
            self._state = {"running": False, "what": "stopped", "done": 0, "total": 0}
            self._worker.stop()
            self._worker = Worker(self._heard)
        return [self.progress()]

    def report(self) -> list[Document]:
        """Write the report of the last fit; the page opens it when it is there."""
        if self._fitted is None:
            raise SettingError("there is no fit to report; start one.")
        self._ready()
        assert self._worker is not None
        self._worker.ask(job(*self._fitted) | {"do": "report", "folder": str(self.folder / "results")})
        return []

    def take(self, said: Mapping[str, Any]) -> list[Document]:
        """Write one page that needs no server, with the sliders where they are."""
        from viz.exported import html

        before = self.show.settings
        self.show.settings = settings_from(said)
        try:
            write_whole(self.folder / "foot.html", html(self.show))
        finally:
            self.show.settings = before
        return [{"type": "taken"}]

    def progress(self) -> Document:
        """How far the fit is."""
        return {"type": "progress", **self._state}

    def _heard(self, document: Document) -> None:
        """A line of the worker, in its thread."""
        kind = document.get("type")
        if kind == "progress":
            self._state |= {name: document[name] for name in ("what", "done", "total")}
            self.told(self.progress())
        elif kind == "fitted":
            self._state = {"running": False, "what": "", "done": 0, "total": 0}
            parameters = self.show.feet[MODEL].parameters
            self.show.fit = fitted(document["document"], parameters, document["sentence"])
            assert self._asked is not None
            self._fitted = self._asked
            self._fit = {key: document[key] for key in ("data", "curves", "chi_square", "traces", "seconds")}
            self._fit |= {"type": "fitted", "fit": self.show.fit, "script": script(*self._asked)}
            self.told(self._fit)
            self.told(self.progress())
        elif kind == "rivals":
            self._state = {"running": False, "what": "", "done": 0, "total": 0}
            self._rivals = {**document, "script": self._compared}
            self.told(self._rivals)
            self.told(self.progress())
        elif kind == "reported":
            self._results = None
            self.told({"type": "reported"})
        elif kind == "problem":
            self._state = {"running": False, "what": "", "done": 0, "total": 0}
            self.told({"type": "complaint", "text": document["text"]})
            self.told(self.progress())
        elif kind == "ended" and self._state["running"] and self._worker is not None and not self._worker.alive:
            self._state = {"running": False, "what": "", "done": 0, "total": 0}
            self.told(
                {"type": "complaint", "text": "the fitting process was ended by the system; memory may be short."}
            )
            self.told(self.progress())

    # ---- the model ---------------------------------------------------------------------------------------------------
    def models(self) -> Document:
        """What the chooser offers, and the text of the model that is shown."""
        now = self.show.models[0]
        names = [name for name in mjcf.names() if _can_be_shown(name)]
        file = None if isinstance(now, Foot) or now in mjcf.names() or "@" in now else Path(now)
        text = ""
        if file is not None and file.is_file():
            text = file.read_text(errors="replace")
        elif not isinstance(now, Foot):
            text = mjcf.path(now.partition("@")[0]).read_text() if now.partition("@")[0] in mjcf.names() else ""
        called = now.name if isinstance(now, Foot) else str(now)
        return {"type": "models", "names": names, "now": called, "file": str(file or ""), "text": text}

    def choose(self, name: str) -> list[Document]:
        """Show another model: a shipped one, or a file of one's own."""
        foot = load_foot(name)
        before = self.show.models[0]
        self.show.models[0] = name
        try:
            self.show.settings = replace(self.show.settings, values={}, delay_s=0.0)
            self.show.show({**self.show.feet, MODEL: foot})
        except FasError:
            self.show.models[0] = before
            raise
        self.show.fit, self._draft = {}, False
        return [self.models(), self.show.description() | {"adopt": True}]

    def check(self, text: str) -> list[Document]:
        """Compile what is being typed, show it where it is sound, and say what is wrong where it is not."""
        name = str(self.show.models[0])
        place = self._place(name)
        draft = place / f".{Path(name).stem or 'model'}.draft.xml"
        try:
            write_whole(draft, text)
            foot = load_foot(str(draft))
            called = Path(name).name if Path(name).suffix else name
            self.show.show({**self.show.feet, MODEL: replace(foot, name=called)})
            self._draft = text != self.models()["text"]
        except FasError as error:
            said = str(error).replace(str(draft), Path(name).name).replace(draft.name, Path(name).name)
            line = re.search(r"line (\d+)", said)
            return [{"type": "checked", "text": said, "line": int(line[1]) if line else None}]
        finally:
            draft.unlink(missing_ok=True)
        return [{"type": "checked", "text": "", "line": None}, self.show.description()]

    def _place(self, name: str) -> Path:
        """The folder whose files a model may include."""
        file = Path(name)
        return file.resolve().parent if file.is_file() else self.folder

    def save(self, text: str, name: str = "") -> list[Document]:
        """Write the model's text: to its own file, or, of a shipped one, to a copy in this folder."""
        now = str(self.show.models[0])
        file = Path(now) if Path(now).is_file() and now not in mjcf.names() else Path("my_foot.xml")
        if name:
            if not _PART.fullmatch(name) or not name.endswith(".xml"):
                raise SettingError(f"{name!r} is no name for a model; give one such as my_foot.xml.")
            file = file.parent / name
        write_whole(file, text)
        return self.choose(str(file))


def _is_name(name: str) -> bool:
    """Whether a dropped file may be called so: inside the session's folder, and nothing hidden."""
    parts = PurePosixPath(name).parts
    return 0 < len(parts) <= DEEP and all(_PART.fullmatch(part) for part in parts)


@cache
def _can_be_shown(name: str) -> bool:
    try:
        load_foot(name)
    except FasError:
        return False
    return True


def _settings(asked: Mapping[str, Any], foot: Foot) -> dict[str, Any]:
    """What a page says of a fit, as `fit_foot` takes it.

    Raises:
        SettingError: it cannot be meant.
    """
    low, high = _STARTS
    starts = asked.get("starts", 4)
    if not isinstance(starts, int) or not low <= starts <= high:
        raise SettingError(f"the number of starts is {starts!r}; give {low} to {high}.")
    settings: dict[str, Any] = {"starts": starts}
    if asked.get("free") is not None:
        free = [name for name in asked["free"] if name in foot.parameters]
        if not free:
            raise SettingError("every parameter is held; let at least one of them go.")
        settings["free"] = free
    bounds = {}
    for name, pair in dict(asked.get("bounds", {})).items():
        if name not in foot.parameters:
            continue
        try:
            least, most = (float(value) for value in pair)
        except (TypeError, ValueError):
            raise SettingError(f"the bounds of {name} are {pair!r}; give two numbers.") from None
        if not least < most:
            raise SettingError(f"the bounds of {name} are {least:g} and {most:g}; the first must be the smaller one.")
        bounds[name] = (least, most)
    return settings | ({"bounds": bounds} if bounds else {})
