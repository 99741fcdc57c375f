"""Heel strikes of people: the published numbers out of the raw volts, the laws against closed forms, bad files."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import in_process
import numpy as np
import pytest
from scipy.integrate import quad

from fasbody.exceptions import FasError, InputFileError, RecordingError, SettingError
from fasbody.foot import damper
from fasbody.foot.model import load
from fasbody.heel import shank
from fasbody.heel.laws import LAWS, TAU_S, THICKNESS_M, law
from fasbody.heel.pad import CARRIED, pad, write_model
from fasbody.heel.plate import Plate
from fasbody.heel.stiffness import slopes
from fasbody.heel.strike import contact_and_peak
from fasbody.heel.study import BUNDLED, HeelStudy, Person, is_heel_study, read_csv

#: Means of the normal strikes by a second program: the authors' scripts, translated line by line and run on their own
#: files. Compression at the peak [mm], work to it [J], speed of contact [m/s], time to the peak [ms], deepest [mm].
PORT = {
    "02": (9.340, 0.7023, 0.4406, 20.50, 12.057),
    "03": (7.273, 0.5722, 0.3881, 18.37, 9.537),
    "04": (8.004, 0.8436, 0.4943, 15.19, 9.898),
    "05": (8.879, 0.9056, 0.5976, 15.03, 11.946),
    "06": (9.677, 0.8578, 0.4665, 19.43, 13.013),
    "07": (8.999, 1.4556, 0.7482, 11.97, 12.594),
    "08": (12.602, 1.3286, 0.5546, 22.27, 15.514),
    "09": (10.532, 1.7544, 0.6633, 16.87, 13.431),
    "10": (12.313, 2.1135, 0.5443, 23.30, 14.295),
    "12": (10.565, 1.1871, 0.4987, 19.74, 15.095),
    "13": (10.047, 2.1122, 0.7166, 13.43, 13.420),
}
THETA = {
    "qlv": (12.0, 7.5, 0.3), "nonlinear": (1000.0, 2.9, 40.0, 2.5, 0.9), "strain_damper": (600.0, 8.0),
    "power": (60.0, 3.2),
    "exponential": (9.0, 430.0), "hunt_crossley": (45.0, 2.6, 1.0), "ogden": (50.0, 6.0),
}  # fmt: skip


@pytest.fixture(scope="module")
def study() -> HeelStudy:
    return HeelStudy.read()


def test_study_is_measured_and_says_whose_it_is(study: HeelStudy) -> None:
    assert study.origin == "measured" and {strike.origin for strike in study.strikes} == {"measured"}
    assert study.doi == "10.1371/journal.pone.0197428" and "MIT" in study.licence
    assert "MIT License" in (BUNDLED / "LICENSE").read_text()
    assert str(study) == "heel strikes of twelve walkers: 216 measured heel strikes of 11 people"
    assert len(study.problems) == 3 and all(problem.endswith(".") for problem in study.problems)
    assert any("subject 11: 19 trials have no markers" in problem for problem in study.problems)


def test_heels_are_stiffer_at_a_higher_rate_at_the_largest_load_only(study: HeelStudy) -> None:
    """Their own slow strikes beside it; docs/arch.md says what a law of the rate would ask for: 9 % at all loads."""
    means = {
        who: np.nanmean([np.log(slopes(strike)) for strike in strikes], axis=0)
        for who, strikes in study.groups().items()
    }
    ratios = [mean - means[person, "slow"] for (person, speed), mean in means.items() if speed == "normal"]
    assert len(ratios) == 11
    np.testing.assert_allclose(np.exp(np.mean(ratios, axis=0)), [1.006, 1.039, 1.087], atol=0.002)
    np.testing.assert_allclose(np.std(ratios, axis=0, ddof=1) / np.sqrt(11), [0.017, 0.015, 0.016], atol=0.002)


@pytest.mark.parametrize("subject", PORT)
def test_published_procedure_gives_what_the_authors_scripts_give(study: HeelStudy, subject: str) -> None:
    """Subject 07 within 4.5 %: its first standing files are broken, so the scripts take its upper marker as origin."""
    numbers = [
        (
            1e3 * p.compression_at_peak_m,
            p.work_to_peak_j,
            p.contact_speed_m_s,
            1e3 * p.time_to_peak_s,
            1e3 * p.deepest_m,
        )
        for p in (strike.published for strike in study.groups()[subject, "normal"])
    ]
    np.testing.assert_allclose(np.mean(numbers, axis=0), PORT[subject], rtol=0.045 if subject == "07" else 0.02)


def test_body_weight_of_everybody(study: HeelStudy) -> None:
    assert len(study.body_weight_n) == 12
    assert all(500 < weight < 1200 for weight in study.body_weight_n.values())


def test_plate_finds_where_a_force_acts() -> None:
    plate = Plate()
    x, y, F = 0.23, 0.25, 400.0
    a, b = (x - 0.2) / 0.12, (y - 0.3) / 0.2  # a lever on four supports, with no fourth unknown
    forces = F / 4 * np.array([[1 - a + b, 1 + a + b, 1 + a - b, 1 - a - b]])
    np.testing.assert_allclose(plate.application(forces), [[x, y]], rtol=1e-12)
    assert np.isnan(plate.application(np.zeros((1, 4)))).all()
    assert plate.gain(np.array([2.0, 2.0])) == pytest.approx(25.01 * 9.81 / 2)


def test_point_fixed_to_the_shank_comes_back() -> None:
    rng = np.random.default_rng(0)
    lower = rng.normal(0, 0.1, (20, 3))
    upper = lower + np.column_stack([rng.normal(0, 0.03, 20), rng.normal(0, 0.05, 20), np.full(20, 0.15)])
    R = shank.frames(lower, upper)
    np.testing.assert_allclose(R @ np.moveaxis(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    along = (upper - lower) / np.linalg.norm(upper - lower, axis=1, keepdims=True)
    np.testing.assert_allclose(R[:, :, 2], along, atol=1e-12)  # its z axis points at the upper marker
    assert np.abs(R[:, 0, 1]).max() < 1e-12  # and its y axis stays in the plane of progression
    point = np.array([0.01, -0.03, -0.2])
    path = shank.out_of(point, lower, R)
    np.testing.assert_allclose(shank.into(path, lower, R), np.broadcast_to(point, (20, 3)), atol=1e-12)


def test_contact_and_peak_of_a_drawn_force() -> None:
    force = np.concatenate([[0.2, -0.3, 0.1], np.linspace(5, 400, 30), np.linspace(390, 200, 20)])
    assert contact_and_peak(force) == (1, 32)  # the last sample before the central difference turns
    for bad, said in (
        (force * 0.1, "never passes 100 N"),
        (force + 1, "never below zero"),
        (force[:33], "never falls"),
    ):
        with pytest.raises(RecordingError, match=said):
            contact_and_peak(bad)


def test_steps_are_all_there() -> None:
    person = Person.bundled("05")
    steps = person.steps(*person.names()[0])

    before = slice(0, steps.contact)
    assert np.abs(steps.force_n[before].mean()) < 1.0 < np.abs(steps.raw_n[before].mean())
    assert steps.frames[0] < steps.frames[1] < steps.frames[2]
    np.testing.assert_allclose(steps.heel_point_m, steps.application_m.mean(axis=0))


def test_energy_that_comes_back_is_less_than_the_work(study: HeelStudy) -> None:
    for strike in study.strikes:
        assert strike.work_j > 0.9 * strike.published.work_to_peak_j > 0
        assert strike.returned_j >= 0.0


@pytest.mark.parametrize("key", LAWS)
def test_laws_start_at_nothing_and_grow(key: str) -> None:
    theta, x = np.array(THETA[key]), np.linspace(0.0, 0.012, 200)
    force = LAWS[key].static_force(x, theta)
    assert force[0] == pytest.approx(0.0, abs=1e-6) and (np.diff(force) > 0).all()


def test_ogden_is_the_slope_of_its_energy() -> None:
    """W = 2 mu / alpha^2 (2 s^(-alpha/2) + s^alpha - 3), with P = mu times area."""
    P, alpha = THETA["ogden"]
    energy = lambda x: 2 * P / alpha**2 * (2 * (1 - x) ** (-alpha / 2) + (1 - x) ** alpha - 3)  # noqa: E731
    e = 0.3
    slope = (energy(e + 1e-6) - energy(e - 1e-6)) / 2e-6
    force = LAWS["ogden"].static_force(np.array([e * THICKNESS_M]), np.array([P, alpha]))[0]
    assert force == pytest.approx(slope, rel=1e-6)


def test_quasi_linear_pad_is_its_hereditary_integral() -> None:
    """A ramp against the integral of relaxation times stress rate, by adaptive quadrature: Eq. (4.22) as printed."""
    A, B, c = THETA["qlv"]
    t = np.linspace(0.0, 0.03, 400)
    x = 0.3 * t
    force = LAWS["qlv"].force(t, x, np.full_like(t, 0.3), np.array([A, B, c]))
    rate = lambda s: A * B / THICKNESS_M * 0.3 * np.exp(B * 0.3 * s / THICKNESS_M)  # noqa: E731
    G = lambda s: damper.relaxation(s, c, *TAU_S)  # noqa: E731
    for k in (100, 399):
        wanted = quad(lambda s, end=t[k]: G(end - s) * rate(s), 0.0, t[k], epsabs=1e-10)[0]
        assert force[k] == pytest.approx(wanted, rel=1e-4)
    twice = LAWS["qlv"].force(np.tile(t, 2), np.tile(x, 2), np.full(800, 0.3), np.array([A, B, c]))
    np.testing.assert_allclose(twice[400:], force, rtol=1e-12)  # a second strike remembers nothing of the first


def test_hunt_crossley_adds_the_rate_and_never_pulls() -> None:
    theta, x = np.array(THETA["hunt_crossley"]), np.full(3, 0.006)
    force = LAWS["hunt_crossley"].force(np.arange(3.0), x, np.array([0.0, 0.5, -5.0]), theta)
    assert force[1] / force[0] == pytest.approx(1.5) and force[2] == 0.0


@pytest.mark.parametrize("key", CARRIED)
def test_a_model_takes_a_measured_law(tmp_path: Path, key: str) -> None:
    """The joint's force about rest, from the engine's own function, is the law's; its slope is the tangent."""
    theta, F_0 = np.array(THETA[key]), 66.0
    numbers = pad(LAWS[key], theta, F_0)
    user = np.zeros(damper.USER_SIZE)
    user[: len(numbers)] = numbers
    rest = numbers[-1] * THICKNESS_M
    for x, v in ((0.0, 0.0), (1e-3, 0.2), (-1e-3, -0.1)):
        wanted = LAWS[key].force(np.zeros(1), np.array([rest - x]), np.array([-v]), theta)[0] - F_0
        assert damper.algebraic_force(user, x, v, 0.0) == pytest.approx(wanted, rel=1e-9, abs=1e-8)
    foot = load(write_model(tmp_path / "foot.xml", LAWS[key], theta, F_0))
    assert "k_F" not in foot.values() and "k_T" in foot.values()
    np.testing.assert_allclose(foot.model.joint("fat_pad").user, user, rtol=1e-5)


