"""How long work reports how far it has come."""

from collections.abc import Callable

#: Called with the stage, the number done and the total.
Advance = Callable[[str, int, int], None]


def silent(stage: str, done: int, total: int) -> None:
    """Report nothing: the default where nobody waits."""
