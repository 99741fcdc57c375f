"""The experiment director against closed forms, finite differences, its own limits, and acquire's virtual bench."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pytest
import typer
from scipy.optimize import minimize
from typer.testing import CliRunner

from fasbody.acquire.board import Stalled
from fasbody.acquire.commands import app as acquire
from fasbody.acquire.level import COMMANDED, Safety
from fasbody.acquire.plan import PROTOCOL, PlannedSession
from fasbody.constants import Z95
from fasbody.exceptions import FasError, InputFileError, SettingError
from fasbody.foot.model import load
from fasbody.foot.two_dof import TwoDof
from fasbody.recording.checks import checked
from fasbody.recording.known import DEPARTURES, Known
from fasbody.recording.recording import Recording
from fasbody.recording.study import Study
from identification.branches import EXCHANGED
from identification.fitting import fit_foot
from identification.nuisances import FOOT_STD, SHANK_STD
from identification.plan import session
from identification.plan.__main__ import _of, app
from identification.plan.belief import Belief
from identification.plan.candidates import (
    PLANNED,
    THESIS,
    UNLOADED,
    Step,
    candidates,
    exposure,
    shaking_s,
    thesis,
)
from identification.plan.director import SHARE, Director
from identification.plan.feet import WIDTH_STD, Cause, Feet, Outlook
from identification.plan.information import Seen, Sight
from identification.plan.observed import observed
from identification.plan.prior import LOSS_STD, STIFFNESS_STD, Person
from identification.plan.record import Offer
from identification.plan.result import Planned, believed, nothing_brings, planned
from identification.plan.session import FAILING, INTERRUPTED, MET, NEVER, SPENT, Offering, Session, Shaken
from identification.plan.shaker import NOISE_M_S2, NOISE_STD, REPEATABILITY, REPEATABILITY_STD, Shaker
from identification.residual import Problem
from identification.result import FitResult
from simulator.rig import SHORTER, Rig, Virtual, recorded, virtual

ALONE = Known().overruled_by(exclude=("all",))
#: A rig of which every recording repeats exactly, and one with a person on it.
SHAKER = Shaker(every_hz=5.0, loads_kg=(0.0, 4.5), repeatability=0.0)
PEOPLE = replace(SHAKER, repeatability=None)
FOOT = {"k_T": 1.5e5, "k_F": 1.0e5, "c_11": 300.0, "c_12": 0.0, "c_13": 0.0, "c_21": 400.0, "c_22": 0.0, "c_23": 0.0}


def person(body_mass_kg: float = 72.0, known: Known = ALONE) -> Person:
    return Person(load("two_dof"), body_mass_kg, known)


def owner(foot: Virtual, known: Known = ALONE) -> Person:
    """Who stands on the shaker with a foot of the simulator."""
    return Person(load("two_dof"), foot.body_kg, known, "made")


def shaken(foot: Virtual, steps: Sequence[Step], session: int = 5) -> list[Recording]:
    return [checked(r) for r in recorded(foot, steps, session)]


def as_thesis(seed: int = 0) -> Director:
    """A director that is asked for the intervals of the thesis' three loads."""
    director = Director(person(), SHAKER, draws=6, seed=seed)
    director.aim(director.as_thesis())
    return director


@pytest.fixture(scope="module")
def director() -> Director:
    return as_thesis()


@pytest.fixture(scope="module")
def plan(director: Director) -> Planned:
    return planned(director, 9, 270.0)


def sight(steps: list[Step], who: Person, shaker: Shaker = SHAKER) -> Sight:
    return Sight(who, steps, shaker, who.allowed(steps, (), 1000.0), np.random.default_rng(0), 25.0)


def scatter_of(shaker: Shaker) -> np.ndarray:
    noise = NOISE_M_S2 if shaker.noise_m_s2 is None else shaker.noise_m_s2
    return np.array([[noise, REPEATABILITY if shaker.repeatability is None else shaker.repeatability]])


def seen_of(eye: Sight, q: np.ndarray, shaker: Shaker = SHAKER) -> Seen:
    """A foot beside its mirror image, with the noise and the repeatability of a shaker."""
    held = np.zeros((1, q.size), bool)
    seen = eye.see(q[None], eye.variables.image(q[None]), held, scatter_of(shaker))
    assert len(seen.q) == 1  # both move
    return seen


# what a recording tells


@pytest.mark.parametrize("sensors", [("malleolus",), ("malleolus", "foot")])
def test_information_is_that_of_finite_differences_of_the_closed_form(sensors: tuple[str, ...]) -> None:
    """Of a linear foot: constants, masses, gains and delays, each nudged in the transmissibilities of Eq. (4.30)."""
    who = person()
    places = ((18.0, 0.0), (48.0, 0.0), (25.0, 2.3))
    steps = [Step("sine", hz, load_kg, 8.95, 10.0, sensors=sensors) for hz, load_kg in places]
    eye = sight(steps, who)
    variables = eye.variables
    q = variables.start(FOOT)
    seen = seen_of(eye, q)
    names = ["k_T", "k_F", "c_11", "c_21", "shank mass", "foot mass", "gain", "delay", "gain of foot", "delay of foot"]
    names = names[: 6 + 2 * len(sensors)]
    at = [variables.names.index(name) for name in names]
    stated = who.condition(steps[0]).masses

    def harmonics(x: np.ndarray, step: Step) -> np.ndarray:
        v = dict(zip(names, x, strict=True))
        a = stated["m_S"] / (stated["m_S"] + stated["m_F"])
        std = {"m_S": ("shank mass", SHANK_STD), "m_F": ("foot mass", FOOT_STD)}
        mass = {n: stated[n] * np.exp(size * v[kind]) for n, (kind, size) in std.items()}
        leg = TwoDof(
            np.exp(v["k_T"] + 0.5 * (v["k_F"] + np.log(a))), np.exp(v["k_T"] - 0.5 * (v["k_F"] + np.log(a))),
            np.exp(v["c_11"]), 0, 0, np.exp(v["c_21"]), 0, 0, mass["m_S"] + step.added_mass_kg, mass["m_F"],
        )  # fmt: skip
        s = 2j * np.pi * step.frequency_hz
        A, B, C = leg.state_space()
        z = np.linalg.solve(s * np.eye(4) - A, B)
        ratios = {"malleolus": C @ z, "foot": s**2 * z[1] + 1}
        late = {name: np.exp(-s * 1e-4 * v[kind]) for name, kind in zip(sensors, names[7::2], strict=True)}
        gain = {name: 1 + 0.01 * v[kind] for name, kind in zip(sensors, names[6::2], strict=True)}
        return np.array([ratios[name] * gain[name] * late[name] * 8.95 for name in sensors])

    for number, step in enumerate(steps):
        x = q[at]
        nudges = np.eye(len(at)) * 1e-4
        J = np.array([(harmonics(x + d, step) - harmonics(x - d, step)) / 2e-4 for d in nudges]).T
        std = NOISE_M_S2 * np.sqrt(2 / 10_000) * np.hypot(1, abs(harmonics(x, step)) / 8.95)
        expected = np.real((J / std[:, None]).conj().T @ (J / std[:, None]))
        found = Feet(seen, variables).sums([number], [1.0]).A[0]
        felt = [i for i in range(variables.size) if np.abs(seen.J[..., i]).any() or i < 8]
        found = found[np.ix_(*[[felt.index(i) for i in at]] * 2)]
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        assert np.abs((found - expected) / scale).max() < 1e-6
    np.testing.assert_array_equal(seen_of(eye, q).J, seen.J)  # nothing is left from before


