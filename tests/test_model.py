"""MJCF feet: edited copies, every force law as the fat pad against an independent ODE, sentences for broken files."""

import math
import re
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import oracle
import pytest
from scipy.integrate import solve_ivp

import mjcf
from fasbody.exceptions import InputFileError, ModelError, SettingError
from fasbody.foot import shaker
from fasbody.foot.model import Foot, load
from fasbody.foot.simulate import simulate

PAD_JOINT = '<joint name="fat_pad" stiffness="1.0e5" damping="800" user="4.25 800 -50 100"/>'
BARE_PAD = '<joint name="fat_pad"/>'
NO_PAD_PARAMETERS = [
    (line, "") for line in re.findall(r'    <text name="(?:k_F|c_21|c_22|c_23)".*\n', mjcf.text("two_dof"))
]
Edit = Callable[..., Path]


def shaken(foot: Foot, frequency: float = 25.0, seconds: float = 0.25) -> tuple[np.ndarray, np.ndarray]:
    out = simulate(foot, shaker.sine(frequency, seconds), step=2.5e-4, values={"k_T": oracle.TRUTH["k_T"]})
    return out.time[0], out.malleolus[0]


#: The stock foot's ankle with the stiffness that `shaken` sets.
ANKLE = {"k_T": oracle.TRUTH["k_T"], "c_11": 430, "c_12": 50, "c_13": 100, "m_S": 3.374505, "m_F": 1.052265}


def agrees(file: Path, pad: oracle.Force, allowed: float = 2e-5) -> None:
    t, y = shaken(load(file))
    want = oracle.malleolus(ANKLE, oracle.sine(25.0), t, pad=pad, rtol=1e-9)
    assert np.abs(y - want).max() < allowed * np.abs(want).max()


def test_stock_model_is_the_two_mass_foot() -> None:
    foot = load("two_dof")
    body = 0.0145 * 72.57
    assert foot.values() == pytest.approx(
        {"k_T": 1.5e5, "k_F": 1e5, "c_11": 430, "c_12": 50, "c_13": 100, "c_21": 800, "c_22": -50, "c_23": 100}
        | {"m_S": 0.0465 * 72.57, "m_F": body},
        rel=1e-12,
    )
    assert foot.step == 5e-4
    assert "k_T 150\u202f000 N/m" in str(foot)
    assert "two_dof" in mjcf.names()
    with pytest.raises(KeyError, match="shipped models"):
        mjcf.path("three_dof")


def test_law_4_25_as_the_pad(edited: Edit) -> None:
    file = edited((PAD_JOINT, '<joint name="fat_pad" stiffness="9e4" user="4.25 600 -90 150"/>'))
    agrees(file, oracle.spring_and_damper(9e4, 600, -90, 150))


def test_law_4_24_as_the_pad(edited: Edit) -> None:
    """Strain-proportional damper: E 1800 N over 20 mm is 9e4 N/m; the pad lifts off where strain would be negative."""
    E, eta, h, e0 = 1800.0, 60.0, 0.02, 0.1

    def pad(x: float, v: float) -> float:
        e = e0 - x / h
        return E * e0 - (E * e + eta * e * (-v / h) if e > 0 else 0.0)

    agrees(edited((PAD_JOINT, f'<joint name="fat_pad" user="4.24 {E} {eta} {h} {e0}"/>')), pad)


def test_law_4_23_as_the_pad(edited: Edit) -> None:
    j, k, l, m, n, h, e0 = 4000.0, 1.4, 150.0, 0.9, 0.8, 0.02, 0.3  # noqa: E741

    def pad(x: float, v: float) -> float:
        e, rate = e0 - x / h, -v / h
        force = j * e**k + l * e**m * abs(rate) ** n * math.copysign(1, rate) if e > 0 else 0.0
        return j * e0**k - force

    # |rate|^0.8 has an infinite slope at rest, so the order of any solver drops there
    agrees(edited((PAD_JOINT, f'<joint name="fat_pad" user="4.23 {j} {k} {l} {m} {n} {h} {e0}"/>')), pad, 5e-3)