def test_laws_that_no_joint_carries_are_refused() -> None:
    with pytest.raises(SettingError, match="cannot carry the exponential"):
        pad(LAWS["exponential"], np.array([9.0, 430.0]), 43.0)
    with pytest.raises(SettingError, match="did you mean 'power'"):
        law("powr")


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A study of subjects 02 and 05, without digests."""
    folder = tmp_path / "study"
    folder.mkdir()
    text = (BUNDLED / "study.toml").read_text()
    (folder / "study.toml").write_text(text.partition("[sha256]")[0])
    for name in ("subject_02.npz", "subject_05.npz"):
        shutil.copy(BUNDLED / name, folder)
    return folder


def change(file: Path, edit: Callable[[dict], None]) -> None:
    arrays = dict(np.load(file, allow_pickle=False))
    edit(arrays)
    np.savez(file, **arrays)


def swap_one(arrays: dict) -> None:
    name = next(name for name in arrays if name.endswith("_markers_mm") and not name.startswith("standing"))
    arrays[name] = arrays[name][:, [3, 4, 5, 0, 1, 2]]


@pytest.mark.parametrize(
    ("edit", "said", "left"),
    [
        (lambda a: a.pop("calibration_volts"), "there is no calibration", 20),
        (swap_one, "the markers are exchanged", 39),
        (lambda a: a.update(normal_07_force_volts=a["normal_07_force_volts"][:, :6]), "shape .1050, 6., and 8", 39),
        (lambda a: a.update({k: v[:0] for k, v in a.items() if k.startswith("slow") and k.endswith("markers_mm")}),
         "10 trials have no markers", 30),
    ],
)  # fmt: skip
def test_what_is_broken_is_a_sentence_and_the_rest_goes_on(copy: Path, edit: Callable, said: str, left: int) -> None:
    change(copy / "subject_02.npz", edit)
    study = HeelStudy.read(copy)
    assert len(study.strikes) == left and len(study.problems) == 1
    assert re.search(said, study.problems[0]) and ". " not in study.problems[0]


def test_broken_and_changed_files(copy: Path) -> None:
    (copy / "subject_02.npz").write_bytes(b"PK\x03\x04 torn")
    study = HeelStudy.read(copy)
    assert len(study.strikes) == 20 and "subject_02.npz: cannot be read" in study.problems[0]
    with (copy / "study.toml").open("a") as file:
        file.write(f'[sha256]\n"subject_05.npz" = "{"0" * 64}"\n')
    with pytest.raises(InputFileError, match="no heel strike can be used"):
        HeelStudy.read(copy)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is no study of heel strikes"),
        ('[study]\nkind = "heel strikes"\n', "origin is missing"),
        ('[study]\nkind = "heel strikes"\norigin = "measured"\n[plates]\n', "unknown table 'plates'"),
        (
            '[study]\nkind = "heel strikes"\norigin = "measured"\nweight = 3\n',
            "unknown key of .study. 'weight'",
        ),
        ("[study", "is not TOML"),
    ],
)
def test_descriptions_that_are_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "study.toml").write_text(text)
    with pytest.raises(FasError, match=said):
        HeelStudy.read(tmp_path)


def test_other_laboratories_bring_force_and_compression(tmp_path: Path) -> None:
    """A drop of a mass on a power pad, by its energy: work to the deepest point is the kinetic energy."""
    t = np.linspace(-0.01, 0.05, 3000)
    x, F = 0.009 * np.sin(np.pi * np.clip(t, 0, 0.03) / 0.03), np.zeros_like(t)
    F = np.where(t > 0, 300.0 * np.maximum(x / 0.005, 0) ** 2.0, -0.1)
    folder = tmp_path / "drops"
    folder.mkdir()
    np.savetxt(
        folder / "1.csv", np.column_stack([t, F, x]), delimiter=",", header="time_s,force_n,compression_m", comments=""
    )
    (folder / "study.toml").write_text('[study]\nkind = "heel strikes"\norigin = "measured"\n')
    (folder / "strikes.csv").write_text("file,subject,speed\n1.csv,7,drop\n2.csv,7,drop\n")
    study = HeelStudy.read(folder)
    assert is_heel_study(folder) and len(study.strikes) == 1 and "2.csv: no such file" in study.problems[0]
    strike = study.strikes[0]
    assert strike.work_j == pytest.approx(300.0 / 0.005**2 * 0.009**3 / 3, rel=1e-3)
    assert strike.returned_j == pytest.approx(strike.work_j, rel=0.01)  # an elastic pad gives all of it back
    (folder / "1.csv").write_text("time_s,force_n\n0,1\n")
    with pytest.raises(InputFileError, match="no column 'compression_m'"):
        read_csv(folder / "1.csv")
    (folder / "1.csv").write_text("time_s,force_n,compression_m\n" + "\n".join(f"{k},1,x" for k in range(20)))
    with pytest.raises(InputFileError, match="line 2: compression_m is 'x', not a number"):
        read_csv(folder / "1.csv")


def test_check_understands_the_study() -> None:
    done = in_process.command("fasbody.recording", "check", str(BUNDLED), "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["origin"] == "measured" and found["strikes"] == 216 and len(found["persons"]) == 22
    assert len(found["problems"]) == 3
