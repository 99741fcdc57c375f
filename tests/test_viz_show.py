"""What a viewer shows: parameters of a fit, a recording, models with names of their own, edited and broken files."""

import json
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

import umsgpack

import mjcf
from fasbody.exceptions import FasError
from fasbody.recording.study import BUNDLED
from viz import fitted, notebook
from viz import foot as command
from viz.excitation import Excitation
from viz.feet import MEASURED, MODEL, OTHER, Show
from viz.load import files_of, load_foot, name_and_values
from viz.scene import Hub

RECORDED = BUNDLED / "recordings" / "20hz_0kg.csv"


def test_result_of_a_fit_moves_the_sliders(tmp_path: Path) -> None:
    entries = {"k_T_n_per_m": {"value": 2e5}, "c_12_per_m": {"value": 5.0}, "delay_s": {"value": 1e-4}}
    file = tmp_path / "result.json"
    file.write_text(json.dumps({"parameters": entries}))
    model = Show(["two_dof"]).feet["a"]
    assert fitted.read(file, model.parameters)["branches"][0]["values"] == {"k_T": 2e5, "c_12": 5.0}
    file.write_text("{}")
    with pytest.raises(FasError, match="is not a result"):
        fitted.read(file, model.parameters)


def estimate(value: float, half: float, exact: float | None = None) -> dict[str, Any]:
    """One entry of a result.json."""
    inside = None if exact is None else estimate(exact, 0.1 * half)
    return {
        "value": value, "std_error": half / 1.96, "lower": value - half, "upper": value + half, "at_bound": False,
        "identifiability": "weak", "if_model_true": inside,
    }  # fmt: skip


def test_result_brings_mirror_intervals_verdict_and_delay(tmp_path: Path) -> None:
    """What a page shows of result.json; the foot gets the values of its table."""
    sides = {
        "stiff ankle": {"k_T_n_per_m": estimate(2e5, 2e4, exact=1.9e5), "delay_s": estimate(2e-4, 1e-5)},
        "stiff pad": {"k_T_n_per_m": estimate(8e4, 1e4), "delay_s": estimate(1e-4, 1e-5)},
    }
    file = tmp_path / "result.json"
    branches = [{"name": name, "parameters": found, "fit_percent": 99.0} for name, found in sides.items()]
    reason = "The data do not decide between stiff ankle and stiff pad (odds 4.48 to 1 for stiff ankle)."
    document = {
        "parameters": sides["stiff ankle"], "branches": branches, "verdict": "undecided", "verdict_reason": reason,
        "log_likelihood_ratio": 1.5, "fit_percent": 99.0, "warnings": ["A note."],
    }  # fmt: skip
    file.write_text(json.dumps(document))
    show = command._show("two_dof", "", None, None, 0.0, False, (RECORDED, None), None, file, {})
    assert (show.settings.values, show.settings.delay_s) == ({"k_T": 2e5}, 2e-4)
    fit = show.description()["fit"]
    assert [branch["name"] for branch in fit["branches"]] == ["stiff ankle", "stiff pad"]
    assert fit["branches"][1]["values"] == {"k_T": 8e4}
    row = fit["branches"][0]["rows"][0]
    assert (row["name"], row["interval"], row["lower"]) == ("k_T", "200\u202f000 ± 20\u202f000", 1.8e5)
    assert (fit["verdict"], fit["reason"], fit["warnings"]) == ("undecided", reason, ["A note."])
    assert "odds" not in fit  # the verdict alone speaks of them, and only where it decides
    json.dumps(show.description(), allow_nan=False)