def test_mirror_foot_of_a_linear_one_misses_nothing_without_load_and_much_under_it() -> None:
    eye = sight([Step("sine", hz, load_kg, 8.95, 10.0) for load_kg in (0.0, 4.5) for hz in (15.0, 30.0)], person())
    seen = seen_of(eye, eye.variables.start(FOOT))
    missed = (seen.missed**2 / seen.noise).sum(-1)[0]
    assert missed[:2].max() < 1e-3 < 100 < missed[2:].min()


@pytest.mark.parametrize("shaker", [SHAKER, PEOPLE])
def test_information_is_that_of_the_fits_problem(shaker: Shaker) -> None:
    """J^T J of `Problem.evaluate`, had the recordings been made of this foot, with noise and scatter."""
    steps = [Step("sine", hz, load_kg, 8.95, 10.0) for hz, load_kg in ((18.0, 0.0), (25.0, 2.3))]
    eye = sight(steps, person(known=Known()), shaker)
    q = eye.variables.draw(np.random.SeedSequence(3), 1)
    seen = seen_of(eye, q, shaker)
    read = eye.problem.predicted(q)
    noise, repeatability = scatter_of(shaker)[0]
    std = np.full(read.shape, noise * np.sqrt(2 / 10_000))
    measured = replace(eye.problem.measured, output=read, output_std=std, base_std=std[:, 0])
    made = Problem.of(measured, eye.variables, eye.problem.motion, repeatability)
    J = made.evaluate(q[None]).jacobian[0, : made.size]
    feet = Feet(seen, eye.variables)
    felt = [i for i in range(q.size) if np.abs(seen.J[..., i]).any()]
    found, expected = feet.sums([0, 1], [1.0, 1.0]).A[0], (J.T @ J)[np.ix_(felt, felt)]
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((found - expected) / size).max() < 1e-6


def test_people_are_recorded_again_and_not_longer() -> None:
    """Noise averages out over time, the scatter of a person over recordings."""
    director = Director(person(), PEOPLE, draws=4)
    step = director.candidates[3]
    twice, longer = (director.outlook(x).half_width["k_T"] for x in ([step, step], [replace(step, seconds=20.0)]))
    once = director.outlook([step]).half_width["k_T"]
    assert twice < longer < once
    # what a candidate adds that is planned already is that of a longer recording
    k = director.candidates.index(step)
    more = director._feet.gains(director._sums(()), [(k, 1.0)], [(k, 1.0), (k, 0.0)]).sum(1)
    alone = director.gains([step])[0]
    assert more[0] == pytest.approx(director.gains([replace(step, seconds=20.0)])[0] - alone)
    both = director.outlook([step, step]).utility.sum() - director.outlook(()).utility.sum()
    assert more[1] == pytest.approx(both - alone) and more[1] > more[0]


def test_least_uncertainty_is_that_of_the_scale_of_all_masses() -> None:
    """Springs, dampers, masses and the load's share may all be off by one factor: the motion is the same.

    What is left of its logarithm are the priors: masses 15 and 10 %, the share 15 %, the population's constants. The
    leg cannot carry more than the load, so that the factor has one side only.
    """
    director = Director(person(known=Known()), PEOPLE, draws=2)
    stiffness, losses = 1 / STIFFNESS_STD**2, 2 / LOSS_STD**2
    precision = 1 / SHANK_STD**2 + 1 / FOOT_STD**2 + 1 / 0.15**2 + stiffness + losses
    for width in director.for_ever().half_width.values():
        assert width == pytest.approx(np.sinh(0.5 * 1.96 / np.sqrt(precision)), rel=1e-2)


def test_what_is_half_normal_widens_an_interval_on_one_side() -> None:
    """Ends of the quadratic beside bounds, as SciPy's SLSQP finds them."""
    director = Director(person(known=Known()), PEOPLE, draws=3)
    feet, sums = director._feet, director._sums(thesis((0.0, 4.5)))
    feet._room = np.random.default_rng(0).choice([0.0, 0.05], feet._room.shape)
    known, at, count = feet._after(sums).known, feet._one_sided, len(EXCHANGED)
    assert at.size == 4  # the load's share, the mount, both springs that relax
    for number, name in product(range(3), range(count)):
        C = known[number][np.ix_([name, *at], [name, *at])]
        std = np.sqrt(np.diag(C))
        L, room = np.linalg.cholesky(C / np.outer(std, std)), feet._room[number] / std[1:]
        inside = {"type": "ineq", "fun": lambda u: Z95**2 - u @ u}
        beside = {"type": "ineq", "fun": lambda u, L=L, room=room: feet._way * (L @ u)[1:] + room}
        ends = [
            -minimize(lambda u, side=side, L=L: -side * (L @ u)[0], np.zeros(5), constraints=[inside, beside]).fun
            for side in (1, -1)
        ]
        expected = np.sinh(0.5 * sum(ends) * std[0])
        assert feet._half_widths(known)[number, name] == pytest.approx(expected, rel=0.1)
        assert feet._half_widths(known)[number, name] < np.sinh(Z95 * std[0])


def test_next_step_is_the_one_of_the_largest_score(director: Director) -> None:
    chosen = [director.candidates[0]]
    totals_of = [score.total for score in director.scores(chosen)]
    best = int(np.argmax(totals_of))
    totals = [
        director.outlook([*chosen, each]).utility.sum() - director.outlook(chosen).utility.sum()
        for each in director.candidates
    ]
    assert int(np.argmax(totals)) == best and totals_of[best] == pytest.approx(max(totals), rel=1e-5)


# plans


def test_third_of_the_recordings_leaves_the_intervals_of_the_thesis(plan: Planned) -> None:
    mine, three, one = (plan.expected[name] for name in (PLANNED, THESIS, UNLOADED))
    assert len(mine.steps) <= 9 and len(three.steps) == 27 and len(one.steps) == 9
    assert all(mine.outlook.half_width[n] <= 1.15 * three.outlook.half_width[n] for n in EXCHANGED)
    assert mine.outlook.half_width["k_T"] <= 0.5 * one.outlook.half_width["k_T"]
    assert plan.mine.goal() >= three.outlook.goal() - 0.1 and not plan.never
    assert plan.met is (plan.mine.goal() >= SHARE)


