"""Feet that could be the person's, all at once: what protocols leave of their constants and branches.

The score is in nats, and a mean over the feet:

- information: half the log det that the asked constants' information gains, all else integrated out;
- branch: how much nearer the expected log-odds between the foot and its mirror image come to 1000 to
  1, as a share;
- rivals: the same for the departures that are not excluded, each of the size that its prior expects;
- widest: the logarithm by which the widest asked interval comes nearer to what was asked.

The odds are those of one Gauss-Newton step from the rival: the mirror image, which has everything else
that may be true to help, or where that leads it in a session of a little of everything
(`Sight.rivals`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from fasbody.constants import Z95
from identification.branches import DECISIVE_ODDS, EXCHANGED
from identification.plan.information import Seen
from identification.plan.prior import PlanVariables

_DECISIVE = float(np.log(DECISIVE_ODDS))
#: Precision of what a rival holds at a bound.
_HELD = 1e9
#: Standard deviation of the logarithm of a fit's half-width about the expected one of the same foot:
#: the scatter of recordings is itself estimated, and the curvature is that of where the fit ends.
WIDTH_STD = 0.25
#: Nuisances that say how large a departure is; the others of its group say of what kind.
_SIZES = ("mount", "relaxing", "rocking", "under load", "load share", "seating")


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
    """What recordings are expected to leave, foot by foot.

    Attributes:
        half: (D, 4) half of the 95 % intervals as shares of the values, in the order of `EXCHANGED`.
        log_odds: (D,) expected, of each foot over its rival.
        asked: half-widths by constant.
        utility: (4,) in the order of `Score`, to take differences of.
    """

    half: np.ndarray
    log_odds: np.ndarray
    asked: Mapping[str, float]
    utility: np.ndarray

    def quantile(self, share: float) -> dict[str, float]:
        """Half-widths by constant that so large a share of the feet stays below."""
        widths = np.quantile(self.half, share, axis=0)
        return dict(zip(EXCHANGED, map(float, widths), strict=True))

    @property
    def half_width(self) -> dict[str, float]:
        """Median over the feet."""
        return self.quantile(0.5)

    @property
    def decisions(self) -> np.ndarray:
        """(D,) probability that the branch is decided: log-odds scatter by the root of twice themselves."""
        odds = np.maximum(self.log_odds, 1e-9)
        return np.asarray(ndtr((odds - _DECISIVE) / np.sqrt(2 * odds)))

    def within(self, names: Sequence[str]) -> np.ndarray:
        """(D,) probability that the intervals of some constants are as asked; they vary together."""
        at = [EXCHANGED.index(name) for name in names]
        if not at:
            return np.ones(len(self.half))
        over = np.log([self.asked[name] for name in names] / self.half[:, at]).min(axis=1)
        return np.asarray(ndtr(over / WIDTH_STD))

    def goal(self, names: Sequence[str] | None = None, branch: bool = True) -> float:
        """Probability that some intervals, all that are asked unless given, and the branch are as asked."""
        narrow = self.within(list(self.asked) if names is None else names)
        return float(np.mean(narrow * self.decisions if branch else narrow))

    def likely(self, name: str) -> float:
        """Probability that the interval of one constant is as asked."""
        return self.goal([name], branch=False)

    @property
    def decided(self) -> float:
        """Probability that the branch is decided."""
        return float(np.mean(self.decisions))


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
    """What is known of D feet after recordings."""

    C: np.ndarray  # (D, f, f) covariance of what is felt
    known: np.ndarray  # (D, r, r) of the rows' products with it
    of_rival: np.ndarray  # (D, n, n) covariance of the rivals
    nearer: np.ndarray  # (D, n) step from a rival to the best foot near it
    missed: np.ndarray  # (D,) what that misses, with its prior's rows


@dataclass(frozen=True)
class Cause:
    """Why a constant stays uncertain.

    Attributes:
        kind: of the variable that is not known beforehand (`Nuisance.kind`); a constant's name.
        name: of the variable.
        share: of the constant's variance.
    """

    kind: str
    name: str
    share: float

    def __str__(self) -> str:
        return f"{self.name} {100 * self.share:.0f} %"


class Feet:
    """Judges recordings.

    Args:
        seen: D feet, as all steps see them.
        variables: n of them.

    Attributes:
        asked: half-widths by constant that the widest interval is compared with; none, and it does not count.
    """

    def __init__(self, seen: Seen, variables: PlanVariables) -> None:
        self.seen, self.asked = seen, dict[str, float]()
        mean, std = variables.prior
        self._P = 1 / std**2
        true, rival = seen.q - mean, seen.rival - mean
        self._pp, self._p_rival = (self._P * true**2).sum(1), self._P * rival
        self._pp_rival = (self._P * rival**2).sum(1)
        self._held = np.where(seen.held, _HELD, self._P)[:, None] * np.eye(mean.size)
        self._variables, self._rivals = variables, _departures(variables)
        # derivatives (D, r, n): of the main constants' logarithms, the prior's slope, and units of the departures
        m, L = len(EXCHANGED), variables.slopes(variables.logarithms, seen.q, np.arange(mean.size))
        at = np.array([i for places in self._rivals for i in places], int)
        units = np.broadcast_to(np.eye(mean.size)[at], (len(true), at.size, mean.size))
        rows = np.concatenate([L, (self._P * true)[:, None], units], axis=1)[:, None]
        # what no recording tells and no constant follows: the kind of a departure of no size, for example
        self._felt = np.flatnonzero(seen.J.any((0, 1, 2)) | rows.any((0, 1, 2)))
        self._rows = rows[..., self._felt]
        self._J = np.ascontiguousarray(seen.J[..., self._felt])
        # rows of the sizes whose priors are half normal, which way they may go, and how far each foot is from there
        lower, upper = (limit[at] == mean[at] for limit in variables.bounds)
        ends = np.flatnonzero(lower | upper)
        self._one_sided, self._way = m + 1 + ends, np.where(lower, 1.0, -1.0)[ends]
        self._room = np.abs(true[:, at[ends]])

    def sums(self, places: Sequence[int], lengths: Sequence[float] | np.ndarray) -> Sums:
        """Of recordings of the steps at some places, so many usual lengths long."""
        at, x = list(places), self.seen
        W = 1 / (x.noise[:, at] / np.array(lengths, float)[:, None] + x.spread[:, at])
        J, K, r, W = (y.reshape(len(y), -1, *y.shape[3:]) for y in (self._J[:, at], x.K[:, at], x.missed[:, at], W))
        KW = np.swapaxes(K * W[..., None], 1, 2)
        A = np.swapaxes(J * W[..., None], 1, 2) @ J
        return Sums(A, KW @ K, (KW @ r[..., None])[..., 0], (W * r**2).sum(1))

    def outlook(self, sums: Sums) -> Outlook:
        """What recordings leave."""
        after = self._after(sums)
        half, odds, utility = self._judge(after.known[:, None], after.missed[:, None])
        return Outlook(half[:, 0], odds[:, 0], self.asked, utility[0])

    def gains(
        self,
        done: Sums,
        plan: Sequence[tuple[int, float]],
        options: Sequence[tuple[int, float]],
        length: float = 1.0,
        feet: int | None = None,
    ) -> np.ndarray:
        """What each option adds by the first feet: (K, 4) as in `Score`.

        A recording updates what is known as a measurement does in Kalman's filter.

        Args:
            done: recordings that stay as they are.
            plan: recordings that are planned, by the place of the candidate and their length.
            options: recordings of it that become longer, or candidates and a length of 0 for one more.
            length: of what is added.
            feet: how many, None for all.
        """
        D, x = feet or len(self.seen.q), self.seen
        planned = self.sums([i for i, _ in plan], [n for _, n in plan])
        now = self._after((done + planned)[slice(D)])
        at, before = [i for i, _ in options], np.array([n for _, n in options])[:, None]
        noise, spread = x.noise[:D, at], x.spread[:D, at]
        after = before + length
        W = after / (noise + after * spread) - before / (noise + before * spread)
        root, unit = np.sqrt(W)[..., None], np.eye(W.shape[-1])
        J, K = root * self._J[:D, at], root * x.K[:D, at]
        moved = J @ now.C[:, None]
        G = moved @ np.swapaxes(self._rows[:D], -1, -2)
        S = unit + moved @ np.swapaxes(J, -1, -2)
        known = now.known[:, None] - np.swapaxes(G, -1, -2) @ np.linalg.solve(S, G)
        e = root[..., 0] * x.missed[:D, at] + (K @ now.nearer[:, None, :, None])[..., 0]
        S = unit + K @ now.of_rival[:, None] @ np.swapaxes(K, -1, -2)
        missed = now.missed[:, None] + (e * np.linalg.solve(S, e[..., None])[..., 0]).sum(-1)
        return self._judge(known, missed)[2] - self._judge(now.known[:, None], now.missed[:, None])[2]

    def _after(self, sums: Sums) -> "_After":
        D = len(sums.A)
        C = np.linalg.inv(sums.A + np.diag(self._P[self._felt]))
        rows = self._rows[:D, 0]
        known = rows @ C @ np.swapaxes(rows, 1, 2)
        bent = sums.b + self._p_rival[:D]
        of_rival = np.linalg.inv(sums.B + self._held[:D])
        nearer = -(of_rival @ bent[..., None])[..., 0]
        missed = sums.c + self._pp_rival[:D] + (bent * nearer).sum(-1)
        return _After(C, known, of_rival, nearer, missed)

    def causes(self, sums: Sums) -> dict[str, list[Cause]]:
        """What keeps each constant uncertain after recordings, the largest first; the noise has the rest.

        Shares are the mean over the feet.
        """
        P, L = self._P[self._felt], self._rows[:, 0, : len(EXCHANGED)]
        moved = L @ np.linalg.inv(sums.A + np.diag(P))
        share = (moved**2 * P / (moved * L).sum(-1, keepdims=True)).mean(0)
        v, felt = self._variables, self._felt
        kinds = (*v.constants, *(item.kind for item in v.nuisances))
        return {
            name: [Cause(kinds[felt[k]], v.names[felt[k]], float(row[k])) for k in np.argsort(-row)]
            for name, row in zip(EXCHANGED, share, strict=True)
        }

    def excluding(self, sums: Sums, places: Sequence[int]) -> dict[str, float]:
        """Half-widths as in `Outlook`, if the variables at some places were known beforehand."""
        P = np.where(np.isin(self._felt, places), _HELD, self._P[self._felt])
        rows = self._rows[:, 0]
        known = rows @ np.linalg.inv(sums.A + np.diag(P)) @ np.swapaxes(rows, 1, 2)
        return dict(zip(EXCHANGED, map(float, np.median(self._half_widths(known), axis=0)), strict=True))

    def _judge(self, known: np.ndarray, missed: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Half-widths (D, K, m), log-odds (D, K), utility (K, 4), of K protocols (`_After`)."""
        m, D = len(EXCHANGED), len(known)
        main, half = known[..., :m, :m], self._half_widths(known)
        at = [EXCHANGED.index(name) for name in self.asked] or list(range(m))
        information = -0.5 * np.linalg.slogdet(main[..., at, :][..., at])[1].mean(0)
        # of the branch: what the best foot near the rival misses, less what the prior costs the foot itself
        odds = 0.5 * (missed - self._pp[:D, None] + known[..., m, m])
        branch = np.clip(odds / _DECISIVE, 0.0, 1.0).mean(0)
        rivals = self._of_departures(known[..., m + 1 :, m + 1 :])
        return half, odds, np.stack([information, branch, rivals, -self._over(half[..., at])], axis=1)

    def _half_widths(self, known: np.ndarray) -> np.ndarray:
        """(..., m) half of the 95 % intervals as shares of the values, from `_After.known`.

        What is half normal moves a constant one way only: on the other side it is held at its bound. What is held is
        chosen once, which is within a tenth of the farthest place of the quadratic.
        """
        m, at = len(EXCHANGED), self._one_sided
        variance = np.einsum("...mm->...m", known)[..., :m]
        C = np.outer(self._way, self._way) * known[..., None, at, :][..., at]
        G = self._way * known[..., :m, at]
        room = self._room[: len(known)].reshape(len(known), *[1] * (known.ndim - 2), -1)
        reach = []
        for side in (1.0, -1.0):
            held = -side * Z95 * G / np.sqrt(variance)[..., None] > room
            among = np.where(held[..., :, None] & held[..., None, :], C, np.eye(at.size))
            by = np.where(held[..., None], np.stack(np.broadcast_arrays(G, -room), -1), 0.0)
            by_G, by_room = np.moveaxis(np.linalg.solve(among, by), -1, 0)
            left = (variance - (by[..., 0] * by_G).sum(-1)) * (Z95**2 - (by[..., 1] * by_room).sum(-1))
            reach.append(side * (by[..., 1] * by_G).sum(-1) + np.sqrt(np.maximum(left, 0.0)))
        return np.sinh(np.minimum(0.5 * (reach[0] + reach[1]), 50.0))

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

    def _over(self, half: np.ndarray) -> np.ndarray:
        """(K,) logarithm by which the widest interval exceeds what is asked, from the asked ones' (D, K, a)."""
        if not self.asked:
            return np.zeros(half.shape[1])
        return np.asarray(np.maximum(0.0, np.log(half / list(self.asked.values())).max(-1)).mean(0))


def _departures(variables: PlanVariables) -> list[list[int]]:
    """Places of the sizes of each departure that is not excluded."""
    places: dict[str, list[int]] = {}
    for i, item in enumerate(variables.nuisances, len(variables.constants)):
        if item.kind in _SIZES:
            places.setdefault(item.group, []).append(i)
    return list(places.values())
