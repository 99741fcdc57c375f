"""The protocol of section 2.2.2: for each frequency, bring the shaker to its level, record, check, and write."""

import contextlib
import platform
import signal
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from datetime import UTC, datetime
from types import FrameType
from typing import Any

from fasbody.acquire import folder, person
from fasbody.acquire.board import STALLED_S, Board, Stalled
from fasbody.acquire.capture import SUFFIX, Capture
from fasbody.acquire.folder import Converted, convert
from fasbody.acquire.generator import Excitation
from fasbody.acquire.level import Level, reach
from fasbody.acquire.monitor import Drive, Fault, Monitor
from fasbody.acquire.plan import Plan
from fasbody.console import console
from fasbody.exceptions import AcquisitionError, FasError


class Faulty(AcquisitionError):
    """What the sensors show is not what the drive predicts; a repeated recording may succeed."""


#: So many samples over range end a recording early.
_OVER_RANGE = 3
#: Signals that end a process, and one that stops it: Ctrl-Z would leave the shaker on and watch nothing.
_ENDING = (signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP)
#: These stop a process in the background that uses its terminal.
_IGNORED = (signal.SIGTTIN, signal.SIGTTOU)


@contextlib.contextmanager
def terminated() -> Iterator[None]:
    """Let every signal that ends or stops a process end what is inside like Ctrl-C, so that all outputs go off."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, stop) for number in _ENDING}
    before |= {number: signal.signal(number, signal.SIG_IGN) for number in _IGNORED}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class Session:
    """Records everything that is planned.

    Args:
        plan: what.
        board: from where.
        generator: the excitation, or None if it is set by hand.

    Attributes:
        made: what was written so far, failed attempts included.
    """

    def __init__(self, plan: Plan, board: Board, generator: Excitation | None = None) -> None:
        self.plan, self.board, self.generator = plan, board, generator
        self.made: list[Converted] = []
        self._listed = False
        self._volts_per = 0.0  # [V per m/s^2], of the latest level

    def run(self) -> list[Converted]:
        """Record; returns `made`.

        Raises:
            FasError: it cannot go on; what was recorded is in the study.
        """
        self.plan.check(self.generator is not None)
        folder.check_writable(self.plan.study)
        self._checklist()
        frequencies = self.plan.frequencies_hz
        for number, frequency in enumerate(frequencies):
            try:
                self._record_well(frequency)
                self._note_dose()
            except BaseException:
                left = [f for f in frequencies[number:] if f is not None]
                console.print(_go_on(left, self.plan.again), soft_wrap=True, markup=False)
                with contextlib.suppress(FasError):  # on a full disk, too, the reason is reported
                    self._note_dose()
                raise
        return self.made

    def _checklist(self) -> None:
        """Print and keep what whoever runs it confirms, once, if a person is to be shaken."""
        if self.generator is None or self._listed or self.plan.one_mass or self.plan.origin != "measured":
            return
        self._listed = True
        console.print("\n".join(f"[ ] {text}" for text in person.CHECKLIST), soft_wrap=True, markup=False)
        person.note(self.plan.study, checklist={"printed": person.today(), "items": person.CHECKLIST})

    def _note_dose(self) -> None:
        """Keep what the person had so far; the next level begins with it."""
        meter, self.board.meter = self.board.meter, None
        if meter is not None:
            person.keep(self.plan.study, self.plan.condition.subject, meter.dose)

    def unusable(self) -> list[str]:
        """Recordings that no attempt made usable, by their first file."""
        by_condition: dict[object, list[Converted]] = {}
        for one in self.made:
            by_condition.setdefault(one.recording.condition, []).append(one)
        return [ones[0].file.name for ones in by_condition.values() if all(one.problems for one in ones)]

    def _record_well(self, frequency: float | None) -> None:
        """One recording, repeated while the line loses samples, a sensor fails or the board stalls."""
        for left in reversed(range(self.plan.retries + 1)):
            try:
                self.board.wait_for_hello()
                one = self._attempt(frequency)
            except Faulty as fault:
                if not left:
                    raise
                console.print(f"{fault} This recording is repeated.", soft_wrap=True, markup=False)
                continue
            except Stalled as stall:
                if not left:
                    raise
                console.print(f"{stall} This recording is repeated as soon as samples come.", soft_wrap=True)
                self.board.revive()
                continue
            if not one.quality.gaps and not one.quality.faults:
                return
            if left:
                what = "samples were lost" if one.quality.gaps else "a sensor or the drive failed"
                console.print(f"{what}, so this recording is repeated")

    def _attempt(self, frequency: float | None) -> Converted:
        """Bring the base to its level and record; the output is off afterwards, whatever ends it."""
        level = None
        if self.generator is not None and frequency is not None:
            level = self._level(self.generator, frequency)
        name = "broadband" if frequency is None else f"{frequency:g}hz"
        stem = folder.free_stem(self.plan.study, f"{name}_{self.plan.condition.added_mass_kg:g}kg")
        capture = Capture(self.plan.study / folder.CAPTURES / f"{stem}{SUFFIX}")
        self.board.doing = f"{stem}: recording {self.plan.seconds:g} s"
        try:
            capture.add("M", time.monotonic(), self._about(frequency, level))
            self._record(capture, frequency, level)
            self.board.stop()
            if self.generator is not None:
                self.generator.ramp_down()
                self.board.watch = None
        except BaseException as error:
            self._off()
            self.board.stop()
            capture.close()
            self._keep(capture, str(error) if isinstance(error, AcquisitionError) else "interrupted")
            raise
        capture.close()
        try:
            one = convert(capture.file, self.plan.study)
        except BaseException:
            console.print(f"to try again: {folder.recovery([capture.file])}", soft_wrap=True, markup=False)
            raise
        self._tell(one)
        return one

    def _level(self, generator: Excitation, frequency: float) -> Level:
        self.board.doing = f"{frequency:g} Hz: finding the level"
        hello = self.board.decoder.hello
        if self.board.meter is None and hello is not None:
            before = person.dose_of(self.plan.study, self.plan.condition.subject)
            safety, rate_hz = self.plan.safety, hello.rate_hz
            self.board.meter = person.Meter(before, safety.daily_a8, rate_hz, safety.daily_vdv)
        target = self.plan.peak_to_peak
        try:
            level = reach(generator, self.board, frequency, target, self.plan.safety, self._volts_per * target)
            self.board.collect(max(0.1, self.plan.wait_s))
        except BaseException:
            self._off()
            raise
        self._volts_per = level.volts / level.peak_to_peak
        return level

    def _off(self) -> None:
        """At once; Generator.close() tries again, and reports it if that fails."""
        self.board.watch = None
        if self.generator is not None:
            with contextlib.suppress(AcquisitionError):
                self.generator.off()

    def _record(self, capture: Capture, frequency: float | None, level: Level | None) -> None:
        """Until the planned samples are there."""
        board, generator = self.board, self.generator
        timeline = board.start(capture)
        hello = timeline.hello
        pair = [hello.roles.index("base"), hello.roles.index("malleolus")]
        drive = Drive()  # what is set by hand is only about as stated
        if level is not None:
            drive = Drive(frequency, 0.5 * level.peak_to_peak, self.plan.one_mass)
        monitor = Monitor(hello.rate_hz, drive)
        planned = round(self.plan.seconds * timeline.hello.rate_hz)
        unplugs, judged = board.unplugs, 0
        latest = time.monotonic() + 1.01 * self.plan.seconds + STALLED_S + board.reader.patience
        while timeline.length < planned:
            board.pump()
            blocks = timeline.blocks(judged)
            judged += len(blocks)
            for start, samples in blocks:
                _refuse(monitor.add(start, samples[:, pair]), generator is not None)
            over = {role: count for role, count in timeline.over_range.items() if count >= _OVER_RANGE}
            if over:
                raise AcquisitionError(
                    f"{', '.join(over)} went over range after {timeline.length / timeline.hello.rate_hz:.3g} s; choose "
                    "a larger range on the board or a lower acceleration."
                )
            if generator is not None and generator.is_on and board.unplugs > unplugs:
                generator.off()  # nobody watches the base any more
                board.watch = None
            if time.monotonic() > latest:
                raise Stalled(
                    f"{board.reader.port_name}: {timeline.length} of {planned} samples came in time; check the board's "
                    "rate."
                )
            if capture.trouble:
                raise AcquisitionError(f"{capture.trouble}.")

    def _keep(self, capture: Capture, why: str) -> None:
        """Write what a broken-off recording has; its capture file stays in any case."""
        again = folder.recovery([capture.file])
        try:
            one = convert(capture.file, self.plan.study, stopped=why)
        except FasError as error:
            console.print(f"{error} To try again: {again}", soft_wrap=True, markup=False)
            return
        self._tell(one)
        if one.problems:
            console.print(f"to use it as it is: {again} --longest", soft_wrap=True, markup=False)

    def _tell(self, one: Converted) -> None:
        if self.plan.truth is not None:
            folder.enter_truth(self.plan.study, self.plan.truth)
        self.made.append(one)
        console.print(str(one), soft_wrap=True, markup=False)

    def _about(self, frequency: float | None, level: Level | None) -> dict[str, Any]:
        """The first record of a capture: all that a recovery needs."""
        reader = self.board.reader
        return {
            "format": "fasbody capture 1",
            "started_utc": datetime.now(UTC).isoformat(timespec="milliseconds"),
            "condition": asdict(replace(self.plan.condition, frequency_hz=frequency)),
            "seconds": self.plan.seconds,
            "origin": self.plan.origin,
            "preamble": self.board.decoder.preamble.hex(),
            "port": reader.port_name,
            "baud": reader.baud,
            "computer": platform.platform(),
            "generator": None if self.generator is None else self.generator.identity,
            "wanted_peak_to_peak_m_s2": self.plan.peak_to_peak if level else None,
            "level": asdict(level) if level else None,
            "one_mass": self.plan.one_mass,
        }


def _refuse(faults: list[Fault], excited: bool) -> None:
    """Raise Faulty for a fault of the sensors; AcquisitionError where the base's has failed, which ends the session."""
    if faults:
        kind = AcquisitionError if any(fault.rule.final for fault in faults) else Faulty
        raise kind(f"{faults[0]}{'; output off' if excited else ''}.")


def _go_on(left: list[float], again: str) -> str:
    """How to record what a session could not, into the same study."""
    if again:
        return f"not recorded: this step and what follows it; go on with {again} and the same --out"
    if not left:
        return "the same command records it anew"
    option = f"--frequency {left[0]:g}"
    if len(left) > 1:
        option = f"--sweep {left[0]:g}:{left[-1]:g}:{left[1] - left[0]:g}"
    return f"not recorded: {', '.join(f'{f:g}' for f in left)} Hz; go on with {option} and the same --out"
