"""The shown motion is the model's: against harmonic balance, the linear equations, an energy balance."""

import json
from threading import Event

import numpy as np
import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

import mjcf
from fasbody.arch.bones import Arch
from fasbody.arch.linear import transmissibility
from fasbody.exceptions import SettingError, SimulationError
from fasbody.foot.linear import Linear
from fasbody.foot.model import load
from fasbody.foot.shaker import PEAK_TO_PEAK, sweep
from fasbody.foot.two_dof import TwoDof
from fasbody.foot.two_mass import parameters, resolved
from fasbody.recording.recording import Recording
from fasbody.recording.study import BUNDLED
from viz.excitation import Excitation
from viz.feet import Show
from viz.motion import UNWANTED, Motion, UnwantedError, periodic_motion, transient_motion, without_drift
from viz.settings import Settings


def balanced(frequency: float, added_mass: float, base: np.ndarray, count: int) -> np.ndarray:
    """Malleolus acceleration over one period by harmonic balance, which knows nothing of MuJoCo."""
    values = load("two_dof").values()
    theta = parameters(values | {"m_S": values["m_S"] + added_mass})
    orbit = resolved(theta[None], np.array([2 * np.pi * frequency]), base[None])
    assert orbit.converged.all()
    k = np.arange(1, orbit.shank.shape[1] + 1)
    return (np.exp(2j * np.pi * np.outer(np.arange(count) / count, k)) @ orbit.shank[0]).real


@pytest.mark.parametrize(("frequency", "added_mass"), [(7.0, 0.0), (10.0, 0.0), (20.0, 2.3), (45.0, 4.5)])
def test_two_masses_follow_harmonic_balance(frequency: float, added_mass: float) -> None:
    motion = periodic_motion(load("two_dof"), Settings(frequency, added_mass=added_mass))
    orbit = balanced(frequency, added_mass, np.array([-0.5j * PEAK_TO_PEAK]), 64)
    assert np.abs(motion.malleolus - orbit).max() < 0.01 * np.abs(orbit).max()
    assert motion.gap < 1e-3


def test_shown_bodies_move_as_their_accelerations_say() -> None:
    motion = periodic_motion(load("two_dof"), Settings(20.0))
    shank = motion.bodies[:, list(motion.names).index("shank"), 1]
    harmonic = np.fft.rfft(motion.malleolus)[1:8] / -((2 * np.pi * 20 * np.arange(1, 8)) ** 2)
    assert np.abs(np.fft.rfft(shank)[1:8] - harmonic).max() < 1e-3 * np.abs(harmonic).max()


STOP = ('name="fat_pad"', 'name="fat_pad" range="-1e-4 1"')


STRAPPED = (
    mjcf.text("two_dof")
    .replace('<site name="base"/>', '<site name="base"/><site name="down" pos="0.15 0 0"/>')
    .replace('<site name="malleolus"', '<site name="up" pos="0.05 0.2 0"/><site name="malleolus"')
    .replace(
        "</mujoco>",
        '<tendon><spatial range="0 0.2236" solreflimit="0.005 1"><site site="down"/><site site="up"/></spatial>'
        "</tendon></mujoco>",
    )
)


def test_the_step_of_a_settled_motion_is_judged_by_whole_periods() -> None:
    """A strap that is hit: against MuJoCo with a step of 1e-5 s, extrapolated over 1 s (0.90678)."""
    motion = periodic_motion(load(STRAPPED), Settings(40.0, peak_to_peak=18.0))
    assert motion.ratio == pytest.approx(0.90678, rel=5e-4)


LANDED = mjcf.text("two_dof").replace('gravity="0 0 0"', 'gravity="0 -9.81 0"').replace(
    'name="fat_pad"', 'name="fat_pad" range="-3e-4 3e-4" solreflimit="0.01 1"', 1
)  # fmt: skip


@pytest.mark.parametrize(("peak", "ratio"), [(9.0, 0.8635), pytest.param(9.5, None, marks=pytest.mark.long)])
def test_impacts_on_a_grid_of_steps_settle(peak: float, ratio: float | None) -> None:
    """Every second period differs by less than the step falsifies, and by nothing at other steps."""
    motion = periodic_motion(load(LANDED), Settings(40.0, peak_to_peak=2 * peak))
    assert motion.gap < 1e-3
    assert ratio is None or motion.ratio == pytest.approx(ratio, rel=2e-4)


