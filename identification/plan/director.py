"""Which recording is worth making next: scores of every candidate over feet that could be the person's (`Feet`).

The feet are drawn from the prior or, after recordings, from what they leave possible. Each purpose has
random numbers of its own, so that the same seed draws the same feet whatever the candidates are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from fasbody.exceptions import SettingError, SimulationError, unknown
from fasbody.presentation import counted
from fasbody.recording.known import DEPARTURES
from fasbody.recording.recording import Recording
from fasbody.sentences import Sentence, called
from identification.branches import EXCHANGED
from identification.engines.twin import carriers
from identification.harmonics import Line
from identification.plan.belief import Belief, believe
from identification.plan.candidates import ADDED_MASSES_KG, Step, candidates, thesis, within
from identification.plan.feet import Cause, Feet, Outlook, Score, Sums
from identification.plan.information import Seen, Sight
from identification.plan.prior import Person, PlanVariables, stream
from identification.plan.shaker import (
    NOISE_M_S2,
    NOISE_STD,
    REPEATABILITY,
    REPEATABILITY_STD,
    SINE,
    Shaker,
)
from identification.sensors import MALLEOLUS

#: Feet over which scores are averaged: of the prior, and of what recordings leave possible, which are
#: more alike.
DRAWS, FEWER = 32, 12
#: What is asked counts as met by a plan at this probability, and as out of reach below the second one.
SHARE, HOPELESS = 0.9, 0.05
#: Half-widths of the 95 % intervals that are asked for where nobody asks, whatever the rig and the
#: person: what the thesis' three loads leave of most feet with the usual noise where a person repeats
#: exactly, and rounder.
GOAL = {"k_T": 0.03, "k_F": 0.03, "c_11": 0.06, "c_21": 0.06}
#: As narrow as the thesis' three loads means within this factor.
AS_THESIS = 1.05
#: The search of a session. Rounds in which its recordings are exchanged, and the gain in nats that is
#: worth a change; below the second one two ways are equally good.
_ROUNDS, _LEAST_GAIN, _ALIKE = 5, 1e-3, 1e-9
#: Feet that search; which session is best is judged by all, and where nothing departs all exchange once
#: more.
_SEARCHING = 8
#: A protocol that goes on for ever has every candidate so often, and oftener until the noise of all of
#: them together is that of a sample with this rms [m/s^2], and their scatter this share: far below any
#: sensor and any person.
_FOR_EVER, _SILENT, _STILL = 1e4, 1e-3, 1e-5
#: From this share of a constant's variance on, a cause is named.
_NAMED = 0.1
#: What is uncertain of every session, unless it is exact.
_INSTRUMENT = ("masses", "gain", "delay")
#: Candidates in a session that has a little of everything, and how long it is in all [s].
_LITTLE, _USUAL_S = 9, 270.0
#: Draws of feet that have no steady motion before it is given up.
_TRIES = 10

#: A recording of a plan while it is searched: the place of its candidate, and its length in pieces.
_Planned = tuple[int, int]


class Director:
    """Scores recordings that could be made of a person, and proposes.

    Args:
        person: on the shaker.
        shaker: its limits.
        ask: half-widths that are asked for, by constant, as a share; a constant that is not named is not asked for, and
            where none is named `GOAL` is.
        earlier: recordings that exist, as steps that were done and what they say.
        seed: of the draws.
        draws: how many feet, 0 for the usual.
        believed: what earlier recordings were taken for before, to go on from.
        compares: the thesis' protocol is looked at, too.

    Attributes:
        asked: half-widths by constant.
        uncertain: groups of what is not known beforehand, beside the foot's constants.
        noise_m_s2: of a sample, as stated, recorded or usual: the middle one of the feet.
        repeatability: of recordings, likewise.
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
        draws = draws or (FEWER if earlier else DRAWS)
        _refuse(person, shaker, ask or {}, earlier, draws)
        # nobody's recordings are this person's: of another they would have masses of their own
        earlier = [
            replace(r, condition=replace(r.condition, subject=person.name)) for r in earlier
        ]
        self.person, self.shaker, self.seed = person, shaker, seed
        self.candidates = candidates(shaker, person.leg_kg)
        self.done = tuple(map(step_of, earlier))
        # the order of the session, the starts of the belief, and the feet
        self._order, starts, self._stream = np.random.SeedSequence([seed, len(earlier)]).spawn(3)
        compared = self.thesis() if compares else ()
        every = tuple(dict.fromkeys(map(self._unit, [*self.candidates, *compared, *self.done])))
        self._place = {step: i for i, step in enumerate(every)}  # of each step, the candidates first
        self._earlier = tuple(earlier)
        allowed = person.allowed(every, earlier, shaker.rate_hz)
        groups = {item.group for item in allowed}
        self.uncertain = tuple(name for name in (*_INSTRUMENT, *DEPARTURES) if name in groups)
        self._middle_hz = float(np.sqrt(shaker.lowest_hz * shaker.highest_hz))
        self.belief: Belief | None = None
        noise, repeats = NOISE_M_S2, REPEATABILITY
        std = np.array([NOISE_STD, REPEATABILITY_STD / np.sqrt(1 + len(earlier))])
        if earlier:
            expected = repeats if shaker.repeatability is None else shaker.repeatability
            self.belief = believe(
                person, earlier, allowed, self._middle_hz, expected, starts, believed
            )
            lines = [Line.of(recording) for recording in earlier]
            sigma = [(line.base.sigma, line.malleolus.sigma) for line in lines]
            noise = float(np.clip(np.sqrt(np.mean(np.square(sigma))), 1e-6, 10.0))
            repeats, std[0] = min(self.belief.repeatability, 0.5), 0.0
        stated = np.array([shaker.noise_m_s2 is not None, shaker.repeatability is not None])
        self._scatter_std = np.where(stated, 0.0, std)
        self.noise_m_s2 = noise if shaker.noise_m_s2 is None else shaker.noise_m_s2
        self.repeatability = repeats if shaker.repeatability is None else shaker.repeatability
        self._sight = self._sees(every)
        self._feet = Feet(self._drawn(draws), self._sight.variables)
        self._scored: dict[tuple[object, ...], dict[_Planned, float]] = {}  # see `_gains`
        self.asked: dict[str, float] = {}
        self.aim(ask or GOAL)

    @property
    def feet(self) -> int:
        """Over how many feet the scores are averaged."""
        return len(self._feet.seen.q)

    def aim(self, ask: Mapping[str, float]) -> None:
        """Ask for other half-widths, by constant, and for no others."""
        _refuse_ask(ask)
        self._feet.asked = self.asked = {name: ask[name] for name in EXCHANGED if name in ask}

    def thesis(self, loads_kg: tuple[float, ...] = ADDED_MASSES_KG) -> tuple[Step, ...]:
        """The thesis' protocol as far as this shaker can do it, with the sensors that are worn here."""
        steps = [replace(step, sensors=self.shaker.sensors) for step in thesis(loads_kg)]
        return within(self.shaker, self.person.leg_kg, steps)

    def as_thesis(self) -> dict[str, float]:
        """Half-widths as the thesis' three loads would leave them here of a middle foot, within 5 %; to aim at.

        Raises:
            SettingError: this shaker makes none of its sines.
        """
        steps = self.thesis()
        if not steps:
            raise SettingError("this shaker makes none of the thesis' sines of 10 to 50 Hz; ask for intervals by name.")
        return {n: AS_THESIS * width for n, width in self.outlook(steps, fresh=True).half_width.items()}

    # feet

    def _sees(self, steps: Sequence[Step]) -> Sight:
        """Some steps, in a drawn order, with all that is allowed for in any step."""
        allowed = self.person.allowed([*self._place, *steps], self._earlier, self.shaker.rate_hz)
        order = np.random.default_rng(self._order)
        return Sight(self.person, steps, self.shaker, allowed, order, self._middle_hz)

    def _drawn(self, count: int) -> Seen:
        """So many feet that have a steady motion: of either branch in turn, or of what recordings leave possible."""
        seen: Seen | None = None
        for first in range(0, _TRIES * count, count):
            numbers = range(first, first + count)
            Q = np.stack([self._draw(number) for number in numbers])
            scatter = np.stack([self._scatter(number) for number in numbers])
            rivals = self._rivals(Q, scatter, self._sight.variables, self._little())
            more = self._sight.see(Q, *rivals, scatter)
            seen = more if seen is None else seen.joined(more)
            if len(seen.q) >= count:
                return seen.rows(slice(count))
        raise SimulationError("too few feet of the population move steadily on this shaker; lower its amplitude.")

    def _rivals(
        self, Q: np.ndarray, scatter: np.ndarray, variables: PlanVariables, little: Sequence[Step]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Rivals (D, n) of feet Q and what of them is at a bound: mirror images, or where a session leads these."""
        if self._departs:
            return self._sees(little).rivals(Q, scatter)
        return variables.image(Q), np.zeros(Q.shape, bool)

    def _scatter(self, number: int) -> np.ndarray:
        """(2,) noise [m/s^2] and repeatability of a foot's recordings."""
        seed = stream(stream(self._stream, str(number)), "scatter")
        factors = np.exp(self._scatter_std * np.random.default_rng(seed).standard_normal(2))
        return np.array([self.noise_m_s2, self.repeatability]) * factors

    def _draw(self, number: int) -> np.ndarray:
        seed, variables = stream(self._stream, str(number)), self._sight.variables
        if self.belief is None:
            return variables.draw(seed, 1 if number % 2 else -1)
        return variables.carried(self.belief.draw(seed), self.belief.variables)

    @property
    def _departs(self) -> bool:
        """Whether departures of the world from the model are allowed for."""
        return bool(self._sight.variables.departing.any())

    def _little(self) -> tuple[Step, ...]:
        """What is done, and a session with a little of everything: about `_LITTLE` candidates, usual minutes in all."""
        few = self.candidates[:: -(-len(self.candidates) // _LITTLE)]
        return tuple(dict.fromkeys([*self.done, *(replace(step, seconds=_USUAL_S / len(few)) for step in few)]))

    # what is expected

    def _unit(self, step: Step) -> Step:
        return replace(step, seconds=self.shaker.seconds)

    def _sums(self, steps: Sequence[Step], fresh: bool = False) -> Sums:
        """Steps as the feet judge them; with what is done unless fresh."""
        steps = [*(() if fresh else self.done), *steps]
        for step in steps:
            if self._unit(step) not in self._place:
                raise SettingError(f"{step} is no candidate of this director, nor of the thesis.")
        places = [self._place[self._unit(step)] for step in steps]
        return self._feet.sums(places, [step.seconds / self.shaker.seconds for step in steps])

    def outlook(self, steps: Sequence[Step], fresh: bool = False) -> Outlook:
        """What is expected after steps, beside those that are done (not if fresh)."""
        return self._feet.outlook(self._sums(steps, fresh))

    @property
    def offers(self) -> tuple[str, ...]:
        """Accelerometers of the model that are not worn and could be."""
        return tuple(name for name in carriers(self.person.foot) if name not in self.shaker.sensors)

    def wearing(self, sensor: str, steps: Sequence[Step]) -> Outlook:
        """What is expected after steps if one more sensor is worn in them; of the same feet.

        The sensor brings a gain, a delay, and what else is allowed for, of its own. Recordings that exist lack it.
        """

        def wears(steps: Sequence[Step]) -> list[Step]:
            return [
                step if step in self.done else replace(step, sensors=(*self.shaker.sensors, sensor))
                for step in steps
            ]

        worn, seen = wears(steps), self._feet.seen
        every = tuple(dict.fromkeys([*self.done, *worn]))
        sight = self._sees(every)
        q = sight.variables.carried(seen.q, self._sight.variables)
        rivals = self._rivals(q, seen.scatter, sight.variables, tuple(wears(self._little())))
        feet = Feet(sight.see(q, *rivals, seen.scatter), sight.variables)
        feet.asked = self.asked
        places = [every.index(step) for step in [*self.done, *worn]]
        return feet.outlook(feet.sums(places, np.ones(len(places))))

    def excluding(self, steps: Sequence[Step]) -> dict[str, dict[str, float]]:
        """Half-widths by constant after steps, if one group of what is uncertain were known beforehand, by its name."""
        variables, sums = self._sight.variables, self._sums(steps)
        return {
            group: self._feet.excluding(
                sums, [variables.place(item) for item in variables.nuisances if item.group == group]
            )
            for group in self.uncertain
        }

    def for_ever(self) -> Outlook:
        """What is expected if every candidate were recorded until no noise is left: what stays is not in the motion."""
        return self._feet.outlook(self._for_ever)

    def causes(self) -> dict[str, tuple[Cause, ...]]:
        """What keeps each constant uncertain then: what has a tenth of its variance or more, the largest first."""
        causes = self._feet.causes(self._for_ever)
        return {name: tuple(cause for cause in items if cause.share >= _NAMED) for name, items in causes.items()}

    @cached_property
    def _for_ever(self) -> Sums:
        """What is done, and every candidate recorded as good as for ever."""
        return self._sums(()) + self._longest * self._sums(self.candidates, fresh=True)

    @property
    def _longest(self) -> float:
        noise, repeatability = self._feet.seen.scatter.max(axis=0)
        return max(_FOR_EVER, float(noise / _SILENT) ** 2, float(repeatability / _STILL) ** 2)

    def times(self, steps: Sequence[Step], names: Sequence[str], branch: bool) -> float:
        """How often steps must be recorded until named constants are as asked.

        If `branch`, that must be decided, too. Infinite where it is never.
        """
        done, more = self._sums(()), self._sums(steps, fresh=True)

        def enough(times: float) -> bool:
            return self._feet.outlook(done + times * more).goal(names, branch) >= SHARE

        low, high = 0.0, 1.0
        while not enough(high):
            low, high = high, 2 * high
            if high > self._longest:
                return float("inf")
        while high - low > 0.01 * high:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if enough(middle) else (middle, high)
        return high

    # proposals

    def scores(self, steps: Sequence[Step]) -> list[Score]:
        """What each candidate adds to what is done and to steps."""
        once = [(i, 0.0) for i in range(len(self.candidates))]
        return [Score(*row) for row in self._feet.gains(self._sums(steps), [], once)]

    def gains(self, steps: Sequence[Step]) -> np.ndarray:
        """Total score (K,) of steps of any length, each alone beside what is done."""
        now = self.outlook(()).utility.sum()
        return np.array([self.outlook([step]).utility.sum() - now for step in steps])

    def met(self, outlook: Outlook) -> bool:
        """The branch is decided and the asked intervals are met, with a probability of `SHARE`."""
        return outlook.goal() >= SHARE

    def session(self, most: int, seconds: float) -> tuple[Step, ...]:
        """A whole session, in the order of its loads.

        The time is divided into pieces of the usual length; a recording is one or more of them. A
        condition may be recorded again, which averages out how a person scatters.

        1. Pieces are added one by one, each where it adds most, until what is asked is likely to be
           met (`_grown`).
        2. Whole recordings are put elsewhere, and single pieces moved from one to another, while that
           gains; pieces that the goal does not need are taken out (`_polished`).
        A few of the feet search. Where nothing departs from the model, step 2 is done once more by all
        of them; else there are twice the unknowns, and that is not worth its time.

        Args:
            most: recordings.
            seconds: of shaking in all.

        Raises:
            SettingError: not even one recording fits in.
        """
        pieces = int(seconds / self.shaker.seconds + 1e-9)
        if most < 1 or pieces < 1:
            raise SettingError(
                f"{seconds:g} s for {counted(most, 'recording')} leave no room for one of {self.shaker.seconds:g} s; "
                "give more time, or shorter ones."
            )
        self._scored.clear()
        few = min(_SEARCHING, self.feet)
        best = self._polished(self._grown((), most, pieces, few), most, pieces, few)
        if not self._departs:
            best = max(best, self._polished(best, most, pieces, self.feet), key=self._rank)
        return tuple(
            sorted(self._steps(best), key=lambda s: (s.added_mass_kg, s.frequency_hz, -s.amplitude_m_s2, s.kind))
        )

    # the search: plans are sorted recordings, most is of recordings, feet is by how many is scored

    def _polished(
        self, plan: tuple[_Planned, ...], most: int, pieces: int, feet: int
    ) -> tuple[_Planned, ...]:
        """The best session that exchanges lead to from a plan, without pieces that the goal does not need."""
        for _ in range(_ROUNDS):
            before = plan
            for recording in sorted(plan, key=lambda r: r[1]):  # whole recordings, the shortest first
                plan = self._exchanged(plan, recording, recording[1], most, feet)
            if plan != before:  # single pieces only once whole recordings have their places
                continue
            for recording in plan:
                plan = self._exchanged(plan, recording, 1, most, feet)
            plan = self._grown(plan, most, pieces, feet)
            if plan == before:
                break
        while self._met(plan):
            fewer = [_without(plan, recording, 1) for recording in dict.fromkeys(plan)]
            fewer = [shorter for shorter in fewer if shorter and self._met(shorter)]
            if not fewer:
                break
            plan = max(fewer, key=self._rank)
        return plan

    def _grown(
        self, plan: tuple[_Planned, ...], most: int, pieces: int, feet: int
    ) -> tuple[_Planned, ...]:
        """A plan with more pieces, one by one, until what is asked is likely to be met or none is left."""
        while sum(n for _, n in plan) < pieces and not (plan and self._met(plan)):
            plan = _with(plan, _best(self._gains(plan, 1, most, feet)), 1)
        return plan

    def _exchanged(
        self, plan: tuple[_Planned, ...], recording: _Planned, pieces: int, most: int, feet: int
    ) -> tuple[_Planned, ...]:
        """A plan with so many pieces of one recording put where they add most, if that is worth it."""
        if recording not in plan:  # an exchange before this one has changed it
            return plan
        rest, (place, whole) = _without(plan, recording, pieces), recording
        gains = self._gains(rest, pieces, most, feet)
        best = _best(gains)
        worth = gains[best] > gains[place, whole - pieces] + _LEAST_GAIN
        return _with(rest, best, pieces) if worth else plan

    def _gains(
        self, plan: tuple[_Planned, ...], pieces: int, most: int, feet: int
    ) -> dict[_Planned, float]:
        """What pieces add to a plan [nat], as a longer recording or as one more (place, 0)."""
        more = range(len(self.candidates)) if len(plan) < most else ()
        options = [*dict.fromkeys(plan), *((place, 0) for place in more)]
        key = plan, pieces, bool(more), feet
        if key not in self._scored:
            gains = self._feet.gains(self._sums(()), plan, options, pieces, feet).sum(1)
            self._scored[key] = dict(zip(options, map(float, gains), strict=True))
        return self._scored[key]

    def _met(self, plan: tuple[_Planned, ...]) -> bool:
        return self.met(self.outlook(self._steps(plan)))

    def _rank(self, plan: tuple[_Planned, ...]) -> tuple[bool, int, float]:
        """Better sessions rank higher: those that meet the goal, by less shaking; then by the score of all feet."""
        outlook = self.outlook(self._steps(plan))
        met = self.met(outlook)
        return met, -sum(n for _, n in plan) if met else 0, float(outlook.utility.sum())

    def _steps(self, plan: tuple[_Planned, ...]) -> list[Step]:
        return [replace(self.candidates[i], seconds=n * self.shaker.seconds) for i, n in plan]


def _best(gains: Mapping[_Planned, float]) -> _Planned:
    """The first of those that gain most: recordings that become longer stand before new ones."""
    most = max(gains.values())
    return next(option for option, gain in gains.items() if gain > most - _ALIKE)


def _without(
    plan: tuple[_Planned, ...], recording: _Planned, pieces: int
) -> tuple[_Planned, ...]:
    rest, (place, whole) = list(plan), recording
    rest.remove(recording)
    return tuple(sorted([*rest, (place, whole - pieces)] if whole > pieces else rest))


def _with(plan: tuple[_Planned, ...], option: _Planned, pieces: int) -> tuple[_Planned, ...]:
    rest, (place, whole) = list(plan), option
    if whole:
        rest.remove(option)
    return tuple(sorted([*rest, (place, whole + pieces)]))


def _refuse(person: Person, shaker: Shaker, ask: Mapping[str, float], earlier: Sequence[Recording], draws: int) -> None:
    _refuse_ask(ask)
    available = [name for name in person.foot.sensors if name != "base"]
    for name in shaker.sensors:
        if name not in available:
            raise SettingError(f"{unknown('sensor', name, available)} in model {person.foot.name}.")
    if shaker.sensors[:1] != MALLEOLUS:
        raise SettingError("the malleolus is always worn; name it first, malleolus,foot for example.")
    if len(set(shaker.sensors)) < len(shaker.sensors):
        raise SettingError(f"the sensors {', '.join(shaker.sensors)} have one twice; name each once.")
    if draws < 2:
        raise SettingError(f"the number of draws is {draws}, no average over feet; give 2 or more.", "draws")
    for recording in earlier:
        whose = recording.condition
        if whose.body_mass_kg is None:
            of = f" of subject {whose.subject!r}" if whose.subject else ""
            text = f"{recording.file} states no body mass, which a plan needs: fill in mass_kg{of} in subjects.csv, "
            raise SettingError(Sentence(text, "or give ", called("body_mass"), "."))
        if whose.subject not in ("", person.name) or whose.body_mass_kg != person.body_mass_kg:
            raise SettingError(
                f"{recording.file} is of subject {whose.subject!r} with {whose.body_mass_kg} kg, and the plan is "
                f"for {person.name!r} with {person.body_mass_kg:g} kg; plan for the person who was recorded."
            )


def _refuse_ask(ask: Mapping[str, float]) -> None:
    for name, share in ask.items():
        if name not in EXCHANGED:
            raise SettingError(f"{unknown('constant to ask for', name, EXCHANGED)}.")
        if not 0 < share < 10:
            raise SettingError(f"the half-width asked for {name} is {share:g}; give a share, 0.05 for +-5 %.", "ask")


def step_of(recording: Recording) -> Step:
    """An earlier recording as the step that it was."""
    line = Line.of(recording)
    condition = recording.condition
    length = recording.time_s.size / recording.rate_hz
    return Step(SINE, line.base.frequency_hz, condition.added_mass_kg, float(abs(line.base.amplitudes[0])), length)
