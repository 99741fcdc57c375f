"""Which of the two wire formats a board speaks, found by listening, and then its messages."""

from fasbody.acquire.frames import FrameReader
from fasbody.acquire.lines import LineReader
from fasbody.acquire.messages import Damage, Hello, Message


class Decoder:
    """Reads both formats until one of them says hello, and only that one from then on.

    Args:
        preamble: the bytes of an earlier hello, for a stream that is known.
    """

    def __init__(self, preamble: bytes = b"") -> None:
        self._readers: list[FrameReader | LineReader] = [FrameReader(), LineReader()]
        self.bytes = 0
        self.feed(preamble)
        self.fresh()
        self.bytes = 0

    @property
    def hello(self) -> Hello | None:
        """The board's description, once it came."""
        return self._readers[0].hello if len(self._readers) == 1 else None

    @property
    def preamble(self) -> bytes:
        """The bytes that said it."""
        return self._readers[0].preamble if self.hello else b""

    def fresh(self) -> None:
        """Forget unfinished messages, as after unplugging."""
        for reader in self._readers:
            reader.fresh()

    def feed(self, data: bytes) -> list[Message]:
        """Messages completed by these bytes; before the hello, damage in either format means nothing."""
        self.bytes += len(data)
        for reader in tuple(self._readers):
            messages = reader.feed(data)
            if len(self._readers) == 1:
                return messages
            if reader.hello is not None:
                self._readers = [reader]
                return [message for message in messages if not isinstance(message, Damage)]
        return []
