"""MuJoCo rollouts of the two-mass foot against DOP853, the compiled twin, and the linear transfer function."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import oracle
import pytest
import thesis

import mjcf
from fasbody.exceptions import SettingError, SimulationError, UnstableError
from fasbody.foot import shaker
from fasbody.foot.engine import SHAKER_CONTROLS, callbacks
from fasbody.foot.model import Foot, can_be_constrained, load
from fasbody.foot.simulate import Batch, simulate
from fasbody.foot.steady_state import Balance
from fasbody.foot.two_dof import NAMES, TwoDof
from fasbody.recording.recording import Recording

SECONDS = 0.3
ALL = list(oracle.FEET.values())
#: All four feet in one batch.
VALUES = {name: np.array([p[name] for p in ALL], float) for name in NAMES} | oracle.MASSES


def recorded(frequency: float) -> shaker.BaseMotion:
    """A sine as a 1 kHz recording gives it: samples only."""
    t = np.arange(0, SECONDS + 1e-9, 1e-3)
    return shaker.samples(t, 8.95 * np.sin(2 * np.pi * frequency * t))


@pytest.mark.parametrize("frequency", [10.0, 50.0])
def test_malleolus_from_a_1_khz_recording_against_dop853(foot: Foot, frequency: float) -> None:
    """The accuracy that the README states: 3e-4 of the peak at 5e-4 s, 2e-5 at 2.5e-4 s, the stiff foot included."""
    t = np.arange(0, SECONDS - 1e-9, 5e-4)
    want = np.array([oracle.malleolus(p, oracle.sine(frequency), t) for p in ALL])
    peak = np.abs(want).max(axis=1, keepdims=True)
    for step, allowed in ((5e-4, 3e-4), (2.5e-4, 2e-5)):
        out = simulate(foot, recorded(frequency), step=step, values=VALUES)
        error = np.abs(out.malleolus[:, :: round(5e-4 / step)] - want) / peak
        assert error.max() <= allowed, f"{step}: {dict(zip(oracle.FEET, error.max(axis=1), strict=True))}"


@pytest.mark.parametrize("frequency", [10.0, 50.0])
def test_fourth_order_with_an_exact_sine(foot: Foot, frequency: float) -> None:
    t = np.arange(0, 0.1 - 1e-9, 1e-3)
    want = oracle.malleolus(oracle.TRUTH, oracle.sine(frequency), t, rtol=1e-12)
    errors = []
    for step in (1e-3, 5e-4, 2.5e-4):
        values = {**oracle.TRUTH, **oracle.MASSES}
        out = simulate(foot, shaker.sine(frequency, 0.1), step=step, values=values, accept=None)
        errors.append(np.abs(out.malleolus[0, :: round(1e-3 / step)] - want).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert ((orders > 3.9) & (orders < 4.7)).all(), orders


def test_base_follows_the_recording_at_and_between_its_samples(foot: Foot) -> None:
    """At 50 Hz: within 1e-6 of the peak at the samples, 1e-4 between them."""
    out = simulate(foot, recorded(50.0), step=2.5e-4, values=oracle.STIFF)
    want = 8.95 * np.sin(2 * np.pi * 50 * out.time[0])
    error = np.abs(out.base[0] - want) / 8.95
    assert error[::4].max() <= 1e-6
    assert error[5:-5].max() <= 1e-4
    assert out.base_error <= 1e-6  # what the result says of itself, against the spline
    assert np.abs(out.base[0]).max() > 8.9


@pytest.mark.parametrize(
    "motion",
    [shaker.sweep(5, 60, 0.5), shaker.multisine([10, 33], 0.5), shaker.random(5, 50, 0.5)],
    ids=lambda motion: motion.name,
)
def test_every_motion_moves_base_and_foot(foot: Foot, motion: shaker.BaseMotion) -> None:
    out = simulate(foot, motion, values={**oracle.TRUTH, **oracle.MASSES})
    np.testing.assert_allclose(out.base[0], motion.acceleration(out.time[0]), atol=1e-6 * np.abs(out.base).max())
    assert out.base_error < 1e-6
    base = lambda t: float(motion.acceleration(np.array([t]))[0])  # noqa: E731
    want = oracle.malleolus(oracle.TRUTH, base, out.time[0], rtol=1e-8)
    assert np.abs(out.malleolus[0] - want).max() < 2e-5 * np.abs(want).max()


def test_sensor_sample_k_belongs_to_state_k(foot: Foot) -> None:
    """The accelerometer before step k is Eq. 4.31 at the state before step k; one step later it is another number."""
    out = simulate(foot, shaker.sine(50.0, 0.1), step=5e-4, values={**oracle.TRUTH, **oracle.MASSES})
    pad, ankle = (int(foot.model.joint(n).qposadr[0]) for n in ("fat_pad", "talocrural"))
    x = np.stack([out.qpos[0, :, ankle], out.qpos[0, :, pad], out.qvel[0, :, ankle], out.qvel[0, :, pad]])
    want = TwoDof.from_values({**oracle.TRUTH, **oracle.MASSES}).output(x)
    peak = np.abs(want).max()
    assert np.abs(out.malleolus[0] - want[:-1]).max() < 1e-8 * peak
    assert np.abs(out.malleolus[0] - want[1:]).max() > 0.05 * peak
    np.testing.assert_allclose(out.time[0], np.arange(200) * 5e-4, atol=1e-12)


def test_settled_linear_foot_has_the_linear_transmissibility(foot: Foot) -> None:
    """Nine frequencies in one batch, amplitude and phase from one whole period, against the dynamic stiffness."""
    linear = {**oracle.TRUTH, "c_12": 0.0, "c_13": 0.0, "c_22": 0.0, "c_23": 0.0}
    frequencies = np.array(thesis.FREQUENCIES_HZ, float)
    out = simulate(foot, [shaker.sine(f, 1.0) for f in frequencies], step=5e-4, values={**linear, **oracle.MASSES})
    last = out.time[0] >= 0.8  # 0.2 s: whole periods of all nine
    turn = np.exp(-2j * np.pi * np.outer(frequencies, out.time[0][last]))
    H = (out.malleolus[:, last] * turn).sum(1) / (out.base[:, last] * turn).sum(1)
    np.testing.assert_allclose(H, oracle.linear_response(linear, frequencies), rtol=2e-5)


def test_parameters_of_one_simulation_are_those_of_a_separate_model(foot: Foot) -> None:
    batch = simulate(foot, shaker.sine(30.0, 0.1), values=VALUES)
    for i, p in enumerate(ALL):
        single = simulate(foot.with_values({**p, **oracle.MASSES}), shaker.sine(30.0, 0.1))
        np.testing.assert_array_equal(batch.malleolus[i], single.malleolus[0])
        np.testing.assert_array_equal(batch.qpos[i], single.qpos[0])
    assert np.ptp(batch.malleolus[:, -1]) > 0.1


def test_batches_do_not_depend_on_threads_or_on_what_ran_before(foot: Foot) -> None:
    motion = shaker.random(5, 50, 0.2)
    one = simulate(foot, motion, values=VALUES, threads=1)
    two = simulate(foot, motion, values=VALUES, threads=2)
    np.testing.assert_array_equal(one.malleolus, two.malleolus)
    batch, controls = Batch(foot, 4, 1), motion.controls(5e-4, 400)[None]
    batch.set(VALUES)
    first = batch.run(controls, 5e-4).malleolus
    batch.run(motion.controls(2.5e-4, 100)[None], 2.5e-4, qvel=np.full(foot.model.nv, 0.1))
    np.testing.assert_array_equal(batch.run(controls, 5e-4).malleolus, first)


def test_initial_states(foot: Foot) -> None:
    """Free vibration from a displaced, moving start."""
    pad, ankle = (int(foot.model.joint(n).qposadr[0]) for n in ("fat_pad", "talocrural"))
    qpos, qvel = np.zeros(3), np.zeros(3)
    qpos[[ankle, pad]], qvel[[ankle, pad]] = (5e-4, -8e-4), (0.05, -0.08)
    still = shaker.BaseMotion("still", 0.1, np.zeros_like, np.zeros_like)
    out = simulate(foot, still, step=1e-4, values={**oracle.TRUTH, **oracle.MASSES}, qpos=qpos, qvel=qvel)
    want = oracle.malleolus(oracle.TRUTH, lambda t: 0.0, out.time[0], start=(5e-4, -8e-4, 0.05, -0.08))
    assert np.abs(out.malleolus[0] - want).max() < 1e-6 * np.abs(want).max()


def test_sizes_that_do_not_fit_get_a_sentence(foot: Foot) -> None:
    with pytest.raises(SettingError, match=r"as many as each other, not \[2, 3\]"):
        simulate(foot, [shaker.sine(10.0, 0.1)] * 2, values={"k_T": np.array([1e5, 2e5, 3e5])})
    with pytest.raises(SettingError, match="shorter than one step"):
        simulate(foot, shaker.sine(10.0, 1e-4))
    with pytest.raises(SettingError, match=r"unknown parameter 'k_t'.*did you mean 'k_T'"):
        simulate(foot, shaker.sine(10.0, 0.1), values={"k_t": 1e5})


def test_an_unstable_step_is_an_error_not_a_number(foot: Foot) -> None:
    values = {"c_21": np.array([300.0, 9000.0])}
    with pytest.raises(UnstableError, match="1 of 2 simulations became unstable"):
        simulate(foot, shaker.sine(10.0, 2.0), step=2e-3, values=values, accept=None)
    halved = simulate(foot, shaker.sine(10.0, 2.0), step=2e-3, values=values)
    assert halved.step_s < 2e-3 and np.isfinite(halved.malleolus).all()


def test_result_prints_itself(foot: Foot) -> None:
    assert "1 x 200 steps" in str(simulate(foot, shaker.sine(30.0, 0.1)))


@pytest.mark.parametrize("values", [{"k_F": [1e5, -1.0]}, {"k_F": -1.0}, {"c_11": float("nan")}])
def test_values_that_a_foot_cannot_have_are_refused_as_elsewhere(foot: Foot, values: dict[str, float]) -> None:
    with pytest.raises(SettingError, match="it must be a number of zero or more"):
        simulate(foot, shaker.sine(20, 0.1), values=values)


def test_a_name_is_no_model() -> None:
    with pytest.raises(SettingError, match=r"load it first: load\('two_dof'\)"):
        simulate("two_dof", shaker.sine(20, 0.1))  # type: ignore[arg-type]


def test_skipping_the_constraint_stage_changes_no_bit() -> None:
    foot, motion = load("two_dof"), shaker.sine(30.0, 0.1)
    assert not can_be_constrained(foot.model)
    fast = simulate(foot, motion)
    foot.model.opt.disableflags = 0
    np.testing.assert_array_equal(fast.malleolus, simulate(foot, motion).malleolus)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<joint name="fat_pad"', '<joint name="fat_pad" range="-0.01 0.01"'),
        ('<geom name="table"', '<geom name="table" contype="1" conaffinity="1"'),
        ("<actuator>", '<equality><joint joint1="talocrural" active="false"/></equality><actuator>'),
    ],
)
def test_a_model_that_can_be_constrained_keeps_the_stage(
    old: str,
    new: str,
    edited: Callable[..., Path],
) -> None:
    foot = load(edited((old, new)))
    assert can_be_constrained(foot.model) and not foot.model.opt.disableflags


def implicit(integrator: str, step: str = "5e-4") -> Foot:
    """two_dof on another integrator, its bends and laws gone, so that nothing but the step falsifies it."""
    text = mjcf.text("two_dof").replace(' user="4.25 800 -50 100"', "").replace("50 100", "0 0")
    velocities = "".join(
        f'<framelinvel name="{name}_velocity" objtype="site" objname="{name}"/>' for name in ("malleolus", "foot")
    )
    text = text.replace("</sensor>", velocities + "</sensor>").replace('timestep="5e-4"', f'timestep="{step}"')
    return load(text.replace("RK4", integrator))


@pytest.mark.parametrize(("integrator", "frequency"), [("implicitfast", 45.0), ("Euler", 20.0), ("implicit", 20.0)])
def test_the_error_of_the_step_is_stated(integrator: str, frequency: float) -> None:
    """Against the transfer function, as the coarse run's own second run estimates it."""
    foot, seconds = implicit(integrator), 20 / frequency
    run = simulate(foot, shaker.sine(frequency, seconds), accept=None)
    values = foot.values() | dict.fromkeys(("c_12", "c_13", "c_22", "c_23"), 0.0)
    T = TwoDof.from_values(values).transmissibility(np.array([frequency]))[0]
    t = run.time[0]
    late = t > 10 / frequency
    true = (T * -1j * 0.5 * shaker.PEAK_TO_PEAK * np.exp(2j * np.pi * frequency * t)).real[late]
    error = np.sqrt(np.mean((run.malleolus[0, late] - true) ** 2) / np.mean(true**2))
    assert error > 1e-3
    assert run.step_error == pytest.approx(error, rel=0.3)
    assert f"step error {run.step_error:.1e}" in str(run)


