"""Every example runs, draws its figure, and shows what it says."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import acquire_virtual_bench
import another_board
import black_box_order
import cell_modes
import edit_the_mjcf
import fit_a_sweep
import heel_strike
import hysteresis
import in_process
import mirror_solution
import numpy as np
import pytest
import shake_the_arch
import transmissibility_figure
import two_loads_decide

from fasbody.foot.two_dof import TwoDof
from fasbody.laboratory.foot import TRUTH
from fasbody.laboratory.study import Plan

ROOT = Path(__file__).parent.parent


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    return tmp_path / "figure.png"


def drawn(picture: Path) -> bool:
    return picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 10_000


def test_arch_follows_moves_more_and_falls_behind(picture: Path) -> None:
    ratios = shake_the_arch.main(picture)
    assert ratios[20.0] > ratios[8.0] > 1 > ratios[50.0]
    assert drawn(picture)


def test_mirror_is_the_same_at_the_malleolus_only(picture: Path) -> None:
    apart = list(mirror_solution.main(picture).values())
    assert apart[0] < 1e-12 and min(apart[1:]) > 0.5
    assert drawn(picture)


@pytest.mark.long
def test_second_load_decides(picture: Path) -> None:
    results = two_loads_decide.main(picture)
    assert results["one load"].verdict == "undecided" and results["two loads"].verdict == "decided"
    assert [branch.name for branch in results["one load"].branches] == ["stiff ankle", "stiff pad"]  # a tie: by name
    truth, mirror = (branch.parameters["k_T_n_per_m"] for branch in results["one load"].branches)
    for estimate in (truth, mirror):
        assert f"k_T = {estimate.interval()}" in results["one load"].sentence()
    assert truth.lower < two_loads_decide.TRUTH.k_T < truth.upper
    best = results["two loads"].parameters
    assert best["k_T_n_per_m"].value == pytest.approx(two_loads_decide.TRUTH.k_T, rel=0.01)
    assert best["k_F_n_per_m"].value == pytest.approx(two_loads_decide.TRUTH.k_F, rel=0.01)
    assert drawn(picture)


@pytest.mark.long
def test_sweep_gives_the_stiffness_back(picture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With half the samples, and the time of the fit goes with their number."""
    monkeypatch.setattr(fit_a_sweep, "SECONDS", 2.0)
    result = fit_a_sweep.main(picture)
    for name in ("k_T", "k_F", "c_11", "c_21"):
        key = next(key for key in result.parameters if key.startswith(f"{name}_"))
        assert result.parameters[key].value == pytest.approx(getattr(fit_a_sweep.TRUTH, name), rel=0.02)
    assert drawn(picture)


@pytest.mark.long
def test_shoe_lowers_the_resonance(picture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edit_the_mjcf, "FREQUENCIES_HZ", np.arange(8.0, 25.0))  # where the peaks are
    curves = edit_the_mjcf.main(picture)
    peak = {name: edit_the_mjcf.FREQUENCIES_HZ[curve.argmax()] for name, curve in curves.items()}
    assert peak["in a shoe"] < peak["as shipped"]
    assert drawn(picture)


@pytest.mark.long
def test_fits_tie_and_responses_do_not(picture: Path) -> None:
    fits, errors = black_box_order.main(picture)
    assert np.ptp(fits) < 0.4 and errors.max() > 20 * errors.min()
    assert drawn(picture)


@pytest.mark.long
def test_cell_modes_are_those_of_the_fine_mesh(picture: Path) -> None:
    analysis = cell_modes.main(picture)
    assert analysis.frequencies_hz[0] == pytest.approx(6405, rel=0.01)  # docs/cell.md, 254,000 unknowns: 6398
    assert drawn(picture)


def test_loops_hold_the_energy_that_the_dampers_take(picture: Path) -> None:
    """Linear theory for the amplitudes, pi c omega |z|^2 for the energy: within the dampers' nonlinearity."""
    lost = hysteresis.main(picture)
    masses = {"m_S": hysteresis.shank_mass(hysteresis.BODY_MASS), "m_F": hysteresis.foot_mass(hysteresis.BODY_MASS)}
    foot = TwoDof.from_values(TRUTH | masses)
    A, B, _ = foot.state_space()
    for f, (ankle, pad) in lost.items():
        w = 2 * np.pi * f
        z_1, z_2 = 8.95 * np.linalg.solve(1j * w * np.eye(4) - A, B)[:2]
        assert ankle == pytest.approx(np.pi * foot.c_11 * w * abs(z_1) ** 2, rel=0.02)
        assert pad == pytest.approx(np.pi * foot.c_21 * w * abs(z_2) ** 2, rel=0.02)
    assert drawn(picture)


@pytest.mark.long
@pytest.mark.usefixtures("patient")
def test_virtual_bench_gives_a_study(picture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command that it runs, in this process."""

    def run(words: list[str], check: bool) -> None:
        assert words[1] == "-m" and check
        assert in_process.command(words[2], "record", *words[3:]).returncode == 0

    monkeypatch.setattr(acquire_virtual_bench, "subprocess", SimpleNamespace(run=run))
    study = acquire_virtual_bench.main(picture, seconds=1.0)
    assert [recording.condition.frequency_hz for recording in study.recordings] == [15.0, 30.0]
    assert study.origin == "synthetic"
    assert drawn(picture)


@pytest.mark.usefixtures("patient")
def test_a_board_of_your_own_gives_a_recording(tmp_path: Path) -> None:
    made = another_board.main(tmp_path / "study", seconds=0.5)
    assert made.problems == () and made.quality.frames >= 32
    one = made.recording
    wave = np.exp(-2j * np.pi * 20 * one.time_s)
    ratio = np.mean(one.malleolus_m_s2 * wave) / np.mean(one.base_m_s2 * wave)
    assert ratio == pytest.approx(12 / 9 * np.exp(-0.3j), abs=1e-3)


@pytest.mark.long
def test_figure_of_loads(picture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With half the subjects, whose recordings are most of the work."""
    monkeypatch.setattr(transmissibility_figure, "Plan", lambda **words: Plan(**words | {"subjects": 3}))
    table = transmissibility_figure.main(figure=picture)
    assert len(table.conditions) == 3
    assert drawn(picture)


def test_gallery_shows_every_example() -> None:
    gallery = (ROOT / "docs" / "examples.md").read_text()
    for file in (ROOT / "examples").glob("*.py"):
        assert f"examples/{file.name}" in gallery, file.name


def test_measured_strike_goes_from_volts_to_work(picture: Path) -> None:
    strike = heel_strike.main(picture)
    assert strike.origin == "measured" and 0 < strike.peak < strike.standstill
    assert 0.2 < strike.published.work_to_peak_j < 3 and 5 < 1e3 * strike.published.compression_at_peak_m < 15
    assert drawn(picture)


def test_pictures_of_the_explanations_are_drawn(tmp_path: Path) -> None:
    drawn_by = runpy.run_path(str(ROOT / "docs" / "draw.py"))
    assert all((ROOT / "docs" / "figures" / f"{name}.svg").is_file() for name in drawn_by["PICTURES"])
    drawn_by["main"](tmp_path, "fit-model.svg", "mirror-feet.svg")
    assert {file.name for file in tmp_path.iterdir()} == {"fit-model.svg", "mirror-feet.svg"}
    assert all(file.read_text().count("<path") > 20 for file in tmp_path.iterdir())
