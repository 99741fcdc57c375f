"""Rival models against closed forms, MuJoCo, a simulator of their own, and worlds whose departure is known."""

import copy
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from scipy.stats import t as student_t
from typer.testing import CliRunner

import mjcf
from fasbody import page
from fasbody.exceptions import InputFileError, ModelError, RecordingError, SettingError
from fasbody.foot.model import load
from fasbody.foot.two_dof import TwoDof
from fasbody.recording.checks import checked
from fasbody.recording.known import Known
from fasbody.recording.recording import Recording
from identification.estimates import Estimate
from identification.intervals import Solution
from identification.optimiser import Optimum
from identification.residual import Problem
from identification.rivals.__main__ import app
from identification.rivals.compare import compare_rivals
from identification.rivals.ladder import AT_REST, LADDER, RungVariables, rungs_of
from identification.rivals.mjcf import difference, edited_text, write_models
from identification.rivals.motion import AT, EXTRA, RivalMotion, felt
from identification.rivals.result import DECISIVE, SPARED, Rival, Rivals, preferred
from identification.rivals.search import evidence, folds, only
from simulator import worlds
from simulator.departure import Exponential, Following, Maxwell, Mount, Polynomial
from simulator.leg import Departure, Leg, Shaking, harmonics

LEG = Leg(1.5e5, 1.0e5, 430.0, 50.0, 100.0, 500.0, -50.0, 100.0, 3.3, 1.05)
#: Its dampers bend so little that it is linear.
LINEAR = replace(LEG, c_12=0.0, c_13=0.0, c_22=0.0, c_23=0.0)
U = 8.95 * np.array([1, 0.02j, 0.01])


def constants(leg: Leg, **changed: float) -> dict[str, float]:
    return AT_REST | vars(leg) | changed


def response(values: dict[str, float], hz: float, base: np.ndarray = U, load_kg: float = 0.0) -> np.ndarray:
    return felt(values, hz, base, load_kg)[: base.size]


# the equations


def test_linear_foot_has_the_closed_form_response() -> None:
    foot = TwoDof(**vars(LINEAR))
    for hz in (10.0, 23.0, 50.0):
        H = foot.transmissibility(hz * np.arange(1, 4))
        assert np.allclose(response(constants(LINEAR), hz), H * U, rtol=1e-11)


@pytest.mark.parametrize("swings", [0.0, 0.3])
def test_linear_rivals_have_their_closed_form_responses(swings: float) -> None:
    """A complex stiffness, a complex mass and a factor, in the transmissibility of two masses on springs."""
    r, tau, f_w, zeta, u, load_kg, hz = 0.0 if swings else 0.4, 6e-3, 22.0, 0.15, 1 / 95**2, 2.3, 18.0
    s = 2j * np.pi * hz * np.arange(1, 4)
    relax = s * tau / (1 + s * tau)
    p_T = LINEAR.k_T * (1 + r * relax) + LINEAR.c_11 * s
    p_F = LINEAR.k_F * (1 + 0.5 * r * relax) + LINEAR.c_21 * s
    W = 2 * np.pi * f_w
    hangs = (W**2 + 2 * zeta * W * s) / (s**2 + 2 * zeta * W * s + W**2)
    m_S = load_kg + LINEAR.m_S * (1 - swings + swings * hangs)
    G = p_T * p_F / ((m_S * s**2 + p_T) * (LINEAR.m_F * s**2 + p_T + p_F) - p_T**2)
    M = 2 * np.pi / np.sqrt(u)
    sensor = (M**2 + 0.4 * M * s) / (s**2 + 0.4 * M * s + M**2)
    c = constants(LINEAR, r_T=r, r_F=0.5 * r, tau=tau, w=swings, f_w=f_w, zeta_w=zeta, u=u)
    assert np.allclose(response(c, hz, load_kg=load_kg), G * U * sensor, rtol=1e-10)


