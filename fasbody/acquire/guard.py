"""`python -m fasbody.acquire.guard PORT BAUD`: switches the generator off if the process that drives it dies.

Its standard input is a pipe from that process. If it closes without the word "done", the driver was killed, and no
`finally` of its own could run.
"""

import sys
import time

from fasbody.acquire.port import Port
from fasbody.exceptions import AcquisitionError

_TRIES = 50


def main() -> None:
    """Wait for the end of the driver, then act."""
    name, baud = sys.argv[1], int(sys.argv[2])
    if b"done" in sys.stdin.buffer.read():
        return
    for _ in range(_TRIES):
        try:
            port = Port(name, baud)
            port.write(b"\nOUTP OFF\n")
            port.close()
            return
        except AcquisitionError:
            time.sleep(0.1)


if __name__ == "__main__":
    main()