def test_foot_of_a_result_has_the_masses_and_the_load_of_its_fit(tmp_path: Path) -> None:
    """A bare file says neither: the page once showed 88 % where the fit said 99, for another body mass alone."""
    bare, file = tmp_path / "loose.csv", tmp_path / "result.json"
    bare.write_text(RECORDED.read_text())
    masses = [{"name": "m_S", "value": 3.162}, {"name": "m_F", "value": 0.986}]
    found = {"parameters": {"k_T_n_per_m": estimate(2e5, 2e4)}, "masses": masses, "verdict": "decided"}
    found["recordings"] = [{"file": "elsewhere/loose.csv", "added_mass_kg": 2.3}]
    file.write_text(json.dumps(found))
    show = command._show("two_dof", "", None, None, 0.0, False, (bare, None), None, file, {})
    assert show.settings.values == {"k_T": 2e5, "m_S": 3.162, "m_F": 0.986}
    assert show.settings.added_mass == 2.3
    foot = show.settings.apply(show.feet[MODEL])
    assert (foot.values()["m_S"], foot.values()["m_F"]) == (pytest.approx(5.462), pytest.approx(0.986))


def test_recording_drives_the_table_and_is_shown_beside(tmp_path: Path) -> None:
    show = Show(["two_dof"], Excitation.recorded(RECORDED, 0.5))
    answer = show.answer(show.settings)
    measured, model = answer["feet"][MEASURED], answer["feet"][MODEL]
    assert measured["base"] == model["base"]
    # the truth of the bundled foot differs from the nominal model, but both are feet at 20 Hz
    assert 0.5 < max(measured["malleolus"]) / max(model["malleolus"]) < 2
    assert max(measured["bodies"]) < 0.01
    drawn = show.description()["feet"][MEASURED]
    assert [s["name"] for s in drawn["segments"]] == ["ring"]
    assert drawn["bodies"] == ["base", "shank"]


def test_ring_goes_around_the_shank_whichever_body_carries_the_accelerometer(monkeypatch: pytest.MonkeyPatch) -> None:
    rings: dict[str, tuple[list[float], float]] = {}
    for model in ("two_dof", "leg"):  # on the shank itself; on a malleolus below it

        def keep(visualizer: object, name: str, centre: Any, radius: float, *rest: object, of: str = model) -> None:
            rings[of] = centre.tolist(), radius

        monkeypatch.setattr("viz.scene.add_ring", keep)
        Show([model], Excitation.recorded(RECORDED, 0.5))
    assert rings["leg"] == (pytest.approx(rings["two_dof"][0], abs=2e-3), pytest.approx(rings["two_dof"][1], abs=2e-3))


def test_foot_with_names_of_its_own_is_drawn_by_its_geoms(tmp_path: Path) -> None:
    text = mjcf.text("two_dof")
    file = tmp_path / "own.xml"
    file.write_text(text.replace('body name="foot"', 'body name="pes"').replace("body foot mass", "body pes mass"))
    show = Show([str(file)])
    rest = show.description()["feet"]["a"]
    assert not rest["dressed"]
    assert [segment["name"] for segment in rest["segments"]] == ["base", "pes", "shank"]
    scene = b"".join(show.hub.messages())
    for path in (b"/meshcat/foot/a/base/geom0", b"/meshcat/foot/a/pes/geom1", b"/meshcat/foot/a/shank/geom2"):
        assert path in scene
    assert b"/meshcat/foot/a/tibia" not in scene


def test_what_was_edited_is_drawn(tmp_path: Path) -> None:
    """A colour, a geom more, and a shoe that is welded on; and the bones remain."""
    text = mjcf.text("two_dof")
    file = tmp_path / "shod.xml"
    file.write_text(text)
    show = Show([str(file)])

    def drawn() -> dict[str, Any]:
        found = [umsgpack.unpackb(message) for message in show.hub.messages()]
        return {m["path"]: m["object"] for m in found if m["type"] == "set_object" and "/foot/a/" in m["path"]}

    plain = drawn()
    shoe = '<body name="shoe"><geom type="box" size="0.1 0.01 0.04" rgba="0.2 0.2 0.9 0.5" mass="0.5"/></body>'
    red = text.replace('<geom name="shank" type', '<geom name="shank" rgba="1 0 0 1" type')
    red = red.replace('<body name="shank">', f'{shoe}<geom name="wart" type="sphere" size="0.01"/><body name="shank">')
    file.write_text(
        red.replace("<worldbody>", '<worldbody><geom name="wall" type="box" size="1 1 0.01" pos="0 0 -1"/>')
    )
    show.reload()
    now = drawn()
    more = {path.rpartition("/")[0].rpartition("/")[2] for path in now.keys() - plain.keys()}
    assert more == {"own shoe", "own foot", "world"}
    assert now["/meshcat/foot/a/tibia"]["materials"][0]["color"] == 0xFF0000
    assert now["/meshcat/foot/a/navicular"]["materials"] != now["/meshcat/foot/a/tibia"]["materials"]
    worn = {part["name"]: part["body"] for part in show.description()["feet"]["a"]["worn"]}
    assert worn == {"own shoe": 2, "own foot": 1}
    assert show.answer(show.settings)["feet"]["a"]["ratio"] > 1
    file.write_text(text)
    show.reload()
    assert drawn().keys() == plain.keys()