@pytest.mark.parametrize(
    ("changed", "departures"),
    [
        ({}, ()),
        ({"r_T": 0.5, "r_F": 0.3}, (Maxwell(0.5, 0.3),)),
        ({"u": 1 / 90**2}, (Mount(90.0),)),
        ({"b_T": 500.0, "b_F": -350.0}, (Exponential(500.0, -350.0),)),
        ({"d_T": 2e5, "d_F": 1e5}, (Polynomial(cubic=(2e5, 1e5)),)),
        ({"e_T": np.log(1.1), "e_F": np.log(1.1)}, (Following(0.1),)),
    ],
    ids=["model", "relaxing", "mount", "exponential", "cubic", "load"],
)
def test_every_rival_moves_as_in_the_other_simulator(
    changed: dict[str, float], departures: tuple[Departure, ...]
) -> None:
    shaking = Shaking(np.full(2, 2.3), np.array([10.0, 27.0]), np.tile(U, (2, 1)))
    for hz, want in zip(shaking.hz, harmonics(LEG, departures, shaking, 2e-4)[0, :, :3], strict=True):
        assert np.abs(response(constants(LEG, **changed), hz, load_kg=2.3) - want).max() < 1e-7 * abs(want[0])


def test_derivatives_are_those_of_differences(problems: dict[str, Problem]) -> None:
    motion = problems["third"].motion
    assert isinstance(motion, RivalMotion)
    bent = constants(LEG, b_T=400, b_F=-300, p_T=100, p_F=-50, d_T=1e5, d_F=2e5, w=0.2)
    theta = np.tile([bent[name] for name in AT], (1, len(motion.omega), 1))
    D, G = motion.response(theta, None)[1], motion.by_base(theta[0])

    def read(nudge: np.ndarray) -> np.ndarray:
        return motion.response(theta + nudge, None)[0]

    for name in (*LEG.__dataclass_fields__, *EXTRA):
        nudge = 1e-5 * abs(bent[name]) * np.eye(len(AT))[AT[name]]
        expected = (read(nudge) - read(-nudge)) / (2 * nudge.sum())
        assert np.abs(D[..., AT[name]] - expected).max() < 1e-5 * np.abs(expected).max(), name
    count, base = G.shape[2] // 2, motion.base
    for place, turn in ((1, 1), (1 + count, 1j)):
        nudge = 1e-5 * turn * np.eye(base.shape[1])[1]
        more, less = (copy.copy(motion) for _ in range(2))
        more.base, less.base = base + nudge, base - nudge
        y = (more.response(theta, None)[0] - less.response(theta, None)[0])[0, :, 0] / 2e-5
        y = np.concatenate([y.real, y.imag], 1)
        assert np.abs(G[:, 0, :, place] - y).max() < 1e-5 * np.abs(y).max()


# the search


@pytest.fixture(scope="module")
def problems() -> dict[str, Problem]:
    """Of every rung, on recordings of a leg that is the model."""
    data = [checked(r) for r in recorded(few=True)]
    return {c.rung.name: c.problem for c in rungs_of(load("two_dof"), data, Known(), LADDER)}


@pytest.mark.parametrize("name", [rung.name for rung in LADDER])
def test_derivatives_of_every_rung_are_those_of_differences(name: str, problems: dict[str, Problem]) -> None:
    problem = problems[name]
    v, rng = problem.variables, np.random.default_rng(1)
    q = v.start(vars(LEG)) + rng.uniform(0.05, 0.1, v.size)  # away from the bounds that a prior ends at
    J = problem.evaluate(q[None]).jacobian[0]
    for i in range(q.size):
        nudge = 1e-4 * np.eye(q.size)[i]
        one, other = problem.evaluate(np.stack([q + nudge, q - nudge])).residual
        assert np.allclose(J[:, i], (one - other) / 2e-4, rtol=1e-3, atol=3e-4 * np.abs(J[:, i]).max() + 1e-5)


