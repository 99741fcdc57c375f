"""The workbench behind the page: recordings that were dropped on it, their checks, the fit, and the model's text.

Everything here is what a script could do: files are read by `fasbody`, judged by its checks and fitted by
`identification.fit_foot` in a separate process. Each call returns documents for all pages.
"""

import hashlib
import importlib
import math
import re
import secrets
import tempfile
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

import mjcf
from fasbody.console import write_whole
from fasbody.exceptions import FasError, SettingError
from fasbody.foot.model import Foot
from fasbody.recording.checks import UNIT_IN_DOUBT, judged, unit_in_doubt
from fasbody.recording.files import TEXTS
from fasbody.recording.formats import READ, ending
from fasbody.recording.recording import Recording
from fasbody.recording.study import BUNDLED
from fasbody.sentences import for_page
from identification.engines.twin import twin_applies
from viz.archive import packed, study, unpacked
from viz.excitation import Excitation
from viz.feet import MODEL, Show
from viz.fitted import fitted
from viz.load import files_of, load_foot
from viz.question import Question
from viz.settings import settings_from
from viz.source import Source, on_page, study_files
from viz.worker import Send, Worker

Document = dict[str, Any]
#: Documents for the requesting page alone; all others are for every page.
PRIVATE = {"columns", "checked", "saved", "taken", "kept"}
#: Largest dropped file [bytes], and how much and how many files a session may hold.
LARGEST, MOST, FILES = 64_000_000, 512_000_000, 500
#: Parts of a dropped file's name: folders, and the file.
DEEP = 4
#: Files that belong to a study beside its recordings.
_BESIDE = {"study.toml", "subjects.csv", "recordings.csv", "truth.json"}
#: Longest part of a dropped file's name [bytes], and what some systems do not take in one.
_LONGEST, _REFUSED = 200, re.compile(r'[<>:"|?*]')
#: Fewest and most starts of a fit.
_STARTS = (1, 64)


