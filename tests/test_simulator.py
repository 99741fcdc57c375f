"""The simulator that judges the fit, against closed forms and an independent integration."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from simulator import departure as d
from simulator import worlds
from simulator.leg import STEP_S, Leg, Shaking, harmonics, motion, sample, under
from simulator.worlds import WORLDS, Member, member

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
        ("exponential maxwell rocking mount", 1e-9, 5e-6),
        ("polynomial thixotropy thigh", 1e-9, 5e-5),
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

