"""Hysteresis loops and energies: closed form, an ODE solver with its own energy integrals, MuJoCo against the twin."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import made_fits
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mjcf
from fasbody.exceptions import ModelError
from fasbody.foot import hysteresis
from fasbody.foot.model import Foot, load
from fasbody.foot.two_dof import TwoDof
from fasbody.recording.checks import checked
from fasbody.recording.recording import Condition, Recording
from identification.harmonics import Line
from identification.replay import relaxing
from identification.study import job

LINEAR = {"c_12": 0.0, "c_13": 0.0, "c_22": 0.0, "c_23": 0.0}
BENT = {"c_12": 90.0, "c_13": 140.0, "c_22": -120.0, "c_23": 180.0}
#: A shaker with some distortion [m/s^2].
BASE = np.array([-8.95j, 0.13 + 0.05j, 0.07j])
SINE = BASE[:1]


@pytest.mark.parametrize("f", [10.0, 27.0, 50.0])
@pytest.mark.parametrize("two_mass", [True, False])
def test_linear_foot_dissipates_pi_c_omega_z_squared(foot: Foot, f: float, two_mass: bool) -> None:
    values = foot.values() | LINEAR
    A, B, _ = TwoDof.from_values(values).state_space()
    z = np.linalg.solve(2j * np.pi * f * np.eye(4) - A, B * -8.95j)[:2]
    found = hysteresis.cycle(foot, f, SINE, values, two_mass)
    for loop, c, amplitude in zip((found.ankle, found.fat_pad), (values["c_11"], values["c_21"]), z, strict=True):
        assert loop.dissipated_j == pytest.approx(np.pi * c * 2 * np.pi * f * abs(amplitude) ** 2, rel=2e-4)
        assert np.sqrt(2) * loop.displacement_m.std() == pytest.approx(abs(amplitude), rel=1e-4)


@pytest.fixture(scope="module")
def integrated(foot: Foot) -> tuple[np.ndarray, float]:
    """The bent foot at 15 Hz by DOP853, its energies integrated along: (ankle, pad, shaker) in one cycle."""
    two = TwoDof.from_values(foot.values() | BENT)
    omega = 2j * np.pi * 15.0 * np.arange(1, BASE.size + 1)

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        turning = np.exp(omega * t)
        u, v0 = (turning @ BASE).real, (turning @ (BASE / omega)).real
        z, z_dot = x[:2], x[2:4]
        c_T = two.c_11 * np.exp(-two.c_12 * z[0]) * np.cos(two.c_13 * z[0])
        c_F = two.c_21 * np.exp(-two.c_22 * z[1]) * np.cos(two.c_23 * z[1])
        pull_T, pull_F = two.k_T * z[0] + c_T * z_dot[0], two.k_F * z[1] + c_F * z_dot[1]
        accelerations = [(pull_F - pull_T) / two.m_F - pull_T / two.m_S, (pull_T - pull_F) / two.m_F - u]
        powers = [c_T * z_dot[0] ** 2, c_F * z_dot[1] ** 2, -pull_F * v0]  # the pad pulls the base up, the base pushes
        return np.array([*z_dot, *accelerations, *powers])

    many = 30  # a motion once begun has decayed to 1e-9 by then
    t = np.array([many, many + 1]) / 15.0
    run = solve_ivp(rates, (0, t[1]), np.zeros(7), method="DOP853", rtol=1e-10, atol=1e-13, t_eval=t)
    return np.diff(run.y[4:], axis=1)[:, 0], float(run.y[0, 1])


@pytest.mark.parametrize("two_mass", [True, False])
def test_nonlinear_energies_are_those_of_an_ode_solver(
    foot: Foot, integrated: tuple[np.ndarray, float], two_mass: bool
) -> None:
    (ankle, pad, work), z_1 = integrated
    assert work == pytest.approx(ankle + pad, rel=1e-6)
    found = hysteresis.cycle(foot, 15.0, BASE, foot.values() | BENT, two_mass)
    assert found.ankle.dissipated_j == pytest.approx(ankle, rel=1e-4)
    assert found.fat_pad.dissipated_j == pytest.approx(pad, rel=1e-4)
    assert found.shaker_work_j == pytest.approx(work, rel=1e-4)
    assert found.ankle.displacement_m[0] == pytest.approx(z_1, rel=1e-4)
    assert abs(found.imbalance) < 1e-6


@pytest.mark.parametrize("relaxes", [False, True])
@pytest.mark.parametrize("f", [10.0, 50.0])
def test_mujoco_draws_the_loops_of_the_equations(foot: Foot, f: float, relaxes: bool) -> None:
    """The closed form against MuJoCo's own forces, where springs relax those of the Maxwell elements among them."""
    values = foot.values() | BENT | {"m_S": 5.0}
    both = [hysteresis.cycle(foot, f, BASE, values, False)]
    if relaxes:
        k, r = (values["k_T"], values["k_F"]), (0.4, 0.7)
        both = [hysteresis.cycle(relaxing(foot), f, BASE, values | {
            "relaxing_T": k[0] * r[0], "relaxing_F": k[1] * r[1], "tau_T": 4e-3, "tau_F": 4e-3}, False)]  # fmt: skip
        values |= {"r_T": r[0], "r_F": r[1], "tau": 4e-3}
    both.append(hysteresis.cycle(foot, f, BASE, values, True))
    for part in ("ankle", "fat_pad"):
        a, b = (getattr(each, part) for each in both)
        every = b.force_n.size // a.force_n.size
        for x, y in ((a.force_n, b.force_n[::every]), (a.displacement_m, b.displacement_m[::every])):
            assert np.abs(x - y).max() < 1e-6 * np.abs(x).max()
        assert a.dissipated_j == pytest.approx(b.dissipated_j, rel=1e-6)
    assert both[0].shaker_work_j == pytest.approx(both[1].shaker_work_j, rel=1e-6)  # the table's force against momentum


