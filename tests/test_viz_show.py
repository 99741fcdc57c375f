"""What a viewer shows: parameters of a fit, a recording, models with names of their own, edited and broken files."""

import json
from pathlib import Path

import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

import umsgpack

import mjcf
from fasbody.exceptions import FasError
from identification.fit import BUNDLED
from viz import foot as command
from viz.excitation import Excitation
from viz.show import MEASURED, MODEL, Show

RECORDED = BUNDLED / "recordings" / "20hz_0kg.csv"


def test_result_of_a_fit_moves_the_sliders(tmp_path: Path) -> None:
    entries = {"k_T_n_per_m": {"value": 2e5}, "c_12_per_m": {"value": 5.0}, "delay_s": {"value": 1e-4}}
    file = tmp_path / "result.json"
    file.write_text(json.dumps({"parameters": entries}))
    model = Show(["two_dof"]).feet["a"]
    assert command.parameters_of(file, model.parameters) == {"k_T": 2e5, "c_12": 5.0}
    file.write_text("{}")
    with pytest.raises(FasError, match="is not a result"):
        command.parameters_of(file, model.parameters)


def test_recording_drives_the_table_and_is_shown_beside(tmp_path: Path) -> None:
    show = Show(["two_dof"], Excitation.recorded(RECORDED, 0.5))
    answer = show.answer(show.settings)
    measured, model = answer["feet"][MEASURED], answer["feet"][MODEL]
    assert measured["base"] == model["base"]
    # the truth of the bundled foot differs from the nominal model, but both are feet at 20 Hz
    assert 0.5 < max(measured["malleolus"]) / max(model["malleolus"]) < 2
    assert max(measured["bodies"]) < 0.01


def test_foot_with_names_of_its_own_is_drawn_by_its_geoms(tmp_path: Path) -> None:
    text = mjcf.path("two_dof").read_text()
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


def test_another_kind_of_model_is_drawn_anew(tmp_path: Path) -> None:
    file = tmp_path / "mine.xml"
    file.write_text(mjcf.path("foot_arch").read_text())
    show, fresh = Show([str(file)]), Show(["two_dof"])
    file.write_text(mjcf.path("two_dof").read_text())
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
    good = mjcf.path("two_dof").read_text()
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
