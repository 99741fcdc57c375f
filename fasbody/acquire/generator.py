"""A function generator that speaks SCPI over a serial line, and the certainty that its output ends up off."""

import contextlib
import subprocess
import sys
import time
from types import TracebackType

from fasbody.acquire.port import Port
from fasbody.acquire.probe import is_identity
from fasbody.console import console
from fasbody.exceptions import AcquisitionError

#: Longest wait for an answer [s].
_ANSWER_S = 1.0
_LONGEST_ANSWER = 4096
#: Steps and length of the ramp down [s].
_RAMP_STEPS, _RAMP_S = 5, 0.2


class Generator:
    """A sine generator with its output off unless this object is in use.

    Leaving the `with` block switches the output off, whatever the reason. A small second process does the same should
    this one be killed (guard.py).

    Args:
        name: port. baud: its rate. guard: start the second process.

    Raises:
        AcquisitionError: nothing answers, or not as an SCPI instrument.
    """

    def __init__(self, name: str, baud: int, guard: bool = True) -> None:
        self.port = Port(name, baud)
        self.volts = 0.0
        self.frequency_hz = 0.0
        self.is_on = False
        self.identity = ""
        self._guard: subprocess.Popen[bytes] | None = None
        try:
            self.port.write(b"\n*CLS\n")
            identity = self.query("*IDN?")
            if not is_identity(identity):
                raise AcquisitionError(f"{name}: answers {identity[:40]!r} to *IDN?, as no SCPI generator does.")
            self.identity = identity
            if guard:
                self._guard = subprocess.Popen(
                    [sys.executable, "-m", "fasbody.acquire.guard", name, str(baud)],
                    stdin=subprocess.PIPE, start_new_session=True,
                )  # fmt: skip
            self.off()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "Generator":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def query(self, command: str) -> str:
        """Answer to a query.

        Raises:
            AcquisitionError: no answer.
        """
        self.port.read()  # a late answer to something earlier is none to this
        self.port.write(command.encode() + b"\n")
        answer, deadline = b"", time.monotonic() + _ANSWER_S
        while b"\n" not in answer and len(answer) < _LONGEST_ANSWER:
            if time.monotonic() > deadline:
                raise AcquisitionError(
                    f"{self.port.name}: no answer to {command} within {_ANSWER_S:g} s; is it an SCPI generator, "
                    f"switched on, at {self.port.baud} baud?"
                )
            answer += self.port.read()
        return answer.split(b"\n")[0].strip().decode("ascii", "replace")

    def command(self, command: str) -> None:
        """Send a command, and read the instrument's error queue.

        Raises:
            AcquisitionError: the instrument reports an error.
        """
        self.port.write(command.encode() + b"\n")
        errors = []
        for _ in range(20):
            answer = self.query("SYST:ERR?")
            if answer.lstrip("+").startswith("0"):
                break
            errors.append(answer)
        if errors:
            raise AcquisitionError(f"{self.identity}: {command} is refused ({'; '.join(errors)}).")

    def sine(self, frequency_hz: float, volts: float) -> None:
        """Set a sine: frequency [Hz], amplitude [V peak to peak]; the output stays as it is."""
        self.command("FUNC SIN")
        self.command("VOLT:UNIT VPP")
        self.set_volts(volts)
        self.command(f"FREQ {frequency_hz:.6g}")
        self.frequency_hz = frequency_hz

    def set_volts(self, volts: float) -> None:
        """Amplitude [V peak to peak]."""
        self.command(f"VOLT {volts:.6f}")
        self.volts = volts

    def on(self) -> None:
        """Switch the output on.

        Raises:
            AcquisitionError: the instrument refuses, or the guard has died.
        """
        if self._guard is not None and self._guard.poll() is not None:
            raise AcquisitionError("the guard that would switch the output off after a crash has died; start again.")
        self.is_on = True  # before the command: if in doubt, it is on
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
        """Switch the output off at once, and see that it is.

        Raises:
            AcquisitionError: it cannot be switched off from here.
        """
        for _ in range(3):
            with contextlib.suppress(AcquisitionError):
                self.port.write(b"\nOUTP OFF\n")
                if self.query("OUTP?") in ("0", "OFF"):
                    self.is_on = False
                    return
        raise AcquisitionError(
            f"{self.port.name}: the generator does not confirm OUTP OFF; switch the amplifier off by hand."
        )

    def close(self) -> None:
        """Output off, guard dismissed, port closed."""
        try:
            if self.identity:  # otherwise nothing was ever told to it
                self.off()
        except AcquisitionError as error:
            console.print(f"[bold red]{error}[/]", soft_wrap=True)
        finally:
            self.port.close()
            if self._guard is not None and self._guard.stdin is not None:
                with contextlib.suppress(OSError):
                    if not self.is_on:
                        self._guard.stdin.write(b"done\n")
                    self._guard.stdin.close()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._guard.wait(10.0)