def test_a_simulation_is_called_as_a_recording(foot: Foot) -> None:
    """One becomes the other by name, whole."""
    run = simulate(foot, shaker.sine(20.0, 1.0))
    names = ("time_s", "base_m_s2", "malleolus_m_s2")
    recording = Recording(*(getattr(run, name)[0] for name in names))
    for name, short in zip(names, ("time", "base", "malleolus"), strict=True):
        np.testing.assert_array_equal(getattr(recording, name), getattr(run, short)[0])
        assert getattr(recording, short) is getattr(recording, name)
    assert {"time_s", "base_m_s2", "malleolus_m_s2"} <= set(run.records()[0])


def test_a_step_that_is_too_long_is_halved() -> None:
    """Until the stated error is accepted; the result has the samples that were asked for."""
    foot, motion = implicit("implicitfast"), shaker.sine(45.0, 0.1)
    rough = simulate(foot, motion, accept=None)
    assert rough.step_error > 0.03 and rough.step_s == foot.step
    run, fine = simulate(foot, motion), simulate(foot, motion, step=foot.step / 256, accept=None)
    assert run.step_error < 1e-3 and run.step_s == foot.step / 64
    np.testing.assert_array_equal(run.time, rough.time)
    assert run.qpos.shape == rough.qpos.shape
    travel = np.ptp(fine.qpos[0], axis=0)  # the base is about zero at the end
    assert (np.abs(run.qpos[0, -1] - fine.qpos[0, -1]) < 2e-3 * travel).all()
    for name, values in run.outputs.items():
        true = fine.outputs[name][:, ::256]
        error = np.sqrt(np.mean((values - true) ** 2) / np.mean(true**2))
        assert error < 1.1 * run.step_error
    assert f"step error {run.step_error:.1e} at 7.81e-06 s" in str(run)


