"""Equalities, stops and contacts at every amplitude, against ODEs with the constraint's force in closed form.

One constraint of a two-mass foot has one unknown force, so MuJoCo's convex problem (computation, "solver") has a closed
solution: f = (a_ref - a_free) / (A + R), on one side alone where it can let go. The table of 1e9 kg is not in it.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mjcf
from fasbody.exceptions import ModelError, NotSmoothError, SimulationError
from fasbody.foot.linear import Linear
from fasbody.foot.model import Foot, load
from fasbody.foot.shaker import harmonics, sine
from fasbody.foot.simulate import Batch, simulate
from fasbody.foot.steady_state import Balance
from fasbody.recording.recording import Recording
from identification.fitting import fit_foot

HZ, PERIODS, STEP = 20.0, 7, 1e-4
W = 2 * np.pi * HZ
#: Masses of foot and shank [kg], springs [N/m] and dampers [N s/m] of pad and ankle.
M_F, M_S, K, C = 1.052265, 3.374505, np.array([1e5, 1.5e5]), np.array([800.0, 430.0])
#: Mass matrix in the joints z_2 (pad), z_1 (ankle), and what the base's acceleration pushes.
M, PUSH = np.array([[M_F + M_S, M_S], [M_S, M_S]]), np.array([M_F + M_S, M_S])
INVERSE = np.linalg.inv(M)
LINEAR = mjcf.text("two_dof").replace("-50 100", "0 0").replace("50 100", "0 0")


@dataclass(frozen=True)
class Constraint:
    """One constraint.

    Attributes:
        mjcf: what is put before the actuators. joint: what is put into the joint of the pad.
        J: (2,) its Jacobian. weight: MuJoCo's estimate of J M^-1 J'. gap: at rest [m], None where it holds both ways.
        rigid: by how much it does not give. loss: force [N] at which dry friction slips, None for others.
        solref: time [s] and ratio.
    """

    mjcf: str
    J: np.ndarray
    weight: float
    joint: str = ""
    gap: float | None = None
    rigid: bool = False
    loss: float | None = None
    solref: tuple[float, float] = (0.02, 1.0)

    def foot(self) -> Foot:
        text = LINEAR.replace("  <actuator>", self.mjcf + "  <actuator>", 1)
        return load(text.replace('name="fat_pad"', f'name="fat_pad" {self.joint}', 1))

    def force(self, z: np.ndarray, v: np.ndarray, free: np.ndarray) -> float:
        """By the default solimp="0.9 0.95 0.001 0.5 2"."""
        time, ratio = self.solref
        r = self.J @ z + (self.gap or 0.0) if self.loss is None else 0.0  # friction holds no place
        if self.gap is not None and r >= 0:
            return 0.0
        x = min(1.0, abs(r) / 1e-3)
        d = 0.9 + 0.05 * (2 * x**2 if x < 0.5 else 1 - 2 * (1 - x) ** 2)
        k, b = 1 / (0.95 * time * ratio) ** 2, 2 / (0.95 * time)
        f = (-b * (self.J @ v) - k * d * r - self.J @ free) / (self.J @ INVERSE @ self.J + (1 - d) / d * self.weight)
        if self.loss is not None:
            return float(np.clip(f, -self.loss, self.loss))
        return f if self.gap is None else max(0.0, f)


TIED = '<equality><joint joint1="talocrural" joint2="fat_pad" {0}/></equality>'
HARD = 'solref="-1e7 -1e4" solimp="0.9999 0.9999 0.001"'
TENDON = ('<tendon><fixed name="both"><joint joint="fat_pad" coef="1"/><joint joint="talocrural" coef="-1"/></fixed>'
          '</tendon><equality><tendon tendon1="both" {0}/></equality>')  # fmt: skip
TENDONS = ('<tendon><fixed name="heel"><joint joint="fat_pad" coef="1"/></fixed><fixed name="ankle"><joint '
           'joint="talocrural" coef="1"/></fixed></tendon><equality><tendon tendon1="heel" tendon2="ankle"/>'
           '</equality>')  # fmt: skip
DIFFERENCE, PAD = np.array([-1.0, 1.0]), np.array([1.0, 0.0])
CONSTRAINTS = {
    "a joint equality": Constraint(TIED.format(""), DIFFERENCE, INVERSE[0, 0] + INVERSE[1, 1]),
    "a hard joint equality": Constraint(TIED.format(HARD), DIFFERENCE, 0.0, rigid=True),
    "a tendon equality": Constraint(TENDON.format(""), -DIFFERENCE, DIFFERENCE @ INVERSE @ DIFFERENCE),
    "a soft equality of two tendons": Constraint(TENDONS, DIFFERENCE, INVERSE[0, 0] + INVERSE[1, 1]),
    "a hard tendon equality": Constraint(TENDON.format(HARD), DIFFERENCE, 0.0, rigid=True),
    "a connect": Constraint(
        f'<equality><connect body1="shank" body2="foot" anchor="0 0 0" {HARD}/></equality>', np.array([0.0, 1.0]), 0.0,
        rigid=True),
    "a stop": Constraint("", PAD, INVERSE[0, 0], 'range="0 1"', gap=0.0),
    "a stop at a distance": Constraint("", PAD, INVERSE[0, 0], 'range="-1e-4 1"', gap=1e-4),
    "dry friction": Constraint("", PAD, INVERSE[0, 0], 'frictionloss="1"', loss=1.0),
    "a contact": Constraint('<contact><pair geom1="sole" geom2="table" condim="1"/></contact>', PAD,
                            INVERSE[0, 0] / 3, gap=1e-5),
}  # fmt: skip
#: The sole as a ball above the top of the table, which lies at -0.02.
SOLE = '<geom name="sole" size="0.01" pos="0.03 -0.00999 0"/><geom name="foot"'


def truth(of: Constraint, peak: float) -> complex:
    """Malleolus over table at `HZ` by the ODE, or in closed form where the constraint is rigid."""
    if of.rigid:
        both = np.array([[of.J[1]], [-of.J[0]]])  # the one way in which both joints may move
        z = np.linalg.solve(both.T @ (np.diag(K + 1j * W * C) - W**2 * M) @ both, -both.T @ PUSH)
        return complex(1 - W**2 * (both @ z).sum())

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        z, v = x[:2], x[2:]
        free = INVERSE @ (-K * z - C * v - PUSH * peak * np.cos(W * t))
        return np.concatenate([v, free + INVERSE @ of.J * of.force(z, v, free)])

    t = (PERIODS - 2 + 2 * np.arange(512) / 512) / HZ
    run = solve_ivp(rates, (0, PERIODS / HZ), np.zeros(4), "DOP853", t_eval=t, rtol=1e-9, atol=1e-13, max_step=1e-3)
    z = 2 / 512 * (run.y[0] + run.y[1]) @ np.exp(-1j * W * t)
    return complex(1 - W**2 * z / peak)


SLIGHT = [pytest.param(name, 0.02, marks=[pytest.mark.long] * (name != "a stop at a distance")) for name in CONSTRAINTS]


@pytest.mark.parametrize(("name", "peak"), [*SLIGHT, *((name, 9.0) for name in CONSTRAINTS)])
def test_a_constraint_acts_at_every_amplitude(name: str, peak: float) -> None:
    of = CONSTRAINTS[name]
    foot = load(LINEAR_CONTACT) if name == "a contact" else of.foot()
    run = simulate(foot, harmonics(HZ, [peak], PERIODS / HZ), step=STEP)
    n = round(2 / HZ / STEP)
    late = run.qpos[0, -n - 1 : -1, 1:].sum(axis=1) @ np.exp(-1j * W * run.time[0, -n:]) * 2 / n
    expected = truth(of, peak)
    assert abs((1 - W**2 * late / peak) / expected - 1) < 5e-4
    assert run.base_error < 1e-7
    free = np.linalg.solve(np.diag(K + 1j * W * C) - W**2 * M, -PUSH)
    acts = (of.gap or 0.0) < 5e-5 * peak
    assert (abs(expected / (1 - W**2 * free.sum()) - 1) > 1e-3) == acts


LINEAR_CONTACT = LINEAR.replace('<geom name="foot"', SOLE, 1).replace(
    "  <actuator>", CONSTRAINTS["a contact"].mjcf + "  <actuator>", 1
)


@pytest.mark.parametrize("option", ['iterations="1"', 'tolerance="1e-3"', 'solver="PGS"'])
def test_settings_of_the_solver_change_nothing(option: str) -> None:
    plain = CONSTRAINTS["a joint equality"].foot()
    text = LINEAR.replace("  <actuator>", TIED.format("") + "  <actuator>", 1)
    other = load(text.replace("<option ", f"<option {option} ", 1))
    one, two = (simulate(foot, harmonics(HZ, [1.0], 0.1)).malleolus for foot in (plain, other))
    np.testing.assert_allclose(two, one, rtol=1e-9, atol=1e-12)


def test_noslip_is_refused() -> None:
    with pytest.raises(ModelError, match="noslip_iterations"):
        load(LINEAR.replace("<option ", '<option noslip_iterations="3" ', 1))


def test_friction_that_does_not_slip_is_linear() -> None:
    """Its slopes are taken so small that they do not slip either."""
    of = CONSTRAINTS["dry friction"]
    expected = truth(of, 0.02)
    assert abs(Linear(of.foot()).transmissibility(np.array([HZ]))[0] / expected - 1) < 1e-4
    assert abs(Balance(of.foot()).orbit(HZ, [0.02]).harmonics()[0] / 0.02 / expected - 1) < 1e-4


HARD_STOP = Constraint("", PAD, INVERSE[0, 0], 'range="-1e-4 1" solreflimit="0.002 0.3"', gap=1e-4, solref=(0.002, 0.3))


def test_a_hard_stop_is_judged_by_its_motion_and_not_by_the_peaks_of_impacts() -> None:
    """The foot's accelerometer reads impacts, whose peaks no step settles; the harmonics of the malleolus are right."""
    peak = 2.0
    run = simulate(HARD_STOP.foot(), harmonics(HZ, [peak], PERIODS / HZ), step=5e-4)
    n = round(2 / HZ / 5e-4)
    T = run.malleolus[0, -n:] @ np.exp(-1j * W * run.time[0, -n:]) * 2 / n / peak
    assert abs(T / truth(HARD_STOP, peak) - 1) < 1e-3
    assert run.step_error < 1e-2  # of the foot's own accelerometer, which reads impacts between the samples
    assert run.sample_error > 1e-3