@pytest.mark.parametrize("name", [rung.name for rung in LADDER])
def test_every_rung_reads_what_the_equations_say(name: str, problems: dict[str, Problem]) -> None:
    """The fit's problem, in closed form where it can be, against the general equations with the constants by name."""
    problem = problems[name]
    v, rng = problem.variables, np.random.default_rng(2)
    assert isinstance(v, RungVariables)
    q = v.start(vars(LEG)) + rng.uniform(0.05, 0.1, v.size)
    share = v.of_kind("load share")
    assert share is not None
    q[share] = 1 / v.scale[share]  # all of the load, as the equations have it
    c, H = v.named(q), problem.measured.base.shape[1]
    for r, have in enumerate(problem.predicted(q)[:, 0]):
        hz, base = v.omega[r] / (2 * np.pi), problem.motion.base[r]
        late = np.exp(-2j * np.pi * hz * np.arange(1, H + 1) * c["delay"])
        gain = 1 + c["gain"] + c["drift"] * v.place_in_session[r]
        want = felt(c, hz, base, v.loads[r])[:H] * gain * late
        assert np.abs(have - want).max() < 1e-6 * np.abs(want).max()


def test_the_image_is_the_mirror_and_a_place_carries_over(problems: dict[str, Problem]) -> None:
    v = problems["linear"].variables
    assert isinstance(v, RungVariables)
    q = v.start(vars(LINEAR))
    values = v.named(q)
    assert all(np.isclose(values[name], getattr(LINEAR, name)) for name in ("k_T", "k_F", "c_11", "c_21"))
    assert all(values[name] == 0 for name in ("c_12", "c_13", "c_22", "c_23"))
    more = problems["relaxing"].variables
    assert isinstance(more, RungVariables)
    over = more.named(more.carried_over(q, v))
    assert all(np.isclose(over[name], values[name], atol=0.2) for name in values)  # c_13 is at least 0.1
    bent = problems["exponential"].variables
    assert isinstance(bent, RungVariables)
    q = bent.carried_over(q, v)
    place = [bent.place(bent.rung.constants[name]) for name in ("b_T", "b_F")]
    q[place] = 0.3, -0.1
    assert bent.image(q)[place].tolist() == [-0.1, 0.3]


def test_evidence_is_the_predictive_density_of_a_linear_model() -> None:
    """Of y = A x + noise with a normal prior of x: evidence of all over that of some, against the normal density."""
    rng = np.random.default_rng(0)
    A, y = rng.normal(size=(9, 3)), rng.normal(size=9)

    def made(rows: slice) -> tuple[SimpleNamespace, np.ndarray]:
        J = np.concatenate([A[rows], np.eye(3)])
        aim = np.concatenate([y[rows], np.zeros(3)])
        x = np.linalg.lstsq(J, aim, rcond=None)[0]
        now = SimpleNamespace(jacobian=J[None], objective=np.array([np.sum((J @ x - aim) ** 2)]))
        return SimpleNamespace(evaluate=lambda Q: now), x

    (whole, x), (part, x_part) = made(slice(None)), made(slice(0, 5))
    C = np.linalg.inv(A[:5].T @ A[:5] + np.eye(3))
    S = np.eye(4) + A[5:] @ C @ A[5:].T
    density = multivariate_normal(A[5:] @ x_part, S).logpdf(y[5:])
    wants = -2 * density - 4 * np.log(2 * np.pi)
    assert np.isclose(evidence(whole, x) - evidence(part, x_part), wants)  # type: ignore[arg-type]