def test_a_step_that_no_halving_mends_is_refused() -> None:
    foot, motion = implicit("implicitfast"), shaker.sine(45.0, 0.2)
    with pytest.raises(SimulationError, match=r"steps of 0.00025 s put sensor 'foot' off by .*IMPLICITFAST"):
        simulate(foot, motion, accept=1e-6)


ARCH = mjcf.text("foot_arch")
SOFT = ARCH.replace('damping="2" user="4.25 2 0 0"', 'damping="0.2" user="4.25 0.2 0 0"')
SOFT_ANKLE = ARCH.replace('joint name="talocrural" stiffness="1e6"', 'joint name="talocrural" stiffness="1e5"')


@pytest.mark.parametrize(("text", "step"), [(ARCH, "2.5e-4"), (SOFT_ANKLE, "2.5e-4"), (ARCH, "2e-3"), (SOFT, "2.5e-4")])
def test_the_stated_error_bounds_the_true_one(text: str, step: str) -> None:
    """Of the arch two errors fall at different rates, or the first step diverges; harmonic balance has no step."""
    foot, hz = load(text.replace('timestep="1e-4"', f'timestep="{step}"')), 40.0
    run = simulate(foot, shaker.sine(hz, 0.4, peak_to_peak=18.0))
    n = round(10 / hz / foot.step)
    turn = np.exp(-2j * np.pi * hz * run.time[0, -n:])
    T = (run.malleolus[0, -n:] @ turn) / (run.base[0, -n:] @ turn)
    off = abs(T * -9j / Balance(foot).orbit(hz, [-9j]).harmonics()[0] - 1)
    assert off < 1.1 * run.step_error < 1.1e-3