def test_law_4_22_as_the_pad(edited: Edit) -> None:
    """Quasi-linear viscoelastic pad: an actuator with eight activations against an ODE with 120 exponentials."""
    A, B, c, tau_1, tau_2, h, e0 = 150.0, 6.0, 0.9, 0.002, 1.0, 0.02, 0.2
    file = edited(
        (PAD_JOINT, BARE_PAD), *NO_PAD_PARAMETERS,
        ("  </actuator>", f'    <general name="pad" joint="fat_pad" dyntype="user" actdim="8" gainprm="0" '
         f'biastype="user" biasprm="4.22 {A} {B} {c} {tau_1} {tau_2} {h} {e0}"/>\n  </actuator>'),
    )  # fmt: skip
    t, y = shaken(load(file))
    count = 120
    tau = tau_1 * (tau_2 / tau_1) ** ((np.arange(count) + 0.5) / count)  # midpoint rule in log(tau)
    weight, whole = np.full(count, math.log(tau_2 / tau_1) / count), 1 + c * math.log(tau_2 / tau_1)
    ankle, base, (m_S, m_F) = oracle.ankle_of(ANKLE), oracle.sine(25.0), (ANKLE["m_S"], ANKLE["m_F"])

    def rates(time: float, s: np.ndarray) -> np.ndarray:
        w1, w2, v1, v2 = s[:4]
        strain, rate = e0 - w2 / h, -v2 / h
        push = (A * (math.exp(B * strain) - math.exp(B * e0)) + c * weight @ s[4:]) / whole
        T, a = ankle(w1 - w2, v1 - v2), base(time)
        stress_rate = A * B * math.exp(B * strain) * rate
        return np.concatenate([[v1, v2, -T / m_S - a, (T + push) / m_F - a], stress_rate - s[4:] / tau])

    s = solve_ivp(rates, (0, t[-1]), np.zeros(4 + count), method="DOP853", t_eval=t, rtol=1e-8, atol=1e-12).y
    want = np.array([-ankle(a, b) / m_S for a, b in zip(s[0] - s[1], s[2] - s[3], strict=True)])
    elastic = [-A * (math.exp(B * (e0 - w / h)) - math.exp(B * e0)) for w in s[1]]
    assert np.ptp(s[1]) / h > 0.02  # the strain moves enough for the exponential to matter
    assert np.ptp(elastic) > 10
    assert np.abs(y - want).max() < 1e-3 * np.abs(want).max()


def test_laws_on_tendons_equal_laws_on_joints(edited: Edit) -> None:
    """The pad as a fixed tendon on the same joint: spring, native damping and law."""
    tendon = (
        '<tendon><fixed name="pad" stiffness="1.0e5" damping="{}" user="4.25 800 -50 100">'
        '<joint joint="fat_pad" coef="1"/></fixed></tendon>\n  <actuator>'
    )
    size = ('<size nuser_jnt="8"/>', '<size nuser_jnt="8" nuser_tendon="8"/>')
    want = shaken(load(edited()))[1]
    for native in (0, 800):
        file = edited(size, (PAD_JOINT, BARE_PAD), *NO_PAD_PARAMETERS, ("<actuator>", tendon.format(native)))
        have = shaken(load(file))[1]
        assert np.abs(have - want).max() < 1e-9 * np.abs(want).max()


def test_an_edited_model_that_keeps_the_named_elements_works(edited: Edit) -> None:
    """Other names for the inner joints and bodies, another mass and no declared parameters."""
    file = edited(
        *NO_PAD_PARAMETERS, ('mass="1.052265"', 'mass="1.5"'), ('name="fat_pad"', 'name="my_pad"'),
        ('<body name="foot"', '<body name="hind_foot"'), ("| body foot mass |", "| body hind_foot mass |"),
    )  # fmt: skip
    t, y = shaken(load(file))
    pad = oracle.spring_and_damper(1e5, 800, -50, 100)
    want = oracle.malleolus({**ANKLE, "m_F": 1.5}, oracle.sine(25.0), t, pad=pad)
    assert np.abs(y - want).max() < 2e-5 * np.abs(want).max()


@pytest.mark.parametrize(
    ("kind", "name", "edits"),
    [
        ("joint", "base", [('<joint name="base"', '<joint name="slide"'), ('joint="base"', 'joint="slide"')]),
        ("actuator", "shaker", [('name="shaker"', 'name="shaking"')]),
        ("sensor", "malleolus", [('<framelinacc name="malleolus"', '<framelinacc name="ankle"')]),
        ("sensor", "base", [('<framelinacc name="base"', '<framelinacc name="table"')]),
        ("site", "malleolus", [('<site name="malleolus"', '<site name="ankle"'),
                               ('objname="malleolus"', 'objname="ankle"')]),
    ],
)  # fmt: skip
def test_a_missing_name_lists_what_is_needed_and_found(edited: Edit, kind: str, name: str, edits: list) -> None:
    with pytest.raises(ModelError) as caught:
        load(edited(*edits))
    text = str(caught.value)
    assert f"there is no {kind} '{name}'" in text
    assert "every foot model needs joint base, actuator shaker, sensor base and malleolus, site malleolus" in text
    found = {"joint": "talocrural", "actuator": "shaker_a0", "site": "base", "sensor": "valid:"}[kind]
    assert found in text