def test_deviance_is_students_where_repeatability_is_estimated(problems: dict[str, Problem]) -> None:
    """Against the density of Student's distribution, whose scale is what the best end leaves over."""
    problem, gap = problems["linear"], 9.0
    q = problem.variables.start(vars(LINEAR))
    ends = [Solution("best", problem.with_repeatability(s), Optimum(0, q, 70.0, True, 1, 1)) for s in (0.0, 0.02)]
    assert ends[0].deviance(70.0 + gap) - ends[0].deviance(70.0) == gap
    nu = ends[1].dof
    logs = [student_t.logpdf(x, nu) for x in (0.0, np.sqrt(gap))]
    wants = 2 * (logs[0] - logs[1]) * nu / (nu + 1)
    assert np.isclose(ends[1].deviance(70.0 + gap) - ends[1].deviance(70.0), wants)


# the verdict


def made(name: str, bic: float, held: float, free: int = 8, repeats: float = 0.01, k_T: float = 1e5, **more) -> Rival:  # type: ignore[no-untyped-def]
    e = Estimate(k_T, 1e3, k_T - 2e3, k_T + 2e3, False, "identified")
    f = Estimate(2e5, 1e3, 1.98e5, 2.02e5, False, "identified")
    values: dict[str, object] = {
        "name": name, "title": name, "free": free, "chi_square": 100.0, "dof": 100, "bic": bic,
        "held_out": {"frequency": held}, "error": 0.01, "branch": "stiff pad", "log_odds": 20.0, "k_T": e, "k_F": f,
        "log_ratio": (np.log(k_T / 2e5), 0.02), "other": None, "constants": (), "values": {}, "predicted": (),
        "converged": True, "extra": free > 8, "repeatability": repeats,
    }  # fmt: skip
    return Rival(**{**values, **more})  # type: ignore[arg-type]


def compared(*rivals: Rival) -> Rivals:
    return Rivals("made", "two_dof", tuple(preferred(list(rivals))), (), 0.01, (), 0.0)


def test_a_rival_is_put_before_the_model_only_by_odds_of_a_thousand_and_foresight() -> None:
    model = made("model", 120.0, 120.0)
    assert compared(model, made("mount", 110.0, 100.0, 10)).first.name == "model"  # odds of 150
    assert compared(model, made("mount", 120 - DECISIVE - 1, 100.0, 10)).first.name == "mount"
    assert compared(model, made("mount", 100.0, 121.0, 10)).first.name == "model"  # foretells worse
    assert compared(model, made("linear", 115.0, 119.0, 4)).first.name == "linear"  # nested, and simpler
    worse = compared(model, made("mount", 50.0, 125.0, 10), made("third", 90.0, 90.0, 11))
    assert worse.first.name == "third"


def test_only_what_all_adequate_rivals_say_is_shared() -> None:
    model, far = made("model", 100.0, 100.0), made("third", 105.0, 100.0, 11, k_T=3e5)
    alone = {c.what: c for c in compared(model).conclusions}
    assert all(c.shared for c in alone.values())
    assert alone["stiffer"].text == "k_F is the stiffer spring" and alone["branch"].text == "the branch is stiff pad"
    both = {c.what: c.shared for c in compared(model, far).conclusions}
    assert both == {"k_T": False, "k_F": True, "branch": True, "stiffer": False}
    out = compared(model, replace(far, bic=130.0))  # out-predicted, so it has no say
    assert all(c.shared for c in out.conclusions) and [r.name for r in out.adequate] == ["model"]
    assert far.k_T and far.k_F
    rich = made("third", 125.0, 100.0, 11, penalty=20.0)  # as near as the model, and more constants
    both = compared(model, rich, made("linear", 190.0, 200.0, 4))
    assert [r.name for r in both.not_needed] == ["third"] and [r.name for r in both.adequate] == ["model"]
    assert "with more constants: third" in both.sentence() and "The other models are ruled out." in both.sentence()
    open_ = replace(model, log_odds=1.0, other=(far.k_T, far.k_F))
    assert {c.what for c in compared(open_).conclusions if c.shared} == {"k_F"}
    said = compared(open_).sentence()
    assert "With model (preferred), k_F is " in said and "N/m over both branches. Undecided are k_T (" in said