def test_probability_of_a_goal_is_that_of_feet_whose_widths_and_odds_scatter() -> None:
    """Against draws: a logarithm about the expected width, common to all four, and log-odds of variance 2 L."""
    rng, count = np.random.default_rng(0), 200_000
    half = np.array([[0.03, 0.05, 0.1, 0.1], [0.05, 0.04, 0.05, 0.3]])
    outlook = Outlook(half, np.array([9.0, 30.0]), {"k_T": 0.04, "c_11": 0.09}, np.zeros(4))
    factor = np.exp(WIDTH_STD * rng.standard_normal(count))
    met = []
    for widths, odds in zip(half, outlook.log_odds, strict=True):
        narrow = (widths[0] * factor <= 0.04) & (widths[2] * factor <= 0.09)
        decided = odds + np.sqrt(2 * odds) * rng.standard_normal(count) > np.log(1000)
        met.append(np.mean(narrow & decided))
    assert outlook.goal() == pytest.approx(np.mean(met), abs=0.003)
    alone = np.mean(factor[:, None] * half[:, 0] <= 0.04)
    assert outlook.goal(["k_T"], branch=False) == pytest.approx(alone, abs=0.003)
    assert outlook.half_width["k_F"] == pytest.approx(0.045) and outlook.quantile(1.0)["c_21"] == 0.3


def test_a_plan_says_what_a_mean_foot_hides() -> None:
    """Half of the feet are far narrower than asked and half far wider: one foot in two, whatever the mean is."""
    half = np.repeat([[0.01] * 4, [0.2] * 4], 8, axis=0)
    outlook = Outlook(half, np.full(16, 50.0), dict.fromkeys(EXCHANGED, 0.05), np.zeros(4))
    assert np.exp(np.log(half).mean()) < 0.05 and outlook.goal() == pytest.approx(0.5, abs=1e-3)


def test_people_are_planned_to_be_recorded_again_and_rigs_longer() -> None:
    """One frequency and load: what scatters is recorded again, what only hisses is recorded longer."""
    for shaker, count in ((replace(PEOPLE, lowest_hz=20.0, highest_hz=20.0, loads_kg=(0.0,)), 4),
                          (replace(SHAKER, lowest_hz=20.0, highest_hz=20.0, loads_kg=(0.0,)), 1)):  # fmt: skip
        steps = Director(person(), shaker, draws=4).session(4, 80.0)
        assert len(steps) == count and shaking_s(steps) == 80.0 and len({s.frequency_hz for s in steps}) == 1


def test_what_is_stated_of_noise_and_repeatability_holds_and_the_rest_is_drawn() -> None:
    usual, stated = (Director(person(), x, draws=32)._feet.seen.scatter for x in (PEOPLE, SHAKER))
    assert np.ptp(stated[:, 1]) == 0 and np.ptp(usual[:, 1]) > 0
    for values, middle, std in ((usual[:, 0], NOISE_M_S2, NOISE_STD), (usual[:, 1], REPEATABILITY, REPEATABILITY_STD)):
        logs = np.log(values / middle)
        assert abs(logs.mean()) < 3 * std / np.sqrt(32) and logs.std() == pytest.approx(std, rel=0.4)


def test_plan_follows_from_its_seed(plan: Planned) -> None:
    again = planned(as_thesis(), 9, 270.0)
    assert {**again.document(), "computing_s": 0} == {**plan.document(), "computing_s": 0}
    assert as_thesis(seed=1).outlook(plan.steps).half_width != again.expected[PLANNED].outlook.half_width


@pytest.mark.parametrize("most", [2, 3])
def test_plan_of_few_recordings_is_the_best_of_all(most: int) -> None:
    """Of all choices of so many recordings, and all shares of the time, by their number of pieces."""
    shaker = Shaker(every_hz=10.0, loads_kg=(0.0, 4.5), repeatability=0.0)
    who = Director(person(), shaker, dict.fromkeys(EXCHANGED, 1e-3), draws=4)
    pieces, places = 8, range(len(who.candidates))
    shares = [s for s in product(range(1, pieces), repeat=most) if sum(s) == pieces]
    scores = [
        who.outlook([replace(who.candidates[i], seconds=10.0 * n) for i, n in zip(chosen, share, strict=True)])
        for chosen in combinations(places, most)
        for share in shares
    ]
    best = max(outlook.utility.sum() for outlook in scores)
    mine = who.session(most, 10.0 * pieces)
    assert len(mine) == most and sum(step.seconds for step in mine) == 10.0 * pieces
    assert who.outlook(mine).utility.sum() == pytest.approx(best, abs=0.01)


def test_same_seed_draws_the_same_feet_whatever_the_candidates(director: Director) -> None:
    """Each purpose has random numbers of its own: other frequencies, loads, sensors and nuisances change no foot."""
    other = Shaker(every_hz=20.0, loads_kg=(0.0, 1.0, 9.0), sensors=("malleolus", "foot"))
    known = Known().overruled_by(exclude=("all",), mass_std=0.1)
    there = Director(person(known=known), other, draws=6)
    mine, its = (who._feet.seen.q for who in (director, there))
    for name in (*FOOT, "shank mass", "foot mass", "gain", "delay"):
        i, j = (who._sight.variables.names.index(name) for who in (director, there))
        np.testing.assert_allclose(mine[:, i], its[:, j], rtol=1e-12, err_msg=name)
    assert len({q.tobytes() for q in mine}) == 6


# what else may be true


@pytest.fixture(scope="module")
def wide() -> Director:
    """What the fit allows for where nobody says anything."""
    return Director(person(known=Known()), SHAKER, draws=6)


def test_plan_allows_for_what_the_fit_allows_for(wide: Director) -> None:
    """And what it would be worth to exclude something is what a director says to whom it is excluded."""
    departures = [name for name in DEPARTURES if name != "seating"]  # nobody sits down anew
    assert wide.uncertain == ("masses", "gain", "delay", *departures)
    steps = thesis((0.0, 4.5))
    told = wide.excluding(steps)
    exact = Known().overruled_by(mass_std=0.0)  # other feet, too: those of the first have masses that are off
    for group, known, rel in (("load", Known().overruled_by(exclude=("load",)), 0.02), ("masses", exact, 0.3)):
        other = Director(person(known=known), SHAKER, draws=6)
        assert group not in other.uncertain
        assert other.outlook(steps).half_width == pytest.approx(told[group], rel=rel)
        assert all(told[group][n] < 0.9 * wide.outlook(steps).half_width[n] for n in EXCHANGED)


def test_recordings_are_chosen_that_tell_departures_from_constants(wide: Director, director: Director) -> None:
    """Of the same minutes: narrower than what is best where there are none."""
    mine, other = wide.session(6, 180.0), Director(person(), SHAKER, dict.fromkeys(EXCHANGED, 1e-3), draws=6)
    its = other.session(6, 180.0)
    assert shaking_s(mine) == shaking_s(its) == 180.0
    widths = [np.log(list(wide.outlook(steps).half_width.values())).mean() for steps in (mine, its)]
    assert widths[0] < widths[1] - 0.05


