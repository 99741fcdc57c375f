"""How late samples reach the host: a busy computer still shows the amplitude loop the base as it was a moment ago."""

_TURN = 2**32
#: Device time that goes back by more [us] is another clock: the board has restarted.
_BACK_US = 1_000_000
#: The two clocks may drift apart by this share: twice what a recording is refused for. A lateness that lasts is so
#: forgotten, 0.1 s in ten seconds.
_DRIFT = 1e-2
#: Stamps that stay the same for longer [s] do not advance.
_STILL_S = 1.0


class Lateness:
    """Compares the host's clock with the blocks' time stamps; the least difference is the way itself.

    No exchange of times with the board is needed: what is beyond the quickest block so far, clocks' drift allowed for,
    is lateness.
    """

    def __init__(self) -> None:
        self._host = self._device = 0.0
        self._moved = 0.0  # when a stamp was last another one
        self.forget()

    def forget(self) -> None:
        """Begin anew, after a restart or another plug."""
        self._time_us: int | None = None
        self._quickest = float("inf")

    @property
    def still(self) -> bool:
        """Whether the stamps do not advance."""
        return self._host - self._moved > _STILL_S

    def of(self, time_us: int, host: float) -> float:
        """By how much the block with this stamp [us], modulo 2^32, is late at `host` [s]."""
        if time_us != self._time_us:
            self._moved = host
        if self._time_us is not None:
            passed = (time_us - self._time_us) % _TURN
            passed -= _TURN if passed >= _TURN // 2 else 0  # stamps that jitter may go back a little
            if passed < -_BACK_US:
                self.forget()
            else:
                self._device += 1e-6 * passed
                self._quickest += _DRIFT * max(0.0, host - self._host)
        self._time_us, self._host = time_us, host
        self._quickest = min(self._quickest, host - self._device)
        return host - self._device - self._quickest
