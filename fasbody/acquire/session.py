"""The protocol of section 2.2.2: for each frequency, bring the shaker to its level, record, judge, and write."""

import contextlib
import math
import platform
import time
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fasbody.acquire import folder
from fasbody.acquire.board import STALLED_S, Board
from fasbody.acquire.capture import SUFFIX, Capture
from fasbody.acquire.folder import Converted, convert
from fasbody.acquire.generator import Generator
from fasbody.acquire.level import Level, Safety, reach
from fasbody.acquire.quality import Limits
from fasbody.console import console
from fasbody.exceptions import AcquisitionError, FasError, SettingError
from fasbody.recording import Condition
from fasbody.shaker import PEAK_TO_PEAK

#: So many samples over range end a recording early.
_OVER_RANGE = 3


@dataclass(frozen=True)
class Plan:
    """What to record.

    Attributes:
        study: folder. frequencies_hz: one recording each; (None,) for broadband or unknown excitation.
        condition: of all recordings; its frequency is set for each. seconds: length of each recording.
        peak_to_peak: wanted base acceleration [m/s^2]. settle_s: wait at the level before recording.
        retries: so often is a recording repeated that lost samples. origin: "measured" or "synthetic".
        safety, limits: of the excitation and of the recordings.
    """

    study: Path
    frequencies_hz: tuple[float | None, ...]
    condition: Condition
    seconds: float = 10.0
    peak_to_peak: float = PEAK_TO_PEAK
    settle_s: float = 0.5
    retries: int = 2
    origin: str = "measured"
    safety: Safety = field(default_factory=Safety)
    limits: Limits = field(default_factory=Limits)

    def check(self, generator: bool) -> None:
        """Refuse what cannot be meant, before anything moves.

        Raises:
            SettingError: which option, and what would be valid. InputFileError: the study is of another origin.
        """
        if not 0.1 <= self.seconds <= 3600:
            raise SettingError(f"a recording of {self.seconds:g} s cannot be meant (valid: 0.1 to 3600).")
        if not 0 < self.peak_to_peak < math.inf:
            raise SettingError(f"the base acceleration is {self.peak_to_peak:g} m/s^2; it must be positive.")
        if not 0 <= self.condition.added_mass_kg <= 100:
            raise SettingError(f"the added mass is {self.condition.added_mass_kg:g} kg (valid: 0 to 100).")
        for frequency in self.frequencies_hz:
            if frequency is None:
                if generator:
                    raise SettingError("the generator needs a frequency: give --frequency or --sweep.")
                continue
            if not 3 <= frequency <= 500:
                raise SettingError(f"{frequency:g} Hz is no excitation for a foot (valid: 3 to 500).")
            if self.seconds * frequency < self.limits.periods:
                raise SettingError(f"{self.seconds:g} s hold fewer than 3 periods of {frequency:g} Hz; record longer.")
            if generator:
                self.safety.check(frequency, self.peak_to_peak)
        folder.check_origin(self.study, self.origin)
        folder.check_mass(self.study, self.condition)


def run(plan: Plan, board: Board, generator: Generator | None = None) -> list[Converted]:
    """Record everything that is planned.

    Args:
        plan: what. board: from where. generator: the excitation, or None if it is set by hand.

    Returns:
        One entry a recording, failed attempts included.

    Raises:
        AcquisitionError, SettingError, InputFileError: the session cannot go on; what was recorded is in the study.
    """
    plan.check(generator is not None)
    folder.check_writable(plan.study)
    made: list[Converted] = []
    volts_per: float = 0.0
    for frequency in plan.frequencies_hz:
        for attempt in range(plan.retries + 1):
            board.wait_for_hello()
            level = None
            if generator is not None and frequency is not None:
                board.doing = f"{frequency:g} Hz: finding the level"
                guess = volts_per * plan.peak_to_peak
                level = reach(generator, board, frequency, plan.peak_to_peak, plan.safety, guess)
                volts_per = level.volts / level.peak_to_peak
                board.collect(max(0.1, plan.settle_s))
            one = _trial(plan, board, generator, frequency, level)
            made.append(one)
            console.print(str(one), soft_wrap=True)
            if not one.quality.gaps:
                break
            if attempt < plan.retries:
                console.print("samples were lost, so this recording is repeated")
    return made