def test_the_area_inside_the_loop_is_the_energy(foot: Foot) -> None:
    found = hysteresis.cycle(foot, 20.0, BASE, foot.values() | BENT, True)
    for loop in (found.ankle, found.fat_pad):
        x, F = loop.displacement_m, loop.force_n
        shoelace = 0.5 * abs(np.sum(x * np.roll(F, -1) - F * np.roll(x, -1)))
        assert loop.dissipated_j == pytest.approx(shoelace, rel=5e-3)  # a polygon of 100 corners


def test_arch_balances_with_its_tendons_and_closed_loop() -> None:
    """foot_arch: pads are tendons, an equality closes the loop, a motor is in the fascia, the integrator implicit."""
    arch = load("foot_arch")
    found = hysteresis.cycle(arch, 50.0, SINE, arch.values(), False)
    assert abs(found.imbalance) < 1e-6
    assert 0 < found.ankle.dissipated_j + found.fat_pad.dissipated_j < found.dissipated_j  # ligaments have the rest
    stiffness = np.polyfit(found.fat_pad.displacement_m, found.fat_pad.force_n, 1)[0]
    assert stiffness == pytest.approx(arch.values()["k_F"], rel=0.05)


def test_a_pad_with_a_memory_balances(edited: Callable[..., Path]) -> None:
    """The pad law 4.22 is an actuator with activations: its force is part of the loop."""
    parameters = re.findall(r'    <text name="(?:k_F|c_21|c_22|c_23)".*\n', mjcf.text("two_dof"))
    joint = '<joint name="fat_pad" stiffness="1.0e5" damping="800" user="4.25 800 -50 100"/>'
    actuator = (
        '    <general name="pad" joint="fat_pad" dyntype="user" actdim="8" gainprm="0" biastype="user" '
        'biasprm="4.22 150 6 0.9 0.002 1 0.02 0.2"/>\n  </actuator>'
    )
    pad = load(
        edited((joint, '<joint name="fat_pad"/>'), *((line, "") for line in parameters), ("  </actuator>", actuator))
    )
    found = hysteresis.cycle(pad, 25.0, SINE, pad.values(), False)
    assert abs(found.imbalance) < 1e-6
    assert found.dissipated_j == pytest.approx(found.ankle.dissipated_j + found.fat_pad.dissipated_j, rel=1e-3)
    assert found.fat_pad.dissipated_j > 0.1 * found.dissipated_j


def test_a_model_without_a_fat_pad_says_so(tmp_path: Path) -> None:
    file = tmp_path / "renamed.xml"
    text = mjcf.text("two_dof")
    file.write_text(text.replace('"fat_pad"', '"sole"').replace("joint fat_pad ", "joint sole "))
    with pytest.raises(ModelError, match="fat_pad or heel_pad and forefoot_pad, so it has no fat pad loop"):
        hysteresis.cycle(load(file), 20.0, SINE, load(file).values(), False)


