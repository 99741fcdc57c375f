"""Edit the file and everything follows, or says which element it cannot follow."""

import json
from pathlib import Path

import numpy as np
import pytest
from arch_copies import compiled, edited
from model_edits import EDITS, FOLLOWED, FOOT, LEG, OF, READERS, SHANK, Edit, arch, chain, mounted, opened, section
from typer.testing import CliRunner

import mjcf
from fasbody.arch.__main__ import app
from fasbody.arch.bones import Arch
from fasbody.arch.linear import transmissibility
from fasbody.exceptions import FasError, ModelError, SimulationError
from fasbody.foot import shaker
from fasbody.foot.model import check, load
from fasbody.foot.simulate import simulate
from fasbody.foot.steady_state import Balance
from fasbody.recording.condition import Condition
from fasbody.recording.recording import Recording
from identification.engines.engine import Whole
from identification.fitting import fit_foot
from viz.load import load_foot

#: Each command with little work; its answer hangs on what the file says.
COMMANDS = {
    "sensitivity": ["--this"],
    "reduction": ["--draws", "1"],
    "load": [],
    "crosscheck": ["--samples", "2"],
}
#: Relative agreement with the truth: stepping errs by 1e-3. Nothing else has a step; a law that bends and the closures'
#: give leave 1e-5, the spectrum of a pad that relaxes 1e-4.
CLOSE, BALANCED = 1e-3, 1e-4
#: One reader of each way to open a file: a foot, that of the viewer, an arch.
LOADERS = ("simulate", "curve", "arch")


#: Changes of an arch beside another of their kind; the start of a fit is seen of each number below.
LIKE = {says for _, says, *_ in FOLLOWED[1:]} | {
    "weaker damper of the pad", "heavier shank", "a cast on the malleolus", "a higher arch", "Euler's integrator",
    "a parameter less", "the solver's tolerance gone",
}  # fmt: skip
SEEN = [pytest.param(e, marks=[pytest.mark.long] * ("arch" in e.model and e.says in LIKE)) for e in EDITS]


@pytest.mark.parametrize("edit", SEEN, ids=lambda edit: f"{edit.model}: {edit.says}")
def test_followed_or_refused_by_its_name(tmp_path: Path, edit: Edit) -> None:
    """Every edit through every reader: the number of an independent calculation, or the sentence."""
    file = edit.write(tmp_path)
    everywhere = edit.refused.get("load")
    if everywhere is None:
        opened(file)
    readers = LOADERS if everywhere else OF[edit.model] if edit.truth else tuple(edit.refused)
    for reader in readers:
        words = everywhere or edit.refused.get(reader)
        if words is not None:
            with pytest.raises(FasError, match=words):
                READERS[reader](file)
            continue
        assert edit.truth is not None
        for what, found in READERS[reader](file).items():
            truth = getattr(edit.truth, what)
            if truth is None:
                continue
            if callable(truth):  # natural frequencies
                assert max((truth(s) for s in found if s.imag > 0), default=0.0) < 1e-2, reader
            else:
                assert abs(found / truth - 1) < (CLOSE if reader == "simulate" else BALANCED), (reader, what)


def test_no_edit_is_a_silent_nothing() -> None:
    """What must come out differs from the shipped model's, but for edits that act beyond small motion alone."""
    shipped = {"two_dof": chain(FOOT, SHANK, at=1).T, "leg": chain(*LEG, at=1).T, "foot_arch": arch().T}
    shipped["mounted_arch"] = mounted().T
    same = [e.says for e in EDITS if e.truth and abs(e.truth.T / shipped[e.model] - 1) < 1e-6]
    assert sum(e.truth is not None for e in EDITS) - len(same) >= 25
    assert len(EDITS) - sum(e.truth is not None for e in EDITS) >= 25
    assert all(e.refused.get("leg") or "gravity" in e.says or "alone" in e.says or "in place of" in e.says
               for e in EDITS if e.says in same and e.model != "foot_arch")  # fmt: skip


def test_the_page_lists_them() -> None:
    page = (Path(__file__).parents[1] / "benchmarks" / "edits.md").read_text()
    for line in section().splitlines():
        assert line in page, (
            f"python tests/model_edits.py prints the section; this is not in benchmarks/edits.md: {line}"
        )


def written(folder: Path, text: str) -> Path:
    file = folder / "copy.xml"
    file.write_text(text)
    return file


def answer(command: str, file: Path) -> dict:
    run = CliRunner().invoke(app, [command, "--json", "--model", str(file), *COMMANDS[command]])
    assert run.exit_code == 0, run.exception
    document = json.loads(run.stdout)
    if command == "crosscheck":  # agreement is rounding; what changes is the constants that it compared
        return document["constants"]
    return document


def numbers(document: object) -> list[float]:
    if isinstance(document, dict | list):
        return [x for item in (document.values() if isinstance(document, dict) else document) for x in numbers(item)]
    return [document] if isinstance(document, float) else []