def test_the_stated_error_bounds_that_of_a_constraint_under_runge_kutta() -> None:
    """One that is to be stiffer than the step allows is as soft as that: no error of the fourth order."""
    tie = '<joint joint1="talocrural" joint2="fat_pad" polycoef="0 -0.5 0 0 0" solref="4e-4 1"/>'
    foot = load(mjcf.text("two_dof").replace("</mujoco>", f"<equality>{tie}</equality></mujoco>"))
    motion = shaker.sine(20.0, 0.2, peak_to_peak=18.0)
    run, fine = (simulate(foot, motion, step=step, accept=None) for step in (foot.step, foot.step / 32))
    rough, true = run.malleolus[0], fine.malleolus[0, ::32]
    off = np.sqrt(np.mean((rough - true) ** 2) / np.mean(true**2))
    assert 0.9 * run.step_error < off < run.step_error


def test_halving_goes_on_where_no_order_can_be_read() -> None:
    """At 0.05 s Runge-Kutta diverges, and errs by ten times at a sixteenth of it."""
    foot = load(mjcf.text("two_dof").replace('timestep="5e-4"', 'timestep="0.05"'))
    assert simulate(foot, shaker.sine(20.0, 1.0)).step_error < 1e-3


@pytest.mark.parametrize(("name", "searched"), [("two_dof", 1), ("foot_arch", 3)])
def test_the_pose_of_rest_is_found_once(monkeypatch: pytest.MonkeyPatch, name: str, searched: int) -> None:
    """The closure of foot_arch is as stiff as each of three steps allows, so its poses differ."""
    calls, standing = [], Batch.standing
    monkeypatch.setattr(Batch, "standing", lambda self, step: calls.append(step) or standing(self, step))
    simulate(load(name), shaker.sine(20.0, 0.01), accept=None)
    assert len(calls) == searched