def test_rival_of_a_foot_is_within_its_bounds_and_misses_less_than_the_mirror_image() -> None:
    foot = virtual(4)
    steps = [Step("sine", hz, kg, 8.95, 10.0) for kg in (0.0, 4.5) for hz in (12.0, 20.0, 32.0, 48.0)]
    who = owner(foot, Known())
    quiet = replace(SHAKER, noise_m_s2=0.02)
    eye = sight(steps, who, quiet)
    q = eye.variables.start({name: getattr(foot.leg, name) for name in FOOT})[None]
    scatter = scatter_of(quiet)
    rival, held = eye.rivals(q, scatter)
    side = -1 if q[0, eye.variables.index["k_F"]] > 0 else 1
    low, high = eye.variables.side(side)
    assert (low <= rival).all() and (rival <= high).all() and held.any()
    near, far = (eye.see(q, other, held, scatter) for other in (rival, eye.variables.image(q)))
    missed = [(x.missed**2 / x.noise).sum() for x in (near, far)]
    assert missed[0] < 0.5 * missed[1]  # the mirror image itself misses far more


def test_another_sensor_is_offered_and_is_worth_what_a_director_with_it_says(plan: Planned) -> None:
    (offer,) = plan.offers
    worn = Director(person(), replace(SHAKER, sensors=("malleolus", "foot")), draws=6)
    expected = worn.outlook([replace(step, sensors=("malleolus", "foot")) for step in plan.steps])
    for name in EXCHANGED:
        assert offer.expected.outlook.half_width[name] == pytest.approx(expected.half_width[name], rel=0.05)
        assert offer.expected.outlook.half_width[name] < 0.5 * plan.expected[PLANNED].outlook.half_width[name]
    assert any("With a second sensor 'foot' (in brackets: without it)" in note for note in plan.sheet().notes)
    assert plan.document()["offers"][0]["sensor"] == "foot" and offer.adds.information > 0


def test_the_thesis_is_compared_with_the_same_sensors() -> None:
    two = ("malleolus", "foot")
    who = Director(person(), replace(SHAKER, sensors=two), draws=2)
    result = planned(who, 1, 10.0)
    assert {s.sensors for e in result.expected.values() for s in e.steps} == {two}
    alone = Director(person(), SHAKER, draws=2)
    narrower = [d.outlook(d.thesis(), fresh=True).half_width["k_T"] for d in (who, alone)]
    assert narrower[0] < 0.7 * narrower[1]
    titles = [n for n in result.sheet().notes if n.startswith("Protocol of the thesis, ")]
    assert len(titles) == 2 and all(", with malleolus and foot: " in n for n in titles)


@pytest.mark.parametrize(
    ("causes", "open_", "sensors", "remedy"),
    [
        ((Cause("foot mass", "foot mass of A", 0.5),), False, ("malleolus",), "masses from their volumes."),
        ((Cause("gain", "gain of malleolus", 0.6),), False, ("malleolus",), "Calibrate the channels."),
        ((), True, ("malleolus",), "Wear a sensor on the foot."),
        ((), True, ("malleolus", "foot"), " %."),
    ],
)
def test_no_remedy_is_one_that_is_there(
    plan: Planned, causes: tuple[Cause, ...], open_: bool, sensors: tuple[str, ...], remedy: str
) -> None:
    names = ("k_T",) if causes else ()
    ever, shaker = replace(plan.mine, asked={"k_T": 0.01}), replace(SHAKER, sensors=sensors)
    said = nothing_brings(ever, {"k_T": causes}, names, open_, shaker)
    assert said.endswith(remedy)
    remains = "".join(f"(remaining variance: {cause})" for cause in causes)
    assert remains in said and ("remaining variance" in said) == bool(causes)
    assert ("the branch is decided" in said) == open_