def test_a_narrow_terminal_shows_whole_intervals(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It showed "122" of "122 000 to 231 000", and "y" of "yes"."""
    wide = Estimate(1.35e5, 3e4, 1.22e5, 2.31e5, False, "identified")
    result = compared(replace(made("model", 100.0, 100.0), k_T=wide, k_F=wide))
    for columns in (80, 120):
        monkeypatch.setenv("COLUMNS", str(columns))
        page.show(result.sheet(), "model", "branch", "adequate", spared=SPARED)
        printed = capsys.readouterr().out
        table = printed.split("Preferred model")[0]
        assert table.count(wide.interval()) == 2 and "yes" in table and "adequate" in table


def test_nothing_is_said_where_no_rival_follows() -> None:
    assert compared(made("model", 900.0, 900.0, repeats=0.14)).adequate
    lost = compared(made("model", 900.0, 900.0, repeats=0.16))
    assert not lost.adequate and not lost.conclusions
    assert "deviates by 16 %, and recordings of people repeat to 15 %" in lost.sentence()
    assert len(lost.records()) == 1 and lost.to_dataframe().shape[0] == 1
    with pytest.raises(SettingError, match="unknown rival 'mond'"):
        lost["mond"]


# worlds


def recorded(
    *departures: Departure, loads: tuple[float, ...] = (0.0, 2.3), stated: float = 1.0, few: bool = False
) -> list[Recording]:
    body = LEG.m_F / worlds.FOOT
    leg = replace(LEG, m_S=worlds.SHANK * body)
    truth = worlds.Member("made", 0, leg, departures, loads, 0.004, 1.0, stated * body)
    hz = (10.0, 20.0, 30.0, 50.0) if few else (10.0, 20.0, 25.0, 30.0, 40.0, 50.0)
    return worlds.recordings(replace(truth, frequencies_hz=hz))


RUNGS = ["relaxing", "mount"]


@pytest.fixture(scope="module")
def relaxing() -> Rivals:
    return compare_rivals(recorded(Maxwell(0.4, 0.3), few=True), models=RUNGS, source="made")


@pytest.mark.long
def test_a_mass_that_is_stated_wrong_chooses_no_rival() -> None:
    result = compare_rivals(recorded(stated=1.05), models=["mount"])
    assert result.first.name == "model"
    assert {c.what for c in result.conclusions if c.shared} >= {"branch", "stiffer"}
    assert result.first.k_T is not None and result.first.k_T.lower < LEG.k_T < result.first.k_T.upper


def test_springs_that_relax_are_named_and_the_model_is_not_believed(relaxing: Rivals) -> None:
    assert relaxing.first.name == "relaxing" and [r.name for r in relaxing.adequate] == ["relaxing"]
    assert relaxing["model"].repeatability > 0.015 > 50 * relaxing.repeatability
    first, hz = relaxing.first, np.exp(np.mean(np.log([p.frequency_hz for p in relaxing.points])))
    x = (2 * np.pi * hz * 5e-3) ** 2
    assert first.k_T and first.k_T.lower < LEG.k_T * (1 + 0.4 * x / (1 + x)) < first.k_T.upper  # in the mid of the band
    assert first.k_T.at_rest and first.k_T.at_rest.lower < LEG.k_T < first.k_T.at_rest.upper
    own = {each.name: each for each in first.constants}
    assert own["r_T"].lower < 0.4 < own["r_T"].upper and own["tau"].lower < 5e-3 < own["tau"].upper
    assert relaxing.sentence().startswith("Preferred model: springs that relax. All other models are ruled out.")


@pytest.mark.long
def test_a_sensor_on_soft_tissue_is_named_with_its_frequency() -> None:
    result = compare_rivals(recorded(Mount(100.0)), models=RUNGS)
    assert result.first.name == "mount"
    (frequency, _) = result.first.constants
    assert frequency.name == "f_u" and frequency.lower < 100 < frequency.upper


@pytest.mark.long
def test_what_repeats_to_some_per_cent_prefers_nothing_to_the_model() -> None:
    """The sensors' noise alone would rule out every rival."""
    rng = np.random.default_rng(3)
    factors = 1 + 0.03 * rng.standard_normal(12)
    data = [replace(r, malleolus_m_s2=f * r.malleolus_m_s2) for r, f in zip(recorded(), factors, strict=True)]
    result = compare_rivals(data, models=["mount"])
    assert result.first.name in ("model", "linear") and result["model"] in result.adequate
    assert 0.01 < result.repeatability < 0.04 and result.document()["repeatability"] == result.repeatability
    assert f"recordings is {100 * result.repeatability:.2g} %." in result.sheet().notes[1]
    k_T = result["model"].k_T
    assert k_T and k_T.lower < LEG.k_T < k_T.upper


def test_what_is_left_out_are_thirds_of_the_frequencies_and_each_load(problems: dict[str, Problem]) -> None:
    problem = problems["model"]
    left = folds(problem)
    assert [kind for kind, _ in left] == ["frequency"] * 3 + ["load"] * 2
    assert np.array([mask for kind, mask in left if kind == "frequency"]).sum(axis=0).tolist() == [1] * 8
    mask = left[0][1]
    assert only(problem, mask).size + only(problem, ~mask).size == problem.size
    q = problem.variables.start({name: value for name, value in vars(LEG).items() if name[0] != "m"})
    q[problem.variables.of_kind("load share")] = 1 / 0.15
    exact = problem.weighed(q)  # with the input's noise seen through the foot
    whole = exact.evaluate(q[None]).residual[0, : exact.size]
    part, rest = (only(exact, kept).evaluate(q[None]).residual[0] for kept in (mask, ~mask))
    both = [part[: only(exact, mask).size], rest[: only(exact, ~mask).size]]
    assert np.isclose(sum(r @ r for r in both), whole @ whole)
    assert 0.5 < whole @ whole / exact.size < 1.5


def test_figures_files_and_command(relaxing: Rivals, tmp_path: Path) -> None:
    for kind in relaxing.plots:
        figure = relaxing.plot(kind)
        assert figure.get_size_inches()[0] > 5
    labels = [text.get_text() for text in relaxing.plot("constants").axes[0].get_yticklabels()]
    assert labels[-1] == "springs that relax"
    assert {file.name for file in relaxing.write(tmp_path)} == {"rivals.csv", "rivals.json"}
    document = json.loads(json.dumps(relaxing.document(), default=float))
    assert document["first"] == "relaxing" and len(document["rivals"]) == 4
    found = write_models(relaxing, mjcf.path("two_dof"), tmp_path)
    assert {path.stem for path in found} == {"linear", "model", "relaxing", "mount"}
    assert max(found.values()) < 1e-5
    exchanged = tmp_path / "exchanged.xml"
    text = mjcf.text("two_dof").replace("talocrural", "ankle").replace("fat_pad", "talocrural")
    exchanged.write_text(text.replace("joint ankle", "joint fat_pad").replace('"ankle"', '"fat_pad"'))
    (tmp_path / "off").mkdir()
    with pytest.raises(ModelError, match=r"MuJoCo's motion is off by [\d.]+ %"):
        write_models(relaxing, exchanged, tmp_path / "off")
    assert not list((tmp_path / "off").iterdir())
    (tmp_path / "shoe.xml").write_text("<mujocoinclude><size/></mujocoinclude>")
    split = tmp_path / "split.xml"
    split.write_text(mjcf.text("two_dof").replace("</mujoco>", '<include file="shoe.xml"/></mujoco>'))
    with pytest.raises(InputFileError, match=r"split.xml: includes 'shoe.xml', .*; write it into the file"):
        write_models(relaxing, split, tmp_path / "off")


# MJCF


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("linear", {"c_12": 0.0, "c_13": 0.0, "c_22": 0.0, "c_23": 0.0}),
        ("model", {}),
        ("exponential", {"b_T": 900.0, "b_F": -400.0}),
        ("polynomial", {"p_T": 100.0, "p_F": -50.0, "d_T": 1e5, "d_F": 2e5}),
        ("relaxing", {"r_T": 0.4, "r_F": 0.3}),
        ("mount", {"u": 1 / 90**2}),
        ("third", {"w": 0.3}),
        ("load", {"e_T": 0.2, "e_F": 0.1}),
    ],
)
def test_mujoco_moves_as_the_compiled_rival(name: str, changed: dict[str, float], tmp_path: Path) -> None:
    values = constants(LEG, **changed)
    file = tmp_path / f"{name}.xml"
    file.write_text(edited_text(mjcf.path("two_dof"), name, name, values, 2.3 if name == "load" else 0.0))
    assert difference(file, values, 24.0, U, 2.3) < 1e-5
    foot = load(file).values()
    told = {"k_T", "k_F", "c_11", "c_21"} if name != "load" else {"c_12", "c_22"}
    assert all(np.isclose(foot[key], values[key]) for key in told)
    if name == "relaxing":
        assert np.isclose(foot["k_RT"], 0.4 * values["k_T"]) and np.isclose(foot["tau_R"], values["tau"])
    assert "<!--" in file.read_text().splitlines()[1]


