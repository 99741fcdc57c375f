"""`python -m fasbody.acquire.guard PORT BAUD FILE`: switches the generator off if the process that drives it is gone.

Its standard input is a pipe from that process. If it closes without the word that all is done, the driver was killed,
and no `finally` of its own could run. If it says nothing for SILENT_S while the output is on, the driver is stopped or
hangs. FILE is the number of the driver's open port, inherited: a driver that still lives does not let it be opened. A
VISA instrument has none (-1) and is opened anew.
"""

import os
import select
import sys
import time

from fasbody.acquire.visa import opened
from fasbody.exceptions import AcquisitionError

#: What the driver says: the output is on and the base is watched; it is off; it is off for good.
ALIVE, OFF, DONE = b"+", b"-", b"."
#: Longest silence while the output is on [s].
SILENT_S = 3.0
_TRIES = 50
_COMMAND = b"\nOUTP OFF\n"


def main() -> None:
    """Wait for the end or the silence of the driver, then act."""
    name, baud, file = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    word = OFF
    while word != DONE:
        if not select.select([0], [], [], SILENT_S if word == ALIVE else None)[0]:
            print(f"{name}: nobody has watched the base for {SILENT_S:g} s; output off.", file=sys.stderr, flush=True)
            break
        said = os.read(0, 4096)
        if not said:
            break
        word = said[-1:]
    else:
        return
    for _ in range(_TRIES):
        if _told(file, name, baud):
            return
        time.sleep(0.1)


def _told(file: int, name: str, baud: int) -> bool:
    """Whether the command went out, through the driver's port or, if that is gone, through one of our own."""
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