def test_a_motion_that_repeats_every_second_period_is_called_so() -> None:
    with pytest.raises(SimulationError, match="repeats itself every second period only"):
        periodic_motion(load(LANDED), Settings(50.0, peak_to_peak=17.9))


def test_a_stop_is_stepped_and_starts_where_small_motion_is() -> None:
    """Where the stop is not reached balance finds the same motion; where it acts, more than one harmonic moves."""
    text = mjcf.text("two_dof")
    stopped = load(text.replace(*STOP))
    free, small = (periodic_motion(foot, Settings(20.0, peak_to_peak=0.2)) for foot in (load(text), stopped))
    assert small.ratio == pytest.approx(free.ratio, rel=1e-6)
    harsh = periodic_motion(stopped, Settings(20.0))
    assert harsh.periodic and harsh.gap > 0
    spectrum = np.abs(np.fft.rfft(harsh.malleolus))
    assert spectrum[2] > 0.01 * spectrum[1]
    q, v, _ = Linear(load(text)).start(20.0, [1.0])
    p = TwoDof.from_values(load(text).values())
    w = 2 * np.pi * 20
    T = p.transmissibility(np.array([20.0]))[0]
    assert (-(w**2) * q.sum(), w * v.sum()) == pytest.approx((T.real, T.imag), rel=1e-6)


def test_the_loop_of_a_polynomial_damper_is_that_of_the_engine() -> None:
    """MuJoCo damps with c v + c_2 v |v|, whichever way it goes."""
    damping = 'damping="430" user="4.25 430 50 100"'
    foot = load(mjcf.text("two_dof").replace(damping, 'damping="430 4000"'))
    x, force = periodic_motion(foot, Settings(frequency=15.0, peak_to_peak=4.0)).loops["ankle"]
    v = np.fft.ifft(2j * np.pi * 15 * x.size * np.fft.fftfreq(x.size) * np.fft.fft(x)).real
    np.testing.assert_allclose(force, 1.5e5 * x + 430 * v + 4000 * v * np.abs(v), atol=1e-3)


def test_loops_hold_the_energy_that_the_shaker_puts_in() -> None:
    """Over one period the work of the base on the foot is what pad and ankle lose: the areas of the shown loops."""
    foot = load("two_dof")
    motion = periodic_motion(foot, Settings(20.0))
    m_S, m_F = (foot.values()[name] for name in ("m_S", "m_F"))
    y = motion.bodies[:, :, 1]
    names = list(motion.names)
    w = 2 * np.pi * 20

    def rate(values: np.ndarray, order: int) -> np.ndarray:
        spectrum = np.fft.rfft(values) * (1j * w * np.arange(33)) ** order
        return np.fft.irfft(spectrum, 64)

    push = m_S * rate(y[:, names.index("shank")], 2) + m_F * rate(y[:, names.index("foot")], 2)
    work = np.sum(push * rate(y[:, names.index("base")], 1)) / 64 / 20
    lost = sum(np.sum(force * rate(x, 1)) / 64 / 20 for x, force in motion.loops.values())
    assert set(motion.loops) == {"fat pad", "ankle"}
    assert lost == pytest.approx(work, rel=1e-3)
    assert lost > 0


def test_arch_flattens_and_fascia_stretches() -> None:
    motion = periodic_motion(load("foot_arch"), Settings(20.0))
    apex = motion.bodies[:, list(motion.names).index("apex"), 1]
    base = motion.bodies[:, list(motion.names).index("base"), 1]
    stretch = motion.loops["fascia"][0]
    assert np.corrcoef(apex - base, stretch)[0, 1] < -0.7  # down goes with longer
    linear = transmissibility(Arch.from_model(load("foot_arch").model), np.array([20.0]))
    assert motion.ratio == pytest.approx(abs(linear[0]), rel=1e-3)


def test_transient_keeps_the_table_in_the_picture() -> None:
    motion: Motion = transient_motion(load("two_dof"), Settings(), sweep(5, 40, 1.0))
    table = motion.bodies[:, 0, 1]
    assert 1e-4 < np.abs(table).max() < 0.02
    assert motion.ratio is None
    assert not motion.periodic