#: A brace that a spring holds against the shank, which sticks to it and slips.
BRACE = (
    '<body name="brace"><joint name="brace" axis="1 0 0" stiffness="2e3" damping="20"/>'
    '<geom type="box" size=".005 .05 .05" pos="0.155 0.08 0" contype="1" conaffinity="2" mass="0.3" '
    'friction="0.5 0.01 0.0001" condim="3"/></body>'
)
SHIN = (
    '<geom type="sphere" size=".03" pos="0.1205 0.08 0" contype="2" conaffinity="1" condim="3" '
    'friction=".5 .01 .0001" solref="0.004 1"/>'
)


def test_error_of_stick_and_slip_is_that_of_its_worst_periods() -> None:
    """Over the whole run it averages out: 8e-4 were stated where the last five periods are off by 1.7e-3."""
    text = mjcf.text("two_dof").replace('gravity="0 0 0"', 'gravity="0 -9.81 0"')
    text = text.replace('<body name="foot"', f'{BRACE}<body name="foot"', 1)
    text = text.replace('<geom name="shank"', f'{SHIN}<geom name="shank"', 1)
    run = simulate(load(text), sine(HZ, 2.0, peak_to_peak=8.0))
    late = run.time[0] > run.time[0, -1] - 5 / HZ
    t = run.time[0, late]
    columns = np.exp(1j * W * np.outer(t, np.arange(-5, 6)))
    malleolus, base = (np.linalg.lstsq(columns, x[0, late], rcond=None)[0][6] for x in (run.malleolus, run.base))
    exact = 1.75736 * np.exp(-1j * np.radians(51.19))  # Runge-Kutta on mj_forward with steps of 1e-4 s and a half
    assert abs(malleolus / base / exact - 1) < run.step_error


