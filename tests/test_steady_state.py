"""Harmonic balance of the shipped models, against equations written elsewhere and ODEs at tight tolerance."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import oracle
import pytest
from scipy.integrate import solve_ivp

import mjcf
from fasbody.arch import linear
from fasbody.arch.bones import Arch
from fasbody.exceptions import NotSmoothError, PeriodicMotionError, SettingError, SimulationError
from fasbody.foot.engine import callbacks
from fasbody.foot.model import Foot, load
from fasbody.foot.rest import standing
from fasbody.foot.shaker import harmonics
from fasbody.foot.simulate import Batch, simulate
from fasbody.foot.steady_state import Balance, Orbit
from fasbody.foot.two_dof import TwoDof
from simulator import mount
from simulator.mounted import SHIPPED

Array = np.ndarray
#: A base with harmonics of its own, and a foot whose dampers bend strongly.
BASE = np.array([8.95 * np.exp(0.3j), 0.13j, 0.07])
BENT = oracle.TRUTH | oracle.MASSES


@cache
def model(name: str) -> Foot:
    return load(name)


@cache
def balance(name: str, *sensors: str) -> Balance:
    return Balance(model(name), sensors or ("malleolus",))


@cache
def bent(frequency_hz: float = 17.0) -> Orbit:
    return balance("two_dof", "malleolus", "foot").orbit(frequency_hz, BASE, BENT)


def table(frequency_hz: float, t: float) -> float:
    return float((BASE @ np.exp(2j * np.pi * frequency_hz * t * np.arange(1, 4))).real)


def after(frequency_hz: float, state: Array, t: Array | None = None) -> Array:
    """States (4, n) of the two masses at times of the first period, by DOP853."""
    twin = TwoDof.from_values(BENT)
    T = 1 / frequency_hz
    return np.asarray(
        solve_ivp(lambda t, s: twin.rates(t, s, table(frequency_hz, t)), (0, T), state, method="DOP853", rtol=1e-12,
                  atol=1e-17, t_eval=[T] if t is None else t).y
    )  # fmt: skip


def two_states(orbit: Orbit) -> Array:
    """z1, z2 and their rates at time zero."""
    qpos, qvel, _ = orbit.initial_state()
    return np.array([qpos[2], qpos[1], qvel[2], qvel[1]])


@pytest.mark.parametrize("frequency_hz", [10.0, 17.0, 45.0])
def test_the_two_masses_are_exact(frequency_hz: float) -> None:
    """Every harmonic of both sensors, and the motion that returns after a period."""
    orbit, twin = bent(frequency_hz), TwoDof.from_values(BENT)
    state, n, H = two_states(orbit), orbit.series.samples, orbit.series.harmonics
    assert after(frequency_hz, state)[:, -1] == pytest.approx(state, rel=1e-9, abs=1e-12)
    states = after(frequency_hz, state, np.arange(n) / n / frequency_hz)
    for name, y in (("malleolus", twin.output(states)), ("foot", twin.foot_output(states))):
        want = 2 / n * np.fft.fft(y)[1 : H + 1]
        np.testing.assert_allclose(orbit.harmonics(name), want, rtol=0, atol=1e-10 * 8.95)
    assert np.abs(orbit.harmonics()[1]) > 0.01  # it bends


def test_the_base_moves_as_asked() -> None:
    orbit = bent()
    np.testing.assert_allclose(orbit.harmonics("base")[:3], BASE, rtol=1e-12)
    assert np.abs(orbit.harmonics("base")[3:]).max() < 1e-12
    acceleration = orbit.shaken.motion(orbit.series, orbit.solution.x)[2, :, 0]
    t = np.arange(orbit.series.samples) / orbit.series.samples / 17.0
    np.testing.assert_allclose(acceleration, [table(17.0, time) for time in t], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("frequency_hz", [5.0, 20.0, 45.0])
def test_the_arch_is_its_equations(frequency_hz: float) -> None:
    """Small motion against Eq. (4.12): six coordinates, an equality and a DC motor."""
    have = balance("foot_arch").orbit(frequency_hz, [0.1]).harmonics()[0] / 0.1
    arch = Arch.from_model(model("foot_arch").model)
    assert have == pytest.approx(complex(linear.transmissibility(arch, np.array(frequency_hz))), rel=1e-6)


@pytest.mark.parametrize("frequency_hz", [10.0, 45.0])
def test_the_mounted_arch_is_its_closed_form(frequency_hz: float) -> None:
    """The give of two equalities, regularised by 1e-4, is left."""
    balanced = balance("mounted_arch", "malleolus", "tuberosity").orbit(frequency_hz, [0.1])
    M, C, K, rows = mount.matrices(SHIPPED)
    want = mount.response(np.array([frequency_hz]), M, C, K, rows)[0]
    for name, T in zip(("malleolus", "tuberosity"), want, strict=False):
        assert balanced.harmonics(name)[0] / 0.1 == pytest.approx(T, rel=1e-5)


@pytest.mark.parametrize("frequency_hz", [10.0, 35.0])
def test_the_leg_is_its_chain(frequency_hz: float) -> None:
    """Five masses in absolute coordinates, under an added mass."""
    from fasbody.leg.chain import Leg

    leg = Leg.from_model(model("leg").model)
    mass = leg.mass.copy()
    mass[leg.carrier] += 2.3
    want = replace(leg, mass=mass, added=2.3)
    orbit = balance("leg", "malleolus", "knee").orbit(frequency_hz, [8.95], {"added_mass": 2.3})
    for site in ("malleolus", "knee"):
        T = want.at(site, np.array([frequency_hz]))[0]
        assert orbit.harmonics(site)[0] / 8.95 == pytest.approx(complex(T), rel=1e-9)


def gap(orbit: Orbit, steps: int) -> float:
    """Largest difference to a rollout of one period from the orbit's state, over the peak."""
    foot = orbit.shaken.balance.foot
    f = orbit.shaken.frequency_hz
    step = 1 / f / steps
    run = Batch(foot, 1, 1).run(harmonics(f, BASE, 1 / f).controls(step, steps)[None], step,
                                *(part[None] for part in orbit.initial_state()))  # fmt: skip
    t = np.arange(steps) * step
    k = np.arange(1, orbit.series.harmonics + 1)
    want = (np.exp(2j * np.pi * f * np.outer(t, k)) @ orbit.harmonics()).real
    return float(np.abs(run.malleolus[0] - want).max() / np.abs(want).max())


