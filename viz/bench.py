"""The workbench behind the page: recordings that were dropped on it, their checks, the fit, and the model's text.

Everything here is what a script could do: files are read by `fasbody`, judged by its checks and fitted by
`identification.fit_foot` in a separate process. Each call returns documents for all pages.
"""

import importlib
import math
import secrets
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from fasbody.console import write_whole
from fasbody.exceptions import FasError, SettingError
from fasbody.foot.model import Foot
from fasbody.recording.study import BUNDLED
from identification.engines.twin import twin_applies
from viz import uploads
from viz.archive import packed, study
from viz.excitation import Excitation
from viz.feet import MODEL, Show
from viz.fits import Fits
from viz.fitted import fitted
from viz.history import History
from viz.job import Answer, Job
from viz.load import files_of, load_foot
from viz.model_text import CHANGED, ModelText, is_shipped
from viz.recordings import Recordings
from viz.session import Session
from viz.settings import settings_from
from viz.signals import signals
from viz.source import Source, on_page, study_files
from viz.worker import Send

Document = dict[str, Any]
#: Documents for the requesting page alone; all others are for every page.
PRIVATE = {"columns", "signals", "checked", "saved", "taken", "kept", "session_kept", "session", "comparison"}
#: Fewest and most starts of a fit.
_STARTS = (1, 64)


