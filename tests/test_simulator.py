"""The simulator that judges the fit, against closed forms and an independent integration."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from simulator import departure as d
from simulator import instrument, worlds
from simulator.leg import STEP_S, Leg, Shaking, harmonics, motion, sample, under
from simulator.worlds import CLEAN, WORLDS, Member, member

#: Its dampers forget within half a second.
LEG = Leg(1.4e5, 1.1e5, 900.0, 80.0, 140.0, 1100.0, -110.0, 170.0, 3.3, 1.05)
BASE = 8.95 * np.exp(1j * np.array([0.4, 2.0, -1.0])) * (1.0, 0.02, 0.01)


def shaking(hz: tuple[float, ...], base: np.ndarray = BASE, load_kg: float = 0.0) -> Shaking:
    return Shaking(np.full(len(hz), load_kg), np.array(hz), np.tile(base, (len(hz), 1)))


def test_simulator_shares_no_code_with_the_fit() -> None:
    for file in worlds.SOURCES:
        nodes = list(ast.walk(ast.parse(Path(file).read_text())))
        names = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
        names |= {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
        ours = {name for name in names if name.startswith(("fasbody", "identification", "mjcf", "viz"))}
        assert ours <= {"fasbody.recording.condition", "fasbody.recording.recording"}, file


# nonlinear motion


def integrated(parts: set[str], t: np.ndarray, rtol: float, hz: float = 20.0) -> np.ndarray:
    """What malleolus and foot feel at t [s] of a settled period, by DOP853 from rest in absolute coordinates.

    States: positions and velocities of shank, foot and thigh, forces of two Maxwell elements, broken
    tissue of ankle and pad, the rotating leg, the sensor on its tissue (each position, velocity).
    """
    w = 2 * np.pi * hz * np.arange(1, 4)
    w_H, w_R, w_M = 2 * np.pi * np.array([12.0, 60.0, 110.0])

    def rates(at: float, s: np.ndarray) -> tuple[list[float], float, float]:
        turn = BASE * np.exp(1j * w * at)
        y0, v0, a0 = (float(x.sum().real) for x in (-turn / w**2, turn / (1j * w), turn))
        y1, y2, y3, v1, v2, v3, q_T, q_F, b_T, b_F, phi, v_phi, p, v_p = s
        forces, more = [], []
        for z, v, q, broken, k, c1, c2, c3, r, p2, d3, b, fast, far in (
            (y1 - y2, v1 - v2, q_T, b_T, LEG.k_T, LEG.c_11, LEG.c_12, LEG.c_13, 0.4, 30.0, 5e4, 90.0, 0.06, 0.01),
            (y2 - y0, v2 - v0, q_F, b_F, LEG.k_F, LEG.c_21, LEG.c_22, LEG.c_23, 0.3, 60.0, 8e4, -70.0, 0.09, 0.02),
        ):  # fmt: skip
            c = c1 * np.exp(-c2 * z) * np.cos(c3 * z)
            linear = k * z + c * v
            force = linear
            if "exponential" in parts:
                force += k * (np.exp(b * z) - 1) / b - k * z
            if "polynomial" in parts:
                force += k * (p2 * z * abs(z) + d3 * z**3)
            if "power" in parts:
                # what a sine of the reference speed dissipates, with the corner rounded off
                x = np.cos(2 * np.pi * np.arange(400) / 400)
                share = (x**2 + 0.05**2) ** -0.2
                kappa = (share * x**2).sum() / (x**2).sum()
                force += c * v * (((v / fast) ** 2 + 0.05**2) ** -0.2 / kappa - 1)
            if "thixotropy" in parts:
                force -= 0.3 * broken * linear
            if "maxwell" in parts:
                force += q
            forces.append(force)
            more.append((r * k * v - q / 6e-3, (1 - broken) * abs(v) / far - broken / 0.03))
        F_T, F_F = forces
        F_T += 5.0 * np.tanh((v1 - v2) / 0.02) * ("friction" in parts)
        if "lifting" in parts:
            F_F = min(F_F, 1.3 * 9.80665 * (LEG.m_S + LEG.m_F))
        F_H = 4.0 * (w_H**2 * (y3 - y1) + w_H * (v3 - v1)) * ("thigh" in parts)
        a1, a2, a3 = (F_H - F_T) / LEG.m_S, (F_T - F_F) / LEG.m_F, -F_H / 4.0
        turning = a0 - 0.2 * w_R * v_phi - w_R**2 * phi
        ground = a1 + 0.05 * turning * ("rocking" in parts)
        slip = -ground - 0.5 * w_M * v_p - w_M**2 * p
        relax, tissue = zip(*more, strict=True)
        felt = ground + slip * ("mount" in parts), a2 + 0.02 * turning * ("rocking" in parts)
        return [v1, v2, v3, a1, a2, a3, *relax, *tissue, v_phi, turning, v_p, slip], *felt

    start = 8 / hz
    s0 = np.zeros(14)
    turn = BASE / w**2
    s0[:3], s0[3:6] = -turn.sum().real, (BASE / (1j * w)).sum().real
    span, exact = (0, start + t[-1]), {"rtol": rtol, "atol": 1e-3 * rtol}
    done = solve_ivp(lambda at, s: rates(at, s)[0], span, s0, "DOP853", start + t, **exact)
    return np.array([rates(at, s)[1:] for at, s in zip(done.t, done.y.T, strict=True)]).T


PARTS = {
    "exponential": d.Exponential(90.0, -70.0), "polynomial": d.Polynomial((30.0, 60.0), (5e4, 8e4)),
    "power": d.PowerLaw(0.6, (0.06, 0.09)), "thixotropy": d.Thixotropy(0.3, 0.03, (0.01, 0.02)),
    "maxwell": d.Maxwell(0.4, 0.3, 6e-3), "friction": d.Friction(5.0, 0.02), "lifting": d.Lifting(1.3),
    "thigh": d.Thigh(4.0, 12.0, 0.5), "rocking": d.Rocking(0.05, 60.0, 0.1, 0.02), "mount": d.Mount(110.0, 0.25),
}  # fmt: skip


def error(names: str, want: np.ndarray, parts: int) -> float:
    """Largest error of a period, of steps so many times smaller, over the largest value."""
    departures = [PARTS[name] for name in names.split()]
    have = motion(LEG, departures, shaking((20.0,)), STEP_S / parts, 97 * parts)[:, 0, :: 4 * parts]
    return float(np.abs(have - want).max() / np.abs(want).max())


@pytest.mark.parametrize(
    ("names", "rtol", "most"),
    [
        ("exponential maxwell rocking mount", 1e-10, 5e-6),
        ("polynomial thixotropy thigh", 1e-10, 5e-5),
        ("lifting", 1e-7, 5e-6),
        ("power friction", 1e-7, 1e-3),  # these dampers are nearly jumps
    ],
)
def test_departures_move_as_their_equations_of_motion_say(names: str, rtol: float, most: float) -> None:
    want = integrated(set(names.split()), 4 * STEP_S * np.arange(25), rtol)
    few, many = (error(names, want, parts) for parts in (1, 2))
    assert many < most
    assert many < few / 12 or few < most  # of fourth order


# linear motion


def small_response(made: Member, hz: float, load: float, i: int) -> tuple[complex, complex]:
    """What malleolus and foot feel over a small base, in closed form, in the i-th recording."""
    p, s = under(made.leg, made.departures, made.shaking), 2j * np.pi * hz
    K, (m_S, m_F) = p.k[:, i] + s * p.c1[:, i], p.m[:, i]
    m_H, hangs = 0.0, 0.0
    for part in made.departures:
        match part:
            case d.Maxwell():
                K = K + p.k[:, i] * (part.ankle, part.pad) * (1 - 1 / (1 + s * part.tau_s))
            case d.Reflex():
                muscle = part.stretch * p.k[0, i] + part.rate * p.c1[0, i] * s
                K = K + np.array([muscle * np.exp(-s * part.delay_s), 0])
            case d.Thigh():
                w, m_H = 2 * np.pi * part.hz, part.kg + load
                hangs = part.kg * (w**2 + 2 * part.zeta * w * s)
    # masses of shank, foot and thigh over the base
    M, u = np.diag([m_S, m_F, m_H or 1.0]), np.array([m_S, m_F, m_H])
    stiff = np.array([[K[0] + hangs, -K[0], -hangs], [-K[0], K.sum(), 0], [-hangs, 0, hangs]])
    w = np.linalg.solve(M * s**2 + stiff, -u)
    felt = 1 + s**2 * w[:2]
    for part in made.departures:
        match part:
            case d.Rocking():
                w_R = 2 * np.pi * part.hz
                felt = felt + np.array([part.share, part.foot]) * s**2 / (s**2 + 2 * part.zeta * w_R * s + w_R**2)
            case d.Mount():
                w_M = 2 * np.pi * part.hz
                felt = felt * (1 - s**2 / (s**2 + 2 * part.zeta * w_M * s + w_M**2), 1)
    return tuple(felt)


#: Worlds that are not linear however small they move.
KINKED = ("friction", "dampers of 0.6", "tremor")


@pytest.mark.parametrize("world", [w for w in WORLDS if member(w, 5).departures and w not in KINKED])
def test_small_motion_has_the_response_of_mass_and_stiffness_matrices(world: str) -> None:
    made = replace(member(world, 5), leg=LEG, frequencies_hz=(20.0, 47.0))
    small = replace(made.shaking, base=1e-4 * made.shaking.base)
    have = harmonics(made.leg, made.departures, small)[:, :, 0] / small.base[:, 0]
    session = zip(small.hz, small.load_kg, strict=True)
    want = np.array([small_response(made, hz, load, i) for i, (hz, load) in enumerate(session)]).T
    np.testing.assert_allclose(have, want, rtol=2e-4)


@pytest.mark.parametrize(
    ("world", "most"),
    [(CLEAN, 1e-6), ("everything at once", 1e-6), ("thigh", 1e-6), ("thixotropy", 1e-4), ("dampers of 0.6", 1e-3)],
)
def test_recording_begins_when_the_transient_is_forgotten(world: str, most: float) -> None:
    made = replace(member(world, 0), frequencies_hz=(15.0, 25.0))
    early, late = (motion(made.leg, made.departures, made.shaking, STEP_S, 400, patience)[0] for patience in (1.0, 2.0))
    assert (np.abs(early - late).max(axis=1) < most * np.abs(late).max(axis=1)).all()


def test_a_reflex_remembers_between_steps() -> None:
    """An ankle's reflex of a delay that is no whole number of steps, in a leg with linear dampers."""
    leg, reflex = replace(LEG, c_12=0.0, c_13=0.0, c_22=0.0, c_23=0.0), d.Reflex(0.03771, 0.1, 0.3)
    made = Member("made", 0, leg, (reflex,), (0.0,), 0.0, 0.0, 70.0, frequencies_hz=(20.0, 45.0))
    have = harmonics(leg, [reflex], made.shaking)[0, :, 0] / made.shaking.base[:, 0]
    want = [small_response(made, hz, 0.0, i)[0] for i, hz in enumerate(made.frequencies_hz)]
    np.testing.assert_allclose(have, want, rtol=5e-5)