def test_cycles_of_a_fit(trial: Callable[..., Recording], foot: Foot) -> None:
    truth = foot.values() | {"k_T": 1.3e5, "c_22": -120.0}
    recordings = [trial(truth, f) for f in (15.0, 30.0)]
    fitted = made_fits.document("pooled", recordings, ["15hz.csv", "30hz.csv"], starts=2)
    result, entries = fitted["result"], fitted["cycles"]
    assert len(entries) == 2 * len(result["branches"])
    for entry in entries:
        assert abs(entry["imbalance"]) < 1e-6
        assert entry["dissipated_j"] == pytest.approx(entry["shaker_work_j"], rel=0.005)
        # of both branches, as the subject's other fits may decide for either
        assert len(entry["ankle"]["displacement_m"]) == job.POINTS
    assert {e["branch"] for e in entries if not e["chosen"]} == {b["name"] for b in result["branches"][1:]}
    for entry, recording in zip((e for e in entries if e["chosen"]), recordings, strict=True):
        line = Line.of(checked(recording))
        moving = truth | recording.condition.masses
        true = hysteresis.cycle(foot, line.base.frequency_hz, line.base.amplitudes, moving, True)
        for part in ("ankle", "fat_pad"):
            assert len(entry[part]["displacement_m"]) == len(entry[part]["force_n"]) == job.POINTS
            assert entry[part]["dissipated_j"] == pytest.approx(getattr(true, part).dissipated_j, rel=0.1)
            # the stored polygon closes the same area
            x, F = np.array(entry[part]["displacement_m"]), np.array(entry[part]["force_n"])
            area = 0.5 * abs(np.sum(x * np.roll(F, -1) - F * np.roll(x, -1)))
            assert area == pytest.approx(entry[part]["dissipated_j"], rel=0.02)
        measured, model = (complex(*entry["transmissibility"][kind]) for kind in ("measured", "model"))
        turning = np.exp(-2j * np.pi * line.base.frequency_hz * recording.time_s)
        direct = (recording.malleolus_m_s2 @ turning) / (recording.base_m_s2 @ turning)
        assert abs(measured / direct - 1) < 0.005 and abs(model / direct - 1) < 0.01


def test_broadband_recordings_have_no_cycle(trial: Callable[..., Recording], foot: Foot) -> None:
    broad = replace(trial(foot.values(), 20.0), condition=Condition("16", "midstance", 0.0, 72.57, None))
    assert job.cycles({"branches": []}, foot, [broad]) == []


def test_a_second_sensors_delay_has_no_part_in_the_motion(foot: Foot) -> None:
    """A study with an accelerometer on the foot fits its delay too, under a key that no model has."""
    estimates = {"k_T_n_per_m": 2e5, "delay_s": 1e-4, "delay_foot_s": 3e-4}
    branch = {"parameters": {key: {"value": value} for key, value in estimates.items()}}
    assert job.values_of(branch, foot) == {"k_T": 2e5, "delay": 1e-4}


@pytest.mark.parametrize(("edit", "mean"), [
    (('gravity="0 0 0"', 'gravity="0 0 0" viscosity="5" density="800"'), 0.0),
    (('<body name="shank">', '<body name="shank" gravcomp="1">'), -1.052265 * 9.81),
])  # fmt: skip
def test_a_loop_is_of_its_spring_and_damper_alone(edit: tuple[str, str], mean: float) -> None:
    """In water, and with a shank that hangs: neither is part of the force in the pad."""
    text = mjcf.text("two_dof").replace(*edit)
    foot = load(text.replace('gravity="0 0 0"', 'gravity="0 -9.81 0"') if mean else text)
    x = (loop := hysteresis.cycle(foot, 20.0, [1.0], foot.values(), False).fat_pad).displacement_m
    v = np.fft.ifft(2j * np.pi * 20 * x.size * np.fft.fftfreq(x.size) * np.fft.fft(x)).real
    force = 1e5 * x + 800 * np.exp(50 * x) * np.cos(100 * x) * v
    np.testing.assert_allclose(loop.force_n, force, atol=1e-5 * np.ptp(force))
    assert loop.force_n.mean() == pytest.approx(mean, abs=0.02)
