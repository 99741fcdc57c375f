"""What a laboratory knows: static forces, the load's share, loads in names; statements that disagree are refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from steady_cases import BENT, problem, recorded, session

from fasbody.exceptions import InputFileError, SettingError
from fasbody.recording.known import Known
from fasbody.recording.sources import gather

GRAVITY = 9.80665


def toml(folder: Path, **table: object) -> Known:
    return Known.from_toml(folder / "study.toml", table)


def test_known_of_a_study(tmp_path: Path) -> None:
    known = toml(tmp_path, mass_std=0.02, mount="tapped")
    assert known == Known(mass_std=0.02, excluded=frozenset({"mount"}))
    assert Known.of_all([known, Known(mass_std=0.1)]) == Known(mass_std=0.1)
    assert known.overruled_by(mass_std=0.0, exclude=("all",)).excluded >= {"load", "rocking", "share"}
    for table in ({"mount": True}, {"mass_std": -1}, {"weather": "fine"}, {"load_share": "most"}):
        with pytest.raises(InputFileError, match=r"study\.toml"):
            toml(tmp_path, **table)
    for wrong in ({"exclude": ("weather",)}, {"mass_std": 3.0}):
        with pytest.raises(SettingError):
            known.overruled_by(**wrong)  # type: ignore[arg-type]


def test_a_static_force_is_for_all_loads_or_for_each(tmp_path: Path) -> None:
    one = toml(tmp_path, static_force_n=120)
    assert one.static_force_n(0.0) == one.static_force_n(2.3) == 120.0 and one.load_share is None
    assert one.overruled_by(mass_std=0.0).static_force_n(0.0) == 120.0
    each = toml(tmp_path, static_force_n={"0": 43.0, "2.3": 62.5})
    assert (each.static_force_n(0.0), each.static_force_n(2.3), each.static_force_n(4.5)) == (43.0, 62.5, None)
    assert each.load_share == pytest.approx((62.5 - 43.0) / (2.3 * GRAVITY))
    three = {"0": 43.0, "2.3": 43.0 + 0.8 * 2.3 * GRAVITY + 1, "4.5": 43.0 + 0.8 * 4.5 * GRAVITY}
    slope = np.polyfit([0, 2.3, 4.5], list(three.values()), 1)[0]
    assert toml(tmp_path, static_force_n=three).load_share == pytest.approx(slope / GRAVITY)
    assert toml(tmp_path, static_force_n={"0": 43.0}).load_share is None


@pytest.mark.parametrize("value", [-3, 0, "much", True, 1e5, {"two": 43.0}, {"0": "much"}])
def test_a_static_force_that_cannot_be_is_refused(value: object, tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match=r"known\.static_force_n"):
        toml(tmp_path, static_force_n=value)


@pytest.mark.parametrize(("share", "valid"), [(0.29, False), (0.31, True), (1.19, True), (1.21, False)])
def test_a_share_of_the_load_is_possible(share: float, valid: bool, tmp_path: Path) -> None:
    """As stated, and as two forces tell."""
    forces = {"0": 43.0, "4.5": 43.0 + share * 4.5 * GRAVITY}
    for table, text in (({"load_share": share}, "load_share"), ({"static_force_n": forces}, "static_force_n")):
        if valid:
            assert toml(tmp_path, **table).load_share == pytest.approx(share)
        else:
            with pytest.raises(InputFileError, match=rf"known\.{text}"):
                toml(tmp_path, **table)


@pytest.mark.parametrize(("share", "agrees"), [(0.81, True), (0.83, False)])
def test_share_and_forces_that_disagree_are_refused(share: float, agrees: bool, tmp_path: Path) -> None:
    table = {"static_force_n": {"0": 43.0, "2.3": 43.0 + 0.8 * 2.3 * GRAVITY}, "load_share": share}
    if agrees:
        assert toml(tmp_path, **table).load_share == share
    else:
        with pytest.raises(InputFileError, match=r"says 0\.8 .*leave out one of them"):
            toml(tmp_path, **table)


def test_a_share_that_a_plate_has_weighed_is_a_prior_of_the_fit() -> None:
    """Of a leg that carries 0.8 of the load: the plate says so, and the recordings need not be asked."""
    data = session(BENT, (12.0, 25.0), (0.0, 4.5), share=0.8)
    plain, weighed = (problem([replace(r, known=known) for r in data]) for known in (Known(), Known(load_share=0.8)))

    def share(made):  # type: ignore[no-untyped-def]
        return next(item for item in made.variables.nuisances if item.kind == "load share")

    assert share(plain).mean == 1.0 == share(plain).upper and share(plain).std == 0.15
    assert (share(weighed).mean, share(weighed).std) == (0.8, 0.02)
    theta = weighed.variables.theta(weighed.variables.start(BENT))
    assert theta[2, 8] - theta[0, 8] == pytest.approx(0.8 * 4.5)
    q = [made.variables.start(BENT) for made in (plain, weighed)]
    off, near = (
        np.sum(made.evaluate(x[None]).residual[0, : made.size] ** 2)
        for made, x in zip((plain, weighed), q, strict=True)
    )
    assert near < 2 * weighed.size < 0.1 * off
    assert not [item for item in problem(data, exclude=["share"]).variables.nuisances if item.kind == "load share"]


def test_a_load_in_a_file_name_counts(tmp_path: Path) -> None:
    for name, added in (("S16_20Hz_2.3kg.csv", 2.3), ("S16_20Hz_4p5kg.csv", 4.5), ("plain.csv", 0.0)):
        recorded(BENT, 20.0, added=added).write(tmp_path / name)
        _, (read,), _ = gather([tmp_path / name], [72.57], None)
        assert read.condition.added_mass_kg == added
        _, (read,), _ = gather([tmp_path / name], [72.57], [added])
        assert read.condition.added_mass_kg == added
    with pytest.raises(SettingError, match=r"S16_20Hz_2\.3kg\.csv: its name says 2\.3 kg, and --added-mass says 4\.5"):
        gather([tmp_path / "S16_20Hz_2.3kg.csv"], [72.57], [4.5])
    _, (read,), _ = gather([tmp_path / "plain.csv"], [72.57], [4.5])
    assert read.condition.added_mass_kg == 4.5


def test_loads_of_file_names_are_listed(tmp_path: Path) -> None:
    names = ("a_20Hz_2.3kg.csv", "b_20Hz_0kg.csv", "plain.csv")
    for name in names:
        recorded(BENT, 20.0, added=0.0).write(tmp_path / name)
    _, (first, *_), _ = gather([tmp_path / name for name in names], [72.57], None)
    assert first.warnings[-1] == (
        "Loads on the knee are those of the files' names: 0 kg for b_20Hz_0kg.csv, 2.3 kg for a_20Hz_2.3kg.csv. "
        "None is named in plain.csv: 0 kg."
    )
    _, (first, *_), _ = gather([tmp_path / name for name in names[1:]], [72.57], None)
    assert not any("names" in text for text in first.warnings)  # no load at all