def test_harmonics_sampled_are_the_trace() -> None:
    bent = shaking((20.0, 33.0))
    trace = motion(LEG, (), bent, STEP_S, 300)[0]
    for y, hz, amplitudes in zip(trace, bent.hz, harmonics(LEG, (), bent)[0], strict=True):
        np.testing.assert_allclose(sample(STEP_S * np.arange(300), hz, amplitudes), y, atol=1e-4)


# constants


def test_constants_follow_the_load_as_stated() -> None:
    weight = LEG.m_S + LEG.m_F
    loads = Shaking(np.array([0.0, 2.3, weight]), np.full(3, 20.0), np.ones((3, 1)))
    straight, power = (under(LEG, [d.Following(0.1, power)], loads) for power in (False, True))
    for p in (straight, power):
        assert p.k[0, :2] / LEG.k_T == pytest.approx([1.0, 1.1]) and p.c1[1, :2] / LEG.c_21 == pytest.approx([1.0, 1.1])
        assert p.m[0] == pytest.approx(LEG.m_S + loads.load_kg) and (p.m[1] == LEG.m_F).all()
    exponent = np.log(1.1) / np.log((weight + 2.3) / weight)
    assert power.k[1, 2] / LEG.k_F == pytest.approx(2**exponent)  # twice the static force
    shared = under(LEG, [d.LoadShare(0.75)], loads).m[0]
    assert shared == pytest.approx(LEG.m_S + 0.75 * loads.load_kg)