@pytest.mark.parametrize(("name", "steps", "coarse"), [("foot_arch", 400, 4e-3), ("mounted_arch", 400, 2e-2)])
def test_stepping_comes_nearer_with_the_step(name: str, steps: int, coarse: float) -> None:
    """MuJoCo's implicit integrator is of first order in the closures: half the step, half of what is between them."""
    orbit = balance(name).orbit(20.0, BASE)
    gaps = [gap(orbit, steps * times) for times in (1, 2, 4)]
    assert coarse > gaps[0] > 1.8 * gaps[1] > 3.24 * gaps[2]


def test_runge_kutta_stays_on_the_orbit_of_the_leg() -> None:
    assert gap(balance("leg").orbit(20.0, BASE), 400) < 1e-7


def differences(orbit: Orbit, name: str, share: float) -> dict[str, Array]:
    """Derivatives by orbits on either side, extrapolated."""
    shaken = orbit.shaken
    item, at = shaken.balance.foot.parameters[name], {**shaken.balance.foot.values(), **shaken.values}[name]
    size = share * (at if item.logarithmic else max(abs(item.lower), abs(item.upper)))

    def slope(step: float) -> Array:
        ends = [shaken.balance.orbit(shaken.frequency_hz, BASE, {**shaken.values, name: at + s * step}, orbit)
                for s in (1, -1)]  # fmt: skip
        one, other = (np.array([end.harmonics(sensor) for sensor in shaken.balance.sensors]) for end in ends)
        return (one - other) / (2 * step)

    return dict(zip(shaken.balance.sensors, (4 * slope(size) - slope(2 * size)) / 3, strict=True))


def test_derivatives_of_the_two_masses() -> None:
    """All eight constants and both masses, at both sensors."""
    orbit = bent()
    names = list(model("two_dof").parameters)
    have = orbit.shaken.balance.derivatives(orbit, names)
    for column, name in enumerate(names):
        for sensor, want in differences(orbit, name, 1e-3).items():
            scale = np.abs(want).max()
            np.testing.assert_allclose(have[sensor][:, column], want, rtol=0, atol=2e-7 * scale, err_msg=name)


