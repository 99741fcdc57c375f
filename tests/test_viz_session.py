"""A session's file: what was saved is there again, after a restart and on another machine, and nothing else is."""

import json
import zipfile
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

from page_client import dropped
from viewer import Watched, served

import mjcf
from fasbody.exceptions import FasError
from fasbody.recording.study import BUNDLED
from viz.archive import packed
from viz.bench import Bench
from viz.feet import Show
from viz.session import NAME

FILES = {name: BUNDLED / "recordings" / name for name in ("10hz_0kg.csv", "20hz_0kg.csv", "25hz_2.3kg.csv")}


JOB: dict[str, Any] = {"sources": {}, "model": "two_dof"}
FIT: dict[str, Any] = {"fit": {"branches": [], "sentence": "It is so."}}


def made(*models: str) -> Bench:
    bench = Bench(Show(list(models) or ["two_dof"]))
    bench.fits.prepare = lambda: None  # type: ignore[method-assign]
    return bench


def saved(bench: Bench, page: dict[str, Any] | None = None) -> bytes:
    assert bench.act({"type": "save_session", "said": page or {}}) == [{"type": "session_kept"}]
    return (bench.folder / ".session.zip").read_bytes()


def opened_with(content: bytes) -> tuple[Bench, list[dict[str, Any]]]:
    other = made()
    assert other.keep("kept.zip", content) == [] and other.dropped_session
    return other, other.act({"type": "open_session"})


def test_a_session_comes_back_as_it_was(bench: Bench) -> None:
    """Recordings with their corrections, the fit with what it is of, and what the page had; twice over."""
    for name, file in FILES.items():
        bench.keep(f"mine/{name}", file.read_bytes())
    bench.keep("mine/odd.csv", FILES["20hz_0kg.csv"].read_bytes().replace(b"time_s,base_m_s2", b"time_s,left"))
    dropped(bench, [f"mine/{name}" for name in (*FILES, "odd.csv")])
    dropped(bench)
    bench.correct({k: {"body_mass_kg": 70 + k} for k in range(3)})
    bench.correct({3: {"channels": {"base": {"column": "left", "unit": "m/s^2"}}}})
    bench.use(1)
    job = replace(bench._job([0, 3, 4], {"values": {"c_12": 40}}), settings={"starts": 2})
    for sentence in ("It is so.", "It is not so."):
        bench.history.add(job, {"fit": {"branches": [], "sentence": sentence}})
    bench.show_fit(1)
    before, page = bench.document(), {"ticked": [0, 3], "state": {"values": {"k_T": 2e5}}}
    content = saved(bench, page)
    for _ in range(2):
        other, answers = opened_with(content)
        try:
            kinds = {answer["type"]: answer for answer in answers}
            after = kinds["data"]
            assert [row | {"id": 0} for row in after["rows"]] == [row | {"id": 0} for row in before["rows"]]
            ids = kinds["session"]["ids"]
            assert kinds["session"]["page"] == page and after["shown"] == before["shown"]
            assert kinds["fitted"]["fit"]["sentence"] == "It is so." and after["stale"] == ""
            again, _ = other.history.of_model("two_dof") or (None, None)
            assert (
                len(other.history.answers) == 2
                and again
                and [again.sources[ids[k]].read().base_m_s2.std() for k in (0, 3, 4)]
                == [s.read().base_m_s2.std() for s in job.sources.values()]
            )
            assert (again.values, again.settings, again.model) == (job.values, job.settings, "two_dof")
            other.correct({ids[0]: {"body_mass_kg": 50}})
            assert "10hz_0kg.csv was read in another way" in other.document()["stale"]
            other.correct({ids[0]: {"body_mass_kg": 70}})
            content = saved(other, {**page, "ticked": [ids[k] for k in page["ticked"]]})
            page = {**page, "ticked": [ids[k] for k in page["ticked"]]}
            before = other.document()
            assert ids == {k: k for k in range(len(ids))}
        finally:
            other.close()


@pytest.mark.long
def test_a_model_of_ones_own_goes_along_with_what_it_includes(tmp_path: Path) -> None:
    text = mjcf.text("two_dof").replace('stiffness="1.0e5"', 'stiffness="0.7e5"')
    start, end = text.index("<worldbody>"), text.index("</worldbody>") + len("</worldbody>")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "body.xml").write_text(f"<mujoco>{text[start:end]}</mujoco>")
    own = tmp_path / "own.xml"
    own.write_text(f'{text[:start]}<include file="parts/body.xml"/>{text[end:]}')
    bench = made(str(own))
    try:
        dropped(bench)
        bench.history.add(bench._job([0], {}), {"fit": {"branches": []}})
        content, stiffness = saved(bench), bench.show.feet["a"].values()["k_F"]
        bench.check(own.read_text() + "<!-- more -->")
        with pytest.raises(FasError, match="is not saved yet"):
            bench.save_session({})
    finally:
        bench.close()
    own.unlink()
    other, answers = opened_with(content)
    try:
        assert other.show.feet["a"].values()["k_F"] == stiffness == 0.7e5
        assert Path(other.model.name).is_relative_to(other.folder) and other.document()["stale"] == ""
        assert answers[-1]["note"].startswith("own.xml is this session's copy")
    finally:
        other.close()


