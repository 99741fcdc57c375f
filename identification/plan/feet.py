"""Feet that could be the person's, all at once: what protocols are expected to leave of their constants and branches.

The score is in nats, and a mean over the feet:

- information: half the log det that the asked constants' information gains, everything else integrated out;
- branch: how much nearer the expected log-odds between the foot and its mirror image come to 1000 to 1, as a share;
- rivals: the same for the departures that are not excluded, each of the size that its prior expects;
- widest: the logarithm by which the widest asked interval comes nearer to what was asked.

The odds are those of one Gauss-Newton step from the mirror image, which has everything else that may be true to help;
where departures are allowed, from where they lead it in a session that has a little of everything (`Sight.rival`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from identification.branches import DECISIVE_ODDS, EXCHANGED
from identification.plan.information import Seen
from identification.plan.prior import PlanSpace

_DECISIVE = float(np.log(DECISIVE_ODDS))
_Z95 = 1.959963984540054
#: Precision of what a rival holds at a bound.
_HELD = 1e9
#: What of each departure says how large it is; the rest says of what kind.
_SIZES = {
    "mount": ("mount",), "relaxation": ("relaxing k_T", "relaxing k_F"), "rocking": ("rocking",), "load": (" under ",),
}  # fmt: skip


@dataclass(frozen=True)
class Score:
    """What a step adds, in nats; see the module."""

    information: float
    branch: float
    rivals: float
    widest: float

    @property
    def total(self) -> float:
        """All together."""
        return self.information + self.branch + self.rivals + self.widest


@dataclass(frozen=True, eq=False)
class Outlook:
    """What recordings are expected to leave.

    Attributes:
        half_width: by constant, the geometric mean over the feet: half of the 95 % interval as a share of the value.
        spread: by constant, least and largest over the feet. met: share of the feet for whom all that is asked of
            intervals is met. log_odds: (D,) of each foot over its mirror image.
        utility: (4,) in the order of `Score`, to take differences of.
    """

    half_width: Mapping[str, float]
    spread: Mapping[str, tuple[float, float]]
    met: float
    log_odds: np.ndarray
    utility: np.ndarray

    @property
    def decided(self) -> float:
        """Share of the feet whose branch is decided."""
        return float(np.mean(self.log_odds > _DECISIVE))


class Feet:
    """Judges protocols, each given by how often it has each of C steps.

    Args:
        seen: D feet, as all steps see them. space: of their n variables. candidates: so many steps come first that
            could be added.

    Attributes:
        asked: half-widths by constant that the widest interval is compared with; none, and it does not count.
    """

    def __init__(self, seen: Sequence[Seen], space: PlanSpace, candidates: int) -> None:
        self.seen, self.asked = list(seen), dict[str, float]()
        self._sums = [np.stack([getattr(foot, name) for foot in seen]) for name in ("A", "B", "b", "c")]
        mean, std = space.prior
        self._P = 1 / std**2
        true, image = (np.stack([getattr(f, which) for f in seen]) - mean for which in ("q", "image"))
        self._pp, self._p_image = (self._P * true**2).sum(1), self._P * image
        self._held = np.where(np.stack([foot.held for foot in seen]), _HELD, self._P)[:, None, None] * np.eye(mean.size)
        self._pp_image = (self._P * image**2).sum(1)
        self._rivals, self._names = _sizes(space.index), list(space.index)
        # derivatives (D, m, n) of the logarithms of the main constants, the prior's slope, and units of the rivals
        L = np.stack([space.logarithms(foot.q, EXCHANGED) for foot in seen])
        units = np.eye(mean.size)[[i for group in self._rivals for i in group]]
        whole = np.broadcast_to(units, (len(seen), *units.shape))
        rows = np.concatenate([L, (self._P * true)[:, None], whole], axis=1)[:, None]
        # what no recording tells and no constant follows: the kind of a departure of no size, for example
        self._felt = np.flatnonzero(np.abs(self._sums[0]).any((0, 1, 2)) | np.abs(rows).any((0, 1, 2)))
        self._rows, at = rows[..., self._felt], np.ix_(self._felt, self._felt)
        self._sums[0] = np.ascontiguousarray(self._sums[0][..., at[0], at[1]])
        self._each = [x[:, :candidates] for x in self._sums]

    def outlook(self, counts: np.ndarray) -> Outlook:
        """What a protocol (C,) leaves."""
        std, odds, utility = self._judge(*(x[:, None] for x in self._summed(counts)))
        half = np.sinh(_Z95 * std[:, 0])
        return Outlook(
            {name: float(np.exp(np.log(half[:, i]).mean())) for i, name in enumerate(EXCHANGED)},
            {name: (float(half[:, i].min()), float(half[:, i].max())) for i, name in enumerate(EXCHANGED)},
            float(np.mean([all(row[EXCHANGED.index(n)] <= share for n, share in self.asked.items()) for row in half])),
            odds[:, 0],
            utility[0],
        )

    def gains(self, counts: np.ndarray, times: float = 1.0, feet: int | None = None) -> np.ndarray:
        """What each candidate, so many times, adds to a protocol (C,) by the first feet: (K, 4) as in `Score`."""
        now = [x[:feet, None] for x in self._summed(counts)]
        after = [s + times * x[:feet] for s, x in zip(now, self._each, strict=True)]
        return self._judge(*after)[2] - self._judge(*now)[2]

    def causes(self, counts: np.ndarray) -> dict[str, dict[str, float]]:
        """What keeps each constant uncertain after a protocol (C,): by constant, shares of its variance by what is not
        known beforehand, the mean over the feet, the largest first; the noise has the rest.
        """
        A = self._summed(counts)[0]
        P = self._P[self._felt]
        C, L = np.linalg.inv(A + np.diag(P)), self._rows[:, 0, : len(EXCHANGED)]
        moved = L @ C
        share = (moved**2 * P / (moved * L).sum(-1, keepdims=True)).mean(0)
        return {
            name: {self._names[self._felt[i]]: float(own[i]) for i in np.argsort(-own)}
            for name, own in zip(EXCHANGED, share, strict=True)
        }

    def excluding(self, counts: np.ndarray, places: Sequence[int]) -> dict[str, float]:
        """Half-widths as in `Outlook` after a protocol (C,), if the variables at some places were known beforehand."""
        left = ~np.isin(self._felt, places)
        A = (self._summed(counts)[0] + np.diag(self._P[self._felt]))[:, left][:, :, left]
        L = self._rows[:, 0, : len(EXCHANGED)][:, :, left]
        half = np.sinh(_Z95 * np.sqrt(np.einsum("dmn,dnk,dmk->dm", L, np.linalg.inv(A), L)))
        return dict(zip(EXCHANGED, map(float, np.exp(np.log(half).mean(0))), strict=True))

    def _summed(self, counts: np.ndarray) -> list[np.ndarray]:
        at = np.flatnonzero(counts)
        return [np.tensordot(counts[at], x[:, at], (0, 1)) for x in self._sums]

    def _judge(
        self, A: np.ndarray, B: np.ndarray, b: np.ndarray, c: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Standard errors (D, K, m) of logarithms, log-odds (D, K), utility (K, 4), of K protocols by their sums.

        Args:
            A: (D, K, f, f) of what is felt. B: (D, K, n, n). b: (D, K, n). c: (D, K).
        """
        m, prior, D = len(EXCHANGED), np.diag(self._P[self._felt]), len(A)
        rows = self._rows[:D]
        right = np.linalg.solve(A + prior, np.swapaxes(rows, -1, -2))
        known = rows @ right  # covariances of the rows' products with the variables
        own = known[..., :m, :m]
        std = np.sqrt(np.einsum("dkmm->dkm", own))
        at = [EXCHANGED.index(name) for name in self.asked] or list(range(m))
        information = -0.5 * np.linalg.slogdet(own[..., at, :][..., at])[1].mean(0)
        # of the branch: what the best foot near the mirror image misses, less what the prior costs the foot itself
        bent = b + self._p_image[:D, None]
        missed = (
            c + self._pp_image[:D, None] - (bent * np.linalg.solve(B + self._held[:D], bent[..., None])[..., 0]).sum(-1)
        )
        odds = 0.5 * (missed - self._pp[:D, None] + known[..., m, m])
        branch = np.clip(odds / _DECISIVE, 0.0, 1.0).mean(0)
        rivals, first = np.zeros(A.shape[1]), m + 1
        for group in self._rivals:
            place = slice(first, first + group.size)
            block = np.linalg.inv(known[..., place, place]) - np.diag(self._P[group])
            rivals += np.clip(0.5 * block.sum((-1, -2)) / _DECISIVE, 0.0, 1.0).mean(0) / len(self._rivals)
            first = place.stop
        over = np.zeros(std.shape[1])
        if self.asked:
            wanted = np.array(list(self.asked.values()))
            half = np.sinh(np.minimum(_Z95 * std[..., at], 50.0))
            over = np.maximum(0.0, np.log(half / wanted).max(-1)).mean(0)
        return std, odds, np.stack([information, branch, rivals, -over], axis=1)


def _sizes(index: Mapping[str, int]) -> list[np.ndarray]:
    """Places of the sizes of each departure that is not excluded."""
    found = []
    for names in _SIZES.values():
        at = [i for name, i in index.items() if any(name == n or (n == " under " and n in name) for n in names)]
        found += [np.array(at)] if at else []
    return found