@pytest.mark.parametrize(("name", "share", "parameters"), [
    ("foot_arch", 1e-2, ("k_T", "k_F", "k_11", "k_12", "c_1", "k_3", "c_T", "c_F", "c_4", "m_T")),
    ("leg", 1e-3, ("k_F", "c_T", "m_K", "added_mass")),
])  # fmt: skip
def test_derivatives_of_other_models(name: str, share: float, parameters: tuple[str, ...]) -> None:
    """Springs, dampers, a DC motor's resistance and inductance, a mass that has its place in an equality's give.

    An orbit rests within 1e-9 of the motion, which is 4e-5 of the least of these differences.
    """
    orbit = balance(name).orbit(20.0, BASE, {"added_mass": 2.3} if name == "leg" else {})
    have = orbit.shaken.balance.derivatives(orbit, parameters)["malleolus"]
    for column, parameter in enumerate(parameters):
        want = differences(orbit, parameter, share)["malleolus"]
        np.testing.assert_allclose(have[:, column], want, rtol=0, atol=5e-5 * np.abs(want).max(), err_msg=parameter)


def test_derivatives_to_the_base() -> None:
    """Real parts first, then imaginary ones."""
    orbit = bent()
    moved = orbit.shaken.balance
    have = moved.base_derivatives(orbit)
    for column, direction in enumerate((*np.eye(3), *(1j * np.eye(3)))):
        one, other = (moved.orbit(17.0, BASE + s * 1e-2 * direction, BENT, orbit) for s in (1, -1))
        for sensor in ("malleolus", "foot"):
            want = (one.harmonics(sensor) - other.harmonics(sensor)) / 2e-2
            np.testing.assert_allclose(have[sensor][:, column], want, rtol=0, atol=1e-8)


def test_multipliers_of_the_two_masses() -> None:
    """Against the eigenvalues of DOP853's monodromy matrix."""
    orbit = bent()
    state, size = two_states(orbit), 1e-6 * np.array([1, 1, 100, 100])
    columns = [(after(17.0, state + d)[:, -1] - after(17.0, state - d)[:, -1]) / (2 * d.max()) for d in np.diag(size)]
    want = np.linalg.eigvals(np.column_stack(columns))
    have = orbit.multipliers
    np.testing.assert_allclose(np.sort_complex(have), np.sort_complex(want), atol=1e-6)
    assert orbit.stable


@pytest.mark.parametrize("frequency_hz", [5.0, 45.0])
def test_multipliers_of_the_arch(frequency_hz: float) -> None:
    """Eleven states, some faster than 1e5 1/s, about rest: exp(lambda T) of Eq. (4.12)."""
    orbit = balance("foot_arch").orbit(frequency_hz, [0.05])
    A = linear.state_space(Arch.from_model(model("foot_arch").model))[0]
    want = np.exp(np.linalg.eigvals(A) / frequency_hz)
    want = want[np.argsort(-np.abs(want))]
    np.testing.assert_allclose(np.abs(orbit.multipliers[:4]), np.abs(want[:4]), rtol=1e-5, atol=1e-9)
    assert orbit.stable


@pytest.mark.parametrize(("c_23", "stable"), [(120.0, True), (250.0, False)])
def test_a_pad_that_feeds_the_foot_makes_it_unstable(c_23: float, stable: bool) -> None:
    """On a soft pad z_2 swings by 14 mm, and the mean of cos(c_23 z_2) falls below zero: energy comes in."""
    soft = {"c_12": 0.0, "c_13": 0.0, "c_21": 20.0, "c_22": 0.0, "c_23": c_23, "k_F": 3e3}
    orbit = balance("two_dof").orbit(1.0, [8.95], soft)
    z = orbit.shaken.motion(orbit.series, orbit.solution.x)[0, :, 1]
    assert (np.mean(np.cos(c_23 * z)) > 0) == stable == orbit.stable


def test_a_start_nearby_leads_to_the_same_orbit() -> None:
    for name in ("two_dof", "mounted_arch"):
        one = balance(name).orbit(20.0, BASE)
        k_T = 1.03 * model(name).values()["k_T"]
        cold, warm = (balance(name).orbit(20.0, BASE, {"k_T": k_T}, start) for start in (None, one))
        np.testing.assert_allclose(warm.harmonics()[:3], cold.harmonics()[:3], rtol=0, atol=1e-6)


