"""A function generator with SCPI over a serial line, whose output ends up off in any case."""

import contextlib
import os
import subprocess
import sys
import time
from typing import Protocol, Self

from fasbody.acquire import guard as guards
from fasbody.acquire.guard import ALIVE, DONE, OFF
from fasbody.acquire.port import is_identity
from fasbody.acquire.visa import opened
from fasbody.console import console
from fasbody.exceptions import AcquisitionError

#: Longest wait for a reply [s].
_ANSWER_S = 1.0
#: And to the first query after *RST, which may take longer.
_RESET_S = 5.0
#: Interval of the driver's messages to the guard [s].
_BEAT_S = 0.2
#: Steps and length of the ramp down [s].
_RAMP_STEPS, _RAMP_S = 5, 0.2


class Refused(AcquisitionError):
    """The instrument reports an error."""


class Excitation(Protocol):
    """What a session needs of a generator; `Generator` documents each method.

    Attributes:
        latency_s: from a change of the output until the board's samples show it, beyond their time stamps.
    """

    identity: str
    volts: float
    is_on: bool
    latency_s: float

    def alive(self) -> None:
        """The base is watched."""

    def sine(self, frequency_hz: float, volts: float) -> None:
        """Set a sine."""

    def set_volts(self, volts: float) -> None:
        """Set the amplitude."""

    def on(self) -> None:
        """Switch the output on."""

    def ramp_down(self) -> None:
        """Fade, then switch off."""

    def off(self) -> None:
        """Switch it off at once."""