TIES = {
    "joint": '<equality><joint joint1="talocrural" joint2="fat_pad"/></equality>',
    "tendon": '<tendon><fixed name="both"><joint joint="fat_pad" coef="1"/><joint joint="talocrural" coef="-1"/>'
    '</fixed></tendon><equality><tendon tendon1="both"/></equality>',
    "connect": '<equality><connect body1="shank" body2="foot" anchor="0 0 0"/></equality>',
}


@pytest.mark.parametrize("hz", [10.0, 25.0, 45.0])
@pytest.mark.parametrize("tie", TIES)
def test_the_stated_error_is_that_of_plain_mujoco_at_a_tenth_of_the_step(tie: str, hz: float) -> None:
    foot, motion = load(mjcf.text("two_dof").replace("</mujoco>", TIES[tie] + "</mujoco>")), shaker.sine(hz, 0.2)
    run = simulate(foot, motion, step=2e-3)
    model, steps = foot.with_values({}, step=2e-4).model, 10
    data, fine = mujoco.MjData(model), []
    data.qpos[foot.base], data.qvel[foot.base] = motion.start or (0.0, 0.0)
    with callbacks():
        for controls in motion.controls(2e-4, steps * run.time.size):
            data.ctrl[foot.shaker :][:SHAKER_CONTROLS] = controls
            mujoco.mj_step(model, data)
            fine.append(float(foot.sensors["malleolus"].read(data.sensordata)))
    off = np.std(run.malleolus[0] - fine[::steps]) / np.std(fine[::steps])
    assert run.step_s == 2e-3 and off < 1.05 * run.step_error < 1e-3


def test_the_step_of_runge_kutta_is_fine(foot: Foot) -> None:
    run = simulate(foot, shaker.sine(45.0, 0.2))
    assert run.step_error < 1e-3
    fine = simulate(foot, shaker.sine(45.0, 0.2), step=foot.step / 8).outputs
    errors = [
        np.sqrt(np.mean((values - fine[name][:, ::8]) ** 2) / np.mean(fine[name] ** 2))
        for name, values in run.outputs.items()
    ]
    assert run.step_error == pytest.approx(max(errors), rel=0.1)


def test_dampers_of_the_law_are_of_second_order() -> None:
    """Half of them is taken at the end of a step: the arch errs by less than 1e-3 at its own step."""
    foot = load("mounted_arch")
    orbit = Balance(foot).orbit(45.0, [1.0])
    count = round(1 / 45 / foot.step)
    step = 1 / 45 / count
    controls = shaker.harmonics(45.0, [1.0], 8 / 45).controls(step, 8 * count)[None]
    run = Batch(foot, 1).run(controls, step, *orbit.initial_state())
    last = run.malleolus[0, -count:] @ np.exp(-2j * np.pi * np.arange(count) / count) * 2 / count
    assert abs(last / orbit.harmonics()[0] - 1) < 1e-3
