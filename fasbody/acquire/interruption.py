"""Signals that end or stop a process, made to end the session like Ctrl-C, so that every output is switched off."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

#: SIGTSTP is Ctrl-Z: a stopped process would leave the shaker on and watch nothing.
_ENDING = (signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP)
#: These stop a process in the background that uses its terminal.
_IGNORED = (signal.SIGTTIN, signal.SIGTTOU)


@contextmanager
def terminated() -> Iterator[None]:
    """Let these signals end what is inside like Ctrl-C."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, stop) for number in _ENDING}
    before |= {number: signal.signal(number, signal.SIG_IGN) for number in _IGNORED}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