def test_values_do_not_stay() -> None:
    """Constants and masses of one orbit leave nothing to the next; the foot is not changed."""
    foot = model("foot_arch")
    before, fresh = foot.values(), Balance(foot)
    first = fresh.orbit(20.0, [8.95]).harmonics()
    fresh.orbit(20.0, [8.95], {"k_12": 3e5, "c_1": 100.0, "m_T": 5.0, "k_F": 2e5})
    np.testing.assert_array_equal(fresh.orbit(20.0, [8.95]).harmonics(), first)
    assert foot.values() == before


@pytest.mark.parametrize(
    "values", [{"k_12": 3e5, "c_1": 100.0, "m_T": 5.0}, {"c_1 [N s/m]": 100.0, "k_F_n_per_m": 2e5}]
)
def test_values_are_those_of_a_changed_foot(values: dict[str, float]) -> None:
    foot = model("foot_arch")
    have = balance("foot_arch").orbit(20.0, [8.95], values).harmonics()
    want = Balance(foot.with_values(values)).orbit(20.0, [8.95]).harmonics()
    np.testing.assert_allclose(have, want, rtol=0, atol=1e-7)


def test_the_table_carries_the_masses() -> None:
    """Newton's second law of what stands on it."""
    orbit = bent()
    want = BENT["m_S"] * orbit.harmonics() + BENT["m_F"] * orbit.harmonics("foot")
    have = orbit.series.complex(orbit.series.project(orbit.table_force_n))
    np.testing.assert_allclose(have, want, rtol=0, atol=1e-5)
    assert abs(orbit.table_force_n.mean()) < 1e-9


def stopped(element: str) -> Balance:
    text = mjcf.text("two_dof").replace('name="fat_pad"', f'name="fat_pad" {element}')
    return Balance(load(text))


@pytest.mark.parametrize(("element", "free", "stopping"), [
    ('range="-1e-3 2e-4"', 2.0, 8.95), ('frictionloss="5"', 0.5, 2.0),
])  # fmt: skip
def test_a_stop_or_dry_friction_is_noticed(element: str, free: float, stopping: float) -> None:
    """A limit that is not reached does nothing, friction that holds too; beyond, the time domain has to do it."""
    held = stopped(element)
    assert held.orbit(20.0, [free]).stable
    with pytest.raises(NotSmoothError, match=r"two_dof: the motion at 20 Hz .* changes its state \d times") as caught:
        held.orbit(20.0, [stopping])
    assert caught.value.changes > 0
    assert isinstance(caught.value, PeriodicMotionError)


def test_a_limit_out_of_reach_changes_nothing() -> None:
    have = stopped('range="-1e-3 2e-4"').orbit(20.0, [2.0]).harmonics()
    np.testing.assert_allclose(have, balance("two_dof").orbit(20.0, [2.0]).harmonics(), rtol=0, atol=1e-12)


#: Pads of Eq. (4.24), of which the static strain e0 says how soon they lift.
E, ETA, THICK = 1800.0, 60.0, 0.02


def test_a_pad_that_stays_on_the_table_is_followed() -> None:
    """To the motion that SciPy comes to rest in."""
    e0, amplitude = 0.2, 4.0
    foot = load(edited_pad(f"4.24 {E} {ETA} {THICK} {e0}"))
    have = Balance(foot).orbit(20.0, [amplitude])

    def pad(x: float, v: float) -> float:
        e = e0 - x / THICK
        assert e > 0
        return E * e0 - (E * e - ETA * e * v / THICK)

    p = foot.values() | {"c_11": 430.0, "m_S": 3.374505, "m_F": 1.052265}
    t = np.arange(50 * 32) / 32 / 20.0
    y = oracle.malleolus(p, lambda t: amplitude * np.cos(2 * np.pi * 20 * t), t, pad=pad)[-32:]
    np.testing.assert_allclose(have.harmonics()[:3], 2 / 32 * np.fft.fft(y)[1:4], rtol=0, atol=1e-6)


def test_a_pad_that_lifts_off_is_noticed() -> None:
    """The force has a kink there, so that harmonics fall with the square of their number only."""
    with pytest.raises(NotSmoothError, match="of its acceleration is in the highest of 48 harmonics") as caught:
        Balance(load(edited_pad(f"4.24 {E} {ETA} {THICK} 0.01"))).orbit(20.0, [4.0])
    assert caught.value.changes == 0


def edited_pad(law: str) -> str:
    pad = 'stiffness="1.0e5" damping="800" user="4.25 800 -50 100"'
    return mjcf.text("two_dof").replace(pad, f'user="{law}"')