@pytest.mark.parametrize(
    ("edits", "sentence"),
    [
        ([('damping="800" user="4.25 800', 'user="4.22 800')], r"names the law 4\.22"),
        ([('biasprm="1"', 'biasprm="2"')], r'needs biastype="user" biasprm="1"'),
        ([('    <general name="shaker_a3" joint="base" gainprm="0"/>\n', "")], "four more actuators"),
        ([("| 3e3 | 1e6 |", "| 3e6 | 1e6 |")], "lower bound 3e[+]06 that is not below"),
        ([("| 3e3 | 1e6 |", "| low | 1e6 |")], "bounds 'low' and '1e6'; both must be numbers"),
        ([("joint fat_pad stiffness", "joint fatpad stiffness")], "unknown joint 'fatpad', did you mean 'fat_pad'"),
        ([("joint fat_pad stiffness", "joint fat_pad strength")], "is no place"),
        ([("joint fat_pad user 3", "joint fat_pad user 8")], "column 8 of 'user', which has 8"),
        ([('<joint name="base" class="base"/>', '<joint name="base" class="base" type="hinge"/>')], "must be a slide"),
        ([('framelinacc name="malleolus"', 'framelinvel name="malleolus"')], "'malleolus' reads no acceleration"),
        ([("4.25 800 -50", "4.25 800 nan")], r"joint 'fat_pad' gives a parameter that is no number to the law 4\.25"),
    ],
)
def test_broken_models_get_one_sentence(edited: Edit, edits: list, sentence: str) -> None:
    with pytest.raises(ModelError, match=sentence) as caught:
        load(edited(*edits))
    assert "edited.xml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_are_no_models(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match=r"no such model; give an MJCF file or one of .*two_dof"):
        load(tmp_path / "none.xml")
    (tmp_path / "text.xml").write_text("<mujoco><worldbody>")
    with pytest.raises(InputFileError, match="MuJoCo cannot compile it"):
        load(tmp_path / "text.xml")
    with pytest.raises(InputFileError, match="no such model"):
        load("two_dofs")


def test_with_values_changes_a_copy(foot: Foot) -> None:
    before = foot.values()
    changed = foot.with_values({"k_T": 2e5, "c_23": 7.0, "m_S": 4.0}, step=1e-4)
    assert foot.values() == before
    assert changed.values() == {**before, "k_T": 2e5, "c_23": 7.0, "m_S": 4.0}
    assert (foot.step, changed.step) == (5e-4, 1e-4)
    heavier = mujoco.mj_getTotalmass(changed.model) - mujoco.mj_getTotalmass(foot.model)
    assert heavier == pytest.approx(4.0 - before["m_S"])
    with pytest.raises(SettingError, match="unknown parameter 'k_S'"):
        foot.with_values({"k_S": 1.0})
    with pytest.raises(SettingError, match=r"model two_dof has no k_M, m_A \(valid: k_T, k_F"):
        foot.with_values({"k_T": 1.0, "k_M": 1.0, "m_A": 1.0})
    with pytest.raises(SettingError, match="k_T is '2e5'; give a number"):
        foot.with_values({"k_T": "2e5"})


@pytest.mark.parametrize("name", ["two_dof", "foot_arch", "leg"])
def test_every_name_of_a_parameter_changes_it(name: str) -> None:
    """The symbol, the key of files, and what tables print; a delay is of no foot."""
    foot = load(name)
    wanted = {p.name: 1.01 * v for p, v in zip(foot.parameters.values(), foot.values().values(), strict=True)}
    for form in ("name", "key", "label"):
        given = {getattr(foot.parameters[symbol], form): value for symbol, value in wanted.items()}
        assert foot.with_values({**given, "delay_s": 1e-4, "delay_foot_s": 0.0}).values() == pytest.approx(wanted)
    alike = [load(name).with_values(values) for values in (wanted, dict(zip(given, wanted.values(), strict=True)))]
    out = [simulate(one, shaker.sine(20.0, 0.01)).malleolus for one in alike]
    np.testing.assert_array_equal(*out)
    batched = simulate(foot, shaker.sine(20.0, 0.01), values=given).malleolus
    np.testing.assert_allclose(batched, out[0], atol=1e-9)