def test_constants_scatter_by_recording_or_by_load() -> None:
    loads = Shaking(np.repeat([0.0, 2.3], 500), np.full(1000, 20.0), np.ones((1000, 1)), (4,))
    p = under(LEG, [d.Scatter(0.03)], loads)
    drawn = np.log([*(p.k.T / (LEG.k_T, LEG.k_F)).T, *(p.c1.T / (LEG.c_11, LEG.c_21)).T])
    assert drawn.std(axis=1) == pytest.approx(np.full(4, 0.03), rel=0.1)
    assert np.abs(np.corrcoef(drawn) - np.eye(4)).max() < 0.1
    seated = under(LEG, [d.Scatter(0.03, by_load=True)], loads).k[0]
    assert np.unique(seated).size == 2 and (seated[:500] == seated[0]).all()
    drifting = under(LEG, [d.Posture(0.1)], loads).c1[0] / LEG.c_11
    assert drifting[[0, -1]] == pytest.approx([0.95, 1.05])


# instruments


def quiet(*instruments: instrument.Instrument, **changes: object) -> Member:
    made = replace(member(CLEAN, 1), leg=LEG, loads_kg=(0.0,), frequencies_hz=(10.0, 20.0))
    return replace(made, instruments=instruments, **changes)  # type: ignore[arg-type]