def unusable(made: list[Converted]) -> list[str]:
    """Recordings of a session that no attempt made usable, by their first file."""
    by_condition: dict[object, list[Converted]] = {}
    for one in made:
        by_condition.setdefault(one.recording.condition, []).append(one)
    return [ones[0].file.name for ones in by_condition.values() if all(one.problems for one in ones)]


def _trial(
    plan: Plan, board: Board, generator: Generator | None, frequency: float | None, level: Level | None
) -> Converted:
    """One recording; whatever ends it, the output goes off first and what came is written then."""
    name = "broadband" if frequency is None else f"{frequency:g}hz"
    stem = folder.free_stem(plan.study, f"{name}_{plan.condition.added_mass_kg:g}kg")
    capture = Capture(plan.study / folder.CAPTURES / f"{stem}{SUFFIX}")
    board.doing = f"{stem}: recording {plan.seconds:g} s"
    try:
        capture.add("M", time.monotonic(), _about(plan, board, generator, frequency, level))
        _record(plan, board, generator, capture)
    except BaseException as error:
        if generator is not None:
            with contextlib.suppress(AcquisitionError):  # close() tries again, and says so
                generator.off()
        _finish(board, capture)
        _keep(plan, capture, str(error) if isinstance(error, AcquisitionError) else "interrupted")
        raise
    _finish(board, capture)
    if generator is not None:
        try:
            generator.ramp_down()
        except BaseException:
            with contextlib.suppress(AcquisitionError):  # at once, before the conversion
                generator.off()
            _keep(plan, capture, "")
            raise
        board.watch = None
    return convert(capture.files, plan.study, plan.limits)


def _record(plan: Plan, board: Board, generator: Generator | None, capture: Capture) -> None:
    """Until the planned samples are there.

    Raises:
        AcquisitionError: over range, a full disk, the board is gone, or too slow.
    """
    timeline = board.start(capture)
    wanted = round(plan.seconds * timeline.hello.rate_hz)
    unplugs = board.unplugs
    latest = time.monotonic() + 1.01 * plan.seconds + STALLED_S + board.reader.patience
    while timeline.length < wanted:
        board.pump()
        over = {role: count for role, count in timeline.over_range.items() if count >= _OVER_RANGE}
        if over:
            raise AcquisitionError(
                f"{', '.join(over)} went over range after {timeline.length / timeline.hello.rate_hz:.3g} s; choose a "
                "larger range on the board or a lower acceleration."
            )
        if generator is not None and generator.is_on and board.unplugs > unplugs:
            generator.off()  # nobody watches the base any more
            board.watch = None
        if time.monotonic() > latest:
            raise AcquisitionError(
                f"{board.reader.port_name}: {timeline.length} of {wanted} samples came in time; check the board's rate."
            )
        if capture.trouble:
            raise AcquisitionError(f"{capture.trouble}.")


def _finish(board: Board, capture: Capture) -> None:
    board.stop()
    capture.close()


def _keep(plan: Plan, capture: Capture, why: str) -> None:
    """Write what a broken-off recording has; its capture file stays in any case."""
    try:
        console.print(str(convert(capture.files, plan.study, plan.limits, stopped=why)), soft_wrap=True)
    except FasError as error:
        names = " ".join(str(file) for file in capture.files)
        text = f"not converted ({error}) What was received: python -m fasbody.acquire recover {names}"
        console.print(text, soft_wrap=True, markup=False)


def _about(
    plan: Plan, board: Board, generator: Generator | None, frequency: float | None, level: Level | None
) -> dict[str, Any]:
    """The first record of a capture: all that a recovery needs."""
    return {
        "format": "fasbody capture 1",
        "started_utc": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "condition": asdict(replace(plan.condition, frequency_hz=frequency)),
        "seconds": plan.seconds,
        "origin": plan.origin,
        "preamble": board.decoder.preamble.hex(),
        "port": board.reader.port_name,
        "baud": board.reader.baud,
        "computer": platform.platform(),
        "generator": None if generator is None else generator.identity,
        "wanted_peak_to_peak_m_s2": plan.peak_to_peak if level else None,
        "level": asdict(level) if level else None,
    }