def changed(content: bytes, change: Any) -> bytes:
    with zipfile.ZipFile(BytesIO(content)) as archive:
        inside = {name: archive.read(name) for name in archive.namelist()}
    document = json.loads(inside[NAME])
    change(document)
    return packed(inside | {NAME: json.dumps(document).encode()})


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda d: d.update(fasbody_session=3), "is a session of form 3, not 2; update fasbody"),
        (lambda d: d.pop("sources"), "is not a whole session"),
        (lambda d: d["sources"]["0"].update(folder="../.."), "is not a whole session"),
        (lambda d: d["sources"]["0"].update(folder="/etc"), "is not a whole session"),
        (lambda d: d["sources"]["0"].update(file="../../x.csv"), "is not a whole session"),
        (lambda d: d["sources"].update(x={}), "is not a whole session"),
        (lambda d: d.update(fits=[{"job": 1}]), "is not a whole session"),
        (lambda d: d.update(fits=[{"job": JOB, "document": {"fit": {}}}]), "is not a whole session"),
        (lambda d: d.update(fits=[{"job": JOB | {"model": "/etc/passwd"}, "document": FIT}]), "is not a whole session"),
    ],
)
def test_a_session_that_is_none_is_refused(bench: Bench, change: Any, sentence: str) -> None:
    bench.keep("20hz.csv", FILES["20hz_0kg.csv"].read_bytes())
    dropped(bench, ["20hz.csv"])
    with pytest.raises(FasError, match=sentence):
        bench.keep("kept.zip", changed(saved(bench), change))
    with pytest.raises(FasError, match="this is not a saved session"):
        bench.open_session()
    assert list(bench.recordings.sources) == [0]


def test_a_session_of_one_fit_opens(bench: Bench) -> None:
    """As this page saved it before it kept all fits."""

    def before(document: dict[str, Any]) -> None:
        del document["fits"], document["chosen"]
        document.update(fasbody_session=1, fit={"job": JOB, "document": FIT})

    bench.keep("20hz.csv", FILES["20hz_0kg.csv"].read_bytes())
    dropped(bench, ["20hz.csv"])
    other, answers = opened_with(changed(saved(bench), before))
    try:
        assert [a["fit"]["sentence"] for a in answers if a["type"] == "fitted"] == ["It is so."]
        assert [a["fits"][0]["at"] for a in answers if a["type"] == "history"] == [0.0]
    finally:
        other.close()


def test_no_file_of_a_session_lands_elsewhere(bench: Bench) -> None:
    dropped(bench)
    with zipfile.ZipFile(BytesIO(saved(bench))) as archive:
        kept = archive.read(NAME)
    evil = {NAME: kept, "files/../../evil.csv": b"x", "files//etc/evil.csv": b"x", "files/.evil": b"x"}
    other, _ = opened_with(packed(evil))
    try:
        assert len(other.recordings.sources) == 12 and not list(other.folder.parent.glob("evil*"))
        assert not list(other.folder.rglob("*evil*"))
    finally:
        other.close()


@pytest.mark.long
def test_the_page_saves_a_session_and_another_one_takes_it_up(opened: Any, tmp_path: Path) -> None:
    with served("--model", "two_dof", folder=tmp_path) as url:
        page = Watched(opened, url)
        page.open_example()
        assert page("task") == "data"
        page("byId('recordings').querySelectorAll('[type=checkbox]')[2].click()")
        page("bench.free.c_13 = false, setValues({ k_T: 2e5 }), ask()")
        page.until("!busy && !wanted")
        page.page.locator("#tasks").get_by_role("button", name="Take away").click()
        with page.page.expect_download() as saved_file:
            page.page.locator("#save_session").click()
        content = Path(saved_file.value.path()).read_bytes()
    with served("--model", "foot_arch", folder=tmp_path) as url:
        page = Watched(opened, url)
        page("openTask('take')")
        page.page.locator("#session_file").set_input_files(
            {"name": "session.zip", "mimeType": "application/zip", "buffer": content}
        )
        page.until("model.name === 'two_dof' && bench.rows.length === 12 && motion && !busy && !wanted")
        page.until("byId('data_state').textContent === '' && ticked().length === 11")
        assert page("[state.values.k_T, bench.free, task]") == [2e5, {"c_13": False}, "data"]
        assert page("motion.feet.measured !== undefined") and page.complaints == []