def test_a_recording_has_the_stated_noise_gain_drift_and_unit() -> None:
    noise, exact = worlds.recordings(quiet(noise=0.01)), worlds.recordings(quiet(noise=0.0))
    for noisy, clean in zip(noise, exact, strict=True):
        for channel in ("base_m_s2", "malleolus_m_s2"):
            residual = getattr(noisy, channel) - getattr(clean, channel)
            assert residual.std() == pytest.approx(0.01 * worlds.AMPLITUDE, rel=0.1)
    odd = worlds.recordings(quiet(instrument.Gain(0.03, 0.02), instrument.Unit(0.1), noise=0.0))
    for changed, clean, place in zip(odd, exact, (-0.5, 0.5), strict=True):
        np.testing.assert_allclose(changed.malleolus_m_s2, 0.1 * 1.03 * (1 + 0.02 * place) * clean.malleolus_m_s2)
        np.testing.assert_allclose(changed.base_m_s2, 0.1 * clean.base_m_s2)
    share = worlds.recordings(quiet(instrument.Noise(0.005), noise=0.0))
    residual = share[0].malleolus_m_s2 - exact[0].malleolus_m_s2
    assert residual.std() == pytest.approx(0.005 * exact[0].malleolus_m_s2.std(), rel=0.1)


def test_hum_clipping_and_converter_change_the_malleolus_as_they_should() -> None:
    (clean, *_), t = worlds.recordings(quiet(noise=0.0)), np.arange(1500) / 1000
    hum = worlds.recordings(quiet(instrument.Hum(0.2), noise=0.0))[0].malleolus_m_s2 - clean.malleolus_m_s2
    assert abs(2 * np.mean(hum * np.exp(-2j * np.pi * 50 * t))) == pytest.approx(0.2)
    assert hum.std() == pytest.approx(0.2 / np.sqrt(2))
    clipped = worlds.recordings(quiet(instrument.Clipping(0.9), noise=0.0))
    largest = max(np.abs(r.malleolus_m_s2).max() for r in worlds.recordings(quiet(noise=0.0)))
    assert max(np.abs(r.malleolus_m_s2).max() for r in clipped) == pytest.approx(0.9 * largest)
    rough = worlds.recordings(quiet(instrument.Converter(8), noise=0.0))
    levels = np.unique([r.malleolus_m_s2 for r in rough])
    assert 50 < levels.size <= 256
    assert np.abs(rough[0].malleolus_m_s2 - clean.malleolus_m_s2).max() <= 0.501 * np.diff(levels).min()


def test_cross_axis_adds_a_resonance_of_the_base() -> None:
    across = instrument.CrossAxis(0.05, 0.6, 30.0, 0.1)
    made, t = (worlds.recordings(quiet(*parts, noise=0.0)) for parts in ((across,), ())), np.arange(1500) / 1000
    for changed, clean in zip(*made, strict=True):
        hz = clean.condition.frequency_hz
        assert hz is not None
        turn, r = np.exp(-2j * np.pi * hz * t), hz / 30  # whole periods
        more = np.mean((changed.malleolus_m_s2 - clean.malleolus_m_s2) * turn) / np.mean(clean.base_m_s2 * turn)
        assert more == pytest.approx(0.05 * 0.6 * (1 + 0.2j * r) / (1 - r**2 + 0.2j * r), rel=1e-6)


def test_a_clock_that_is_off_writes_another_frequency() -> None:
    late = worlds.recordings(quiet(clock=1e-3, noise=0.0))[0].base_m_s2
    t = np.arange(1500) / 1000
    power = [abs(np.mean(late * np.exp(-2j * np.pi * hz * t))) for hz in np.linspace(9.9, 10.1, 41)]
    assert np.linspace(9.9, 10.1, 41)[np.argmax(power)] == pytest.approx(10.01, abs=0.006)


# what is recorded, and what is true


