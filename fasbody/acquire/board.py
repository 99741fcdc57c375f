"""A board in use: its messages as they come, the last seconds of its signals, and what is safe."""

import contextlib
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fasbody.acquire.capture import Capture
from fasbody.acquire.person import Meter
from fasbody.acquire.port import HELLO_S, WAIT_S, Opener, Port, Reader
from fasbody.acquire.timeline import Lateness, Timeline
from fasbody.acquire.wire import Block, Decoder, Hello, Message
from fasbody.exceptions import AcquisitionError
from fasbody.presentation import counted

#: How much of the signals is kept for the live view and the amplitude loop [s].
WINDOW_S = 2.0
#: So long without a sample means a stall [s]; noise, hellos and error texts are no samples.
STALLED_S = 3.0
#: So long without a sample ends the excitation [s]: nobody watches the base any more.
BLIND_S = 1.0
#: After a stall samples are of now when in this time [s] no more come than so many times what is taken in it; if much
#: fewer come, the computer itself stood still, and they are no measure.
_CALM_S, _HURRY = 0.5, 1.5
#: A board whose self-test fails has this in its name.
FAILED = "FAILED"


class Stalled(AcquisitionError):
    """No samples come, though the port is there; a repeated recording may succeed."""


@dataclass(frozen=True)
class Watch:
    """What the base must keep to while the shaker is on.

    Attributes:
        peak: it stays within so much either way [m/s^2].
        offset: of this [m/s^2].
        looked: called whenever it was seen to.
    """

    peak: float
    offset: float
    looked: Callable[[], None] | None = None

    def check(self, base: np.ndarray) -> None:
        """Raise AcquisitionError if it does not; base (n,) [m/s^2]."""
        highest = float(np.abs(base - self.offset).max())
        if not highest <= self.peak:
            raise AcquisitionError(
                f"the base reached {highest:.3g} m/s^2, beyond the safety limit of {self.peak:.3g}; output off."
            )


