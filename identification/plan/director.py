"""Which recording is worth making next: scores of every candidate over feet that could be the person's.

The score is in nats, and a mean over draws of the prior (or, after recordings, of what they leave possible):

- information: half the log det that the asked constants' information gains, whatever else may be true integrated out;
- branch: how much nearer the expected log-odds between the foot and its mirror image come to 1000 to 1, as a share;
- rivals: the same for the departures that are not excluded, each of the size that its prior expects;
- widest: the logarithm by which the widest asked interval comes nearer to what was asked.

The odds are those of one Gauss-Newton step from the mirror image, which has everything else that may be true to help.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fasbody.exceptions import SettingError, SimulationError, unknown
from fasbody.recording.known import DEPARTURES
from fasbody.recording.recording import Recording
from identification.branches import DECISIVE_ODDS, EXCHANGED
from identification.periodic import Line
from identification.plan.belief import Belief, believe
from identification.plan.candidates import Candidates, Step, thesis
from identification.plan.information import Seen, Sight
from identification.plan.prior import Person
from identification.plan.shaker import SINE, Shaker
from identification.sensors import MALLEOLUS

#: Feet over which scores are averaged: of the prior, and of what recordings leave possible, where they are more alike.
DRAWS, FEWER = 32, 12
#: A branch counts as decided for a plan where so large a share of the feet is.
SHARE = 0.9
#: What is not asked for is to be as narrow as the thesis' three loads make it, within this factor:
#: for feet that are not the population's, 15 % have room for the difference.
AS_THESIS = 1.05
#: Rounds of exchange of a whole session, and the gain in nats that is worth one.
_ROUNDS, _WORTH = 3, 1e-3
_DECISIVE = float(np.log(DECISIVE_ODDS))
_Z95 = 1.959963984540054
#: So often is every candidate recorded where a protocol goes on for ever.
_FOR_EVER = 1e4
#: Draws of feet that have no steady motion before it is given up.
_TRIES = 10
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
        spread: by constant, least and largest over the feet. log_odds: (D,) of each foot over its mirror image.
        utility: (4,) in the order of `Score`, to take differences of.
    """

    half_width: Mapping[str, float]
    spread: Mapping[str, tuple[float, float]]
    log_odds: np.ndarray
    utility: np.ndarray

    @property
    def decided(self) -> float:
        """Share of the feet whose branch is decided."""
        return float(np.mean(self.log_odds > _DECISIVE))


