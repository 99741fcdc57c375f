"""An SCPI instrument made of a thread: the bench's own, with the habits that real ones have."""

import select
import threading
from pathlib import Path
from types import TracebackType

from fasbody.acquire.line import Line
from fasbody.acquire.shaken import Shaker


class Instrument:
    """Answers on a pseudo-terminal; `answers` replace what the bench's generator says, `unknown` are refused."""

    def __init__(self, folder: Path, answers: dict[str, str] | None = None, unknown: tuple[str, ...] = ()) -> None:
        self.line = Line(folder / "instrument")
        self.port = str(self.line.link)
        self.shaker = Shaker()
        self.answers, self.unknown = answers or {}, unknown
        self.heard: list[str] = []
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "Instrument":
        self.line.plug()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end.set()
        self._thread.join(5)
        self.line.unplug()

    def _run(self) -> None:
        rest = b""
        while not self._end.is_set():
            select.select([self.line.master], [], [], 0.05)
            *lines, rest = (rest + self.line.receive()).split(b"\n")
            for line in lines:
                text = line.decode().strip()
                if not text:
                    continue
                self.heard.append(text)
                if text.partition(" ")[0] in self.unknown:
                    self.shaker.errors.append('-113,"Undefined header"')
                    continue
                answer = self.answers.get(text, self.shaker.do(text))
                if answer is not None:
                    self.line.send(answer.encode() + b"\r\n")
