"""What both wire formats share: a stream of bytes cut into pieces at an end mark, and each piece read as a message."""

from abc import ABC, abstractmethod

from fasbody.acquire.messages import Damage, Hello, Message


class PieceReader(ABC):
    """Turns bytes, in pieces of any size, into messages; nothing it is fed makes it fail or grow.

    A format says what ends a piece, how long one can be, and overrides `read`.

    Attributes:
        hello: the board's description, once it came. preamble: the bytes that said it.
    """

    END: bytes
    LONGEST: int

    def __init__(self) -> None:
        self.hello: Hello | None = None
        self.preamble = b""
        self.fresh()

    def fresh(self) -> None:
        """Forget an unfinished piece: the next bytes may begin in the middle of one."""
        self._rest = b""
        self._skip = False
        self._first = True

    @property
    def kept(self) -> int:
        """Bytes of the unfinished piece, never more than LONGEST."""
        return len(self._rest)

    @abstractmethod
    def read(self, piece: bytes) -> Message | None:
        """One whole piece without its end; None for what says nothing yet."""

    def feed(self, data: bytes) -> list[Message]:
        """Messages completed by these bytes."""
        messages: list[Message] = []
        pieces = (self._rest + data).split(self.END)
        self._rest = pieces.pop()
        for piece in pieces:
            skip, self._skip = self._skip, False
            if skip or not piece:
                continue
            message = self.read(piece) if len(piece) <= self.LONGEST else Damage("too long", len(piece))
            if message is not None and not (self._first and isinstance(message, Damage)):
                messages.append(message)  # the first piece may be the tail of one: that is no damage
            self._first = False
        if len(self._rest) > self.LONGEST:
            if not self._skip:
                messages.append(Damage("no end", len(self._rest)))
            self._rest, self._skip, self._first = b"", True, False
        return messages
