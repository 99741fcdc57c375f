"""The virtual generator: state, commands and replies of an SCPI instrument."""

from collections import deque
from typing import Any, ClassVar


class VirtualGenerator:
    """State of the instrument. `do` takes one command and returns the reply to a query.

    Attributes:
        values: of each setting, in Hz and V.
        on: whether the output is.
        errors: its queue, oldest first.
    """

    LIMITS: ClassVar = {"FREQ": (1e-3, 1e6), "VOLT": (0.0, 20.0), "VOLT:OFFS": (-10.0, 10.0)}

    def __init__(self) -> None:
        self.errors: deque[str] = deque(maxlen=20)
        self._reset()

    def _reset(self) -> None:
        self.values = {"FREQ": 1000.0, "VOLT": 0.1, "VOLT:OFFS": 0.0}
        self.on = False

    def do(self, command: str) -> str | None:
        """Execute one line."""
        head, _, value = command.upper().partition(" ")
        if head.endswith("?"):
            return self._answer(head[:-1])
        if head in self.LIMITS:
            self._set(head, value)
        elif head == "OUTP" and value in ("ON", "1", "OFF", "0"):
            self.on = value in ("ON", "1")
        elif head == "*CLS":
            self.errors.clear()
        elif head == "*RST":
            self._reset()
        elif command and (head, value) not in (("FUNC", "SIN"), ("VOLT:UNIT", "VPP")):
            self.errors.append('-113,"Undefined header"')
        return None

    def _set(self, head: str, value: str) -> None:
        low, high = self.LIMITS[head]
        try:
            number = float(value)
        except ValueError:
            self.errors.append('-104,"Data type error"')
            return
        if low <= number <= high:
            self.values[head] = number
        else:
            self.errors.append('-222,"Data out of range"')

    def _answer(self, head: str) -> str | None:
        if head == "*IDN":
            return "FAS,virtual generator,0,1"
        if head == "SYST:ERR":
            return self.errors.popleft() if self.errors else '0,"No error"'
        if head == "OUTP":
            return "1" if self.on else "0"
        if head in self.values:
            return f"{self.values[head]:g}"
        self.errors.append('-113,"Undefined header"')
        return None

    def output(self) -> dict[str, Any]:
        """What comes out: amplitude [V peak to peak] and frequency."""
        return {"frequency_hz": self.values["FREQ"], "volts": self.values["VOLT"] if self.on else 0.0}