STIFFER = edited(('<joint name="spring_ligament"/>', '<joint name="spring_ligament" stiffness="9000"/>'))


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_of_the_arch_reads_the_file(tmp_path: Path, command: str) -> None:
    before = np.array(numbers(answer(command, written(tmp_path, edited()))))
    after = np.array(numbers(answer(command, written(tmp_path, STIFFER))))
    assert (np.abs(after - before) > 1e-3 * np.abs(before)).any()


def test_the_start_of_a_fit_is_what_the_file_says(tmp_path: Path) -> None:
    for name, _, change, value in FOLLOWED:
        foot = load_foot(str(written(tmp_path, edited(change))))
        if name in foot.parameters:
            assert foot.values()[name] == pytest.approx(value)


@pytest.mark.parametrize("command", COMMANDS)
def test_an_open_arch_is_refused_by_its_name(tmp_path: Path, command: str) -> None:
    """A forgotten theta_1: the closure would keep the gap that it finds."""
    file = written(tmp_path, edited(("-0.06527 ", "-0.075 "), ("-0.032635 ", "-0.0375 ")))
    run = CliRunner().invoke(app, [command, "--model", str(file), *COMMANDS[command]])
    assert isinstance(run.exception, ModelError)
    assert "'closure' ties the tendons 'heel_pad' and 'forefoot_pad', whose lengths at rest are" in str(run.exception)
    with pytest.raises(ModelError, match=r"3\.566 mm apart"):
        load_foot(str(file))


def test_a_damper_without_a_law_is_its_damping() -> None:
    """What is written goes where it acts, and what would bend a law that is gone is no parameter."""
    foot = load(mjcf.text("two_dof").replace(' user="4.25 800 -50 100"', ""))
    assert foot.values()["c_21"] == 800 and not {"c_22", "c_23"} & set(foot.parameters)
    assert foot.with_values({"c_21": 500.0}).model.joint("fat_pad").damping[0] == 500


def test_the_draws_of_the_thesis_keep_only_the_bones(tmp_path: Path) -> None:
    documents = []
    for text in (edited(), STIFFER):
        options = ["sensitivity", "--json", "--draws", "2", "--model", str(written(tmp_path, text))]
        documents.append(json.loads(CliRunner().invoke(app, options).stdout))
    assert documents[0]["studies"] == documents[1]["studies"]
    assert documents[0]["own"] != documents[1]["own"]


#: Both pads by Eq. 4.24, in place of spring and damper; their declarations go, since the numbers do.
STRAIN_PADS = (
    ('stiffness="5e4" damping="1500" user="4.25 1500 0 0"', 'user="4.24 2000 80 0.02 0.3"'),
    *((line + "\n", "") for line in edited().splitlines() if '<text name="k_F"' in line or '<text name="c_F"' in line),
)


def test_pads_of_another_law_are_linear_for_small_motion() -> None:
    foot = check(compiled(*STRAIN_PADS), "pads")
    arch, f, seconds, step = Arch.from_model(foot.model), 25.0, 0.4, 2.5e-5  # no native share, so a finer step
    assert (arch.k_F, arch.c_F) == pytest.approx((2 * 2000 / 0.02, 2 * 80 * 0.3 / 0.02))
    run = simulate(foot, shaker.sine(f, seconds, 1e-3), step=step)
    late = run.time[0] > seconds - 2 / f - step / 2
    carrier = np.exp(-2j * np.pi * f * run.time[0, late])
    measured = np.abs(np.mean(run.malleolus[0, late] * carrier) / np.mean(run.base[0, late] * carrier))
    assert measured == pytest.approx(float(np.abs(transmissibility(arch, np.array(f)))), rel=1e-3)


def test_a_range_of_an_activation_is_refused_by_name() -> None:
    """MuJoCo keeps it while it steps only, so harmonic balance would follow another foot."""
    exo = '<general name="exo" joint="talocrural" dyntype="filter" dynprm="0.01" gainprm="50" {}/>'
    text = mjcf.text("two_dof").replace("</actuator>", exo + "</actuator>")
    assert load(text.format('ctrlrange="1 2"')).model.na == 1
    with pytest.raises(ModelError, match="actuator 'exo' has an actrange, which MuJoCo keeps while it steps only"):
        load(text.format('actrange="1 2"'))


def test_a_law_declares_its_parameters_where_the_element_has_none() -> None:
    """The leg's pad had a stiffness and a damping that it no longer has."""
    plain = 'name="fat_pad" stiffness="1.633e5" damping="47.6"'
    foot = load(mjcf.text("leg").replace(plain, 'name="fat_pad" user="4.24 3000 60 0.02 0.3"'))
    assert {"fat_pad_E", "fat_pad_eta"} <= set(foot.parameters) and not {"k_F", "c_F"} & set(foot.parameters)
    one, two = (Balance(foot).orbit(15.0, [1.0], {"fat_pad_E": E}).harmonics()[0] for E in (3000.0, 6000.0))
    other = Balance(foot.with_values({"fat_pad_E": 6000.0})).orbit(15.0, [1.0]).harmonics()[0]
    assert two == pytest.approx(other) and abs(two / one - 1) > 0.01