class Bench:
    """What the page can do with a show: other data, other models, a fit.

    Args:
        show: what is shown.
        send: gets documents that come later, from the fitting process, in another thread.
        results: folder of the fit that is shown from the start, with its report.
    """

    def __init__(self, show: Show, send: Send = lambda document: None, results: Path | None = None) -> None:
        self.show = show
        self.send = send
        self._results = results
        self._folder = tempfile.TemporaryDirectory(prefix="fasbody-")
        self.session = secrets.token_hex(8)
        # Recordings and their rows on the page, by ids that are not used again in a session.
        self.sources: dict[int, Source] = {}
        self._rows: dict[int, Document] = {}
        self._doubts: dict[int, list[str]] = {}  # the checks' warnings, with their codes
        self._latest: tuple[Source, Recording] | None = None  # read last, so that a long file is read once
        self._next_id = 0
        self.current = -1
        self._worker: Worker | None = None
        self._warm = False  # the worker has compiled what it needs
        self._state: Document = {"running": False, "what": "", "done": 0, "total": 0}
        self._asked: Question | None = None  # the running job
        self._fit: tuple[Question, Document] | None = None
        self._rivals: tuple[Question, Document] | None = None
        self._fits = 0
        self._reporting = False
        self._draft = False  # what is shown was typed and not saved
        self._first = (self._called, show.fit)  # a result that was there from the start
        self._user_models = [self._called] if self._file is not None else []

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
        inside = {f"results/{file.relative_to(self.results).as_posix()}": file.read_bytes() for file in files}
        return packed(inside) if inside else b""

    def keep_study(self, numbers: list[int]) -> list[Document]:
        """Write the chosen recordings as a study folder, in one file.

        Raises:
            SettingError: nothing is chosen, or one has no body mass.
        """
        recordings = [self._source(number).read() for number in numbers]
        if not recordings:
            raise SettingError("tick the recordings that the study is to hold.")
        files = study("recordings of a session", recordings, self.folder)
        write_whole(self.folder / ".study.zip", packed({f"study/{name}": text for name, text in files.items()}))
        return [{"type": "kept"}]

    def close(self) -> None:
        """End the fitting process and delete the session's files."""
        if self._worker is not None:
            self._worker.stop()
        self._folder.cleanup()

    @staticmethod
    def prepare() -> None:
        """Import the packages that the first long recording needs."""
        importlib.import_module("pandas")
        importlib.import_module("scipy.signal")

    def documents(self) -> list[Document]:
        """The documents for a page that opens now."""
        return [self.document(), self.models(), self.progress(), *self._results_of_model()]

    def _results_of_model(self) -> list[Document]:
        """Fit and rivals of the model that is shown."""
        return [answer[1] for answer in (self._fit, self._rivals) if answer and answer[0].model == self._called]

    def followed(self) -> list[Document]:
        """The documents for all pages after another program changed a file of the model."""
        if not self.show.error:
            self._draft = False  # the file is shown again
        return [self.models(), self.document()]

    def act(self, message: Mapping[str, Any]) -> list[Document]:
        """Do the action of a page's message.

        Raises:
            SettingError: there is no such action. FasError: it failed.
        """
        kind, number = message.get("type"), message.get("number", -1)
        number = number if isinstance(number, int) else -1
        text, name, digest = (str(message.get(key, "")) for key in ("text", "name", "digest"))
        fields = message.get("said")
        fields = fields if isinstance(fields, dict) else {}
        several = message.get("numbers", []) if kind in ("fit", "rivals", "remove", "keep_study") else []
        chosen = [n for n in several if isinstance(n, int)]
        actions: dict[Any, Callable[[], list[Document]]] = {
            "open": lambda: self.open([str(n) for n in message.get("names", [])]), "bundled": self.bundled,
            "use": lambda: self.use(number), "sine": self.sine, "columns": lambda: self.columns(number),
            "correct": lambda: self.correct(_changes(message.get("changes"))),
            "fit": lambda: self.fit(chosen, fields), "stop": self.stop, "rivals": lambda: self.rivals(chosen, fields),
            "remove": lambda: self.remove(chosen), "keep_study": lambda: self.keep_study(chosen),
            "report": self.report, "choose": lambda: self.choose(name), "check": lambda: self.check(text),
            "save": lambda: self.save(text, digest), "take": lambda: self.take(fields),
        }  # fmt: skip
        if kind not in actions:
            raise SettingError(f"the page asks for {str(kind)[:40]!r}, which it cannot do; reload it.")
        return actions[kind]()

    # ---- files -------------------------------------------------------------------------------------------------------
    def keep(self, name: str, content: bytes) -> list[str]:
        """Keep a dropped file for this session, or what a zip file holds; the names that are kept.

        Raises:
            SettingError: no name of a file, of no format that is read, or too large. InputFileError: no zip file.
        """
        if Path(name).suffix.lower() != ".zip":
            return [self._keep(name, content)]
        inside = unpacked(name[:80], content, LARGEST, MOST, FILES)
        return [self._keep(f"{Path(name).stem}/{file}", text) for file, text in inside if _is_read(Path(file))]

    def _keep(self, name: str, content: bytes) -> str:
        kept = _kept(name)
        if not kept:
            raise SettingError(f"{name[:80]!r} is no name for a file; use printable characters, with no dot in front.")
        file = PurePosixPath(kept)
        if not _is_read(Path(kept)):
            valid = ", ".join((*TEXTS, *READ, ".zip"))
            raise SettingError(f"{file.name}: no format has the ending {ending(Path(kept))!r}; valid: {valid}.")
        if len(content) > LARGEST:
            raise SettingError(f"{file.name} is larger than {LARGEST // 1_000_000} MB; split it into recordings.")
        others = [f for f in self.folder.rglob("*") if f.is_file() and f != self.folder / kept]
        if sum(f.stat().st_size for f in others) + len(content) > MOST or len(others) >= FILES:
            raise SettingError("this session holds as many files as it may; remove some, or start another one.")
        write_whole(self.folder / kept, content)
        return kept

    def open(self, names: list[str]) -> list[Document]:
        """Read dropped files, or the study among them, and show the first that can be shown."""
        kept = [name for name in map(_kept, names) if name and (self.folder / name).is_file()]
        tables = [name for name in kept if PurePosixPath(name).name == "recordings.csv"]
        fresh: list[Source] = []
        for table in tables:
            inside = (self.folder / table).parent
            fresh += [Source(file, str(inside)) for file in study_files(inside)]
        if not tables:
            chosen = [n for n in kept if PurePosixPath(n).name not in _BESIDE and ending(Path(n)) in (*TEXTS, *READ)]
            fresh = [Source.bare(name, str(self.folder)) for name in chosen]
        return self._add(fresh)

    def bundled(self) -> list[Document]:
        """The study that ships with the package."""
        return self._add([Source(file, str(BUNDLED)) for file in study_files(BUNDLED)])

    def _add(self, fresh: list[Source]) -> list[Document]:
        if not fresh:
            raise SettingError("none of these files is a recording; drop a .csv, or any format of the readers.")
        self._ready()  # loads the solver while the recordings are read
        known, is_driving = {(s.folder, s.file): number for number, s in self.sources.items()}, False
        for source in fresh:
            number = known.get((source.folder, source.file), self._next_id)
            self._next_id = max(self._next_id, number + 1)
            # dropped again: the recording keeps its corrections
            self.sources[number] = self.sources.get(number, source)
            self._rows[number] = row = self._row(number)
            if not is_driving and _sound(row):
                documents, is_driving = self.use(number), True
                if len(fresh) == 1:
                    return documents
                for document in documents:  # the foot moves while the others are read
                    self.send(document)
        doubtful = [number for number, row in self._rows.items() if row["doubt"]]
        if not is_driving and self.current < 0 and doubtful:
            return self.use(doubtful[0])  # the foot is at rest, with the reason
        return [self.document()]

    def _row(self, number: int) -> Document:
        """One row of the page: the sentences of the checks, and the entries of the form."""
        source = self.sources[number]
        row: Document = {"id": number, "file": source.file, "unread": "", "problem": "", "doubt": "", "warnings": []}
        row |= {"unit": source.unit, "body_mass_kg": source.body_mass_kg, "added_mass_kg": source.added_mass_kg}
        try:
            recording = source.read()
            self._latest = source, recording
        except FasError as error:
            row["unread"] = self.words(error)
        else:
            judgement = judged(recording)
            condition = recording.condition
            row |= {
                key: judgement.get(key)
                for key in ("problem", "warnings", "frequency_hz", "samples", "rate_hz", "seconds")
            }
            self._doubts[number] = judgement["warnings"]
            row["doubt"] = "" if source.unit else for_page(unit_in_doubt([judgement["warnings"]]))
            row["problem"] = for_page(row["problem"])
            row["warnings"] = list(map(for_page, row["warnings"]))
            row |= {"label": recording.file, "origin": recording.origin, "subject": condition.subject}
            row |= {"unit": source.unit or _unit_of(recording), "body_mass_kg": condition.body_mass_kg}
            row["added_mass_kg"] = condition.added_mass_kg
        return row

    def words(self, error: FasError) -> str:
        """An error in the words of the page, its file as it was dropped."""
        return on_page(error, (self._folder.name, str(BUNDLED)))

    def correct(self, changes: Mapping[int, Mapping[str, Any]]) -> list[Document]:
        """Read recordings again with the page's corrections; where one correction is invalid, none is applied."""
        changed = {number: self._corrected(number, fields) for number, fields in changes.items()}
        for number, source in changed.items():
            before, row = self.sources[number], self._rows[number]
            masses = {key: getattr(source, key) for key in ("body_mass_kg", "added_mass_kg")}
            self.sources[number] = source
            if source.weighed and not row["unread"] and replace(before, **masses) == source:
                self._rows[number] = row | masses
            else:
                self._rows[number] = self._row(number)
        if self.current in changed:
            return self.use(self.current) if not self._rows[self.current]["unread"] else self.sine()
        good = [number for number in changed if _sound(self._rows[number])]
        alone = len(changed) == 1 or self.current < 0
        return self.use(good[0]) if good and alone else [self.document()]

    def _corrected(self, number: int, fields: Mapping[str, Any]) -> Source:
        """A source with corrections; masses that its study stated stay when its channels are corrected."""
        source, row = self._source(number), self._rows[number]
        masses = {key: row[key] for key in ("body_mass_kg", "added_mass_kg") if row.get("subject")}
        return source.corrected(masses | dict(fields))

    def remove(self, numbers: list[int]) -> list[Document]:
        """Forget recordings; their files go where no fit needs them for its report."""
        needed = {s.path for answer in (self._fit, self._asked and (self._asked, {})) if answer
                  for s in answer[0].sources.values()}  # fmt: skip
        for number in numbers:
            source = self._source(number)
            del self.sources[number], self._rows[number]
            self._doubts.pop(number, None)
            if source.folder == str(self.folder) and source.path not in needed:
                source.path.unlink(missing_ok=True)
        return [self.document()] if self.current in self.sources or self.current < 0 else self.sine()

    def use(self, number: int) -> list[Document]:
        """Shake the foot by one of the recordings.

        Raises:
            SettingError: it is no longer here, or a channel of it stands still.
        """
        source = self._source(number)
        recording = self._latest[1] if self._latest and self._latest[0] is source else source.read()
        for name in ("base_m_s2", "malleolus_m_s2"):
            values = recording.channels[name]
            if not (np.isfinite(values).all() and np.ptp(values) > 0):
                channel = name.removesuffix("_m_s2")
                raise SettingError(f"{recording.file}: the channel {channel} does not move; name its column with “…”.")
        self.show.drive(replace(Excitation.recorded(recording), doubt=self._rows[number]["doubt"]))
        self.current = number
        return [self.document(), self.show.description() | {"adopt": True}]

    def sine(self) -> list[Document]:
        """Shake the foot by a sine again."""
        self.current = -1
        self.show.drive(Excitation())
        return [self.document(), self.show.description() | {"adopt": True}]

    def columns(self, number: int) -> list[Document]:
        """Names and units of a file's columns."""
        source = self._source(number)
        layout = {"channels": source.channels, "rate_hz": source.rate_hz}
        return [{"type": "columns", "number": number, "columns": source.columns(), "said": layout}]

    def _source(self, number: int) -> Source:
        if number not in self.sources:
            raise SettingError("that recording is no longer here; reload the page.")
        return self.sources[number]

    def document(self) -> Document:
        """The recordings, as the page lists them."""
        stale = self._fit[0].stale(self.sources, self._whole) if self._fit else ""
        if self._fit:
            self._fit[1]["fit"]["stale"] = stale  # an exported page states it, too
        rows = list(self._rows.values())
        return {"type": "data", "session": self.session, "rows": rows, "shown": self.current, "stale": stale}

    # ---- the fit -----------------------------------------------------------------------------------------------------
    def _ready(self) -> None:
        if self._worker is None or not self._worker.alive:
            self._warm = False
            self._worker = Worker(self._receive)

    def fit(self, numbers: list[int], asked: Mapping[str, Any]) -> list[Document]:
        """Begin a fit of the chosen recordings.

        Raises:
            SettingError: nothing is chosen, a fit runs already, or the settings are invalid.
        """
        question = self._question(numbers, asked)
        return self._begin(replace(question, settings=_settings(asked, self.show.feet[MODEL])))

    def rivals(self, numbers: list[int], asked: Mapping[str, Any]) -> list[Document]:
        """Begin to compare rival models on the chosen recordings.

        Raises:
            SettingError: nothing is chosen, a fit runs already, or the model has no rivals.
        """
        question = self._question(numbers, asked)
        if not twin_applies(self.show.feet[MODEL]):
            raise SettingError("rivals are known of the two masses only; choose two_dof, or a model like it.")
        return self._begin(replace(question, rivals=True))

    def _begin(self, question: Question) -> list[Document]:
        self._ready()
        assert self._worker is not None
        self._asked = question
        self._worker.ask(question.job)
        what = (
            "reading the recordings"
            if self._warm
            else "loading the solver, which is compiled when it is used for the first time"
        )
        self._state = {"running": True, "what": what, "done": 0, "total": 0}
        return [self.progress()]

    def _question(self, numbers: list[int], asked: Mapping[str, Any]) -> Question:
        """What is to be fitted."""
        if self._state["running"]:
            raise SettingError("a fit runs already; stop it first.")
        sources = {number: self._source(number) for number in numbers}
        if not sources:
            raise SettingError("choose at least one recording to fit.")
        foot = self.show.feet[MODEL]
        if isinstance(self.show.models[0], Foot):
            raise SettingError("a model that was handed over in Python is fitted there: identification.fit_foot.")
        if self._draft:
            raise SettingError("the model in the editor is not saved yet; save it first, for a fit reads its file.")
        values = {
            str(name): float(value) for name, value in dict(asked.get("values", {})).items() if name in foot.parameters
        }
        for name, value in values.items():
            if not math.isfinite(value):
                raise SettingError(f"{name} is {value}; give a number.")
        return Question(sources, self._called, self._whole, values)

    def stop(self) -> list[Document]:
        """End the running fit; a report that waits for the process is requested again."""
        if self._worker is not None and self._state["running"]:
            reporting, self._reporting = self._reporting, False
            self._idle("stopped; the report that was asked for is still being written" if reporting else "stopped")
            self._worker.stop()
            self._worker, self._warm = Worker(self._receive), False
            if reporting:
                self.report()
        return [self.progress()]

    @property
    def _waited_for(self) -> bool:
        return self._reporting or bool(self._state["running"])

    def _idle(self, what: str = "") -> None:
        self._state = {"running": False, "what": what, "done": 0, "total": 0}

    def report(self) -> list[Document]:
        """Write the report of the last fit; the page opens it when it is there."""
        if self._fit is None:
            raise SettingError("there is no fit to report; start one.")
        self._ready()
        assert self._worker is not None
        self._worker.ask(self._fit[0].job | {"do": "report", "folder": str(self.folder / "results")})
        self._reporting = True
        return []

    def take(self, settings: Mapping[str, Any]) -> list[Document]:
        """Write one page that needs no server, with the sliders where they are."""
        from viz.exported import html

        before = self.show.settings
        self.show.settings = settings_from(settings)
        try:
            write_whole(self.folder / "foot.html", html(self.show))
        finally:
            self.show.settings = before
        return [{"type": "taken"}]

    def progress(self) -> Document:
        """How far the fit is."""
        return {"type": "progress", **self._state}

    def _receive(self, document: Document) -> None:
        """Handle a document of the worker, in the listening thread."""
        kind = document.get("type")
        if kind == "ready":
            self._warm = True
            if self._state["running"]:
                self._state["what"] = "reading the recordings"
                self.send(self.progress())
        elif kind == "progress":
            self._state |= {name: document[name] for name in ("what", "done", "total")}
            self.send(self.progress())
        elif kind in ("fitted", "rivals"):
            self._idle()
            self._answered(kind, document)
            self.send(self.progress())
        elif kind == "reported":
            self._results, self._reporting = None, False
            self.send({"type": "reported"})
        elif kind == "problem":
            of = document.get("of", "")
            knows_unit = of == "report" or document.get("code") == UNIT_IN_DOUBT
            doubt = "" if knows_unit else self._unit_in_doubt()
            self._failed(" ".join(filter(None, (document["text"], doubt))), of)
        elif kind == "ended" and self._worker is not None and not self._worker.alive and self._waited_for:
            self._failed("the fitting process was ended by the system; memory may be short.")

    def _unit_in_doubt(self) -> str:
        """The checks' doubt about the units of the recordings of the running job."""
        asked = self._asked.sources if self._asked else ()
        return for_page(unit_in_doubt(self._doubts[number] for number in asked if number in self._doubts))

    def _failed(self, sentence: str, of: str = "") -> None:
        """Report that a fit or a report failed, without `of` both. The other one goes on."""
        if of != "report":
            self._idle()
        if of in ("report", ""):
            self._reporting = False
        self.send({"type": "complaint", "text": sentence, "of": of})
        self.send(self.progress())

    def _answered(self, kind: str, document: Document) -> None:
        """Keep a result; it is shown where its model is the current one."""
        question = self._asked
        assert question is not None
        is_current = question.model == self._called
        if kind == "rivals":
            self._rivals = question, {**document, "script": question.script}
            answer = self._rivals[1]
        else:
            parameters = (self.show.feet[MODEL] if is_current else load_foot(question.model)).parameters
            fit = fitted(document["document"], parameters, document["sentence"], question.values)
            answer = {key: document[key] for key in ("data", "curves", "chi_square", "traces", "seconds")}
            self._fits += 1
            answer |= {"type": "fitted", "number": self._fits, "fit": fit, "script": question.script}
            self._fit = question, answer
            if is_current:
                self.show.fit = fit
        if is_current:
            self.send(answer)
            self.send(self.document())
        else:
            self.send({"type": "complaint", "text": f"{question.model} is fitted; choose it to see what was found."})

    # ---- the model ---------------------------------------------------------------------------------------------------
    @property
    def _called(self) -> str:
        """The model that is shown, by name or file."""
        now = self.show.models[0]
        return now.name if isinstance(now, Foot) else str(now)

    @property
    def _file(self) -> Path | None:
        """The file of the model, None of a shipped one."""
        now = self.show.models[0]
        return None if isinstance(now, Foot) or now.partition("@")[0] in mjcf.names() else Path(now.partition("@")[0])

    @property
    def _text(self) -> str:
        """The model's MJCF as its file has it."""
        file, shipped = self._file, self._called.partition("@")[0]
        if file is None:
            return mjcf.path(shipped).read_text() if shipped in mjcf.names() else ""
        return file.read_text(errors="replace") if file.is_file() else ""

    @property
    def _digest(self) -> str:
        return hashlib.sha256(self._text.encode()).hexdigest()

    @property
    def _whole(self) -> str:
        """Digest of the model's text with all files that it includes: what a fit is of."""
        digest = hashlib.sha256(self._text.encode())
        for file in sorted(files_of(self._called)) if self._file is not None else []:
            digest.update(f"\0{file}\0".encode() + (file.read_bytes() if file.is_file() else b""))
        return digest.hexdigest()

    def models(self) -> Document:
        """What the chooser offers, and the text of the model that is shown."""
        names = [name for name in mjcf.names() if _loads(name)]
        names += [name for name in self._user_models if name not in names]
        about = {"names": names, "now": self._called, "file": str(self._file or ""), "copy": str(self._copy())}
        return {"type": "models", **about, "text": self._text, "digest": self._digest, "draft": self._draft}

    def choose(self, name: str) -> list[Document]:
        """Show another model, a shipped one or a user's file, with its results."""
        foot = load_foot(name)
        before = self.show.models[0]
        self.show.models[0] = name
        try:
            self.show.settings = replace(self.show.settings, values={}, delay_s=0.0)
            self.show.show({**self.show.feet, MODEL: foot})
        except FasError:
            self.show.models[0] = before
            raise
        if self._file is not None and name not in self._user_models:
            self._user_models.append(name)
        answers, self._draft = self._results_of_model(), False
        fits = [document["fit"] for document in answers if document["type"] == "fitted"]
        self.show.fit = fits[0] if fits else self._first[1] if self._first[0] == name else {}
        return [self.models(), self.show.description() | {"adopt": True}, *answers, self.document()]

    def check(self, text: str) -> list[Document]:
        """Compile what is being typed, show it where it is sound, and say what is wrong where it is not."""
        name = str(self.show.models[0])
        place = self._place(name)
        draft = place / f".{Path(name).stem or 'model'}.draft.xml"
        called = Path(name).name if Path(name).suffix else name
        try:
            write_whole(draft, text)
            self.show.show({**self.show.feet, MODEL: load_foot(str(draft), called)})
            self._draft = text != self._text
        except FasError as error:
            text = error.on_page(called if error.file == str(draft) else "")
            return [{"type": "checked", "text": text, "line": error.line}]
        finally:
            draft.unlink(missing_ok=True)
        return [{"type": "checked", "text": "", "line": None}, self.show.description() | {"draft": self._draft}]

    def _place(self, name: str) -> Path:
        """The folder whose files a model may include."""
        file = Path(name)
        return file.resolve().parent if file.is_file() else self.folder

    def _copy(self) -> Path:
        """Where a shipped model is saved: a copy with its name in this folder, never over another file."""
        name = self._called.partition("@")[0]
        names = (Path(f"my_{name}{number}.xml") for number in ("", *(f"_{k}" for k in range(2, 1000))))
        return next(file for file in names if not file.exists())

    def save(self, text: str, digest: str) -> list[Document]:
        """Write the model's text to its file, or that of a shipped model to a copy in this folder.

        Args:
            text: the MJCF.
            digest: of what was opened in the editor; a file that is another by now is not written
                over.

        Raises:
            SettingError: it was handed over in Python. ModelError: a copy of a shipped model is not sound.
        """
        if isinstance(self.show.models[0], Foot):
            raise SettingError("a model that was handed over in Python has no file to save.")
        source = self._file
        if source is not None and source.is_file() and digest != self._digest:
            return [{"type": "saved", "file": "", "text": f"{source.name} was changed by another program meanwhile."},
                    self.models()]  # fmt: skip
        if source is None:
            (checked, *_) = self.check(text)
            if checked["text"]:
                raise SettingError(f"not saved, for a copy has to be sound: {checked['text']}")
        file = source or self._copy()
        write_whole(file, text)
        saved = {"type": "saved", "file": str(file), "text": "", "digest": hashlib.sha256(text.encode()).hexdigest()}
        try:
            models, description, *answers = self.choose(self._called if source else str(file))
        except FasError as error:
            return [saved | {"text": f"saved, but the last good model is shown: {error}"}, self.models()]
        return [saved, models, description | {"same": True}, *answers]


