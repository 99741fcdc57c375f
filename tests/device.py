"""What every device made of a thread is: a pseudo-terminal that it serves while the test is inside its `with`."""

import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from fasbody.acquire.bench import Line


class Device:
    """Plugs its line and runs `serve` in a thread; `port` is the name to open."""

    def __init__(self, link: Path) -> None:
        self.line = Line(link)
        self.port = str(link)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self.serve, daemon=True)

    def serve(self) -> None:
        """Until `_end` is set."""

    def __enter__(self) -> Self:
        self.line.plug()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end.set()
        self._thread.join(5)
        self.line.unplug()