def test_gravity_shifts_what_the_foot_stands_on() -> None:
    """With straight dampers gravity is a mean alone: the weight over each spring."""
    straight = {"c_12": 0.0, "c_13": 0.0, "c_22": 0.0, "c_23": 0.0}
    heavy = load(mjcf.text("two_dof").replace('gravity="0 0 0"', 'gravity="0 -9.81 0"'))
    have, want = (Balance(foot).orbit(20.0, [8.95], straight) for foot in (heavy, model("two_dof")))
    np.testing.assert_allclose(have.harmonics(), want.harmonics(), rtol=0, atol=1e-9)
    m_S, m_F = 3.374505, 1.052265
    sag = have.solution.x[:, 0] - want.solution.x[:, 0]
    np.testing.assert_allclose(sag, [-(m_S + m_F) * 9.81 / 1e5, -m_S * 9.81 / 1.5e5], rtol=1e-9)


def test_threads_with_a_balance_each_do_not_disturb_one_another() -> None:
    def orbits(name: str) -> list[Array]:
        mine = Balance(model(name))
        return [mine.orbit(f, BASE).harmonics() for f in (10.0, 20.0, 30.0)]

    names = ["two_dof", "leg", "foot_arch", "two_dof"]
    alone = [orbits(name) for name in names]
    with ThreadPoolExecutor(4) as pool:
        for each, together in zip(alone, pool.map(orbits, names), strict=True):
            for one, other in zip(each, together, strict=True):
                np.testing.assert_array_equal(one, other)


def test_what_cannot_be_meant_is_refused() -> None:
    here = balance("two_dof")
    with pytest.raises(SettingError, match="did you mean 'malleolus'"):
        Balance(model("two_dof"), ("maleolus",))
    with pytest.raises(SettingError, match="unknown accelerometer 'knee'"):
        bent().harmonics("knee")
    with pytest.raises(SettingError, match="unknown parameter 'k_11'"):
        here.orbit(20.0, BASE, {"k_11": 1.0})
    with pytest.raises(SettingError, match="k_T is -1"):
        here.orbit(20.0, BASE, {"k_T": -1.0})
    for frequency in (0.0, np.nan):
        with pytest.raises(SettingError, match="needs a frequency above 0 Hz"):
            here.orbit(frequency, BASE)
    for base in ([np.inf], [0.0]):
        with pytest.raises(SettingError, match="harmonics of the base are"):
            here.orbit(20.0, base)
    with pytest.raises(SettingError, match="a base of 49 harmonics has more than 48"):
        here.orbit(1.0, np.ones(49))


def test_a_base_of_many_harmonics_is_not_cut_off() -> None:
    """Ten harmonics take more than six in the motion; the linear leg takes them one by one."""
    base = np.arange(10, 0, -1) * np.exp(1j * np.arange(10))
    have = balance("leg").orbit(3.0, base).harmonics()
    for k, amplitude in enumerate(base):
        alone = balance("leg").orbit(3.0 * (k + 1), [amplitude]).harmonics()[0]
        assert have[k] == pytest.approx(alone, rel=1e-9)


GRAVITY = ('gravity="0 0 0"', 'gravity="0 -9.81 0"')
PAD = 'stiffness="1.0e5" damping="800" user="4.25 800 -50 100"'


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("foot_arch", *GRAVITY),
        ("foot_arch", 'aponeurosis" stiffness="15e3"', 'aponeurosis" springlength="0.1665" stiffness="15e3"'),
        ("mounted_arch", 'biasprm="-42.0 0 0"', 'biasprm="-70 0 0"'),
        ("two_dof", PAD, 'user="1 1e5 40 2 0.5 0 -1"'),
    ],
    ids=["arch with gravity", "fascia that pulls", "heavier weight", "pad without stiffness"],
)
def test_a_foot_that_does_not_stand_in_the_pose_of_its_file(name: str, old: str, new: str) -> None:
    """Its small motion goes on about where MuJoCo leaves it, as stepping has it."""
    text = mjcf.text(name)
    assert old in text
    text = text.replace(old, new)
    foot = load(text.replace(*GRAVITY) if name == "two_dof" else text)
    rest = standing(foot)
    data = mujoco.MjData(foot.model)
    with callbacks():
        data.qpos[:] = rest
        mujoco.mj_forward(foot.model, data)
    weight = abs(foot.model.body_subtreemass[0] - foot.model.body_mass[foot.model.dof_bodyid[foot.base]]) * 9.81
    M = np.zeros((foot.model.nv, foot.model.nv))
    mujoco.mj_fullM(foot.model, data, M)
    assert np.abs(np.delete(M @ data.qacc, foot.base)).max() < 1e-5 * weight
    still = simulate(foot, harmonics(20.0, [1e-3], 0.05), accept=None)
    assert np.abs(still.malleolus).max() < 9e-3  # it does not fall
    orbit = Balance(foot).orbit(20.0, [0.02])
    batch = Batch(foot, 1, 1)
    step = 1 / 20.0 / round(1 / 20.0 / 1e-4)
    count = round(1 / 20.0 / step)
    state = orbit.initial_state()
    run = batch.run(harmonics(20.0, [0.02], 0.05).controls(step, count)[None], step, *(part[None] for part in state))
    moved = run.malleolus_m_s2[0] @ np.exp(-2j * np.pi * np.arange(count) / count) * 2 / count
    assert abs(moved / orbit.harmonics()[0] - 1) < 3e-3