def test_transient_keeps_the_peaks_of_fifty_hertz() -> None:
    """Frames between two shown ones are drawn on a straight line, which must not cut off the peaks."""
    motion = transient_motion(load("two_dof"), Settings(), sweep(50, 50.001, 0.5))
    step = motion.time[1] - motion.time[0]
    assert 1 / step >= 12 * 50
    late = motion.base[len(motion.base) // 2 :]
    assert late.max() > 0.96 * PEAK_TO_PEAK / 2


@pytest.mark.parametrize("weight", ["-9.81", "-1e-3"])
def test_a_transient_of_a_foot_that_nothing_carries_is_refused(weight: str) -> None:
    text = mjcf.text("two_dof").replace('name="fat_pad" stiffness="1.0e5"', 'name="fat_pad"')
    text = text.replace('gravity="0 0 0"', f'gravity="0 {weight} 0"')
    lines = [line for line in text.splitlines() if '"k_F"' not in line]
    with pytest.raises(SimulationError, match="nothing carries joint 'fat_pad'"):
        transient_motion(load("\n".join(lines)), Settings(), sweep(5, 40, 0.2))


def test_table_at_rest_has_no_ratio() -> None:
    motion = periodic_motion(load("two_dof"), Settings(20.0, 0.0))
    assert motion.periodic
    assert (motion.ratio, motion.phase) == (None, None)
    assert np.abs(motion.malleolus).max() < 1e-6


def test_displacement_of_a_sine() -> None:
    t = np.arange(2000) / 1000
    seen = without_drift(3 * np.sin(2 * np.pi * 20 * t), 1e-3, twice=True)[500:1500]
    expected = -3 * np.sin(2 * np.pi * 20 * t[500:1500]) / (2 * np.pi * 20) ** 2
    assert np.abs(seen - expected).max() < 0.02 * np.abs(expected).max()


def test_harmonics_together_are_more_than_a_sine() -> None:
    """Under two harmonics harmonic balance finds the same motion."""
    U = np.array([-8.0j, 2.0 + 1.0j])
    motion = periodic_motion(load("two_dof"), Settings(12.0), U)
    orbit = balanced(12.0, 0.0, U, 64)
    assert np.abs(motion.malleolus - orbit).max() < 0.01 * np.abs(orbit).max()


def recorded(seconds: float = 4.0, rate: float = 1000.0) -> Recording:
    """A malleolus that moves 1.03 mm at 19.7 Hz, of which no whole number of periods was recorded."""
    t = np.arange(round(seconds * rate)) / rate
    w = 2 * np.pi * 19.7
    base, malleolus = 0.6e-3 * np.sin(w * t + 0.4), 1.03e-3 * np.sin(w * t - 0.6)
    return Recording.from_arrays(t, -(w**2) * base, -(w**2) * malleolus, body_mass_kg=72.57)


def test_steady_recording_is_displaced_as_it_moved() -> None:
    """From the first moment to the last, without an invented start or end."""
    recording = recorded()
    show = Show(["two_dof"], Excitation.recorded(recording))
    motion = show.answer(show.settings)["feet"]["measured"]
    drawn = np.reshape(motion["bodies"], (64, 2, 6))[..., 1]
    t = np.arange(64) * motion["duration"] / 64
    w = 2 * np.pi / motion["duration"]
    for seen, size, phase in ((drawn[:, 0], 0.6e-3, 0.4), (drawn[:, 1], 1.03e-3, -0.6)):
        assert np.abs(seen - size * np.sin(w * t + phase)).max() < 0.01 * size


def test_model_and_measurement_differ_as_their_accelerations_do() -> None:
    """With the known constants of the bundled foot the drawn difference is that of the accelerations, ride or stay."""
    truth = json.loads((BUNDLED / "truth.json").read_text())
    excitation = Excitation.recorded(BUNDLED / "recordings" / "20hz_0kg.csv")
    delay = truth["instrument"]["delay_s"]
    show = Show(["two_dof"], excitation, Settings(values=truth["parameters"], delay_s=delay))
    feet = show.answer(show.settings)["feet"]
    model, seen = feet["a"], feet["measured"]
    own = np.reshape(model["bodies"], (64, -1, 6))[..., 1]
    drawn, table = np.reshape(seen["bodies"], (64, 2, 6))[:, 1, 1], own[:, 0]
    shank = own[:, -1]
    by_acceleration = np.std(np.subtract(model["malleolus"], seen["malleolus"])) / np.std(seen["malleolus"])
    assert np.std(shank - drawn) / np.std(drawn) == pytest.approx(by_acceleration, abs=2e-3)
    assert by_acceleration < 0.025
    riding = np.std((shank - table) - (drawn - table)) / np.std(drawn)
    assert riding == pytest.approx(np.std(shank - drawn) / np.std(drawn), rel=1e-9)
    assert seen["fit_percent"] > 99
    assert model["ratio"] == pytest.approx(seen["ratio"], rel=5e-3)


def test_other_recordings_keep_a_margin_on_both_sides() -> None:
    """Where the shown piece begins and ends, model and measurement move as they did, not as a filter starts."""
    rng, rate = np.random.default_rng(3), 1000.0
    f = np.arange(12, 40, 1.11)
    t, phase = np.arange(6000) / rate, rng.uniform(0, 2 * np.pi, f.size)
    lines = np.cos(2 * np.pi * np.outer(t, f) + phase)
    base = lines.sum(1)
    displaced = -(lines / (2 * np.pi * f) ** 2).sum(1)
    excitation = Excitation.recorded(Recording.from_arrays(t, base, base, body_mass_kg=72.57), 2.0)
    assert excitation.steady is None
    show = Show(["two_dof"], excitation)
    feet = show.answer(show.settings)["feet"]
    frames = feet["measured"]["frames"]
    drawn = np.reshape(feet["measured"]["bodies"], (frames, 2, 6))[..., 1]
    at = show.motions(show.settings)["a"].time
    assert at[0] == pytest.approx(excitation.window[0], abs=2e-3)
    expected = np.interp(at, t, displaced)
    for column in (0, 1):
        assert np.abs(drawn[:, column] - expected).max() < 0.06 * np.abs(expected).max()


def test_parameters_stay_within_their_bounds() -> None:
    foot = load("two_dof")
    wild = Settings(20.0, values={"k_F": 1e12})
    with pytest.raises(SettingError, match=r"k_F is 1e\+12 N/m, but must be between 3000 and 1e\+06"):
        wild.apply(foot)
    assert wild.held(foot).apply(foot).values()["k_F"] == pytest.approx(foot.parameters["k_F"].upper)
    with pytest.raises(SettingError, match="unknown parameter 'k_X'"):
        Settings(20.0, values={"k_X": 1.0}).apply(foot)


@pytest.mark.parametrize(
    "wrong", [{"frequency": 0.0}, {"frequency": float("nan")}, {"added_mass": -1.0}, {"peak_to_peak": 1e9}]
)
def test_settings_that_cannot_be_meant(wrong: dict[str, float]) -> None:
    with pytest.raises(SettingError, match="must be between"):
        Settings(**wrong)


def test_corners_of_the_declared_bounds_are_shown() -> None:
    """Far too stiff for the model's own step."""
    corner = {"m_F": 0.2, "c_21": 3e3, "c_11": 2.9e3, "c_12": 0.0, "c_13": 0.0, "c_22": 0.0, "c_23": 0.0}
    motion = periodic_motion(load("two_dof"), Settings(30.0, values=corner))
    foot = TwoDof.from_values(load("two_dof").values() | corner)
    assert motion.ratio == pytest.approx(abs(foot.transmissibility(np.array([30.0]))[0]), rel=1e-6)


@pytest.mark.parametrize("name", ["k_2", "k_3", "k_4"])
def test_arch_is_shown_with_a_joint_at_its_declared_bound(name: str) -> None:
    foot = load("foot_arch")
    stiff = {name: foot.parameters[name].upper}
    motion = periodic_motion(foot, Settings(20.0, values=stiff))
    linear = transmissibility(Arch.from_model(foot.with_values(stiff).model), np.array([20.0]))
    assert motion.ratio == pytest.approx(abs(linear[0]), rel=1e-3)


def test_too_stiff_names_the_parameter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("viz.motion.STEPS", 1024)
    text = mjcf.text("foot_arch")
    foot = load(text.replace('<joint name="spring_ligament"/>', '<joint name="spring_ligament" range="-1e-5 1"/>'))
    with pytest.raises(SimulationError, match=r"lower k_3, 3e\+06 .* times the model's own\.$"):
        periodic_motion(foot, Settings(20.0, values={"k_3": 3e6}))


def test_computing_has_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """No period is begun after it."""
    foot = load(mjcf.text("two_dof").replace(*STOP))
    monkeypatch.setattr("viz.motion.PATIENCE", -1.0)
    with pytest.raises(SimulationError, match="has not settled in -1 s"):
        periodic_motion(foot, Settings(20.0))
    monkeypatch.setattr("viz.motion.PATIENCE", 20.0)
    assert periodic_motion(foot, Settings(20.0)).periodic
    unwanted = Event()
    unwanted.set()
    before = UNWANTED.set(unwanted)
    with pytest.raises(UnwantedError):
        periodic_motion(foot, Settings(20.0))
    UNWANTED.reset(before)