def test_a_plan_is_as_long_as_the_daily_exposure_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless its minutes were asked for; with room for no recording it stays, and says so."""
    who = Director(person(), SHAKER, draws=2)
    usual = planned(who, 3, 60.0)
    assert not usual.warning and planned(who, 3, 60.0, shorten=True).steps == usual.steps
    monkeypatch.setattr(Safety, "daily_a8", 0.8 * exposure(usual.steps).a8)
    assert planned(who, 3, 60.0).warning
    shorter = planned(who, 3, 60.0, shorten=True)
    assert not shorter.warning and 0.3 * shaking_s(usual.steps) < shaking_s(shorter.steps) < shaking_s(usual.steps)
    monkeypatch.setattr(Safety, "daily_a8", 1e-3)
    assert planned(who, 3, 60.0, shorten=True).warning


def test_a_plan_that_recording_refuses_says_so_first(plan: Planned) -> None:
    """The minutes that it names are within the limits of a day, with the same recordings."""
    assert not plan.warning
    once = plan.steps[0]
    share = 1.5 * (Safety.daily_vdv / exposure([once]).vdv) ** 4
    long = replace(once, seconds=share * once.seconds)
    result = replace(plan, steps=(long,), adds=plan.adds[:1])
    assert result.sheet().notes[0].startswith("fasbody record would refuse this plan: ")
    assert "VDV would be" in result.warning and "--max-vdv" in result.warning
    minutes = float(result.warning.split("--minutes ")[1].rstrip(". "))
    shorter = replace(result, steps=(replace(long, seconds=60 * minutes),))
    assert not shorter.warning and minutes > 0.6 * long.seconds / 60


def test_figures_are_drawn(plan: Planned) -> None:
    for kind in plan.plots:
        axes = plan.plot(kind).axes
        assert all(axis.get_xlabel() for axis in axes[:2])
        for axis in axes[:2]:  # no mark at the edge
            highest = max(float(np.max(line.get_ydata())) for line in axis.get_lines())  # type: ignore[arg-type]
            assert axis.get_ylim()[1] > 1.05 * highest


def test_what_shaking_cannot_tell_is_said() -> None:
    """One load leaves every constant as uncertain as the mass of the leg."""
    shaker = Shaker(every_hz=10.0, loads_kg=(0.0,), repeatability=0.0)
    result = planned(Director(person(), shaker, dict.fromkeys(EXCHANGED, 0.01), draws=4), 4, 40.0)
    assert set(result.never) == set(EXCHANGED)
    for name in EXCHANGED:  # what is asked, what can be reached, and what is in the way
        reached = 100 * result.reached.half_width[name]
        assert reached > 10 and f"{name} ±{reached:.2g} % (goal ±1 %)" in result.sentence()
        assert {cause.kind for cause in result.causes[name]} >= {"shank mass", "foot mass"}
    # an unlimited plan is as wide as that, and exact masses leave nothing of it
    known = Known().overruled_by(exclude=("all",), mass_std=0.0)
    assert Director(person(known=known), shaker, draws=4).for_ever().half_width["k_T"] < 0.02


def test_noise_is_told_from_what_shaking_cannot_tell(director: Director) -> None:
    """Where noise is in the way the plan says for how long it must be shaken, and that time is enough."""
    loud = Director(person(), replace(SHAKER, noise_m_s2=2.0), dict.fromkeys(EXCHANGED, 0.2), draws=6)
    result = planned(loud, 9, 270.0)
    assert result.missed and not result.never and "oise limits" in result.sentence()
    assert result.longer is not None and f"{result.longer}" in result.sentence()
    steps = result.steps if result.longer.steps == "the plan" else loud.candidates
    long, short = (
        loud.outlook([replace(s, seconds=share * result.longer.times * s.seconds) for s in steps])
        for share in (1, 0.95)
    )
    assert loud.met(long) and not loud.met(short)
    # what no noise leaves does not depend on how much there was
    assert max(loud.for_ever().half_width.values()) < 1e-3 > max(director.for_ever().half_width.values())


def test_what_is_not_named_is_not_asked_for() -> None:
    """k_T alone: it is met with the other intervals as wide as they may be, and said to be all that is asked."""
    who = Director(person(), SHAKER, {"k_T": 0.05}, draws=6)
    result = planned(who, 9, 270.0)
    mine = result.expected[PLANNED].outlook.half_width
    assert result.met and mine["k_T"] <= 0.05
    all_four = Director(person(), SHAKER, dict.fromkeys(EXCHANGED, 0.05), draws=6).session(9, 270.0)
    assert shaking_s(result.steps) < shaking_s(all_four)
    assert result.document()["asked"] == {"k_T": 0.05, "k_F": None, "c_11": None, "c_21": None}
    assert "Goal: k_T ±5 %, and the branch decided. No goal for k_F, c_11, c_21." in result.sheet().notes
    usual = planned(Director(person(), SHAKER, draws=2), 1, 10.0).sheet().notes
    assert any("c_21 ±6 %, and the branch decided. This is the default" in n for n in usual)
    everything = who.candidates[0]
    for name in EXCHANGED:  # information is that on what is asked
        who.aim({name: 0.05})
        gained = who.outlook([everything]).utility[0] - who.outlook(()).utility[0]
        widths = [np.arcsinh(who.outlook(steps).half_width[name]) for steps in ((), [everything])]
        assert gained > 0 and widths[1] < widths[0]


@pytest.mark.parametrize("minutes", [0.5, 1.0])
def test_no_plan_exceeds_its_minutes(minutes: float) -> None:
    """Few candidates and a goal out of reach: restarts often draw the recording that they move."""
    for seed in range(4):
        narrow = Shaker(every_hz=10.0, loads_kg=(0.0,), repeatability=0.0)
        who = Director(person(), narrow, dict.fromkeys(EXCHANGED, 1e-3), draws=3, seed=seed)
        steps = who.session(9, 60.0 * minutes)
        assert sum(step.seconds for step in steps) <= 60.0 * minutes


def test_thesis_is_compared_as_far_as_the_shaker_can_do_it() -> None:
    """2 mm of travel and 15 to 45 Hz: no sine of 10 or 50 Hz, and the slow ones as weak as the travel asks for."""
    small = Shaker(15.0, 45.0, 10.0, displacement_m=0.002, loads_kg=(0.0, 4.5), repeatability=0.0)
    result = planned(Director(person(), small, draws=2), 2, 20.0)
    steps = result.expected[THESIS].steps
    assert len(steps) == 21 and {s.frequency_hz for s in steps} == {15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0}
    for s in steps:  # half of the travel that acquire commands, by the square of the angular frequency
        travel = 0.5 * COMMANDED * 0.002 * (2 * np.pi * s.frequency_hz) ** 2
        assert s.amplitude_m_s2 == pytest.approx(min(8.95, travel))
    least = 0.5 * COMMANDED * 0.002 * (30 * np.pi) ** 2
    said = f"to what this shaker can do: without 10 and 50 Hz, and weaker at 15 Hz, down to {least:.3g} instead of 8.95"
    assert any(said in note for note in result.sheet().notes) and said in result.document()["limited"]
    assert planned(Director(person(), SHAKER, draws=2), 1, 10.0).limited == ""
    fast = Director(person(), Shaker(60.0, 80.0, 10.0), draws=2)
    alone = planned(fast, 1, 10.0)
    assert "cannot make any sine" in alone.limited and "thesis" not in alone.sentence()
    assert not any(note.startswith("the thesis") for note in alone.sheet().notes)
    with pytest.raises(SettingError, match="none of the thesis' sines"):
        fast.as_thesis()


def test_one_person_of_an_earlier_study_is_chosen() -> None:
    two, other = (replace(r, condition=replace(r.condition, subject=who, posture=how))
                  for r in [Recording(np.arange(3.0), np.zeros(3), np.zeros(3))]
                  for who, how in (("1", "midstance"), ("2", "dorsiflexion")))  # fmt: skip
    assert _of([two, other], "2", None) == [other] and _of([two], None, None) == [two]
    with pytest.raises(SettingError, match=r"several people \(1, 2\); choose one with --subject"):
        _of([two, other], None, None)
    with pytest.raises(SettingError, match=r"--subject: unknown subject '3' .valid: 1, 2"):
        _of([two, other], "3", None)
    with pytest.raises(SettingError, match=r"several postures .*--posture"):
        _of([two, replace(other, condition=replace(other.condition, subject="1"))], "1", None)


# limits


@pytest.mark.parametrize("shaker", [Shaker(displacement_m=1e-3), Shaker(force_n=60.0), Shaker(amplitude_m_s2=3.0)])
def test_no_candidate_exceeds_a_limit(shaker: Shaker) -> None:
    leg, safety = person().leg_kg, Safety(displacement_m=shaker.displacement_m)
    steps = candidates(replace(shaker, kinds=("sine", "multisine")), leg)
    for step in steps:
        U = step.base(step.count(1000.0))
        wave = np.real(np.exp(2j * np.pi * np.outer(np.arange(4096) / 4096, np.arange(1, U.size + 1))) @ U)
        w = 2 * np.pi * step.frequency_hz * np.arange(1, U.size + 1)
        travel = np.real(np.exp(2j * np.pi * np.outer(np.arange(4096) / 4096, np.arange(1, U.size + 1))) @ (U / w**2))
        assert np.abs(wave).max() <= shaker.amplitude_m_s2 * 1.001
        assert np.ptp(travel) <= COMMANDED * shaker.displacement_m * 1.001
        if step.kind == "sine":
            safety.check(step.frequency_hz, 2 * step.amplitude_m_s2)
        if shaker.force_n is not None:
            assert (shaker.table_kg + leg + step.added_mass_kg) * np.abs(wave).max() <= shaker.force_n
    assert {step.kind for step in steps} == {"sine", "multisine"}


def test_what_cannot_be_meant_is_refused() -> None:
    for wrong in (
        {"lowest_hz": 60.0}, {"loads_kg": ()}, {"loads_kg": (-1.0,)}, {"kinds": ("noise",)}, {"kinds": ()},
        {"amplitude_m_s2": np.nan}, {"force_n": 0.0}, {"seconds": 0.1},
    ):  # fmt: skip
        with pytest.raises(SettingError):
            Shaker(**wrong)  # type: ignore[arg-type]
    with pytest.raises(SettingError, match="20 to 300"):
        person(5.0)
    with pytest.raises(SettingError, match="another model"):
        Person(load("foot_arch"), 70.0)
    for ask in ({"k_X": 0.1}, {"k_T": 0.0}):
        with pytest.raises(SettingError):
            Director(person(), SHAKER, ask, draws=2)


@pytest.mark.parametrize(
    "words",
    [
        ["--ask", "k_T"], ["--ask", "k_X=0.1"], ["--frequencies", "50:10:2"], ["--frequencies", "a"], ["--loads", "x"],
        ["--kinds", "noise"], ["--amplitude", "0"], ["--body-mass", "5"],
        ["--exclude", "ghosts"],
        ["--minutes", "0"], ["--draws", "1"], ["--body-mass", "0"],
        ["--sensors", "malleolus,malleolus"], ["no_such_study"], ["--sensors", "malleolus,nose"], ["run"],
        ["run", "--out", "s"], ["run", "--simulate", "--port", "x", "--out", "s"],
    ],
)  # fmt: skip
def test_command_refuses_in_a_sentence(words: list[str]) -> None:
    words = words if words[0] == "run" else ["propose", *words]
    result = CliRunner().invoke(app, words)
    assert isinstance(result.exception, FasError) and str(result.exception).endswith(".")


def test_command_writes_what_it_says(tmp_path: Path) -> None:
    words = ["--frequencies", "10:50:10", "--loads", "0,4.5", "--draws", "3", "--recordings", "3", "--minutes", "0.5"]
    file = tmp_path / "steps.json"
    result = CliRunner().invoke(app, ["propose", *words, "--json", "--protocol", str(file)])
    document = json.loads(result.stdout)
    rows = document["protocol"], [document["next"]], document["information"]
    assert {type(row["sensors"]) for part in rows for row in part} == {list}
    assert json.loads(file.read_text())["protocol"] == document["protocol"]
    assert document["shaker"]["seconds"] == 10.0 and document["shaker"]["noise_m_s2"] == NOISE_M_S2
    stated = CliRunner().invoke(app, ["propose", *words, "--noise", "0.2", "--repeatability", "0", "--json"])
    shaker = json.loads(stated.stdout)["shaker"]
    assert (shaker["noise_m_s2"], shaker["repeatability"]) == (0.2, 0.0)


# files


def test_protocol_comes_back_and_broken_ones_are_refused(tmp_path: Path, plan: Planned) -> None:
    file = next(path for path in plan.write(tmp_path) if path.name == "protocol.json")
    session, document = PlannedSession.read(file), json.loads(file.read_text())
    names = ("kind", "frequency_hz", "added_mass_kg", "amplitude_m_s2", "seconds")
    ours, back = ([[getattr(s, n) for n in names] for s in steps] for steps in (plan.steps, session.protocol))
    assert back == ours
    assert (session.subject, session.body_mass_kg) == (plan.subject, plan.body_mass_kg)
    step = document["protocol"][0]
    for broken in (
        {**document, "format": "x"}, {**document, "protocol": []}, {**document, "body_mass_kg": None},
        {**document, "protocol": [{**step, "seconds": True}]},
        {**document, "protocol": [{**step, "frequency_hz": 1e9}]},
        {**document, "protocol": [7]}, [],
    ):  # fmt: skip
        file.write_text(json.dumps(broken))
        with pytest.raises(InputFileError, match=r"protocol\.json"):
            PlannedSession.read(file)


@pytest.mark.long
@pytest.mark.usefixtures("patient")
def test_acquire_runs_a_plan_on_the_virtual_bench(tmp_path: Path) -> None:
    steps = (Step("sine", 30.0, 2.3, 5.0, 0.6), Step("sine", 40.0, 2.3, 4.0, 0.5))
    file = tmp_path / "steps.json"
    rows = [vars(step) | {"sensors": list(step.sensors)} for step in steps]
    file.write_text(json.dumps({"format": PROTOCOL, "subject": "16", "body_mass_kg": 72.57, "protocol": rows}))
    study = tmp_path / "study"
    result = CliRunner().invoke(acquire, ["record", "--simulate", "--plan", str(file), "--out", str(study), "--json"])
    assert result.exit_code == 0, result.output
    made = Study.read(study).recordings
    assert [(r.condition.frequency_hz, r.condition.added_mass_kg) for r in made] == [(30.0, 2.3), (40.0, 2.3)]
    for step, recording in zip(steps, made, strict=True):
        assert observed(checked(recording)).level_m_s2 == pytest.approx(step.amplitude_m_s2, rel=0.04)
        assert recording.time_s.size == pytest.approx(1000 * step.seconds)


@pytest.mark.parametrize(
    ("step", "words", "says"),
    [
        ({"kind": "multisine"}, [], "makes sines only"),
        ({}, ["--frequency", "20"], "leave out"),
        ({}, ["--added-mass", "9"], "no step has 9 kg"),
        ({"amplitude_m_s2": 40.0}, [], "limit"),
        ({"body_mass_kg": 80.0}, [], "is planned for 80 kg, and the virtual bench's subject has 72.57 kg"),
        ({"frequency_hz": 4.0}, [], "more than 6.92 mm, which leave room to the limit of 8 mm"),
    ],
)
def test_acquire_refuses_a_plan_that_it_cannot_run(
    tmp_path: Path, step: dict[str, object], words: list[str], says: str
) -> None:
    row = {"kind": "sine", "frequency_hz": 30.0, "added_mass_kg": 0.0, "amplitude_m_s2": 5.0, "seconds": 1.0, **step}
    file = tmp_path / "steps.json"
    mass = row.pop("body_mass_kg", 72.57)
    file.write_text(json.dumps({"format": PROTOCOL, "body_mass_kg": mass, "protocol": [row]}))
    line = ["record", "--simulate", "--plan", str(file), "--out", str(tmp_path / "s"), *words]
    result = CliRunner().invoke(acquire, line)
    assert isinstance(result.exception, FasError) and says in str(result.exception)


# while shaking


@pytest.fixture(scope="module")
def half_way() -> Iterator[tuple[Director, list[Recording]]]:
    foot = virtual(3)
    data = shaken(foot, thesis((0.0, 4.5), 2.0)[::2])
    yield Director(owner(foot), SHAKER, earlier=data, draws=4), data


def test_recordings_of_another_simulator_are_believed(half_way: tuple[Director, list[Recording]]) -> None:
    director, _ = half_way
    belief, truth = director.belief, virtual(3).leg
    assert belief is not None and belief.follows and belief.decided
    assert belief.ends[0].branch == ("stiff ankle" if truth.stiff_ankle else "stiff pad")
    for name, band in belief.open_bands(EXCHANGED).items():
        assert band.lower <= getattr(truth, name) <= band.upper
    more = director.outlook([director.candidates[0]]).half_width
    assert all(more[n] < director.outlook(()).half_width[n] for n in EXCHANGED)
    assert director.noise_m_s2 == pytest.approx(virtual(3).noise_m_s2 / np.sqrt(SHORTER), rel=0.05)


def test_recordings_of_somebody_else_are_refused(half_way: tuple[Director, list[Recording]]) -> None:
    with pytest.raises(SettingError, match="is of subject 'made'"):
        Director(person(), SHAKER, earlier=half_way[1], draws=2)


def test_recordings_of_nobody_named_are_of_the_person(half_way: tuple[Director, list[Recording]]) -> None:
    """Bare files name no subject; their body mass must be the person's all the same."""
    unnamed = [replace(r, condition=replace(r.condition, subject="")) for r in half_way[1]]
    director = Director(half_way[0].person, SHAKER, earlier=unnamed, draws=2)
    assert len(director.done) == len(unnamed)
    assert sum("foot mass" in name for name in director._sight.variables.names) == 1  # one pair of masses, not two
    heavier = replace(half_way[0].person, body_mass_kg=half_way[0].person.body_mass_kg + 1)
    with pytest.raises(SettingError, match="is of subject ''"):
        Director(heavier, SHAKER, earlier=unnamed, draws=2)