def test_another_kind_of_model_is_drawn_anew(tmp_path: Path) -> None:
    file = tmp_path / "mine.xml"
    file.write_text(mjcf.text("foot_arch"))
    show, fresh = Show([str(file)]), Show(["two_dof"])
    file.write_text(mjcf.text("two_dof"))
    show.reload()
    path = "/meshcat/foot/a/tibia"

    def vertices(shown: Show) -> bytes:
        found = [umsgpack.unpackb(message) for message in shown.hub.messages()]
        drawn = next(m for m in found if m["path"] == path and m["type"] == "set_object")
        return bytes(drawn["object"]["geometries"][0]["data"]["attributes"]["position"]["array"].data)

    assert vertices(show) == vertices(fresh)
    assert vertices(show) != vertices(Show(["foot_arch"]))


def test_broken_model_keeps_the_last_good_one(tmp_path: Path) -> None:
    file = tmp_path / "mine.xml"
    good = mjcf.text("two_dof")
    file.write_text(good)
    show = Show([str(file)])
    file.write_text(good.replace("</worldbody>", ""))
    with pytest.raises(FasError, match="cannot compile"):
        show.reload()
    assert show.description()["error"]
    assert show.answer(show.settings)["feet"]["a"]["ratio"] > 1
    file.write_text(good)
    show.reload()
    assert not show.description()["error"]


def test_page_is_told_what_a_bound_has_stopped() -> None:
    show = Show(["two_dof"])
    wild, upper = (replace(show.settings, values={"k_F": value}) for value in (1e12, 1e6))
    answer = show.answer(wild)
    assert answer["held"] == {"k_F": 1e6}
    assert answer["feet"][MODEL]["ratio"] == show.answer(upper)["feet"][MODEL]["ratio"]
    assert show.answer(upper)["held"] == {}


def test_compared_foot_keeps_its_own_parameters(tmp_path: Path) -> None:
    """k_F of the other file is doubled: a slider moves both by the same factor, and the other does not jump."""
    file = tmp_path / "stiff.xml"
    file.write_text(mjcf.text("two_dof").replace('stiffness="1.0e5"', 'stiffness="2.0e5"'))
    show, alone = Show(["two_dof", str(file)]), Show([str(file)])
    assert show.answer(show.settings)["other"] == {"k_F": pytest.approx(2e5)}
    moved = show.answer(replace(show.settings, values={"k_F": 1.1e5}))
    assert moved["other"] == {"k_F": pytest.approx(2.2e5)}
    expected = alone.answer(replace(show.settings, values={"k_F": 2.2e5}))["feet"][MODEL]["ratio"]
    assert moved["feet"][OTHER]["ratio"] == pytest.approx(expected, rel=1e-9)
    stopped = show.answer(replace(show.settings, values={"k_F": 8e5}))
    assert stopped["other"] == {"k_F": pytest.approx(1e6)}


