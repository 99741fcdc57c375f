"""An SCPI instrument made of a thread: the bench's own, with the habits that real ones have."""

import select
from pathlib import Path

from device import Device

from fasbody.acquire.bench import Shaker


class Instrument(Device):
    """Answers on a pseudo-terminal; `answers` replace what the bench's generator says, `unknown` are refused."""

    def __init__(self, folder: Path, answers: dict[str, str] | None = None, unknown: tuple[str, ...] = ()) -> None:
        super().__init__(folder / "instrument")
        self.shaker = Shaker()
        self.answers, self.unknown = answers or {}, unknown
        self.heard: list[str] = []

    def serve(self) -> None:
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