def test_population_holds_what_is_asked_of_it() -> None:
    legs = [member(world, seed) for world in WORLDS for seed in range(14)]
    assert len(legs) >= 500 and legs[7] == member(CLEAN, 7)
    assert 0.4 < np.mean([m.leg.stiff_ankle for m in legs]) < 0.6
    assert {m.loads_kg for m in legs} == {(0.0,), (0.0, 2.3), (0.0, 2.3, 4.5)}
    mounts = [part.hz for m in legs if m.world == "sensor on tissue" for part in m.departures]
    for values, low, high in (([m.noise for m in legs if m.noise], 0.002, 0.01), (mounts, 80, 150)):
        assert low <= min(values) < low + 0.2 * (high - low) and high - 0.2 * (high - low) < max(values) <= high
    one_load = {m.world for m in legs if len(m.loads_kg) == 1}
    assert not one_load & {"stiffer under load", "load share 0.9", "load share 0.75", "thigh", "scatter 3 %"}
    assert all(m.departures or m.instruments or m.clock for m in legs if m.world not in (CLEAN, "heavier leg")
               and not m.world.startswith("mass"))  # fmt: skip


@pytest.mark.parametrize("world", WORLDS)
def test_every_world_can_be_recorded(world: str) -> None:
    made = replace(member(world, 1), frequencies_hz=(20.0, 35.0), seconds=0.2)
    data = worlds.recordings(made, foot=True)
    assert [r.condition.added_mass_kg for r in data] == np.repeat(made.loads_kg, 2).tolist()
    for r in data:
        assert r.time_s.shape == (200,)
        assert all(np.isfinite(y).all() and y.std() > 0.05 for y in r.channels.values())


def test_a_sensor_on_the_foot_changes_nothing_else() -> None:
    made = quiet(seconds=0.2)
    for alone, both in zip(worlds.recordings(made), worlds.recordings(made, foot=True), strict=True):
        assert (alone.malleolus_m_s2 == both.malleolus_m_s2).all() and (alone.base_m_s2 == both.base_m_s2).all()
        assert not alone.others and list(both.others) == ["foot"]


def test_truth_of_relaxing_springs_is_dynamic_in_the_middle_of_the_band() -> None:
    made = member("springs relax", 0)
    (relaxing,) = made.departures
    assert isinstance(relaxing, d.Maxwell)
    w, tau = 2 * np.pi * np.prod(worlds.FREQUENCIES_HZ) ** (1 / 9), relaxing.tau_s
    maxwell = relaxing.ankle * made.leg.k_T
    k, c = (made.truth[name] for name in ("k_T", "c_11"))
    assert k == pytest.approx(2 * (made.leg.k_T + maxwell * (w * tau) ** 2 / (1 + (w * tau) ** 2),))
    assert c == pytest.approx(2 * (made.leg.c_11 + maxwell * tau / (1 + (w * tau) ** 2),))


def test_truth_of_other_worlds_is_the_constant_and_of_a_seating_what_lies_between() -> None:
    for world in (CLEAN, "mass +10 %", "stiffer under load", "load share 0.75", "scatter 3 %", "reflex"):
        made = member(world, 2)
        assert all(made.truth[name] == pytest.approx(2 * (getattr(made.leg, name),)) for name in made.truth)
    made = member("scatter 3 % by load", 2)
    seated = under(made.leg, made.departures, made.shaking)
    for name, value in (("k_T", seated.k[0, 0]), ("c_21", seated.c1[1, 0])):
        assert made.truth[name] == pytest.approx(sorted([getattr(made.leg, name), value]))
        assert made.truth[name][0] < made.truth[name][1]


def test_foot_near_the_axis_is_recorded_as_stated() -> None:
    data, again, other = worlds.recorded_near_axis(), worlds.recorded_near_axis(108), worlds.recorded_near_axis(109)
    made = member(worlds.NEAR_AXIS, 108)
    assert made.leg.k_T / (made.leg.a * made.leg.k_F) == pytest.approx(0.925, abs=0.001) and not made.stiff_ankle
    assert [(r.condition.added_mass_kg, r.condition.frequency_hz) for r in data] == [
        (load, hz) for load in (0.0, 2.3) for hz in (10.0, 20.0, 30.0, 40.0, 50.0)
    ]
    assert all(r.time_s.size == 1500 and r.condition.body_mass_kg == 76 for r in data)
    assert (data[0].base_m_s2 == again[0].base_m_s2).all() and (data[0].base_m_s2 != other[0].base_m_s2).any()
    assert data[3].base_m_s2.std() == pytest.approx(8.95 / np.sqrt(2), rel=0.01)