class Director:
    """Scores recordings that could be made of a person, and proposes.

    Args:
        person: on the shaker. shaker: its limits. ask: half-widths that are asked for, by constant, as a share; those
            that are not named are as narrow as the thesis' three loads are expected to make them, within 15 %.
        earlier: recordings that exist, as steps that were done and what they said. seed: of the draws.
        draws: how many feet, 0 for the usual. believed: what earlier recordings were taken for before, to go on from.
        compares: the thesis' protocol is looked at, too; it must be where not all intervals are asked for.
    """

    def __init__(
        self,
        person: Person,
        shaker: Shaker,
        ask: Mapping[str, float] | None = None,
        earlier: Sequence[Recording] = (),
        seed: int = 0,
        draws: int = 0,
        believed: Belief | None = None,
        compares: bool = True,
    ) -> None:
        self.person, self.shaker, self.seed = person, shaker, seed
        for name, share in (ask or {}).items():
            if name not in EXCHANGED:
                raise SettingError(f"{unknown('constant to ask for', name, EXCHANGED)}.")
            if not 0 < share < 10:
                raise SettingError(f"the half-width asked for {name} is {share:g}; give a share, 0.05 for +-5 %.")
        draws = draws or (FEWER if earlier else DRAWS)
        there = [name for name in person.foot.sensors if name != "base"]
        for name in shaker.sensors:
            if name not in there:
                raise SettingError(f"{unknown('sensor', name, there)} in model {person.foot.name}.")
        if shaker.sensors[:1] != MALLEOLUS:
            raise SettingError("the malleolus is always worn; name it first, malleolus,foot for example.")
        if draws < 2:
            raise SettingError(f"{draws} feet are no average; give 2 or more.")
        self.candidates = Candidates(shaker, person.leg_kg).steps
        self.done = tuple(step_of(recording) for recording in earlier)
        for recording in earlier:
            whose = recording.condition
            if (whose.subject, whose.body_mass_kg) != (person.name, person.body_mass_kg):
                raise SettingError(
                    f"{recording.file} is of subject {whose.subject!r} with {whose.body_mass_kg} kg, and the plan is "
                    f"for {person.name!r} with {person.body_mass_kg:g} kg."
                )
        if earlier:  # what sensors and person hiss is known by now
            sigma = [(line.base.sigma, line.malleolus.sigma) for line in map(Line.of, earlier)]
            shaker = replace(shaker, noise_m_s2=float(np.clip(np.sqrt(np.mean(np.square(sigma))), 1e-6, 10.0)))
            self.shaker = shaker
        rng = np.random.default_rng([seed, len(earlier)])
        compared = thesis() if compares or set(ask or {}) != set(EXCHANGED) else ()
        every = tuple(dict.fromkeys(map(self._unit, [*self.candidates, *compared, *self.done])))
        self._place = {step: i for i, step in enumerate(every)}
        allowed = person.allowed(every, earlier, shaker.rate_hz)
        middle = float(np.sqrt(shaker.lowest_hz * shaker.highest_hz))
        self._sight = Sight(person, every, shaker, allowed, rng, middle)
        self.belief = believe(person, earlier, allowed, middle, rng, believed) if earlier else None
        self._feet = self._draws(draws, rng)
        given = dict(ask or {})
        usual = self.outlook(thesis(), fresh=True).half_width if compared else given
        self.asked = {name: given.get(name, AS_THESIS * usual[name]) for name in EXCHANGED}
        self.told = tuple(given)

    @property
    def feet(self) -> int:
        """Over how many feet the scores are averaged."""
        return len(self._feet)

    @property
    def allowed(self) -> tuple[str, ...]:
        """Departures of the world from the model that are allowed for."""
        return tuple(group for group in DEPARTURES if group not in self.person.known.excluded)

    def _draws(self, count: int, rng: np.random.Generator) -> list[Seen]:
        feet: list[Seen] = []
        for number in range(_TRIES * count):
            sign = 1 if number % 2 else -1
            q = self._sight.space.draw(rng, sign) if self.belief is None else self.belief.draw(rng)
            seen = self._sight.see(q)
            if seen is not None:
                feet.append(seen)
            if len(feet) == count:
                return feet
        raise SimulationError("too few feet of the population move steadily on this shaker; lower its amplitude.")

    # sums of what steps tell

    @cached_property
    def _A(self) -> np.ndarray:
        return np.stack([foot.A for foot in self._feet])

    @cached_property
    def _B(self) -> np.ndarray:
        return np.stack([foot.B for foot in self._feet])

    @cached_property
    def _b(self) -> np.ndarray:
        return np.stack([foot.b for foot in self._feet])

    @cached_property
    def _c(self) -> np.ndarray:
        return np.stack([foot.c for foot in self._feet])

    @cached_property
    def _L(self) -> np.ndarray:
        """Derivatives (D, m, n) of the logarithms of the main constants."""
        return np.stack([self._sight.space.logarithms(foot.q, EXCHANGED) for foot in self._feet])

    @cached_property
    def _prior(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """P (n,) and, of foot and image, P (q - mean) (D, n) and its product with q - mean (D,)."""
        mean, std = self._sight.space.prior
        P = 1 / std**2
        true, image = (np.stack([getattr(f, which) for f in self._feet]) - mean for which in ("q", "image"))
        return P, P * true, (P * true**2).sum(1), P * image, (P * image**2).sum(1)

    def _unit(self, step: Step) -> Step:
        """A step of the length that was looked at: information grows with the time."""
        return replace(step, seconds=self.shaker.seconds)

    def _counts(self, steps: Sequence[Step], fresh: bool) -> np.ndarray:
        """How long (C,) each step lasts, in lengths that were looked at."""
        found = np.zeros(len(self._place))
        for step in (*(() if fresh else self.done), *steps):
            place = self._place.get(self._unit(step))
            if place is None:
                raise SettingError(f"{step} is no candidate of this director, nor of the thesis.")
            found[place] += step.seconds / self.shaker.seconds
        return found

    def outlook(self, steps: Sequence[Step], fresh: bool = False) -> Outlook:
        """What is expected after steps, beside those that are done (not if fresh)."""
        return self._outlook(self._counts(steps, fresh))

    def for_ever(self) -> Outlook:
        """What is expected if every candidate were recorded over and over."""
        counts = self._counts((), False)
        for step in self.candidates:
            counts[self._place[self._unit(step)]] += _FOR_EVER
        return self._outlook(counts)

    def _outlook(self, counts: np.ndarray) -> Outlook:
        at = np.flatnonzero(counts)
        sums = [np.tensordot(counts[at], x[:, at], (0, 1)) for x in (self._A, self._B, self._b, self._c)]
        std, odds, utility = self._judge(*(x[:, None] for x in sums))
        half = np.sinh(_Z95 * std[:, 0])
        names = EXCHANGED
        return Outlook(
            {name: float(np.exp(np.log(half[:, i]).mean())) for i, name in enumerate(names)},
            {name: (float(half[:, i].min()), float(half[:, i].max())) for i, name in enumerate(names)},
            odds[:, 0],
            utility[0],
        )

    def _judge(
        self, A: np.ndarray, B: np.ndarray, b: np.ndarray, c: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Standard errors (D, K, m) of logarithms, log-odds (D, K), utility (K, 4), of K protocols by their sums.

        Args:
            A, B: (D, K, n, n). b: (D, K, n). c: (D, K).
        """
        P, p, pp, p_image, pp_image = self._prior
        M = A + np.diag(P)
        covariance = np.linalg.inv(M)
        own = np.einsum("dmi,dkij,dlj->dkml", self._L, covariance, self._L)
        std = np.sqrt(np.einsum("dkmm->dkm", own))
        information = -0.5 * np.linalg.slogdet(own)[1].mean(0)
        # of the branch: what the best foot near the mirror image misses, less what the prior costs the foot itself
        bent = b + p_image[:, None]
        missed = c + pp_image[:, None] - np.einsum("dki,dki->dk", bent, _solved(B + np.diag(P), bent))
        kept = pp[:, None] - np.einsum("di,dkij,dj->dk", p, covariance, p)
        odds = 0.5 * (missed - kept)
        branch = np.clip(odds / _DECISIVE, 0.0, 1.0).mean(0)
        rivals = np.zeros(A.shape[1])
        for group in self._rivals.values():
            block = np.linalg.inv(covariance[..., group[:, None], group]) - np.diag(P[group])
            rivals += np.clip(0.5 * block.sum((-1, -2)) / _DECISIVE, 0.0, 1.0).mean(0) / len(self._rivals)
        asked = getattr(self, "asked", None)
        if asked is None:
            over = np.zeros(std.shape[1])
        else:
            wanted = np.array([asked[name] for name in EXCHANGED])
            over = np.maximum(0.0, np.log(np.sinh(np.minimum(_Z95 * std, 50.0)) / wanted).max(-1)).mean(0)
        return std, odds, np.stack([information, branch, rivals, -over], axis=1)

    @cached_property
    def _rivals(self) -> dict[str, np.ndarray]:
        """Places of the sizes of each departure that is not excluded."""
        index, found = self._sight.space.index, {}
        for group, names in _SIZES.items():
            at = [i for name, i in index.items() if any(name == n or (n == " under " and n in name) for n in names)]
            if at:
                found[group] = np.array(at)
        return found

    # proposals

    def scores(self, steps: Sequence[Step]) -> list[Score]:
        """What each candidate adds to what is done and to steps."""
        return [Score(*row) for row in self._gains(self._counts(steps, False))]

    def gains(self, steps: Sequence[Step]) -> np.ndarray:
        """Total score (K,) of steps of any length, each alone beside what is done."""
        now = self.outlook(()).utility.sum()
        return np.array([self.outlook([step]).utility.sum() - now for step in steps])

    def _gains(self, counts: np.ndarray) -> np.ndarray:
        """(K, 4) by candidate."""
        at = np.flatnonzero(counts)
        parts = [np.tensordot(counts[at], x[:, at], (0, 1)) for x in (self._A, self._B, self._b, self._c)]
        places = [self._place[self._unit(step)] for step in self.candidates]
        sums = [s[:, None] + x[:, places] for s, x in zip(parts, (self._A, self._B, self._b, self._c), strict=True)]
        return self._judge(*sums)[2] - self._judge(*(s[:, None] for s in parts))[2]

    def next(self, steps: Sequence[Step] = (), same_load: float | None = None) -> tuple[Step, Score]:
        """The candidate that adds most to what is done and to steps.

        Args:
            steps: planned before it. same_load: stay with this load on the knee.
        """
        gains = self._gains(self._counts(steps, False))
        total = gains.sum(1)
        if same_load is not None:
            keep = np.array([step.added_mass_kg == same_load for step in self.candidates])
            total = np.where(keep, total, -np.inf)
        best = int(np.argmax(total))
        if not np.isfinite(total[best]):
            raise SettingError(f"no candidate has {same_load:g} kg on the knee.")
        return self.candidates[best], Score(*gains[best])

    def met(self, outlook: Outlook) -> bool:
        """The branch is expected to be decided and the asked intervals are met."""
        narrow = all(outlook.half_width[name] <= self.asked[name] for name in EXCHANGED)
        return narrow and outlook.decided >= SHARE

    def session(self, most: int, seconds: float) -> tuple[Step, ...]:
        """A whole session, in the order of its loads.

        Pieces of the usual length are added one by one until what is asked is expected to be met, then exchanged while
        that gains. Pieces that are alike make one longer recording.

        Args:
            most: recordings. seconds: of shaking in all.

        Raises:
            SettingError: not even one recording fits in.
        """
        pieces = int(seconds / self.shaker.seconds + 1e-9)
        if most < 1 or pieces < 1:
            raise SettingError(
                f"{most} recordings in {seconds:g} s leave no room for {self.shaker.seconds:g} s; "
                "give more or shorter ones."
            )
        chosen: list[int] = []
        for _ in range(_ROUNDS):
            while len(chosen) < pieces and not (chosen and self.met(self.outlook(self._steps(chosen)))):
                chosen.append(self._best(chosen, most)[0])
            if not self._exchange(chosen, most):
                break
        while len(chosen) < pieces and not self.met(self.outlook(self._steps(chosen))):
            chosen.append(self._best(chosen, most)[0])
        steps = [replace(self.candidates[i], seconds=n * self.shaker.seconds) for i, n in Counter(chosen).items()]
        return tuple(sorted(steps, key=lambda s: (s.added_mass_kg, s.frequency_hz, -s.amplitude_m_s2, s.kind)))

    def _exchange(self, chosen: list[int], most: int) -> bool:
        """Replace each piece by what adds more beside all the others; whether any was."""
        changed = False
        for number, now in enumerate(chosen):
            best, gains = self._best(chosen[:number] + chosen[number + 1 :], most)
            if gains[best] > gains[now] + _WORTH:
                chosen[number], changed = best, True
        return changed

    def _steps(self, chosen: Sequence[int]) -> list[Step]:
        return [self.candidates[i] for i in chosen]

    def _best(self, chosen: Sequence[int], most: int) -> tuple[int, np.ndarray]:
        """The candidate that adds most to those chosen, of so many different ones, and what each adds (C,)."""
        gains = self._gains(self._counts(self._steps(chosen), False)).sum(1)
        there = sorted(set(chosen))
        if len(there) < most:
            return int(np.argmax(gains)), gains
        return there[int(np.argmax(gains[there]))], gains


def _solved(M: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.solve(M, b[..., None]))[..., 0]


def step_of(recording: Recording) -> Step:
    """An earlier recording as the step that it was."""
    line = Line.of(recording)
    condition = recording.condition
    length = recording.time_s.size / recording.rate_hz
    return Step(SINE, line.base.frequency_hz, condition.added_mass_kg, float(abs(line.base.amplitudes[0])), length)