def test_samples_that_miss_impacts_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stop of both joints that is hit at 9 m/s^2: the motion is right, and samples of half a millisecond are not.

    No halving mends them, so few are tried.
    """
    of, run, steps = HARD_STOP.foot(), Batch.run, []
    monkeypatch.setattr(Batch, "run", lambda self, u, h, *state: steps.append(h) or run(self, u, h, *state))
    with pytest.raises(SimulationError, match=r"steps of 0\.0005 s put sensor"):
        simulate(of, harmonics(HZ, [9.0], PERIODS / HZ), step=5e-4)
    assert min(steps) >= 5e-4 / 16
    assert simulate(of, harmonics(HZ, [9.0], PERIODS / HZ), step=5e-4, accept=0.2).step_error > 1e-2


def test_a_motion_that_is_wrong_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fasbody.foot.simulate.HALVINGS", 0)
    with pytest.raises(SimulationError, match="put sensor 'foot' off by"):
        simulate(HARD_STOP.foot(), harmonics(HZ, [2.0], PERIODS / HZ), step=5e-4)


SHIPPED_PAD = 'name="fat_pad" stiffness="1.0e5" damping="800" user="4.25 800 -50 100"'
STRAP = """<tendon><fixed name="strap" springlength="{} 0.3" stiffness="{}"><joint joint="fat_pad" coef="1"/></fixed>
</tendon></mujoco>"""


@pytest.mark.parametrize(
    ("old", "new", "linear"),
    [
        ("</mujoco>", STRAP.format(0, "3e4"), False),
        ("</mujoco>", STRAP.format(-1e-4, "3e4"), True),
        ("</mujoco>", STRAP.format(0, "10"), True),  # a ten-thousandth of the pad
        (SHIPPED_PAD, SHIPPED_PAD.replace("4.25 800 -50 100", "1 1e5 30 1.5 0.5 0 -1"), False),
        (SHIPPED_PAD, 'name="fat_pad" user="4.23 900 1.5 60 1 0.7 0.02 0.2"', False),
        (SHIPPED_PAD, 'name="fat_pad" user="4.23 900 1.5 60 1 1 0.02 0.2"', True),
        (SHIPPED_PAD, SHIPPED_PAD.replace('stiffness="1.0e5"', 'stiffness="1.0e5 0 1e9"'), True),
    ],
)
def test_a_force_without_a_slope_at_rest_has_no_small_motion(old: str, new: str, linear: bool) -> None:
    """A strap that pulls only, and powers of stretch or rate; beside a strap that is slack or weak, and smooth laws."""
    assert old in mjcf.text("two_dof")
    foot = load(mjcf.text("two_dof").replace(old, new))
    if linear:
        Linear(foot)
    else:
        with pytest.raises(SimulationError, match="joint 'fat_pad' has another spring or damper as soon as the foot"):
            Linear(foot)


def test_rounding_of_a_stiff_closure_is_no_corner() -> None:
    """An arch that carries its own weight: its forces are rounded to 1e-4 N, ten times a step of 1e-8 m."""
    Linear(load(mjcf.text("foot_arch").replace('gravity="0 0 0"', 'gravity="0 -9.81 0"')))


@pytest.mark.parametrize(
    ("gap", "linear"), [(1e-9, True), (1e-11, False), (0.0, False), (-1e-11, False), (-1e-9, True)]
)
def test_what_is_about_to_touch_has_no_small_motion(gap: float, linear: bool) -> None:
    """A stop that is open by `gap` [m] leaves the foot free; one that is pressed is a spring and a damper."""
    of = Constraint("", PAD, INVERSE[0, 0], f'range="{-gap!r} 1"', gap=gap)
    if not linear:
        with pytest.raises(SimulationError, match="joint 'fat_pad' touches, stops or slips as soon as the foot moves"):
            Linear(of.foot())
        return
    d, rate = 0.9, 2 / (0.95 * 0.02)
    stop = 0.0 if gap > 0 else (d * 1 / (0.95 * 0.02) ** 2 + 1j * W * rate - W**2) / ((1 - d) / d * INVERSE[0, 0])
    z = np.linalg.solve(np.diag(K + 1j * W * C) - W**2 * M + stop * np.outer(PAD, PAD), -PUSH)
    assert abs(Linear(of.foot()).transmissibility(np.array([HZ]))[0] / (1 - W**2 * z.sum()) - 1) < 1e-4


@pytest.mark.parametrize("name", ["a joint equality", "a tendon equality", "a connect"])
def test_harmonic_balance_finds_the_same(name: str) -> None:
    of = CONSTRAINTS[name]
    found = Balance(of.foot()).orbit(HZ, [1.0]).harmonics()[0]
    assert abs(found / truth(of, 1.0) - 1) < 1e-4


def test_harmonic_balance_refuses_a_stop_that_acts() -> None:
    with pytest.raises(NotSmoothError):
        Balance(CONSTRAINTS["a stop at a distance"].foot()).orbit(HZ, [9.0])


@pytest.mark.parametrize("name", ["dry friction", "a joint equality", "a connect", "a stop at a distance"])
def test_another_mass_moves_what_the_engine_derives_from_it(name: str) -> None:
    """How soft a constraint is hangs on masses; parameters of one simulation count as those of a file."""
    foot, motion, values = CONSTRAINTS[name].foot(), harmonics(HZ, [1.0], 4 / HZ), {"m_S": 10.0}
    run, file = simulate(foot, motion, values=values), simulate(foot.with_values(values), motion)
    np.testing.assert_allclose(run.malleolus, file.malleolus, atol=1e-9 * np.abs(file.malleolus).max())


def test_the_current_of_a_motor_is_of_first_order() -> None:
    """A coil on the ankle, whose damping is K^2 / (R + iwL), against harmonic balance."""
    coil = (
        '<dcmotor name="coil" joint="talocrural" input="none" motorconst="5 5" resistance="0.1" inductance="5e-4 0"/>'
    )
    foot = load(LINEAR.replace("  </actuator>", f"{coil}</actuator>", 1))
    run = simulate(foot, harmonics(HZ, [1.0], PERIODS / HZ), accept=5e-3)
    n = round(2 / HZ / foot.step)
    T = run.malleolus[0, -n:] @ np.exp(-1j * W * run.time[0, -n:]) * 2 / n
    off = abs(T / Balance(foot).orbit(HZ, [1.0]).harmonics()[0] - 1)
    assert 1e-5 < off < 1.5 * run.step_error


@pytest.mark.long
def test_a_fit_of_every_sample_needs_no_harmonics() -> None:
    """One sine on a pad of dry friction that slips: constants come back from a start that is 20 % off."""
    foot, step = CONSTRAINTS["dry friction"].foot(), 5e-4
    run = simulate(foot, harmonics(HZ, [9.0], 1.0), step=step)
    late, rng = slice(-800, None), np.random.default_rng(1)
    base, malleolus = (x[0, late] + rng.normal(0, 0.01, 800) for x in (run.base, run.malleolus))
    start = foot.with_values({"k_T": 1.2 * K[1], "c_21": 1.2 * C[0]})
    recording = Recording(step * np.arange(800), base, malleolus)
    result = fit_foot(recording, start, free=["k_T", "c_21"], domain="time", starts=1, threads=1)
    assert result["k_T"].value == pytest.approx(K[1], rel=3e-3)
    assert result["c_21"].value == pytest.approx(C[0], rel=3e-3)