class Bench:
    """What the page can do with a show: other data, other models, a fit.

    Args:
        show: what is shown.
        send: gets documents that come later, from the fitting process, in another thread.
        results: folder of the fit that is shown from the start, with its report.

    Attributes:
        recordings: of the session.
        model: as text.
        fits: the process that fits.
        history: of the fits that were made.
        current: id of the recording that shakes the foot, -1 for none.
        dropped_session: folder and content of a session's file that was dropped last.
        unread: dropped recordings that are still to be read; see `read_next`.
    """

    def __init__(self, show: Show, send: Send = lambda document: None, results: Path | None = None) -> None:
        self.show = show
        self.send = send
        self._results = results
        self._folder = tempfile.TemporaryDirectory(prefix="fasbody-")
        self.session = secrets.token_hex(8)
        self._folders = (self._folder.name, str(BUNDLED))
        self.recordings = Recordings(self._folders)
        self.model = ModelText(show, self.folder)
        self.fits = Fits(lambda document: self.send(document), self._answered, self._doubt)
        self.current = -1
        self.history = History()
        self._rivals: Answer | None = None
        self._first = (self.model.name, show.fit)  # a result that was there from the start
        self.dropped_session: tuple[Path, Session] | None = None
        self.unread: list[Source] = []

    @property
    def folder(self) -> Path:
        """Where the session's files lie."""
        return Path(self._folder.name)

    @property
    def results(self) -> Path:
        """Where report and numbers of the last fit lie, once they are written."""
        return self._results or self.folder / "results"

    def words(self, error: FasError) -> str:
        """An error in the words of the page, its file as it was dropped."""
        return on_page(error, self._folders)

    def close(self) -> None:
        """End the fitting process and delete the session's files."""
        self.fits.close()
        self._folder.cleanup()

    @staticmethod
    def prepare() -> None:
        """Import the packages that the first long recording needs."""
        importlib.import_module("pandas")
        importlib.import_module("scipy.signal")

    def documents(self) -> list[Document]:
        """The documents for a page that opens now."""
        now = [self.document(), self.model.document(), self.fits.progress(), self.history.document()]
        return [*now, *self._results_of_model()]

    def document(self) -> Document:
        """The recordings, as the page lists them."""
        answer, stale = self.history.of_model(self.model.name), ""
        if answer:
            stale = answer[0].stale(self.recordings.sources, self.model.whole)
            answer[1]["fit"]["stale"] = stale  # an exported page states it, too
        rows, undo = list(self.recordings.rows.values()), self.recordings.steps
        about = {"session": self.session, "shown": self.current, "stale": stale, "undo": undo}
        about["unread"] = len(self.unread)
        return {"type": "data", **about, "rows": rows}

    def _results_of_model(self) -> list[Document]:
        name = self.model.name
        answers = (self.history.of_model(name), self._rivals)
        return [answer[1] for answer in answers if answer and answer[0].model == name]

    def followed(self) -> list[Document]:
        """The documents for all pages after another program changed a file of the model."""
        if not self.show.error:
            self.model.draft = False  # the file is shown again
        return [self.model.document(), self.document()]

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
        several = message.get("numbers", [])
        chosen = [n for n in several if isinstance(n, int)] if isinstance(several, list) else []
        actions: dict[Any, Callable[[], list[Document]]] = {
            "open": lambda: self._begin_reading(uploads.sources(self.folder, [*map(str, message.get("names", []))])),
            "bundled": lambda: self._begin_reading(_bundled()),
            "use": lambda: self.use(number), "sine": self.sine, "columns": lambda: self.columns(number),
            "signals": lambda: [{"type": "signals", "number": number, **signals(self.recordings.source(number))}],
            "correct": lambda: self.correct(_changes(message.get("changes"))),
            "undo": lambda: self.undo(message.get("again") is True),
            "show_fit": lambda: self.show_fit(number), "remove_fit": lambda: self.remove_fit(number),
            "compare_fits": lambda: [self.history.comparison(chosen, name)],
            "fit": lambda: self.fit(chosen, fields), "stop": self.stop, "rivals": lambda: self.rivals(chosen, fields),
            "remove": lambda: self.remove(chosen), "keep_study": lambda: self.keep_study(chosen),
            "report": self.report, "choose": lambda: self.choose(name), "check": lambda: self.check(text),
            "save": lambda: self.save(text, digest), "take": lambda: self.take(fields),
            "save_session": lambda: self.save_session(fields), "open_session": self.open_session,
        }  # fmt: skip
        if kind not in actions:
            raise SettingError(f"the page asks for {str(kind)[:40]!r}, which it cannot do; reload it.")
        return actions[kind]()

    # ---- recordings --------------------------------------------------------------------------------------------------
    def keep(self, name: str, content: bytes) -> list[str]:
        """Keep a dropped file for this session, or what a zip file holds; the names that are kept.

        A session's file is kept for `open_session`, and has no names.

        Raises:
            SettingError, InputFileError: see `uploads.keep`.
        """
        self.dropped_session = None
        if Path(name).suffix.lower() == ".zip":
            folder = uploads.fresh(self.folder)
            session = Session.unpack(name[:80], content, folder)
            if session is not None:
                self.dropped_session = folder, session
                return []
        return uploads.keep(self.folder, name, content)

    def _begin_reading(self, fresh: list[Source]) -> list[Document]:
        """Read recordings as far as the first that can be shown; the others are `unread`."""
        if not fresh:
            raise SettingError("none of these files is a recording; drop a .csv file or another readable format.")
        self.fits.prepare()  # loads the solver while the recordings are read
        for k, source in enumerate(fresh):
            number = self.recordings.first([self.recordings.add(source)])
            if number >= 0:
                self.unread += fresh[k + 1 :]
                return self.use(number)  # the foot moves while the others are read
        doubtful = [number for number, row in self.recordings.rows.items() if row["doubt"]]
        if self.current < 0 and doubtful:
            return self.use(doubtful[0])  # the foot is at rest, with the reason
        return [self.document()]

    def read_next(self) -> list[Document]:
        """Read one more of the unread recordings; the list of all after the last one."""
        if self.unread:
            self.recordings.add(self.unread.pop(0))
        return [] if self.unread else [self.document()]

    def correct(self, changes: Mapping[int, Mapping[str, Any]]) -> list[Document]:
        """Read recordings again with the page's corrections; where one correction is invalid, none is applied."""
        return self._corrected(self.recordings.correct(changes))

    def undo(self, again: bool) -> list[Document]:
        """Take back the last corrections, or make them `again`."""
        return self._corrected(self.recordings.undo(again))

    def _corrected(self, changed: set[int]) -> list[Document]:
        if self.current in changed:
            return self.sine() if self.recordings.rows[self.current]["unread"] else self.use(self.current)
        good = self.recordings.first(sorted(changed))
        alone = len(changed) == 1 or self.current < 0
        return self.use(good) if good >= 0 and alone else [self.document()]

    def remove(self, numbers: list[int]) -> list[Document]:
        """Forget recordings; their files go where no fit needs them for its report."""
        answers = [*self.history.answers.values(), *([self._rivals] if self._rivals else [])]
        jobs = [*(job for job, _ in answers), *([self.fits.job] if self.fits.job else [])]
        needed = {source.path for job in jobs for source in job.sources.values()}
        for number in numbers:
            self.recordings.forget(number, self.folder, needed)
        if not self.recordings.sources:  # all of them, and what is still to be read
            self.unread.clear()
        return [self.document()] if self.current in self.recordings.sources or self.current < 0 else self.sine()

    def use(self, number: int) -> list[Document]:
        """Shake the foot by one of the recordings.

        Raises:
            SettingError: it is no longer here, or a channel of it stands still.
        """
        recording = self.recordings.read(number)
        row, excitation = self.recordings.rows[number], Excitation.recorded(recording)
        return self._drive(replace(excitation, doubt=row["doubt"], refused=bool(row["problem"])), number)

    def sine(self) -> list[Document]:
        """Shake the foot by a sine again."""
        return self._drive(Excitation(), -1)

    def _drive(self, excitation: Excitation, number: int) -> list[Document]:
        self.show.drive(excitation)
        self.current = number
        return [self.document(), self.show.description() | {"adopt": True}]

    def columns(self, number: int) -> list[Document]:
        """Names and units of a file's columns."""
        source = self.recordings.source(number)
        layout = {"channels": source.channels, "rate_hz": source.rate_hz}
        return [{"type": "columns", "number": number, "columns": source.columns(), "said": layout}]

    def keep_study(self, numbers: list[int]) -> list[Document]:
        """Write the chosen recordings as a study folder, in one file.

        Raises:
            SettingError: nothing is chosen, or one has no body mass.
        """
        recordings = [self.recordings.source(number).read() for number in numbers]
        if not recordings:
            raise SettingError("tick the recordings to save in the study.")
        files = study("recordings of a session", recordings, self.folder)
        write_whole(self.folder / ".study.zip", packed({f"study/{name}": text for name, text in files.items()}))
        return [{"type": "kept"}]

    # ---- the fit -----------------------------------------------------------------------------------------------------
    def fit(self, numbers: list[int], asked: Mapping[str, Any]) -> list[Document]:
        """Begin a fit of the chosen recordings.

        Raises:
            SettingError: nothing is chosen, a fit runs already, or the settings are invalid.
        """
        return self._begin(replace(self._job(numbers, asked), settings=_settings(asked, self.show.feet[MODEL])))

    def rivals(self, numbers: list[int], asked: Mapping[str, Any]) -> list[Document]:
        """Begin to compare rival models on the chosen recordings.

        Raises:
            SettingError: nothing is chosen, a fit runs already, or the model has no rivals.
        """
        job = self._job(numbers, asked)
        if not twin_applies(self.show.feet[MODEL]):
            raise SettingError("rival models exist for the two-mass foot only; choose two_dof, or a model like it.")
        return self._begin(replace(job, rivals=True))

    def _begin(self, job: Job) -> list[Document]:
        self.fits.begin(job)
        return [self.fits.progress()]

    def _job(self, numbers: list[int], asked: Mapping[str, Any]) -> Job:
        if self.fits.running:
            raise SettingError("a fit is already running; stop it first.")
        sources = {number: self.recordings.source(number) for number in numbers}
        if not sources:
            raise SettingError("choose at least one recording to fit.")
        foot = self.show.feet[MODEL]
        if isinstance(self.show.models[0], Foot):
            raise SettingError(
                f"{CHANGED} so it cannot be fitted here. Use identification.fit_foot, or save the model and show its "
                "file."
            )
        if self.model.draft:
            raise SettingError("the model in the editor is not saved yet; save it before you fit.")
        values = dict(asked.get("values", {}))
        values = {str(name): float(value) for name, value in values.items() if name in foot.parameters}
        for name, value in values.items():
            if not math.isfinite(value):
                raise SettingError(setting=name, quantity=name, value=value, valid="a number")
        return Job(sources, self.model.name, self.model.whole, values)

    def stop(self) -> list[Document]:
        """End the running fit; a report that waits for the process is requested again."""
        if self.fits.stop():
            self.report()
        return [self.fits.progress()]

    def report(self) -> list[Document]:
        """Write the report of the fit that is shown; the page opens it when it is there."""
        answer = self.history.of_model(self.model.name)
        if answer is None:
            raise SettingError("there is no fit yet; start one.")
        self._results = None  # the new one counts
        self.fits.report(answer[0], self.folder / "results")
        return []

    def show_fit(self, number: int) -> list[Document]:
        """Show a fit that was made before, with its model.

        Raises:
            SettingError: it is no longer kept. FasError: its model cannot be shown.
        """
        job, document = self.history.answer(number)
        self.history.chosen = number
        if job.model != self.model.name:
            return self.choose(job.model)
        self.show.fit = document["fit"]
        return [document, self.document()]

    def remove_fit(self, number: int) -> list[Document]:
        """Forget a fit.

        Raises:
            SettingError: it is no longer kept.
        """
        self.history.answer(number)
        before = self.history.of_model(self.model.name)
        del self.history.answers[number]
        after = self.history.of_model(self.model.name)
        if after is before:
            return [self.history.document()]
        self.show.fit = after[1]["fit"] if after else {}
        return [self.history.document(), after[1] if after else self.show.description(), self.document()]

    def zipped(self) -> bytes:
        """What `FitResult.write` writes, in one file; empty where nothing is written."""
        files = [self.results / name for name in ("report.html", "result.json", "parameters.csv")]
        files = [file for file in (*files, *sorted((self.results / "figures").glob("*.*"))) if file.is_file()]
        inside = {f"results/{file.relative_to(self.results).as_posix()}": file.read_bytes() for file in files}
        return packed(inside) if inside else b""

    def take(self, settings: Mapping[str, Any]) -> list[Document]:
        """Write one page that needs no server, with the sliders where they are."""
        from viz.exported import html

        before = self.show.settings
        self.show.settings = settings_from(settings)
        try:
            write_whole(self.folder / ".foot.html", html(self.show))
        finally:
            self.show.settings = before
        return [{"type": "taken"}]

    def _doubt(self, job: Job) -> str:
        return self.recordings.doubt(job.sources)

    def _answered(self, job: Job, document: Document) -> None:
        """Keep a result; it is shown where its model is the current one."""
        is_current = job.model == self.model.name
        if document["type"] == "rivals":
            answer = {**document, "script": job.script}
            self._rivals = job, answer
        else:
            parameters = (self.show.feet[MODEL] if is_current else load_foot(job.model)).parameters
            fit = fitted(document["document"], parameters, document["sentence"], job.values)
            answer = {key: document[key] for key in ("data", "curves", "chi_square", "traces", "seconds")}
            answer = self.history.add(job, answer | {"fit": fit})
            if is_current:
                self.show.fit = fit
            self.send(self.history.document())
        if is_current:
            self.send(answer)
            self.send(self.document())
        else:
            self.send({"type": "complaint", "text": f"{job.model} has been fitted; choose it to see the result."})

    # ---- the model ---------------------------------------------------------------------------------------------------
    def choose(self, name: str) -> list[Document]:
        """Show another model, a shipped one or a user's file, with its results."""
        self.model.choose(name)
        answers = self._results_of_model()
        fits = [document["fit"] for document in answers if document["type"] == "fitted"]
        self.show.fit = fits[0] if fits else self._first[1] if self._first[0] == name else {}
        return [self.model.document(), self.show.description() | {"adopt": True}, *answers, self.document()]

    def check(self, text: str) -> list[Document]:
        """Compile what is being typed, show it where it is sound, and say what is wrong where it is not."""
        checked = self.model.check(text)
        return [checked] if checked["text"] else [checked, self.show.description() | {"draft": self.model.draft}]

    def save(self, text: str, digest: str) -> list[Document]:
        """Write the model's text to its file, or that of a shipped model to a copy in this folder.

        Args:
            text: the MJCF.
            digest: of what was opened in the editor; a file that is another by now is not written over.

        Raises:
            SettingError: it was changed in Python, or a copy of a shipped model is not sound.
        """
        saved = self.model.save(text, digest)
        if not saved["file"]:
            return [saved, self.model.document()]
        try:
            models, description, *answers = self.choose(saved["file"] if self.model.file is None else self.model.name)
        except FasError as error:
            return [saved | {"text": f"saved, but the last good model is shown: {error}"}, self.model.document()]
        return [saved, models, description | {"same": True}, *answers]

    # ---- the session -------------------------------------------------------------------------------------------------
    def save_session(self, page: Mapping[str, Any]) -> list[Document]:
        """Write all of this session into one file.

        Raises:
            SettingError: the model was changed in Python, or its text is not saved.
        """
        if isinstance(self.show.models[0], Foot):
            raise SettingError(f"{CHANGED} so it cannot be saved in a session. Save the model and show its file.")
        if self.model.draft:
            raise SettingError("the model in the editor is not saved yet; save it before you save the session.")
        kept = f"model/{Path(self.model.name).name}" if self.model.file is not None else self.model.name
        pairs = [(number, self._kept(answer, kept)) for number, answer in self.history.answers.items()]
        fits = {number: answer for number, answer in pairs if answer}
        rivals = self._kept(self._rivals, kept) if self._rivals else None
        jobs = [job.sources for job, _ in (*fits.values(), *([rivals] if rivals else []))]
        sources = [source for group in (self.recordings.sources, *jobs) for source in group.values()]
        folders = uploads.places(self.folder, {Path(s.folder) for s in sources if s.folder != str(BUNDLED)})
        files = {
            (Path(inside) / file.relative_to(folder)).as_posix(): file.read_bytes()
            for folder, inside in folders.items()
            for file in uploads.inside(Path(folder), self.folder)
        }
        name, main = self.model.name, self.model.file
        if main is not None:  # with what it includes, where that lies beside it
            beside = main.resolve().parent
            parts = [file for file in files_of(name) if file.is_relative_to(beside) and file.is_file()]
            files |= {f"model/{file.relative_to(beside).as_posix()}": file.read_bytes() for file in parts}
        chosen = list(fits).index(self.history.chosen) if self.history.chosen in fits else -1
        answers = tuple(fits.values())
        session = Session(self.recordings.sources, self.current, kept, answers, chosen, rivals, page, files)
        write_whole(self.folder / ".session.zip", session.pack(folders))
        return [{"type": "session_kept"}]

    def _kept(self, answer: Answer, model: str) -> Answer | None:
        """A result for the session's file: of the model that is shown, whose digest goes where it is up to date, or of
        a shipped one; None of other files, which the session does not hold.
        """
        job, document = answer
        if job.model == self.model.name:
            return replace(job, model=model, text="" if job.text == self.model.whole else "changed"), document
        return answer if is_shipped(job.model) else None

    def open_session(self) -> list[Document]:
        """Take up the session whose file was dropped, in place of this one.

        Raises:
            SettingError: none was, or a fit runs. FasError: its model cannot be shown.
        """
        if self.dropped_session is None:
            raise SettingError("this is not a saved session; drop a file that this page has saved.")
        if self.fits.running:
            raise SettingError("a fit runs; stop it first.")
        (folder, session), self.dropped_session = self.dropped_session, None
        for name, content in session.files.items():
            if kept := uploads.safe(name):
                write_whole(folder / kept, content)
        self.history, self._rivals = History(count=self.history.count), None
        self.remove(list(self.recordings.sources))
        self.recordings.forget_corrections()
        in_file = session.model.startswith("model/")
        models = self.choose(str(folder / session.model) if in_file else session.model)
        ids = {number: self.recordings.add(source, new=True) for number, source in session.sources.items()}
        answers = [self._opened(answer, ids, session.model) for answer in session.fits]
        self.history = History(answers, self.history.count)
        self._rivals = self._opened(session.rivals, ids, session.model) if session.rivals else None
        numbers = list(self.history.answers)
        self.history.chosen = numbers[session.chosen] if 0 <= session.chosen < len(numbers) else 0
        if answer := self.history.of_model(self.model.name):
            self.show.fit = answer[1]["fit"]
        driven = self.use(ids[session.current]) if session.current in ids else self.sine()
        note = f"{Path(self.model.name).name} is this session's copy; save the session to keep its edits."
        page = {"type": "session", "page": dict(session.page), "ids": ids, "note": note if in_file else ""}
        documents = [models[0], *driven, self.history.document(), *self._results_of_model(), self.document()]
        return [*documents, page]

    def _opened(self, answer: Answer, ids: Mapping[int, int], model: str) -> Answer:
        """A result of a session's file under the ids of this session, and its `model` where that now lies."""
        job, document = answer
        sources = {ids.get(number, -1 - number): source for number, source in job.sources.items()}
        job = replace(job, sources=sources, text=job.text or self.model.whole)
        job = replace(job, model=self.model.name) if job.model == model else job
        return job, document | {"script": job.script}