class Generator:
    """A sine generator with its output off unless this object is in use.

    Leaving the `with` block switches the output off, whatever the reason. A small second process does the same should
    this one be killed or stopped (guard.py): while the output is on, whoever watches the base must call `alive`.

    Args:
        name: port, or a VISA name.
        baud: its rate.
        guard: start the second process.

    Attributes:
        identity: maker, model and so on, by *IDN?.
        volts: amplitude [V peak to peak].
        is_on: whether the output is, or may be.

    Raises:
        AcquisitionError: no reply, or not that of an SCPI instrument.
    """

    latency_s = 0.0

    def __init__(self, name: str, baud: int, guard: bool = True) -> None:
        self.port = opened(name, baud)
        self.volts = 0.0
        self.is_on = False
        self.identity = ""
        self._guard: subprocess.Popen[bytes] | None = None
        self._beat = 0.0
        try:
            self.port.write(b"\n*CLS\n")
            identity = self.query("*IDN?")
            if not is_identity(identity):
                raise AcquisitionError(f"{name}: answers {identity[:40]!r} to *IDN?, as no SCPI generator does.")
            self.identity = identity
            if guard:
                self._guard = subprocess.Popen(
                    [sys.executable, "-m", "fasbody.acquire.guard", name, str(baud), str(self.port.fileno()),
                     f"{guards.SILENT_S:g}"],
                    stdin=subprocess.PIPE, bufsize=0, start_new_session=True,
                    pass_fds=[number for number in [self.port.fileno()] if number >= 0],
                )  # fmt: skip
                assert self._guard.stdin is not None
                os.set_blocking(self._guard.stdin.fileno(), False)
            self.off()
            self._reset()
        except BaseException as error:
            self.close(error)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self.close(error)

    def alive(self) -> None:
        """Report to the guard that the base is watched."""
        now = time.monotonic()
        if self.is_on and now - self._beat > _BEAT_S:
            self._beat = now
            self._tell_guard(ALIVE)

    def _tell_guard(self, word: bytes) -> None:
        if self._guard is None or self._guard.stdin is None:
            return
        try:
            if self._guard.poll() is not None:
                raise BrokenPipeError
            with contextlib.suppress(BlockingIOError):  # it has plenty to read
                self._guard.stdin.write(word)
        except OSError:
            raise AcquisitionError(
                "the guard that switches the output off after a crash has done so, or has died; start again."
            ) from None

    def query(self, command: str, patience: float | None = None) -> str:
        """Reply to a query, waited for so long [s], or as long as usual."""
        patience = _ANSWER_S if patience is None else patience
        self.port.read()  # a late reply to an earlier query is none to this
        answer, whole = self.port.ask(command.encode() + b"\n", patience)
        if not whole:
            raise AcquisitionError(
                f"{self.port.name}: no answer to {command} within {patience:g} s; is it an SCPI generator, switched "
                f"on, at {self.port.baud} baud?"
            )
        return answer

    def command(self, command: str, patience: float | None = None) -> None:
        """Send a command, and read the instrument's error queue; each reply is waited for so long [s].

        Raises:
            Refused: the instrument reports an error. AcquisitionError: it does not reply.
        """
        self.alive()
        self.port.write(command.encode() + b"\n")
        errors = []
        for _ in range(20):
            answer = self.query("SYST:ERR?", patience)
            if answer.lstrip("+").startswith("0"):
                break
            errors.append(answer)
        if errors:
            raise Refused(f"{self.identity}: {command} is refused ({'; '.join(errors)}).")

    def _reset(self) -> None:
        """Clear what an earlier user left: offset, burst, sweep, modulation."""
        cleared = False
        for command in ("*RST", "VOLT:OFFS 0"):
            with contextlib.suppress(Refused):
                self.command(command, _RESET_S)
                cleared = True
        if not cleared:
            console.print(
                f"{self.identity} knows neither *RST nor VOLT:OFFS: see that its offset is 0, and burst, sweep and "
                "modulation are off.", soft_wrap=True, markup=False,
            )  # fmt: skip
        self.off()  # some switch it on at a reset

    def sine(self, frequency_hz: float, volts: float) -> None:
        """Set a sine: frequency [Hz], amplitude [V peak to peak]; the output stays as it is."""
        self.command("FUNC SIN")
        self.command("VOLT:UNIT VPP")
        self.set_volts(volts)
        self.command(f"FREQ {frequency_hz:.6g}")

    def set_volts(self, volts: float) -> None:
        """Amplitude [V peak to peak]."""
        self.command(f"VOLT {volts:.6f}")
        self.volts = volts

    def on(self) -> None:
        """Switch the output on."""
        self.is_on = True  # before the command: if in doubt, it is on
        self._beat = 0.0
        self.command("OUTP ON")

    def ramp_down(self) -> None:
        """Lower the amplitude in steps, then switch off."""
        if self.is_on:
            start = self.volts
            for step in range(_RAMP_STEPS - 1, 0, -1):
                self.set_volts(start * step / _RAMP_STEPS)
                time.sleep(_RAMP_S / _RAMP_STEPS)
        self.off()

    def off(self) -> None:
        """Switch the output off at once, and check that it is."""
        for _ in range(3):
            with contextlib.suppress(AcquisitionError):
                self.port.write(b"\nOUTP OFF\n")
                if self.query("OUTP?").lstrip("+") in ("0", "OFF"):
                    self.is_on = False
                    with contextlib.suppress(AcquisitionError):
                        self._tell_guard(OFF)
                    return
        raise AcquisitionError(
            f"{self.port.name}: the generator does not confirm OUTP OFF; switch the amplifier off by hand.",
            code="output not confirmed off",
        )

    def close(self, reason: BaseException | None = None) -> None:
        """Output off, guard dismissed, port closed; what `reason` states already is not repeated."""
        try:
            if self.identity:  # otherwise nothing was ever sent to it
                self.off()
        except AcquisitionError as error:
            if getattr(reason, "code", "") != error.code:
                console.print(f"[bold red]{error}[/]", soft_wrap=True)
        finally:
            self.port.close()
            if self._guard is not None and self._guard.stdin is not None:
                with contextlib.suppress(OSError, AcquisitionError):
                    if not self.is_on:
                        self._tell_guard(DONE)
                with contextlib.suppress(OSError):
                    self._guard.stdin.close()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._guard.wait(60.0)  # it may still be starting on a busy computer
