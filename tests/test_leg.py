"""The leg above the foot: three engines, an independent ODE, the added mass, the shipped peaks; edits: test_edits."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text

import mjcf
from fasbody.exceptions import ModelError
from fasbody.foot.model import load
from fasbody.leg.chain import Leg
from fasbody.leg.crosscheck import MATRICES, RESPONSES, crosscheck
from fasbody.leg.peaks import peaks
from fasbody.leg.statements import ADDED_KG, RANGES_HZ
from fasbody.presentation import PAGE

Edit = Callable[..., Path]


@pytest.fixture
def edit(tmp_path: Path) -> Edit:
    def edited(*changes: tuple[str, str]) -> Path:
        text = mjcf.text("leg")
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        file = tmp_path / "edited.xml"
        file.write_text(text)
        return file

    return edited


def read(model: str | Path) -> Leg:
    foot = load(model)
    return Leg.from_model(foot.model, foot.name)


def test_three_engines_agree_on_a_loaded_leg() -> None:
    result = crosscheck(added_mass_kg=4.5)
    assert max(result.matrices.values()) < MATRICES
    assert max(result.responses.values()) < RESPONSES
    assert result.agrees


def test_peaks_lie_where_they_were_measured_and_no_constant_changes() -> None:
    leg, f = read("leg"), np.arange(10, 50, 0.1)
    for added, (low, high) in zip(ADDED_KG, RANGES_HZ, strict=True):
        assert low < f[np.abs(leg.with_added(added).at("malleolus", f)).argmax()] < high
    assert all(leg.with_added(added).modes()[0][0] < 15 for added in ADDED_KG)
    assert abs(leg.stiffness[2] - 14.9e3) < 2 * 3.5e3
    assert abs(leg.damping[2] - 430) < 2 * 36


def test_the_figure_can_be_printed_as_wide_as_a_page() -> None:
    """At 180 mm nothing is smaller than 7 points or runs out of the paper, and each load is named on its curve."""
    figure = peaks(read("leg"), "leg").plot()
    assert figure.get_figwidth() <= PAGE
    figure.draw_without_rendering()
    texts = [text for text in figure.findobj(Text) if text.get_text() and text.get_visible()]
    assert min(text.get_fontsize() for text in texts) >= 7
    assert {"0 kg", "2.3 kg", "4.5 kg"} <= {text.get_text() for text in texts}
    for axis in figure.axes:
        box = axis.get_tightbbox()
        assert box.x0 >= 0 and box.x1 <= figure.bbox.x1 and box.y0 >= 0 and box.y1 <= figure.bbox.y1


def test_a_load_that_moves_with_the_shank_misses_the_ranges(edit: Edit) -> None:
    """The control: bolted to the shank the same load raises the peak too, but not to where it was measured."""
    file = edit(('name="tissue" stiffness="', 'name="tissue" stiffness="1000'))
    bolted, leg, f = read(file), read("leg"), np.arange(10, 50, 0.1)
    for added in ADDED_KG[1:]:
        soft, stiff = (f[np.abs(x.with_added(added).at("malleolus", f)).argmax()] for x in (leg, bolted))
        assert stiff < 30 < soft


def test_added_mass_goes_where_the_model_says(edit: Edit) -> None:
    foot = load("leg")
    heavy = foot.with_values({"added_mass": 2.3})
    np.testing.assert_allclose(
        Leg.from_model(heavy.model).matrices()[0], read("leg").with_added(2.3).matrices()[0], rtol=1e-12
    )
    again = Leg.from_model(heavy.model).with_added(4.5)  # in place of the 2.3 kg, as a parameter is
    np.testing.assert_allclose(again.mass, read("leg").with_added(4.5).mass, rtol=1e-12)
    bag = '<body name="bag"><inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/></body><site name="tuberosity"'
    moved = edit(('<site name="tuberosity"', bag), ("body load mass", "body bag mass"))
    assert read(moved).names[read(moved).carrier] == "talocrural"


def test_a_load_is_set_and_taken_away() -> None:
    """The row "0 kg" of a loaded file is an unloaded leg, as a fit with added_mass 0 has it."""
    loaded = Leg.from_model(load("leg").with_values({"added_mass": 4.5}).model)
    np.testing.assert_allclose(loaded.with_added(0).mass, read("leg").mass, rtol=1e-12)
    assert loaded.with_added(0).added == 0
    again, once = peaks(loaded, "loaded").records(), peaks(read("leg"), "leg").records()
    for one, other in zip(again, once, strict=True):
        assert one == pytest.approx(other)


def test_a_law_that_bends_is_compared_for_small_motion(tmp_path: Path) -> None:
    text = mjcf.text("leg")
    file = tmp_path / "leg.xml"
    for law in ("1 1.2e5 43 2.5 2 43 -1", "2 2e4 300 2 43 -1"):
        file.write_text(
            text.replace('name="fat_pad" stiffness="1.633e5" damping="47.6"', f'name="fat_pad" user="{law}"')
        )
        found = crosscheck(file)
        assert found.agrees and "'fat_pad' is not linear" in found.note
    assert not crosscheck().note


def test_what_is_no_number_is_told_once(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo's own warning and its log in the working folder do not come before the sentence."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "leg.xml"
    file.write_text(mjcf.text("leg").replace('stiffness="1.162e4"', 'stiffness="nan"'))
    with pytest.raises(ModelError, match="joint 'talocrural' has the stiffness nan"):
        load(file)
    assert capfd.readouterr() == ("", "") and [f.name for f in tmp_path.iterdir()] == ["leg.xml"]


def test_a_brace_between_sites_is_refused_by_its_name() -> None:
    """Its first site has the number that joint `base` has among the joints."""
    brace = '<actuator><general name="brace" site="base" refsite="malleolus" gear="0 1 0 0 0 0"/></actuator></mujoco>'
    foot = load(mjcf.text("leg").replace("</mujoco>", brace))
    with pytest.raises(ModelError, match="actuator 'brace' is not in the equations of a leg"):
        Leg.from_model(foot.model)