def test_a_model_is_loaded_from_a_file_its_text_or_a_spec(tmp_path: Path) -> None:
    text = mjcf.text("two_dof")
    softer = text.replace('stiffness="1.5e5"', 'stiffness="1.2e5"')
    (tmp_path / "softer.xml").write_text(softer)
    spec = mujoco.MjSpec.from_string(text)
    spec.joint("talocrural").stiffness = [1.2e5, 0, 0]
    feet = [load(tmp_path / "softer.xml"), load(softer), load(spec)]
    assert [foot.name for foot in feet] == ["softer.xml", "two_dof", "two_dof"]
    first, *others = (simulate(foot, shaker.sine(20.0, 0.05)).malleolus for foot in feet)
    for other in others:
        np.testing.assert_array_equal(other, first)
    assert feet[2].values()["k_T"] == 1.2e5 and load("two_dof").values()["k_T"] == 1.5e5
    spec.joint("talocrural").stiffness = [2e5, 0, 0]
    assert feet[2].values()["k_T"] == 1.2e5  # as it was when it was loaded
    with pytest.raises(InputFileError, match=r"^MJCF text, line \d+: MuJoCo cannot compile it \(.*bases"):
        load(text.replace('joint="base"', 'joint="bases"'))
    spec.actuator("shaker").target = "nothing"
    with pytest.raises(InputFileError, match=r"^MjSpec, line \d+: MuJoCo cannot compile it .*nothing"):
        load(spec)
    with pytest.raises(ModelError, match=r"^MuJoCo Model: there is no joint"):
        load("<mujoco/>")


LAW = 'damping="430" user="4.25 430 50 100"/>'
HINGE = '<joint name="lean" type="hinge" axis="0 0 1" stiffness="150" damping="0.5"/>'


@pytest.mark.parametrize(("model", "name", "written"), [
    ("leg", "c_H", ('name="thigh" stiffness="2.792e4" damping="971"/>',
                    'name="thigh" stiffness="2.792e4" damping="971" user="4.25 971 50 100"/>')),
    ("two_dof", "c_11", ("joint talocrural user 1", "joint talocrural damping")),
])  # fmt: skip
def test_a_damper_declared_beside_its_law_moves_the_law(model: str, name: str, written: tuple[str, str]) -> None:
    """`damping` only repeats c_1, so that MuJoCo alone has it: another number there would change nothing."""
    text = mjcf.text(model)
    assert written[0] in text
    foot = load(text.replace(*written))
    (place,) = foot.parameters[name].places
    joint = foot.model.joint("thigh" if model == "leg" else "talocrural").id
    assert (place.field, divmod(place.index, foot.model.nuser_jnt)) == ("jnt_user", (joint, 1))


@pytest.mark.parametrize(("edits", "sentence"), [
    ([('<general name="shaker_a3" joint="base" gainprm="0"/>',
       '<general name="shaker_a3" joint="base" gainprm="0"/>'
       '<position name="hold" joint="talocrural" kp="5e4" dampratio="0.7"/>')],
     "the kv of actuator 'hold' follows from its dampratio"),
    ([(LAW, LAW + HINGE), ('<inertial pos="0 0.25 0" mass="3.374505" diaginertia="1e-2 1e-2 1e-2"/>', ""),
      ('<geom name="shank" type="capsule"', '<geom name="shank" mass="3.374505" type="capsule"')],
     "parameter 'm_S' is the mass of body 'shank', whose inertia follows from its geoms"),
    ([(LAW, LAW + HINGE.replace('stiffness="150" damping="0.5"', 'springdamper="0.2 1"'))],
     "stiffness and damping of joint 'lean' follow from its springdamper"),
])  # fmt: skip
def test_what_the_compiler_derives_from_a_mass_is_refused(edited: Edit, edits: list, sentence: str) -> None:
    """It would stay as it is when another value of a parameter is tried."""
    with pytest.raises(ModelError, match=re.escape(sentence)):
        load(edited(*edits))


@pytest.mark.parametrize("geom", [
    '<geom density="1000" mass="0" name="sole" size="0.02"/>',
    '<geom name="sole" mass="0" size="0.02" density="1000"/>',
])  # fmt: skip
def test_a_shoe_without_weight_is_refused_wherever_its_density_stands(edited: Edit, geom: str) -> None:
    site = '<site name="foot" pos="0.06 0.055 0"'
    with pytest.raises(ModelError, match="geom 'sole' has the density 1000, which counts for nothing"):
        load(edited((site, f'<body name="shoe">{geom}</body>{site}')))
    with pytest.raises(ModelError, match=r'edited.xml: <geom density="1000"/> in a <default> cannot be told'):
        load(edited(("<default>", '<default><default class="shoe"><geom density="1000"/></default>')))