def _bundled() -> list[Source]:
    return [Source(file, str(BUNDLED)) for file in study_files(BUNDLED)]


def _changes(asked: Any) -> dict[int, Mapping[str, Any]]:
    pairs = asked if isinstance(asked, list) else []
    good = [isinstance(pair, list) and list(map(type, pair)) == [int, dict] for pair in pairs]
    if not good or not all(good):
        raise SettingError("the page's corrections cannot be read; reload it.")
    return dict(pairs)


def _settings(asked: Mapping[str, Any], foot: Foot) -> dict[str, Any]:
    low, high = _STARTS
    starts = asked.get("starts", 4)
    if not isinstance(starts, int) or not low <= starts <= high:
        valid = f"{low} to {high}"
        raise SettingError(setting="starts", quantity="the number of starts", value=repr(starts), valid=valid)
    settings: dict[str, Any] = {"starts": starts}
    if asked.get("free") is not None:
        free = [name for name in asked["free"] if name in foot.parameters]
        if not free:
            raise SettingError("all parameters are held; tick at least one to estimate.", "free")
        settings["free"] = free
    bounds = {}
    for name, pair in dict(asked.get("bounds", {})).items():
        if name not in foot.parameters:
            continue
        try:
            least, most = (float(value) for value in pair)
        except (TypeError, ValueError):
            raise SettingError(f"the bounds of {name} are {pair!r}; give two numbers.", "bounds") from None
        if not least < most:
            text = f"the bounds of {name} are {least:g} and {most:g}; the first must be the smaller one."
            raise SettingError(text, "bounds")
        bounds[name] = (least, most)
    return settings | ({"bounds": bounds} if bounds else {})