def test_recordings_without_a_body_mass_say_where_it_goes(half_way: tuple[Director, list[Recording]]) -> None:
    bare = [replace(r, condition=replace(r.condition, body_mass_kg=None)) for r in half_way[1]]
    said = r"states no body mass.*fill in mass_kg of subject '\w+' in subjects\.csv"
    with pytest.raises(SettingError, match=said) as caught:
        Director(half_way[0].person, SHAKER, earlier=bare, draws=2)
    assert "None" not in str(caught.value) and str(caught.value).endswith("or give --body-mass.")


def test_level_distortion_and_coherence_are_those_of_the_signals() -> None:
    rng, t = np.random.default_rng(0), np.arange(10_000) / 1000
    base = 5 * np.sin(2 * np.pi * 20 * t) + 0.4 * np.sin(2 * np.pi * 40 * t + 1)
    y = 7.5 * np.sin(2 * np.pi * 20 * t - 0.5)
    clean = checked(Recording.from_arrays(t, base, y + 1e-3 * rng.normal(size=t.size), frequency_hz=20.0))
    found = observed(clean)
    assert found.level_m_s2 == pytest.approx(5, rel=1e-4) and found.distortion == pytest.approx(0.08, rel=1e-3)
    assert found.transmissibility == pytest.approx(1.5, rel=1e-4) and found.lower <= 1.5 <= found.upper
    assert found.phase_deg == pytest.approx(-np.degrees(0.5), abs=0.02) and found.coherence > 0.99999
    # amplitudes of segments scatter as much as they are large: |E Y U*|^2 / (E|Y|^2 E|U|^2) = 1/2
    wander = np.repeat(rng.normal(size=10) + 1j * rng.normal(size=10), 1000)
    half = replace(clean, malleolus_m_s2=np.real((1 + wander / np.sqrt(2)) * np.exp(2j * np.pi * 20 * t)))
    assert observed(half).coherence == pytest.approx(0.5, abs=0.25)


