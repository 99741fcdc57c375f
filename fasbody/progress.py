"""How long work reports how far it has come."""

import time
from collections.abc import Callable

#: Called with the stage, the number done and the total.
Advance = Callable[[str, int, int], None]
#: Share of the work before which the time that it takes says nothing of the rest, and so does the first second [s].
_TELLING, _FIRST = 0.03, 1.0
#: Steps that were not expected, as a share of those done: the least that is still to come.
_MORE = 0.02


def silent(stage: str, done: int, total: int) -> None:
    """Report nothing: the default where nobody waits."""


class Work:
    """Steps that are done, of as many as there may be, where their number is known only as the work goes on.

    Args:
        advance: called after each step with the stage, the steps done and about how many there are in all stages.
        after: share of the whole work that takes no such steps and comes last.

    Attributes:
        stage: that goes on.
    """

    def __init__(self, advance: Advance = silent, after: float = 0.0) -> None:
        self._advance, self._after, self.stage = advance, after, ""
        self._done, self._total, self._most, self._reached = 0.0, 0.0, 0.0, 0.0

    def expect(self, most: float) -> None:
        """So many steps may still come; of those that might have come before, the same share did."""
        share = self._done / self._most if self._most else 1.0
        self._total = self._done + share * most
        self.did(0)

    def might(self, most: float) -> None:
        """So many steps might come, of which some will."""
        self._most += most

    def did(self, steps: float = 1) -> None:
        """Steps are done."""
        self._done += steps
        self._total = max(self._total, (1 + _MORE) * self._done)
        self._advance(self.stage, round(self._done), round(self._total / (1 - self._after)))

    def after(self, stage: str, share: float) -> None:
        """The steps are done, and such a share of what comes after them."""
        self.stage, self._total = stage, self._done
        total = self._done / (1 - self._after)
        self._reached = max(self._reached, self._done + share * (total - self._done))
        self._advance(stage, round(self._reached), round(total))


class Pace:
    """How much longer work takes, by the time that it took so far, and what of it is done.

    Attributes:
        share: that is done, which never falls, even where more turns out to be needed.
        left_s: seconds that are left, None where nothing is known of them.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._began = clock, clock()
        self.share, self._done = 0.0, 0
        self.left_s: float | None = None

    def at(self, done: int, total: int) -> None:
        """So much is done of so much."""
        took, share = self._clock() - self._began, done / total if total else 0.0
        went = max(0.0, (done - self._done) / max(1, total - self._done))  # of what was left
        self.share, self._done = min(1.0, max(self.share + (1 - self.share) * went, share)), done
        self.left_s = took * (1 / share - 1) if share > _TELLING and took > _FIRST else None