class Board:
    """An accelerometer board on a port.

    Args:
        name: port.
        baud: its rate.
        patience: how long to wait for a replug [s].
        opener: of the port, if it is no serial one.

    Attributes:
        reader: of the port.
        decoder: of its bytes.
        timeline: of the recording, while there is one.
        unplugs: how often the plug was pulled.
        watch: on the base, while the shaker is on.
        meter: of what the person gets meanwhile.
        doing: what for, in words.
        listener: called after each look at the port.

    Raises:
        AcquisitionError: the port cannot be opened.
    """

    def __init__(self, name: str, baud: int, patience: float = 15.0, opener: Opener = Port) -> None:
        self.reader = Reader(name, baud, patience, opener)
        self.decoder = Decoder()
        self.timeline: Timeline | None = None
        self.unplugs = 0
        self._away = False
        self.watch: Watch | None = None
        self.meter: Meter | None = None
        self.doing = ""
        self.listener: Callable[[Board], None] | None = None
        self._recent: deque[np.ndarray] = deque()
        self._kept = 0
        self._lateness = Lateness()
        self._since, self._older = 0.0, 0  # samples taken before this time of the host's clock are counted, not kept
        self._last = time.monotonic()  # of the last sample, or of the first hello
        self._bytes = 0  # that had come by then
        self._last_byte = self._last

    def wait_for_hello(self, seconds: float | None = None) -> Hello:
        """The board's description, waited for so long [s], or as long as usual.

        Raises:
            AcquisitionError: it sends no hello, lacks a channel, or its self-test fails.
        """
        deadline = time.monotonic() + (HELLO_S if seconds is None else seconds)
        self.reader.send(b"?\n")  # a query; boards that do not receive repeat their hello every second
        while self.decoder.hello is None:
            self.pump()
            if time.monotonic() > deadline and self.decoder.hello is None:
                why = "nothing came; is this the board's port"
                if self.decoder.bytes:
                    came = counted(self.decoder.bytes, "byte")
                    why = f"{came} came, but no hello; is {self.reader.baud} the board's baud rate"
                raise AcquisitionError(f"{self.reader.port_name}: {why}? (--probe tries them all)")
        hello = self.decoder.hello
        for role in ("base", "malleolus"):
            if hello.roles.count(role) != 1:
                raise AcquisitionError(f"{hello}: a recording needs one channel {role!r}; see docs/acquisition.md.")
        if FAILED in hello.board:
            raise AcquisitionError(f"{hello.board}: its own test fails; check wiring and supply of what it names.")
        return hello

    def pump(self, wait: float = WAIT_S) -> list[Message]:
        """Take what has arrived.

        Raises:
            Stalled: no sample has come for too long.
            AcquisitionError: the base is beyond its limit, or the port is gone.
        """
        messages: list[Message] = []
        looked = self.reader.looked  # before the bytes of that look are taken
        for arrival in self.reader.take(wait):
            if arrival.event:
                self.unplugs += arrival.event == "unplugged"
                self._away = arrival.event == "unplugged" or (self._away and arrival.event != "replugged")
                self.decoder.fresh()
                self._lateness.forget()
                if self.timeline is not None:
                    self.timeline.note(arrival.event)
                continue
            greeted = self.decoder.hello is not None
            self._last_byte = arrival.host
            decoded = self.decoder.feed(arrival.data)
            blocks = [message for message in decoded if isinstance(message, Block)]
            if blocks or (self.decoder.hello and not greeted):
                self._last, self._bytes = arrival.host, self.decoder.bytes
            if self.timeline is not None:
                self.timeline.add(decoded, arrival.host)
            messages += decoded
            for block in blocks:
                if arrival.host - self._lateness.of(block.time_us, arrival.host) >= self._since:
                    self._keep(block.samples)
                else:
                    self._older += len(block.samples)
        if self.watch is not None:
            self._look([message for message in messages if isinstance(message, Block)], self.watch)
        if self.listener is not None:
            self.listener(self)
        if self.watch is not None and time.monotonic() - self._last > BLIND_S:
            what = "unplugged" if self._away else f"no samples for {BLIND_S:g} s"
            raise Stalled(f"{self.reader.port_name}: {what} while the shaker was on; output off.")
        # Counted to the reader's last look, not to now: a busy computer is no silent board.
        stalled = self.decoder.hello is not None and looked - self._last > self.patience
        if self.reader.failure is None and stalled:
            came = self.decoder.bytes - self._bytes
            how = "is unplugged" if self._away else "is silent"
            # Not for the half of a frame after which it fell silent.
            if came and looked - self._last_byte < self.patience / 2:
                how = f"sent {counted(came, 'byte')} and no sample"
            raise Stalled(
                f"{self.reader.port_name}: the board {how} for {self.patience:g} s; check its supply and firmware."
            )
        return messages

    def _look(self, blocks: list[Block], watch: Watch) -> None:
        """Raise AcquisitionError if the base moves too far, or if a sensor is over range and so hides how far."""
        for block in blocks:
            if block.over.any() and self.decoder.hello is not None:
                roles = [role for role, count in zip(self.decoder.hello.roles, block.over, strict=False) if count]
                raise AcquisitionError(
                    f"{', '.join(roles) or 'a sensor'} went over range while the shaker was on; output off. Choose a "
                    "larger range on the board or a lower acceleration."
                )
            watch.check(block.samples[:, self.base])
            if self.meter is not None:
                self.meter.add(block.samples[:, self.base])
        if blocks and watch.looked is not None:
            watch.looked()

    def _keep(self, samples: np.ndarray) -> None:
        if self._recent and self._recent[-1].shape[1] != samples.shape[1]:
            self.forget()
        self._recent.append(samples)
        self._kept += len(samples)
        limit = WINDOW_S * (self.decoder.hello.rate_hz if self.decoder.hello else 1000.0)
        while self._kept - len(self._recent[0]) > limit:
            self._kept -= len(self._recent.popleft())

    def revive(self) -> None:
        """After a stall: wait for the next sample as long as for a replug, and until they come no faster than taken.

        What a board or a computer held back comes in a hurry and shows the base as it was.

        Raises:
            Stalled: none came, or they never calm down.
        """
        self.watch = None
        self._lateness.forget()  # what was lost without a word in the stall would count as lateness for minutes
        before = self._last
        deadline = time.monotonic() + self.reader.patience
        self.reader.send(b"?\n")
        while self._last == before:
            with contextlib.suppress(Stalled):
                self.pump(0.5)
            if time.monotonic() > deadline:
                raise Stalled(
                    f"{self.reader.port_name}: {'unplugged, and ' if self._away else ''}no sample came for another "
                    f"{self.reader.patience:g} s; switch the board off and on, check its supply and firmware."
                )
        assert self.decoder.hello is not None  # without it there are no samples
        taken = _CALM_S * self.decoder.hello.rate_hz
        self._since = 0.0
        while not self._calm(taken):
            if time.monotonic() > deadline:
                raise Stalled(
                    f"{self.reader.port_name}: samples come unevenly for {self.reader.patience:g} s after a stall, so "
                    "that nobody knows when they were taken; close other programs, check cable and supply."
                )
        self._lateness.forget()

    def _calm(self, taken: float) -> bool:
        """Whether in the next _CALM_S about as many samples come as are taken in it."""
        self.forget()
        with contextlib.suppress(Stalled):
            self.watch_for(_CALM_S)
        return taken / _HURRY <= self._kept <= _HURRY * taken

    @property
    def patience(self) -> float:
        """How long to wait for a sample [s]: longer once the board has been unplugged."""
        return STALLED_S if self.unplugs == 0 else STALLED_S + self.reader.patience

    @property
    def base(self) -> int:
        """Column of the base channel."""
        hello = self.decoder.hello
        if hello is None or "base" not in hello.roles:
            raise AcquisitionError(f"{self.reader.port_name}: the board no longer has a base channel.")
        return hello.roles.index("base")

    def recent(self) -> np.ndarray:
        """The last WINDOW_S of samples (n, channels) [m/s^2], gaps left out."""
        return np.concatenate(self._recent) if self._recent else np.zeros((0, 1))

    def forget(self) -> None:
        """Drop the samples kept so far."""
        self._recent.clear()
        self._kept = 0

    def collect(self, seconds: float) -> np.ndarray:
        """Wait for so many seconds of samples that were taken from now on; (n, channels) [m/s^2]. Below WINDOW_S.

        Raises:
            Stalled: they do not come.
            AcquisitionError: the board's time stamps do not advance, or what `pump` raises.
        """
        hello = self.decoder.hello
        assert hello is not None
        self._since, self._older = time.monotonic(), 0  # what comes late on a busy computer was taken before
        self.forget()
        count = round(seconds * hello.rate_hz)
        patience = 2 * seconds + STALLED_S
        deadline = time.monotonic() + patience
        while self._kept < count:
            self.pump()
            if self._lateness.still:
                raise AcquisitionError(f"{hello.board}: its time stamps do not advance; see docs/acquisition.md.")
            if time.monotonic() > deadline:
                silent = time.monotonic() - self._last
                if silent > BLIND_S:
                    raise Stalled(f"{hello.board}: stalled, no samples for {silent:.2g} s; check supply and firmware.")
                older = f" and {counted(self._older, 'older one')}" if self._older else ""
                raise Stalled(
                    f"{hello.board}: {counted(self._kept, 'sample')}{older} in {patience:g} s at {hello.rate_hz:g} Hz, "
                    "by its time stamps; is it late after a stall, or are they not as docs/acquisition.md says?"
                )
        return self.recent()[:count]

    def watch_for(self, seconds: float) -> None:
        """Let so many seconds pass, in which the base is watched."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self.pump()

    def start(self, capture: Capture) -> Timeline:
        """Begin a recording: every byte from now on into the capture file, every block onto a timeline."""
        hello = self.decoder.hello
        assert hello is not None
        self.reader.record(capture)
        self.reader.take(0.0)  # after record(): the capture then begins no later than the timeline
        self.decoder.fresh()
        self.timeline = Timeline(hello)
        return self.timeline

    def stop(self) -> None:
        """End the recording."""
        self.reader.record(None)
        self.timeline = None

    def close(self) -> None:
        """Close the port."""
        self.reader.close()
