"""`python -m fasbody.acquire.guard PORT BAUD FILE SILENT`: switches a generator off whose driver is gone.

The driver is the process that has the generator in use; a pipe from it is our standard input. If that closes without
the word that all is done, the driver was killed, and no `finally` of its own could run. If nothing is said for SILENT
seconds while the output is on, the driver is stopped or hangs; a computer that stood still as a whole, this process
with it, is not silent. FILE is the number of the driver's open port, inherited: a driver that still lives does not let
it be opened. A VISA instrument has none (-1) and is opened anew.
"""

import os
import select
import sys
import time

from fasbody.acquire.visa import opened
from fasbody.exceptions import AcquisitionError

#: Messages of the driver: the output is on and the base is watched; it is off; it is off for good.
ALIVE, OFF, DONE = b"+", b"-", b"."
#: Longest silence while the output is on [s].
SILENT_S = 3.0
#: It is waited for in so many intervals: a standstill of the computer ends only one of them.
_LOOKS = 30
_TRIES = 50
_COMMAND = b"\nOUTP OFF\n"


def main() -> None:
    """Wait for the end or the silence of the driver, then act."""
    name, baud, file, silent_s = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
    word, silent = OFF, False
    while word != DONE:
        if not _message_within(silent_s if word == ALIVE else None):
            silent = True
            break
        data = os.read(0, 4096)
        if not data:
            break
        word = data[-1:]
    else:
        return
    for _ in range(_TRIES):
        if _sent(file, name, baud):
            if silent:
                _say(f"{name}: nobody has watched the base for {silent_s:g} s; output off.")
            return
        time.sleep(0.1)
    _say(f"{name}: cannot be switched off; switch the amplifier off by hand.")


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _message_within(silent_s: float | None) -> bool:
    """Whether a message of the driver, or its end, comes within so long [s]; None waits for ever."""
    wait_s = None if silent_s is None else silent_s / _LOOKS
    return any(select.select([0], [], [], wait_s)[0] for _ in range(_LOOKS))


def _sent(file: int, name: str, baud: int) -> bool:
    """Whether the command was sent, through the driver's port or, if that is gone, through a new one."""
    try:
        return os.write(file, _COMMAND) == len(_COMMAND)
    except OSError:
        pass
    try:
        port = opened(name, baud)
        port.write(_COMMAND)
        port.close()
    except AcquisitionError:
        return False
    return True


if __name__ == "__main__":
    main()