@pytest.mark.long
def test_session_ends_by_itself_within_the_limits() -> None:
    foot = virtual(10_000)
    rig = Rig(foot, np.random.default_rng(2))
    said: list[str] = []

    class Listening(Offering):
        def report(self, sentence: str) -> None:
            said.append(sentence)

    who = owner(foot)
    shaker = Shaker(every_hz=10.0, loads_kg=(0.0, 4.5), seconds=2.0, repeatability=0.0)
    done = Session(who, shaker, dict.fromkeys(EXCHANGED, 0.3), 4, 20.0, 0, 3, rig.record, Listening()).run()
    assert len(done.good) <= 4 and sum(t.step.seconds for t in done.good) <= 20.0
    assert not rig.is_on and not rig.crept and rig.beyond_s <= 0.06
    assert rig.peak_m_s2 > 4.0 and rig.travel_m > 1e-4  # it did shake
    assert {replace(t.step, seconds=2.0) for t in done.taken} <= set(candidates(shaker, who.leg_kg))
    assert any("transmissibility" in text for text in said) and done.reason in done.sentence()
    assert json.loads(json.dumps(done.document(), default=float))["recordings"] == len(done.good)


@pytest.mark.long
def test_another_load_is_laid_where_it_pays() -> None:
    """Under one load the mass of the leg leaves all constants open; another load adds more than a minute there."""
    foot, shaker = virtual(3), Shaker(every_hz=10.0, loads_kg=(0.0, 4.5), repeatability=0.0)
    data = shaken(foot, thesis((0.0,), 10.0)[::2])
    who = owner(foot)
    director = Director(who, shaker, dict.fromkeys(EXCHANGED, 0.02), data, draws=2)

    def chosen(change_s: float) -> Step:
        session = Session(
            who, shaker, dict.fromkeys(EXCHANGED, 0.02), 4, 40.0, 0, 2, lambda step: data[0], None, data, change_s
        )
        session._load = 0.0
        step = session._next(director)
        assert step is not None
        return step

    step = chosen(60.0)
    stay = [replace(s, seconds=s.seconds + 60.0) for s in director.candidates if s.added_mass_kg == 0.0]
    assert step.added_mass_kg == 4.5 and director.gains([step])[0] > director.gains(stay).max()
    # once both loads are known, a little more under the other is not worth an hour's change
    both = shaken(foot, thesis((0.0, 4.5), 10.0)[::2])
    director = Director(who, shaker, dict.fromkeys(EXCHANGED, 0.001), both, draws=2)
    assert chosen(3600.0).added_mass_kg == 0.0


def test_interrupted_session_keeps_what_it_has(tmp_path: Path) -> None:
    foot = virtual(3)
    who = owner(foot)
    shaker = Shaker(every_hz=20.0, loads_kg=(0.0, 4.5), seconds=5.0, repeatability=0.0)
    made: list[Step] = []

    def record(step: Step) -> Recording:
        if len(made) == 1:
            raise KeyboardInterrupt
        made.append(step)
        return recorded(foot, [step], 5)[0]

    done = Session(who, shaker, dict.fromkeys(EXCHANGED, 0.02), 4, 40.0, 0, 2, record).run()
    assert done.ended == INTERRUPTED and len(done.good) == 1 and done.left and set(done.bands) == set(EXCHANGED)
    (file,) = done.write(tmp_path)
    document = json.loads(file.read_text())
    assert document["ended"] == "interrupted" and document["recordings"] == 1
    assert len(document["left"]) == len(done.left)
    assert document["fit"]["k_T"]["value"] == pytest.approx(done.bands["k_T"].value)
    assert any(note.startswith("Planned and not recorded") for note in done.sheet().notes)


