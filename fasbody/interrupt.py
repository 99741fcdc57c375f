"""Ctrl-C: raised once for each time it is pressed, never taken for a failure, and never a worker's business.

A terminal sends it to every process of a command, `timeout -s INT` twice. Compiled code that it meets makes a
SystemError of it, and a broad `except` of that a failed result. A worker that it meets dies with a lock in its hand.
"""

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from types import FrameType

#: Signals that come within this time were one key press [s].
_TOGETHER_S = 0.5
#: When Ctrl-C was pressed, on the monotonic clock; and how many blocks now want to end before they hear of it.
_pressed: list[float] = []
_holding = 0


def _press(number: int, frame: FrameType | None) -> None:
    again = bool(_pressed) and time.monotonic() - _pressed[-1] < _TOGETHER_S
    if not again:
        _pressed.append(time.monotonic())
        if not _holding:
            raise KeyboardInterrupt


@contextmanager
def once() -> Iterator[None]:
    """Count a doubled signal once; where Ctrl-C is ignored or handled already, nothing changes."""
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    try:
        signal.signal(signal.SIGINT, _press)
    except ValueError:  # signals are the main thread's, and this is another
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def heeded() -> Iterator[None]:
    """End the block with KeyboardInterrupt if Ctrl-C was pressed in it, whatever was made of that on the way."""
    with once():
        before = len(_pressed)
        try:
            yield
        except Exception:
            if len(_pressed) > before:
                raise KeyboardInterrupt from None
            raise
        if len(_pressed) > before:
            raise KeyboardInterrupt


@contextmanager
def held() -> Iterator[None]:
    """Ctrl-C comes when the block has ended; processes and threads started in it never see it."""
    global _holding
    with once():
        before, _holding = len(_pressed), _holding + 1
        try:
            with _deaf_children():
                yield
        finally:
            _holding -= 1
        if len(_pressed) > before:
            raise KeyboardInterrupt


@contextmanager
def _deaf_children() -> Iterator[None]:
    """Block the signal in this thread: its children inherit that. Another thread may still take it for this process."""
    if sys.platform == "win32":
        yield
        return
    resource_tracker.ensure_running()  # by multiprocessing; it would unblock the signal when it starts later
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
