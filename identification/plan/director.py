"""Which recording is worth making next: scores of every candidate over feet that could be the person's (`Feet`).

The feet are drawn from the prior or, after recordings, from what they leave possible. Each purpose has random numbers
of its own, so that the same seed draws the same feet whatever the candidates are.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fasbody.exceptions import SettingError, SimulationError, unknown
from fasbody.recording.known import DEPARTURES
from fasbody.recording.recording import Recording
from identification.branches import EXCHANGED
from identification.engines.twin import carriers
from identification.periodic import Line
from identification.plan.belief import Belief, believe
from identification.plan.candidates import Candidates, Step, thesis
from identification.plan.feet import Feet, Outlook, Score
from identification.plan.information import Seen, Sight
from identification.plan.prior import Person, stream
from identification.plan.shaker import SINE, Shaker
from identification.sensors import MALLEOLUS

#: Feet over which scores are averaged: of the prior, and of what recordings leave possible, where they are more alike.
DRAWS, FEWER = 32, 12
#: A branch counts as decided for a plan where so large a share of the feet is.
SHARE = 0.9
#: What is not asked for is to be as narrow as the thesis' three loads make it, within this factor:
#: 15 % are allowed for feet that are not the population's, and the rest is room for the difference.
AS_THESIS = 1.05
#: Rounds of exchange of a whole session, and the gain in nats that is worth one.
_ROUNDS, _WORTH = 3, 1e-3
#: A protocol that goes on for ever has every candidate so often, and oftener until the noise of all of them together
#: is that of a sample with this rms [m/s^2], far below that of any sensor.
_FOR_EVER, _SILENT = 1e4, 1e-3
#: Draws of feet that have no steady motion before it is given up.
_TRIES = 10


class Director:
    """Scores recordings that could be made of a person, and proposes.

    Args:
        person: on the shaker. shaker: its limits. ask: half-widths that are asked for, by constant, as a share; those
            that are not named are as narrow as the thesis' three loads are expected to make them, within 5 %.
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
        order, starts, feet = np.random.SeedSequence([seed, len(earlier)]).spawn(3)
        compared = thesis() if compares or set(ask or {}) != set(EXCHANGED) else ()
        every = tuple(dict.fromkeys(map(self._unit, [*self.candidates, *compared, *self.done])))
        self._place = {step: i for i, step in enumerate(every)}
        allowed = person.allowed(every, earlier, shaker.rate_hz)
        middle = float(np.sqrt(shaker.lowest_hz * shaker.highest_hz))
        self._earlier, self._order = tuple(earlier), order
        self._sight = Sight(person, every, shaker, allowed, np.random.default_rng(order), middle)
        self.belief = believe(person, earlier, allowed, middle, starts, believed) if earlier else None
        self._feet = Feet(self._draws(draws, feet), self._sight.space, len(self.candidates))
        self._gained: dict[tuple[int, ...], np.ndarray] = {}
        given = dict(ask or {})
        usual = self.outlook(thesis(), fresh=True).half_width if compared else given
        self.asked = {name: given.get(name, AS_THESIS * usual[name]) for name in EXCHANGED}
        self._feet.asked, self.told = self.asked, tuple(given)

    @property
    def feet(self) -> int:
        """Over how many feet the scores are averaged."""
        return len(self._feet.seen)

    @property
    def allowed(self) -> tuple[str, ...]:
        """Departures of the world from the model that are allowed for."""
        return tuple(group for group in DEPARTURES if group not in self.person.known.excluded)

    def _draws(self, count: int, seed: np.random.SeedSequence) -> list[Seen]:
        feet: list[Seen] = []
        for number in range(_TRIES * count):
            own, sign = stream(seed, str(number)), 1 if number % 2 else -1
            q = self._sight.space.draw(own, sign) if self.belief is None else self.belief.draw(own)
            seen = self._sight.see(q)
            if seen is not None:
                feet.append(seen)
            if len(feet) == count:
                return feet
        raise SimulationError("too few feet of the population move steadily on this shaker; lower its amplitude.")

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
        return self._feet.outlook(self._counts(steps, fresh))

    @property
    def offers(self) -> tuple[str, ...]:
        """Accelerometers of the model that are not worn and could be."""
        return tuple(name for name in carriers(self.person.foot) if name not in self.shaker.sensors)

    def wearing(self, sensor: str, steps: Sequence[Step]) -> Outlook:
        """What is expected after steps if one more sensor is worn in them; of the same feet.

        The sensor brings a gain, a delay, and what else is allowed for, of its own. Recordings that exist lack it.
        """
        shaker = replace(self.shaker, sensors=(*self.shaker.sensors, sensor))
        worn = [*self.done, *(replace(step, sensors=shaker.sensors) for step in steps)]
        every = tuple(dict.fromkeys(map(self._unit, worn)))
        allowed = self.person.allowed([*self._place, *every], self._earlier, shaker.rate_hz)
        sight = Sight(
            self.person, every, shaker, allowed, np.random.default_rng(self._order), self._sight.space.middle_hz
        )
        before, now, mean = self._sight.space.index, sight.space.index, sight.space.prior[0]
        seen = []
        for foot in self._feet.seen:
            q = np.array([foot.q[before[name]] if name in before else mean[i] for name, i in now.items()])
            seen.append(sight.see(q))
        feet = Feet([foot for foot in seen if foot is not None], sight.space, len(every))
        feet.asked = self.asked
        counts = np.zeros(len(every))
        for step in worn:
            counts[every.index(self._unit(step))] += step.seconds / shaker.seconds
        return feet.outlook(counts)

    def for_ever(self) -> Outlook:
        """What is expected if every candidate were recorded until no noise is left: what stays is not in the motion."""
        return self._feet.outlook(self._counts((), False) + self._longest * self._counts(self.candidates, True))

    @property
    def _longest(self) -> float:
        return max(_FOR_EVER, (self.shaker.noise_m_s2 / _SILENT) ** 2)

    def times(self, steps: Sequence[Step], names: Sequence[str], branch: bool) -> float:
        """How often steps must be recorded until some intervals are as asked; infinite where that is never.

        Args:
            steps: together, beside what is done. names: of the constants. branch: whether it must be decided as well.
        """
        done, more = self._counts((), False), self._counts(steps, True)

        def enough(times: float) -> bool:
            outlook = self._feet.outlook(done + times * more)
            narrow = all(outlook.half_width[name] <= self.asked[name] for name in names)
            return narrow and (outlook.decided >= SHARE or not branch)

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
        return [Score(*row) for row in self._feet.gains(self._counts(steps, False))]

    def gains(self, steps: Sequence[Step]) -> np.ndarray:
        """Total score (K,) of steps of any length, each alone beside what is done."""
        now = self.outlook(()).utility.sum()
        return np.array([self.outlook([step]).utility.sum() - now for step in steps])

    def next(self, steps: Sequence[Step] = ()) -> tuple[Step, Score]:
        """The candidate that adds most to what is done and to steps planned before it."""
        gains = self._feet.gains(self._counts(steps, False))
        best = int(np.argmax(gains.sum(1)))
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
        self._gained.clear()
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
        key = tuple(sorted(chosen))
        if key not in self._gained:  # pieces of one recording are alike
            self._gained[key] = self._feet.gains(self._counts(self._steps(chosen), False)).sum(1)
        gains, there = self._gained[key], sorted(set(chosen))
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