def _is_read(file: Path) -> bool:
    """Whether a file is a recording by its ending, or belongs to one."""
    return ending(file) in (*TEXTS, *READ, ".json", ".toml") or file.name in _BESIDE


def _sound(row: Mapping[str, Any]) -> bool:
    """Whether a recording can be fitted, and is in the unit that it seems to be in."""
    return not (row["unread"] or row["problem"] or row["doubt"])


def _unit_of(recording: Recording) -> str:
    """The unit of the base in its file, as the recording's source states it."""
    made = next((text for text in recording.used if text.startswith("base:")), "")
    return made.partition(", its times")[0].rpartition(" in ")[2].replace("_s2", "/s^2")


def _changes(asked: Any) -> dict[int, Mapping[str, Any]]:
    """Corrections of recordings from a page's message, by their ids.

    Raises:
        SettingError: it is no list of pairs of an id and a table.
    """
    pairs = asked if isinstance(asked, list) else []
    good = [isinstance(pair, list) and list(map(type, pair)) == [int, dict] for pair in pairs]
    if not good or not all(good):
        raise SettingError("the page's corrections cannot be read; reload it.")
    return dict(pairs)


def _kept(name: str) -> str:
    """The name that a dropped file is kept under, inside the session's folder; empty where there is none for it."""
    parts = [_REFUSED.sub("_", unicodedata.normalize("NFC", part)) for part in PurePosixPath(name).parts]
    good = all(part.isprintable() and part[0] != "." and "\\" not in part for part in parts)
    good = good and not name.startswith("/") and all(len(part.encode()) <= _LONGEST for part in parts)
    return "/".join(parts) if good and 0 < len(parts) <= DEEP else ""


@cache
def _loads(name: str) -> bool:
    try:
        load_foot(name)
    except FasError:
        return False
    return True


def _settings(asked: Mapping[str, Any], foot: Foot) -> dict[str, Any]:
    """Settings of a fit from a page's message, as `fit_foot` takes them.

    Raises:
        SettingError: a setting is invalid.
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