def test_reload_takes_both_feet_and_included_files(tmp_path: Path) -> None:
    whole = mjcf.text("foot_arch")
    start, end = whole.index("  <custom>"), whole.index("</custom>") + len("</custom>")
    part, main = tmp_path / "parameters.xml", tmp_path / "arch.xml"
    part.write_text(f"<mujoco>{whole[start:end]}</mujoco>")
    main.write_text(f'{whole[:start]}<include file="parameters.xml"/>{whole[end:]}')
    show = Show([str(main), f"{main}@25"])
    assert show.files() == [main.resolve(), part.resolve()]
    assert files_of("two_dof") == set()
    before = {name: show.feet[name].values()["k_2"] for name in (MODEL, OTHER)}
    main.write_text(main.read_text().replace('stiffness="230"', 'stiffness="460"'))
    show.reload()
    for name, value in before.items():
        assert show.feet[name].values()["k_2"] == pytest.approx(2 * value)
    part.write_text(part.read_text().replace('"kg | 0.5 | 20 |', '"kg | 0.5 | 30 |'))
    show.reload()
    assert show.feet[OTHER].parameters["m_T"].upper == 30


def test_mass_that_nothing_carries_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "own.xml"
    text = mjcf.text("two_dof")
    line = next(line for line in text.splitlines() if 'text name="m_S"' in line)
    file.write_text(text.replace(line, ""))
    assert not Show(["two_dof", str(file)]).description()["can_add_mass"]
    settings = replace(Show(["two_dof"]).settings, added_mass=2.3)
    for models in ([str(file)], ["two_dof", str(file)]):
        with pytest.raises(FasError, match=r"own\.xml: --added-mass needs the parameter m_S or m_T"):
            Show(models, settings=settings)


def test_scene_is_read_while_it_changes() -> None:
    """A page opens while a reload draws the scene anew in another thread; it gets each message once or later."""
    hub, stop, met = Hub(), threading.Event(), []

    def change() -> None:
        number = 0
        while not stop.is_set():
            number += 1
            hub.put({"type": "set_property", "path": f"/{number % 500}", "property": "p", "value": number})
            hub.put({"type": "delete", "path": f"/{(number + 250) % 500}"})

    worker = threading.Thread(target=change)
    worker.start()
    try:
        for _ in range(300):
            assert all(isinstance(message, bytes) for message in hub.join(met.append))
            hub.leave(met.append)
    finally:
        stop.set()
        worker.join()


def test_a_model_has_what_it_includes_where_mujoco_finds_it(tmp_path: Path) -> None:
    """Beside the main file, then beside the one that includes; what is in a comment is no include."""
    (tmp_path / "parts").mkdir()
    texts = {
        "main.xml": '<mujoco><!-- <include file="no.xml"/> --><include file="parts/a.xml"/></mujoco>',
        "parts/a.xml": '<mujoco><include file="b.xml"/><include file="c.xml"/></mujoco>',
        "parts/b.xml": "<mujoco/>", "parts/c.xml": "<mujoco/>", "c.xml": "<mujoco/>", "no.xml": "<mujoco/>",
    }  # fmt: skip
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    expected = {"main.xml", "parts/a.xml", "parts/b.xml", "c.xml"}
    assert {file.relative_to(tmp_path).as_posix() for file in files_of(str(tmp_path / "main.xml"))} == expected


@pytest.mark.parametrize("name", ["two_dof", "foot_arch@25"])
def test_a_loaded_model_is_known_by_name_and_values(name: str) -> None:
    """So the page can fit it; what differs in more than its parameters is shown as it is."""
    foot = load_foot(name)
    assert name_and_values(foot) == (name, {})
    k = next(iter(foot.parameters))
    value = 1.1 * foot.values()[k]
    assert name_and_values(foot.with_values({k: value})) == (name, {k: pytest.approx(value)})
    assert name_and_values(foot.with_values({}, step=1e-5)) is None
    assert name_and_values(replace(foot, name="of my own")) is None


def test_show_of_a_loaded_model_is_that_of_its_name() -> None:
    foot = load_foot("two_dof").with_values({"k_T": 2e5})
    made = notebook._display(foot, None, None, None, 20.0, 0.0)
    assert made.models == ["two_dof"] and made.settings.values == {"k_T": pytest.approx(2e5)}
    other = foot.with_values({}, step=1e-5)
    assert notebook._display(other, None, None, None, 20.0, 0.0).models == [other]