def test_nothing_carries_a_foot_without_springs() -> None:
    text = mjcf.text("two_dof").replace(PAD, "").replace(*GRAVITY)
    with pytest.raises(SimulationError, match="nothing carries joint 'fat_pad'"):
        standing(load(text))


@pytest.mark.parametrize("gravity", ["0 0 0", "0 -9.81 0"])
@pytest.mark.parametrize("beside", [False, True], ids=["on the table", "beside it"])
def test_a_foot_in_free_fall_is_refused_by_its_joint(gravity: str, beside: bool) -> None:
    """Also where it never was on the table."""
    text = mjcf.text("two_dof").replace(GRAVITY[0], f'gravity="{gravity}"').replace(PAD, "")
    if beside:
        text = text.replace('<body name="foot"', '</body><body name="foot"').replace(
            "</body>\n  </worldbody>", "</worldbody>"
        )
    foot = load("\n".join(line for line in text.splitlines() if "joint fat_pad" not in line))
    with pytest.raises(SimulationError, match="nothing carries joint 'fat_pad'"):
        simulate(foot, harmonics(20.0, [1.0], 0.2))


@pytest.mark.parametrize(("at", "stands"), [(0.06, True), (0.5, False)], ids=["on the table", "off its edge"])
@pytest.mark.parametrize("slides", ["", '<joint name="slip" axis="1 0 0"/>'], ids=["guided", "on friction"])
def test_what_a_contact_carries_is_simulated(at: float, stands: bool, slides: str) -> None:
    sole = f'<geom name="sole" type="box" size="0.1 0.02 0.04" pos="{at} 0 0"/><site name="foot" '
    text = mjcf.text("two_dof").replace(*GRAVITY).replace(PAD + "/>", "/>" + slides).replace('<site name="foot" ', sole)
    text = text.replace("<sensor>", '<contact><pair geom1="table" geom2="sole"/></contact><sensor>')
    foot = load("\n".join(line for line in text.splitlines() if "joint fat_pad" not in line))
    if stands:
        assert np.ptp(simulate(foot, harmonics(20.0, [1.0], 0.3)).qpos[..., 1]) < 1e-3
    else:
        with pytest.raises(SimulationError, match="nothing carries joint 'fat_pad'"):
            simulate(foot, harmonics(20.0, [1.0], 0.3))


@pytest.mark.parametrize(("stiffness", "stands"), [(7.0, False), (9.0, True)])
def test_a_foot_that_would_topple_is_refused_by_its_joint(stiffness: float, stands: bool) -> None:
    """A shank on a hinge topples where that is less stiff than m g l = 8.28 N m, closed form of a pendulum."""
    law = 'damping="430" user="4.25 430 50 100"/>'
    hinge = f'<joint name="lean" type="hinge" axis="0 0 1" stiffness="{stiffness}" damping="1"/>'
    text = mjcf.text("two_dof").replace('gravity="0 0 0"', 'gravity="0 -9.81 0"').replace(law, law + hinge)
    foot = load(text.replace('pos="0 0.25 0" mass', 'pos="0.001 0.25 0" mass'))
    if stands:
        standing(foot)
    else:
        for stand in (standing, lambda foot: simulate(foot, harmonics(10.0, [1.0], 0.3))):
            with pytest.raises(SimulationError, match="topples about joint 'lean'"):
                stand(foot)