def test_ctrl_c_at_a_question_is_ctrl_c(monkeypatch: pytest.MonkeyPatch) -> None:
    def pressed(*words: object, **more: object) -> bool:
        raise typer.Abort

    monkeypatch.setattr(typer, "confirm", pressed)
    with pytest.raises(KeyboardInterrupt):
        Offer(auto=False).step(Step("sine", 20.0, 0.0, 5.0, 2.0), "")


def test_strangeness_takes_several_recordings(half_way: tuple[Director, list[Recording]]) -> None:
    """A scatter beyond what people have, on either side of it; one bad recording makes that, too."""
    director, data = half_way
    belief = director.belief
    assert belief is not None and not belief.strange

    def repeating(to: float) -> Belief:
        first, other = belief.ends
        return Belief((replace(first, problem=first.problem.with_repeatability(to)), other))

    assert not repeating(0.149).strange and repeating(0.149).decided
    bad = repeating(0.151)
    assert bad.strange and not bad.follows and not bad.decided
    who = owner(virtual(3))
    wild = [replace(r, malleolus_m_s2=3.0 ** (-1) ** i * r.malleolus_m_s2) for i, r in enumerate(data)]
    both, all_ = (Director(who, PEOPLE, earlier=wild[:count], draws=2) for count in (2, 9))
    assert both.belief is not None and not both.belief.strange
    assert all_.belief is not None and all_.belief.strange
    assert "The model does not follow these recordings" in believed(all_)
    assert both.belief.follows or "Too little is recorded to say" in believed(both)


@pytest.mark.long
def test_session_goes_on_while_more_minutes_narrow_what_can_never_be_met() -> None:
    """One load leaves 14 % whatever is recorded: twice as wide it goes on, there it ends and says why."""
    shaker, ask = Shaker(every_hz=20.0, loads_kg=(0.0,), repeatability=0.0), dict.fromkeys(EXCHANGED, 0.02)
    ends = []
    for seed, noise, ratio in ((11, 0.2, 1.75), (7, 0.05, 1.0)):
        foot = replace(virtual(seed), noise_m_s2=noise)
        who = owner(foot)
        data = shaken(foot, thesis((0.0,), 10.0)[::2])
        director = Director(who, shaker, ask, data, draws=4)
        session = Session(who, shaker, ask, 4, 40.0, 0, 4, lambda step: recorded(foot, [step], 5)[0], None, data)  # noqa: B023
        ever, belief = director.for_ever().half_width, director.belief
        assert belief is not None and belief.decided and ever["k_T"] > 0.1
        assert belief.bands(EXCHANGED)["k_T"].half_width / ever["k_T"] == pytest.approx(ratio, rel=0.1)
        ends.append(session._over(director))
    on, over = ends
    assert on is None and over is not None and over[0] == NEVER
    assert f"k_T ±{100 * ever['k_T']:.2g} % (goal ±2 %)" in over[1]
    assert "shank mass" in over[1] and "predicts no narrower" in over[1]


def made(half_way: tuple[Director, list[Recording]], ask: dict[str, float]) -> Session:
    """A session that goes on from recordings, as wide as a test asks."""
    director, data = half_way
    return Session(director.person, SHAKER, ask, 4, 40.0, 0, 4, lambda step: data[0], None, data)


@pytest.fixture(scope="module")
def alone(half_way: tuple[Director, list[Recording]]) -> FitResult:
    """What a fit says of the same recordings."""
    return fit_foot(half_way[1], load("two_dof"), exclude=("all",), starts=1, threads=1)


def test_a_session_is_met_by_the_fits_own_bands(half_way: tuple[Director, list[Recording]], alone: FitResult) -> None:
    director, _ = half_way
    widths = {name: band.half_width for name, band in director.belief.open_bands(EXCHANGED).items()}  # type: ignore[union-attr]
    fitted = {n: next(e for key, e in alone.best.parameters.items() if key.startswith(f"{n}_")) for n in EXCHANGED}
    met = made(half_way, {name: 1.5 * width for name, width in widths.items()})
    director.aim(met._ask)
    ended = met._over(director)
    assert ended is not None and ended[0] == MET and alone.verdict == "decided"
    bands = met._end(*ended).bands
    assert all(bands[n].lower == pytest.approx(fitted[n].lower, rel=1e-3) for n in EXCHANGED)


def test_a_session_goes_on_where_the_fit_is_not_there_yet(
    half_way: tuple[Director, list[Recording]], alone: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    director, _ = half_way
    director.aim(dict.fromkeys(EXCHANGED, 0.9))
    monkeypatch.setattr(session, "fit_foot", lambda *data, **more: replace(alone, verdict="undecided"))
    assert made(half_way, director.asked)._over(director) is None


def test_nothing_more_helps_only_where_all_that_is_left_would_fail(half_way: tuple[Director, list[Recording]]) -> None:
    """Expected to stay where it is, a little wider than asked: another recording may still meet that."""
    director, _ = half_way
    assert director.belief is not None
    widths = {name: band.half_width for name, band in director.belief.open_bands(EXCHANGED).items()}
    last = (director.candidates[0],)
    for share, ends in ((0.97, False), (0.2, True)):
        director.aim({"k_T": share * min(widths["k_T"], director.outlook(last).half_width["k_T"])})
        on = made(half_way, director.asked)
        on._left = last
        now = director.outlook(())
        director.outlook = lambda steps, now=now: now  # type: ignore[method-assign]
        ended = on._idle(director)
        del director.outlook
        assert (ended is not None and ended[0] == NEVER) is ends


def test_step_whose_board_stalls_is_tried_again() -> None:
    foot = virtual(3)
    who = owner(foot)
    shaker, tried = Shaker(every_hz=20.0, loads_kg=(0.0, 4.5), seconds=5.0, repeatability=0.0), list[Step]()

    def stalling(times: int) -> Shaken:
        tried.clear()

        def record(step: Step) -> Recording:
            tried.append(step)
            if len(tried) <= times:
                raise Stalled("no samples for 3 s.")
            return recorded(foot, [step], 5)[0]

        return Session(who, shaker, dict.fromkeys(EXCHANGED, 0.02), 1, 5.0, 0, 2, record).run()

    done = stalling(2)
    assert done.ended == SPENT and tried == [tried[0]] * 3 and len(done.good) == 1
    assert [t.stalled for t in done.taken] == [True, True, False]
    assert "Step 1 stalled: no samples for 3 s." in done.sheet().notes
    dead = stalling(99)
    assert dead.ended == FAILING and len(tried) == 3
    assert dead.reason == "The board has stalled 3 times in a row: no samples for 3 s."


def test_session_on_a_dead_shaker_gives_up() -> None:
    rig = Rig(virtual(0), np.random.default_rng(0))
    rig._gain = 0.0
    who = owner(virtual(0))
    shaker = Shaker(every_hz=20.0, loads_kg=(0.0, 4.5), seconds=2.0, repeatability=0.0)
    done = Session(who, shaker, dict.fromkeys(EXCHANGED, 0.3), 4, 20.0, 0, 2, rig.record).run()
    assert done.ended == FAILING and not done.good and not rig.is_on
    assert "does not follow" in str(done.sheet())