@pytest.mark.long
def test_a_users_own_model_is_a_rival(tmp_path: Path) -> None:
    """The truth written as MJCF, with all but the springs held: it follows, and its springs are the truth's."""
    values = constants(LEG, u=1 / 90**2)
    text = edited_text(mjcf.path("two_dof"), "mount", "mount", values)
    lines = [line for line in text.splitlines() if not any(f'text name="{name}"' in line for name in tuple(AT)[2:8])]
    file = tmp_path / "my_foot.xml"
    file.write_text("\n".join(lines))
    data = recorded(Mount(90.0), loads=(0.0,))[1:4]
    result = compare_rivals(data, models=["mount"], files=[file])
    mine = result["my_foot.xml"]
    assert mine.free == 2 and mine.follows and mine in result.adequate
    assert mine.k_T and mine.k_F and mine.k_T.lower < LEG.k_T < mine.k_T.upper
    assert result["model"].repeatability > 5 * mine.repeatability and result["model"] not in result.adequate


# bad input


def test_bad_input_is_one_sentence(tmp_path: Path) -> None:
    data = recorded()
    with pytest.raises(SettingError, match="unknown rival model 'maunt', did you mean 'mount'"):
        compare_rivals(data, models=["maunt"])
    with pytest.raises(ModelError, match="exist for the two-mass foot only"):
        compare_rivals(data, load("foot_arch"))
    with pytest.raises(RecordingError, match="no recording"):
        compare_rivals([])
    with pytest.raises(RecordingError, match="three or more frequencies"):
        compare_rivals(data[:2])
    other = replace(data[0], condition=replace(data[0].condition, body_mass_kg=50.0))
    with pytest.raises(RecordingError, match="several persons"):
        compare_rivals([other, *data[1:]])
    rng = np.random.default_rng(0)
    wild = replace(data[0], base_m_s2=rng.normal(size=data[0].time_s.size))
    wild = replace(wild, condition=replace(wild.condition, frequency_hz=None))
    with pytest.raises(RecordingError, match="need steady recordings"):
        compare_rivals([wild, *data[1:]])
    bare = tmp_path / "bare.xml"
    bare.write_text(mjcf.text("two_dof").replace('name="talocrural"', 'name="ankle"'))
    with pytest.raises(ModelError, match="no body with the joint 'talocrural'"):
        edited_text(bare, "model", "model", constants(LEG))
    found = CliRunner().invoke(app, [str(tmp_path / "nothing.csv")])
    assert found.exception is not None and "no such file" in str(found.exception)