@pytest.mark.parametrize("phase", [1.0, -1.0j], ids=["cosine", "sine"])
def test_a_table_that_is_tied_to_the_world_moves_about_its_place(tmp_path: Path, phase: complex) -> None:
    """Of a table that drifts a rope lifts the foot, whose pad has another damping there."""
    rope = next(edit for edit in EDITS if edit.says == "a rope from the world to the knee")
    foot, f, peak = load(rope.write(tmp_path)), 20.0, 9.0
    run = simulate(foot, shaker.harmonics(f, [peak * phase], 2.0), step=5e-4)
    late = run.time[0] > 2.0 - 2 / f - 2.5e-4
    carrier = np.exp(-2j * np.pi * f * run.time[0, late])
    ratio = np.mean(run.malleolus[0, late] * carrier) / np.mean(run.base[0, late] * carrier)
    assert ratio == pytest.approx(Balance(foot).orbit(f, [peak]).harmonics()[0] / peak, rel=1e-4)
    with pytest.raises(SimulationError, match="tendon 'rope' ties the foot to the world"):
        simulate(foot, shaker.sweep(5.0, 20.0, 1.0))


WORLD = ("<worldbody>", '<worldbody><site name="ceiling" pos="0 1.3 0"/>')
TO_WORLD = '<tendon><spatial name="tie" {}><site site="ceiling"/><site site="malleolus"/></spatial></tendon>'
LIFT = '<actuator><general name="tie" site="malleolus" refsite="ceiling" gear="0 1 0 0 0 0" gainprm="0" '


@pytest.mark.parametrize(
    ("tie", "by"),
    [
        (TO_WORLD.format('damping="300"'), "tendon 'tie'"),
        (TO_WORLD.format('frictionloss="3"'), "tendon 'tie'"),
        (LIFT + 'biastype="affine" biasprm="-24200 -2e4 -30"/></actuator>', "actuator 'tie'"),
        ('<option jacobian="sparse"/>' + TO_WORLD.format('stiffness="2e4"'), "tendon 'tie'"),
        ('<equality><weld body1="shank" solref="-2e4 -100"/></equality>', "equality number 1"),
    ],
    ids=["damper", "friction", "servo", "sparse", "no name"],
)
def test_whatever_ties_the_foot_to_the_world_is_named(tie: str, by: str) -> None:
    """A damper and friction feel how fast the table goes, of which a sweep's acceleration says as little."""
    foot = load(mjcf.text("two_dof").replace(*WORLD).replace("</mujoco>", tie + "</mujoco>"))
    with pytest.raises(SimulationError, match=f"{by} ties the foot to the world"):
        simulate(foot, shaker.sweep(5.0, 20.0, 1.0))


def test_a_fit_follows_a_foot_that_is_tied_to_the_world(tmp_path: Path) -> None:
    """Sines begin where their table does not drift; a sweep does not say where its table is."""
    rope = next(edit for edit in EDITS if edit.says == "a rope from the world to the knee")
    foot, step = load(rope.write(tmp_path)), 5e-4
    rng, data = np.random.default_rng(1), []
    for motion in (shaker.harmonics(20.0, [5.0], 2.0), shaker.harmonics(30.0, [5.0], 2.0)):
        run = simulate(foot, motion, step=step)
        late = slice(-round(1.0 / step), None)
        base, malleolus = (x[0, late] + rng.normal(0, 0.02, 2000) for x in (run.base, run.malleolus))
        data.append(Recording(step * np.arange(2000), base, malleolus, condition=Condition(body_mass_kg=72.57)))
    result = fit_foot(data, foot, free=["k_T", "k_F"], starts=1, threads=1, departures=False)
    for name in ("k_T", "k_F"):
        assert result[name].value == pytest.approx(foot.values()[name], rel=3e-3)
    with pytest.raises(SimulationError, match="tendon 'rope' ties the foot to the world, and the base of 'recording'"):
        Whole.of(data[0], foot)


@pytest.mark.parametrize("domain", ["periodic", "time"])
def test_a_fit_refuses_a_foot_that_nothing_carries(tmp_path: Path, domain: str) -> None:
    foot = load(next(edit for edit in EDITS if edit.says == "a foot without a spring").write(tmp_path))
    t = np.arange(2000) / 2000
    recording = Recording(
        t, np.sin(40 * np.pi * t), 1.8 * np.sin(40 * np.pi * t - 0.9), condition=Condition(body_mass_kg=72.57)
    )
    with pytest.raises(SimulationError, match="nothing carries joint 'fat_pad'"):
        fit_foot([recording], foot, free=["k_T"], starts=1, threads=1, departures=False, domain=domain)
