"""The recordings of a session, as the page's table lists them: what the checks say of each, and its corrections."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.exceptions import FasError, SettingError
from fasbody.recording.checks import judged, unit_in_doubt
from fasbody.recording.recording import Recording
from fasbody.sentences import for_page
from viz.source import Source

Row = dict[str, Any]
_JUDGED = ("problem", "warnings", "frequency_hz", "samples", "rate_hz", "seconds")


class Recordings:
    """Recordings by ids that are not used again in a session.

    Args:
        folders: that are left out before the name of a file.

    Attributes:
        sources: files with their corrections, by id.
        rows: of the page's table, by id.
    """

    def __init__(self, folders: tuple[str, ...]) -> None:
        self._folders = folders
        self.sources: dict[int, Source] = {}
        self.rows: dict[int, Row] = {}
        self._warnings: dict[int, list[str]] = {}  # of the checks, with their codes
        self._latest: tuple[Source, Recording] | None = None  # read last, so that a long file is read once
        self._next_id = 0
        self.forget_corrections()

    def add(self, source: Source, *, new: bool = False) -> int:
        """Read a file; one that is dropped again keeps its id and its corrections, unless it is `new`."""
        known = [n for n, s in self.sources.items() if (s.folder, s.file) == (source.folder, source.file)]
        number = known[0] if known and not new else self._next_id
        self.put(number, self.sources.get(number, source))
        return number

    def put(self, number: int, source: Source) -> None:
        """Read a file under an id."""
        self._next_id = max(self._next_id, number + 1)
        before, row = self.sources.get(number), self.rows.get(number)
        self.sources[number] = source
        masses = {key: getattr(source, key) for key in ("body_mass_kg", "added_mass_kg")}
        if row and before and source.weighed and not row["unread"] and replace(before, **masses) == source:
            self.rows[number] = row | masses
        else:
            self.rows[number] = self._row(number)

    def _row(self, number: int) -> Row:
        """The sentences of the checks, and the entries of the form."""
        source = self.sources[number]
        row: Row = {"id": number, "file": source.file, "unread": "", "problem": "", "doubt": "", "warnings": []}
        row |= {"unit": source.unit, "start_s": source.start_s, "end_s": source.end_s}
        row |= {"body_mass_kg": source.body_mass_kg, "added_mass_kg": source.added_mass_kg}
        try:
            recording = source.read()
            self._latest = source, recording
        except FasError as error:
            return row | {"unread": for_page(error.reason)}
        judgement, condition = judged(recording), recording.condition
        texts = [judgement["warnings"]]
        self._warnings[number] = judgement["warnings"]
        return row | {key: judgement.get(key) for key in _JUDGED} | {
            "problem": for_page(judgement["problem"]), "warnings": list(map(for_page, judgement["warnings"])),
            "doubt": for_page(unit_in_doubt(texts, stated=bool(source.unit))),
            "believed": not unit_in_doubt(texts, stated=True),  # if a person says that the unit is right
            "label": recording.file, "origin": recording.origin, "subject": condition.subject,
            "unit": source.unit or _unit_of(recording),
            "body_mass_kg": condition.body_mass_kg, "added_mass_kg": condition.added_mass_kg,
        }  # fmt: skip

    def doubt(self, numbers: Iterable[int]) -> str:
        """The checks' doubt about the units of some recordings, in a sentence; empty where there is none."""
        return for_page(unit_in_doubt(self._warnings[number] for number in numbers if number in self._warnings))

    def correct(self, changes: Mapping[int, Mapping[str, Any]]) -> set[int]:
        """Read recordings with corrections; where one correction is invalid, none is applied. The ids.

        Raises:
            SettingError, RecordingError, InputFileError: see `Source.corrected`.
        """
        changed = {number: self.corrected(number, fields) for number, fields in changes.items()}
        self._undone.clear()
        self._done.append(self._put_all(changed))
        return set(changed)

    def undo(self, again: bool) -> set[int]:
        """Take back the last corrections, or make those `again` that were taken back last. The ids.

        Raises:
            SettingError: there are none.
        """
        past, future = (self._undone, self._done) if again else (self._done, self._undone)
        if not past:
            raise SettingError(f"there is nothing to {'redo' if again else 'undo'}.")
        changed = past.pop()
        future.append(self._put_all(changed))
        return set(changed) & set(self.sources)

    @property
    def steps(self) -> tuple[int, int]:
        """How many corrections can be taken back, and made again."""
        return len(self._done), len(self._undone)

    def forget_corrections(self) -> None:
        """Nothing is to be undone."""
        self._done: list[dict[int, Source]] = []
        self._undone: list[dict[int, Source]] = []

    def _put_all(self, sources: Mapping[int, Source]) -> dict[int, Source]:
        """Read recordings that are still listed; what they were before."""
        before = {number: self.sources[number] for number in sources if number in self.sources}
        for number in before:
            self.put(number, sources[number])
        return before

    def corrected(self, number: int, fields: Mapping[str, Any]) -> Source:
        """A source with corrections; masses that its study stated stay when its channels are corrected.

        Raises:
            SettingError, RecordingError, InputFileError: see `Source.corrected`.
        """
        source, row = self.source(number), self.rows[number]
        masses = {key: row[key] for key in ("body_mass_kg", "added_mass_kg") if row.get("subject")}
        return source.corrected(masses | dict(fields))

    def read(self, number: int) -> Recording:
        """A recording that can drive the table.

        Raises:
            SettingError: it is no longer here, or a channel of it stands still.
        """
        source = self.source(number)
        recording = self._latest[1] if self._latest and self._latest[0] is source else source.read()
        for name in ("base_m_s2", "malleolus_m_s2"):
            values = recording.channels[name]
            if not (np.isfinite(values).all() and np.ptp(values) > 0):
                channel = name.removesuffix("_m_s2")
                raise SettingError(
                    file=recording.file,
                    setting=f"channels.{channel}.column",
                    problem=f"the channel {channel} does not move",
                    remedy="name its column with “…”",
                )
        return recording

    def source(self, number: int) -> Source:
        """A recording's file with its corrections.

        Raises:
            SettingError: it is no longer here.
        """
        if number not in self.sources:
            raise SettingError("that recording is no longer here; reload the page.")
        return self.sources[number]

    def forget(self, number: int, folder: Path, needed: set[Path]) -> None:
        """Forget a recording; its file in the session's folder goes unless a fit needs it for its report."""
        source = self.source(number)
        for held in (self.sources, self.rows, self._warnings):
            held.pop(number, None)
        if source.folder == str(folder) and source.path not in needed:
            source.path.unlink(missing_ok=True)

    def first(self, numbers: Iterable[int]) -> int:
        """The first that can be fitted, in the unit that it seems to be in; -1 where none can."""
        return next((number for number in numbers if is_sound(self.rows[number])), -1)


def is_sound(row: Mapping[str, Any]) -> bool:
    """Whether a recording can be fitted, and is in the unit that it seems to be in."""
    return not (row["unread"] or row["problem"] or row["doubt"])


def _unit_of(recording: Recording) -> str:
    """The unit of the base in its file, as the recording's source states it."""
    made = next((text for text in recording.used if text.startswith("base:")), "")
    return made.partition(", its times")[0].rpartition(" in ")[2].replace("_s2", "/s^2")