ATTACHED = (
    '<mujoco model="shoe">{}<worldbody><body name="shoe"><geom name="sole" size="0.1" {}/></body></worldbody></mujoco>'
)
ATTACHES = (
    ("<worldbody>", '<asset><model name="shoe" file="shoe.xml"/></asset><worldbody>'),
    ('<site name="foot" ', '<attach model="shoe" body="shoe" prefix="a_"/><site name="foot" '),
)
MASSLESS = '<default><geom mass="0"/></default>'


@pytest.mark.parametrize("default", [MASSLESS, ""], ids=["massless class", "no class"])
@pytest.mark.parametrize("density", [300, 1000])
@pytest.mark.parametrize("way", ["attach", "MjSpec", "add_geom"])
def test_a_shoe_of_another_file_is_followed_or_refused(edited: Edit, way: str, density: int, default: str) -> None:
    child, weighs = ATTACHED.format(default, f'density="{density}"'), density * 4 / 3 * np.pi * 0.1**3
    file = edited(*ATTACHES) if way == "attach" else edited()
    file.with_name("shoe.xml").write_text(child)
    spec = mujoco.MjSpec.from_file(str(file))
    if way == "MjSpec":
        spec.body("foot").add_frame().attach_body(mujoco.MjSpec.from_string(child).body("shoe"), "a_", "")
    elif way == "add_geom":
        geom = spec.body("foot").add_body(name="a_shoe").add_geom(name="a_sole", size=[0.1, 0, 0], density=density)
        geom.mass = 0.0 if default else np.nan
    model = file if way == "attach" else spec
    assert (file.with_name("shoe.xml") in mjcf.parts(file)) == (way == "attach")  # the page reads it again, too
    if default:
        with pytest.raises(ModelError, match=r"geom 'a_sole' has the density|body 'a_shoe' weighs nothing"):
            load(model)
    else:
        assert load(model).model.body("a_shoe").mass[0] == pytest.approx(weighs)


def test_a_bound_that_another_file_brings_is_refused(edited: Edit) -> None:
    file, child = edited(*ATTACHES), ATTACHED.format('<compiler boundmass="{}"/>', 'mass="0.3"')
    file.with_name("shoe.xml").write_text(child.format("0.2"))
    assert load(file).model.body("a_shoe").mass[0] == 0.3
    file.with_name("shoe.xml").write_text(child.format("2.00"))
    with pytest.raises(ModelError, match=r"body 'a_shoe' has the mass 0\.3, and <compiler boundmass> makes it 2"):
        load(file)


def test_a_kv_that_is_written_and_a_mass_that_only_slides_are_followed(edited: Edit) -> None:
    actuator = '<general name="shaker_a3" joint="base" gainprm="0"/>'
    load(edited((actuator, actuator + '<position name="hold" joint="talocrural" kp="5e4" kv="90"/>')))
    load(edited(('<inertial pos="0 0.25 0" mass="3.374505" diaginertia="1e-2 1e-2 1e-2"/>', ""),
                ('<geom name="shank"', '<geom name="shank" mass="3.374505"')))  # fmt: skip


def test_two_joints_that_move_one_mass_are_refused() -> None:
    """Which of them moves nobody knows, unless a mass is between them."""
    text, shank, joint = mjcf.text("two_dof"), '<body name="shank">', '<joint name="cartilage" stiffness="1e6"/>'
    with pytest.raises(ModelError, match="joint 'cartilage' and joint 'talocrural' move the same masses"):
        load(text.replace(shank, shank + joint))
    mass = '<body name="cartilage"><inertial pos="0 0 0" mass="0.01" diaginertia="1e-5 1e-5 1e-5"/>'
    apart = text.replace(shank, mass + joint + shank).replace("</body>\n      </body>", "</body></body>\n      </body>")
    assert load(apart).model.nv == 4


def test_numbers_behind_a_law_are_refused() -> None:
    text, law = mjcf.text("two_dof"), "4.25 800 -50 100"
    assert text.count(law) == 1
    with pytest.raises(ModelError, match="joint 'fat_pad' has more numbers than its law"):
        load(text.replace(law, law + " 7"))
    load(text.replace(law, law + " 0"))
