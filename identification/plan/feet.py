"""Feet that could be the person's, all at once: what protocols are expected to leave of their constants and branches.

The score is in nats, and a mean over the feet:

- information: half the log det that the asked constants' information gains, everything else integrated out;
- branch: how much nearer the expected log-odds between the foot and its mirror image come to 1000 to 1, as a share;
- rivals: the same for the departures that are not excluded, each of the size that its prior expects;
- widest: the logarithm by which the widest asked interval comes nearer to what was asked.

The odds are those of one Gauss-Newton step from the rival: the mirror image, which has everything else that may be true
to help, or where that leads it in a session that has a little of everything (`Sight.rivals`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fasbody.constants import Z95
from identification.branches import DECISIVE_ODDS, EXCHANGED
from identification.plan.information import Seen
from identification.plan.prior import PlanVariables

_DECISIVE = float(np.log(DECISIVE_ODDS))
#: Precision of what a rival holds at a bound.
_HELD = 1e9
#: Nuisances that say how large a departure is; the others of its group say of what kind.
_SIZES = ("mount", "relaxing", "rocking", "under load", "load share")


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
        half_width: by constant, half of the 95 % interval as a share of the value, the geometric mean over the feet.
        spread: by constant, least and largest over the feet.
        met: share of the feet for whom all that is asked of intervals is met.
        log_odds: (D,) of each foot over its rival.
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


@dataclass(frozen=True, eq=False)
class Sums:
    """Information of D feet that recordings add up to.

    Attributes:
        A: (D, f, f) of the feet's variables that are felt.
        B: (D, n, n) of the rivals'.
        b: (D, n) slopes of what the rivals miss.
        c: (D,) its squares.
    """

    A: np.ndarray
    B: np.ndarray
    b: np.ndarray
    c: np.ndarray

    def __add__(self, other: "Sums") -> "Sums":
        return Sums(self.A + other.A, self.B + other.B, self.b + other.b, self.c + other.c)

    def __rmul__(self, times: float) -> "Sums":
        return Sums(times * self.A, times * self.B, times * self.b, times * self.c)

    def __getitem__(self, feet: slice) -> "Sums":
        return Sums(self.A[feet], self.B[feet], self.b[feet], self.c[feet])


@dataclass(frozen=True, eq=False)
class _After:
    """What is known of D feet after recordings.

    Attributes:
        C: (D, f, f) covariance of what is felt.
        known: (D, r, r) of the rows' products with it.
        of_rival: (D, n, n) covariance of the rivals.
        nearer: (D, n) step from a rival to the best foot near it.
        missed: (D,) what that misses, with its prior's rows.
    """

    C: np.ndarray
    known: np.ndarray
    of_rival: np.ndarray
    nearer: np.ndarray
    missed: np.ndarray


class Feet:
    """Judges recordings.

    Args:
        seen: D feet, as all steps see them.
        variables: n of them.
        candidates: so many steps come first that could be added.

    Attributes:
        asked: half-widths by constant that the widest interval is compared with; none, and it does not count.
    """

    def __init__(self, seen: Seen, variables: PlanVariables, candidates: int) -> None:
        self.seen, self.asked = seen, dict[str, float]()
        self._candidates = candidates
        mean, std = variables.prior
        self._P = 1 / std**2
        true, rival = seen.q - mean, seen.rival - mean
        self._pp, self._p_rival = (self._P * true**2).sum(1), self._P * rival
        self._pp_rival = (self._P * rival**2).sum(1)
        self._held = np.where(seen.held, _HELD, self._P)[:, None] * np.eye(mean.size)
        self._names, self._rivals = variables.names, _departures(variables)
        # derivatives (D, r, n): of the main constants' logarithms, the prior's slope, and units of the departures
        L = variables.slopes(variables.logarithms, seen.q, np.arange(mean.size))
        units = np.eye(mean.size)[[i for places in self._rivals for i in places]]
        units = np.broadcast_to(units, (len(true), *units.shape))
        rows = np.concatenate([L, (self._P * true)[:, None], units], axis=1)[:, None]
        # what no recording tells and no constant follows: the kind of a departure of no size, for example
        self._felt = np.flatnonzero(seen.J.any((0, 1, 2)) | rows.any((0, 1, 2)))
        self._rows = rows[..., self._felt]
        self._J = np.ascontiguousarray(seen.J[..., self._felt])

    def sums(self, places: Sequence[int], lengths: Sequence[float] | np.ndarray) -> Sums:
        """Of recordings of the steps at some places, so many usual lengths long."""
        at, x = list(places), self.seen
        W = 1 / (x.noise[:, at] / np.array(lengths, float)[:, None] + x.scatter[:, at])
        J, K, r, W = (y.reshape(len(y), -1, *y.shape[3:]) for y in (self._J[:, at], x.K[:, at], x.missed[:, at], W))
        KW = np.swapaxes(K * W[..., None], 1, 2)
        A = np.swapaxes(J * W[..., None], 1, 2) @ J
        return Sums(A, KW @ K, (KW @ r[..., None])[..., 0], (W * r**2).sum(1))

    def outlook(self, sums: Sums) -> Outlook:
        """What recordings leave."""
        after = self._after(sums)
        std, odds, utility = self._judge(after.known[:, None], after.missed[:, None])
        half = np.sinh(Z95 * std[:, 0])
        met = [all(row[EXCHANGED.index(n)] <= share for n, share in self.asked.items()) for row in half]
        mean, low, high = np.exp(np.log(half).mean(0)), half.min(0), half.max(0)
        return Outlook(
            dict(zip(EXCHANGED, map(float, mean), strict=True)),
            {name: (float(low[i]), float(high[i])) for i, name in enumerate(EXCHANGED)},
            float(np.mean(met)), odds[:, 0], utility[0],
        )  # fmt: skip

    def gains(self, done: Sums, plan: Mapping[int, float], length: float = 1.0, feet: int | None = None) -> np.ndarray:
        """What each candidate of a length adds by the first feet: (K, 4) as in `Score`.

        A recording updates what is known as a measurement does in Kalman's filter.

        Args:
            done: recordings that stay as they are.
            plan: candidates that are planned, with their lengths; more of one makes it longer.
            length: of what is added.
            feet: how many, None for all.
        """
        D, x = feet or len(self.seen.q), self.seen
        now = self._after((done + self.sums(list(plan), list(plan.values())))[slice(D)])
        at = np.s_[:D, : self._candidates]
        before = np.array([plan.get(i, 0.0) for i in range(self._candidates)])[:, None]
        noise, scatter = x.noise[at], x.scatter[at]
        W = (before + length) / (noise + (before + length) * scatter) - before / (noise + before * scatter)
        root, unit = np.sqrt(W)[..., None], np.eye(W.shape[-1])
        J, K = root * self._J[at], root * x.K[at]
        moved = J @ now.C[:, None]
        G = moved @ np.swapaxes(self._rows[:D], -1, -2)
        S = unit + moved @ np.swapaxes(J, -1, -2)
        known = now.known[:, None] - np.swapaxes(G, -1, -2) @ np.linalg.solve(S, G)
        e = root[..., 0] * x.missed[at] + (K @ now.nearer[:, None, :, None])[..., 0]
        S = unit + K @ now.of_rival[:, None] @ np.swapaxes(K, -1, -2)
        missed = now.missed[:, None] + (e * np.linalg.solve(S, e[..., None])[..., 0]).sum(-1)
        return self._judge(known, missed)[2] - self._judge(now.known[:, None], now.missed[:, None])[2]

    def _after(self, sums: Sums) -> "_After":
        """What is known after recordings, by the feet that they are summed of."""
        D = len(sums.A)
        C = np.linalg.inv(sums.A + np.diag(self._P[self._felt]))
        rows = self._rows[:D, 0]
        known = rows @ C @ np.swapaxes(rows, 1, 2)
        bent = sums.b + self._p_rival[:D]
        of_rival = np.linalg.inv(sums.B + self._held[:D])
        nearer = -(of_rival @ bent[..., None])[..., 0]
        missed = sums.c + self._pp_rival[:D] + (bent * nearer).sum(-1)
        return _After(C, known, of_rival, nearer, missed)

    def causes(self, sums: Sums) -> dict[str, dict[str, float]]:
        """What keeps each constant uncertain after recordings: by constant, shares of its variance by what is not known
        beforehand, the mean over the feet, the largest first; the noise has the rest.
        """
        P, L = self._P[self._felt], self._rows[:, 0, : len(EXCHANGED)]
        moved = L @ np.linalg.inv(sums.A + np.diag(P))
        share = (moved**2 * P / (moved * L).sum(-1, keepdims=True)).mean(0)
        return {
            name: {self._names[self._felt[i]]: float(row[i]) for i in np.argsort(-row)}
            for name, row in zip(EXCHANGED, share, strict=True)
        }

    def excluding(self, sums: Sums, places: Sequence[int]) -> dict[str, float]:
        """Half-widths as in `Outlook`, if the variables at some places were known beforehand."""
        left = ~np.isin(self._felt, places)
        A = (sums.A + np.diag(self._P[self._felt]))[:, left][:, :, left]
        L = self._rows[:, 0, : len(EXCHANGED)][:, :, left]
        half = np.sinh(Z95 * np.sqrt(np.einsum("dmn,dnk,dmk->dm", L, np.linalg.inv(A), L)))
        return dict(zip(EXCHANGED, map(float, np.exp(np.log(half).mean(0))), strict=True))

    def _judge(self, known: np.ndarray, missed: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Standard errors (D, K, m) of logarithms, log-odds (D, K), utility (K, 4), of K protocols (`_After`)."""
        m, D = len(EXCHANGED), len(known)
        main = known[..., :m, :m]
        std = np.sqrt(np.einsum("dkmm->dkm", main))
        at = [EXCHANGED.index(name) for name in self.asked] or list(range(m))
        information = -0.5 * np.linalg.slogdet(main[..., at, :][..., at])[1].mean(0)
        # of the branch: what the best foot near the rival misses, less what the prior costs the foot itself
        odds = 0.5 * (missed - self._pp[:D, None] + known[..., m, m])
        branch = np.clip(odds / _DECISIVE, 0.0, 1.0).mean(0)
        rivals = self._of_departures(known[..., m + 1 :, m + 1 :])
        return std, odds, np.stack([information, branch, rivals, -self._over(std[..., at])], axis=1)

    def _of_departures(self, covariance: np.ndarray) -> np.ndarray:
        """(K,) how decided departures are, from the covariance (D, K, r, r) of their sizes."""
        decided, first = np.zeros(covariance.shape[1]), 0
        for places in self._rivals:
            at = np.s_[first : first + len(places)]
            block = np.linalg.inv(covariance[..., at, at]) - np.diag(self._P[places])
            odds = 0.5 * block.sum((-1, -2))
            decided += np.clip(odds / _DECISIVE, 0.0, 1.0).mean(0) / len(self._rivals)
            first += len(places)
        return decided

    def _over(self, std: np.ndarray) -> np.ndarray:
        """(K,) logarithm by which the widest interval exceeds what is asked, from the asked ones' (D, K, a)."""
        if not self.asked:
            return np.zeros(std.shape[1])
        half = np.sinh(np.minimum(Z95 * std, 50.0))
        return np.asarray(np.maximum(0.0, np.log(half / list(self.asked.values())).max(-1)).mean(0))


def _departures(variables: PlanVariables) -> list[list[int]]:
    """Places of the sizes of each departure that is not excluded."""
    places: dict[str, list[int]] = {}
    for i, item in enumerate(variables.nuisances, len(variables.constants)):
        if item.kind in _SIZES:
            places.setdefault(item.group, []).append(i)
    return list(places.values())
