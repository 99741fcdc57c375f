"""The workbench behind the page: files in, what the checks say, a fit that a script repeats, the model's text."""

import asyncio
import json
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")

import tornado.httpclient
from page_client import WAIT, at, documents, dropped, leave, status, upgrade

import mjcf
from fasbody.exceptions import FasError
from fasbody.recording.formats import READ
from fasbody.recording.study import BUNDLED, read_file
from identification.criteria import fit_percent
from viz.bench import Bench
from viz.display import page_json
from viz.feet import Show
from viz.fitted import fitted
from viz.job import Job
from viz.server import Server
from viz.source import Source

ONE = BUNDLED / "recordings" / "20hz_0kg.csv"


class Told:
    """What a bench says later, and a wait for it."""

    def __init__(self) -> None:
        self.heard: list[dict[str, Any]] = []
        self._more = self.deaf = threading.Condition()

    def __call__(self, document: dict[str, Any]) -> None:
        with self._more:
            self.heard.append(document)
            self._more.notify_all()

    def wait(self, *kinds: str) -> dict[str, Any]:
        """The first document of one of these kinds."""
        with self._more:
            assert self._more.wait_for(lambda: any(d["type"] in kinds for d in self.heard), WAIT)
            return next(d for d in self.heard if d["type"] in kinds)


def test_dropped_file_shakes_the_foot(bench: Bench) -> None:
    bench.keep("mine/20hz.csv", ONE.read_bytes())
    listed, shown = dropped(bench, ["mine/20hz.csv"])
    assert [row["file"] for row in listed["rows"]] == ["mine/20hz.csv"]
    assert listed["rows"][0]["frequency_hz"] == pytest.approx(20, abs=1e-3)
    assert listed["rows"][0]["body_mass_kg"] is None
    assert shown["recorded"] and shown["adopt"]
    own = bench.show.feet["a"].values()["m_S"]

    # masses from the form reach the model, the load its slider
    _, shown = bench.correct({0: {"body_mass_kg": "60", "added_mass_kg": "2.3"}})
    masses = {p["name"]: p["nominal"] for p in shown["parameters"]}
    assert masses["m_S"] == pytest.approx(0.0465 * 60)
    assert masses["m_S"] != pytest.approx(own)
    assert shown["settings"]["added_mass"] == 2.3
    assert not bench.sine()[1]["recorded"]


def test_the_solver_loads_while_recordings_are_read(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []
    read = Source.read
    monkeypatch.setattr(bench.fits, "prepare", lambda: order.append("solver"))
    monkeypatch.setattr(Source, "read", lambda source: order.append("read") or read(source))
    bench.keep("20hz.csv", ONE.read_bytes())
    dropped(bench, ["20hz.csv"])
    assert order == ["solver", "read"]


def test_study_is_read_as_a_whole(bench: Bench) -> None:
    names = []
    for file in (*BUNDLED.glob("*.*"), *sorted(BUNDLED.glob("recordings/*.csv"))[:4]):
        names.append(f"study/{file.relative_to(BUNDLED)}")
        bench.keep(names[-1], file.read_bytes())
    *first, listed = dropped(bench, names)
    assert [document["type"] for document in first] == ["data", "model"]  # the foot moves while the rest is read
    assert first[0]["unread"] == len(first[0]["rows"]) * 11 == 11 and listed["unread"] == 0
    rows = listed["rows"]
    assert len(rows) == 12
    good = [row for row in rows if not row["unread"]]
    assert len(good) == 4
    assert {row["body_mass_kg"] for row in good} == {72.57}
    assert all("no such file" in row["unread"] for row in rows if row not in good)


def test_columns_and_units_are_corrected_in_the_form(bench: Bench) -> None:
    """A table that says nothing of itself: a sentence, the columns, and the same recording once they are named."""
    lines = ONE.read_text().splitlines()[1:]
    rows = [line.split(",") for line in lines]
    text = "\n".join(["t,left,right", *(f"{float(t) * 1e3:.3f},{-float(a) / 9.80665:.9f},{b}" for t, a, b, *_ in rows)])
    bench.keep("odd.csv", text.encode())
    (listed,) = dropped(bench, ["odd.csv"])
    assert "names no channel" in listed["rows"][0]["unread"]
    (form,) = bench.columns(0)
    assert [column["name"] for column in form["columns"]] == ["t", "left", "right"]
    said = {"channels": {
        "time": {"column": "t", "unit": "ms"}, "base": {"column": "left", "unit": "g", "sign": "-1"},
        "malleolus": {"column": "right", "unit": "m/s^2"},
    }}  # fmt: skip
    listed, shown = bench.correct({0: said})
    assert not listed["rows"][0]["unread"] and shown["recorded"]
    found = bench.recordings.sources[0].read()
    assert found.base_m_s2 == pytest.approx(read_file(ONE).base_m_s2, abs=1e-6)
    for wrong, sentence in (
        ({"channels": {"base": {"sign": "x"}}}, "sign is 'x'; give a number"),
        ({"body_mass_kg": 7000}, "the body mass is 7000 kg; it must lie between"),
    ):
        with pytest.raises(FasError, match=sentence):
            bench.correct({0: wrong})
    assert bench.document()["rows"][0] == listed["rows"][0]  # what was refused changes nothing


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("../evil.csv", "is no name for a file"), ("/etc/passwd.csv", "is no name for a file"), ("", "is no name"),
        ("a/b/c/d/e.csv", "is no name"), (".hidden.csv", "is no name"), ("x.exe", "no format has the ending '.exe'"),
        ("a\0b.csv", "is no name"), ("x.html", "no format has the ending"),
        ("a\nb.csv", "is no name"), ("a\\b.csv", "is no name"), ("\udcff.csv", "is no name"),
    ],
)  # fmt: skip
def test_names_that_cannot_be_are_refused(bench: Bench, name: str, sentence: str) -> None:
    with pytest.raises(FasError, match=sentence):
        bench.keep(name, b"x")
    assert not list(bench.folder.rglob("*.*"))
    with pytest.raises(FasError, match="none of these files is a recording"):
        dropped(bench, [str(ONE), f"../{ONE}", name])


def test_hostile_files_of_every_format_are_a_sentence_each(bench: Bench) -> None:
    names = [f"broken{end}" for end in (".csv", *READ) if end != ".zip"]
    for number, name in enumerate(names):
        bench.keep(name, bytes((7 * k * k + number) % 256 for k in range(3000)))
    with pytest.raises(FasError, match=r"broken\.zip: is no zip file"):  # an archive is unpacked as it comes
        bench.keep("broken.zip", bytes(3000))
    (listed,) = dropped(bench, names)
    assert len(listed["rows"]) == len(names)
    assert all(row["unread"] and str(bench.folder) not in row["unread"] for row in listed["rows"])
    assert bench.current == -1


def test_rows_keep_their_ids_and_what_was_said_of_them(bench: Bench) -> None:
    """A file that is dropped again is the same recording; one that is removed leaves the others as they are."""
    names = ["Proband 3 – 20 Hz [1].csv", "a#b&c.csv", "c.csv"]
    assert [bench.keep(name, ONE.read_bytes()) for name in names] == [[name] for name in names]
    assert bench.keep('d<1>?".csv', ONE.read_bytes()) == ["d_1___.csv"]
    *_, listed = dropped(bench, names)
    assert [(row["id"], row["file"]) for row in listed["rows"]] == list(enumerate(names))
    bench.correct({1: {"body_mass_kg": 60}})
    bench.keep(names[1], ONE.read_bytes())
    listed, _ = dropped(bench, [names[1]])
    assert [row["id"] for row in listed["rows"]] == [0, 1, 2]
    assert listed["rows"][1]["body_mass_kg"] == 60
    listed, model = bench.remove([1])
    assert ([row["id"] for row in listed["rows"]], listed["shown"], model["recorded"]) == ([0, 2], -1, False)
    assert not (bench.folder / names[1]).exists()
    with pytest.raises(FasError, match="no longer here"):
        bench.use(1)
    (listed,) = bench.remove([0, 2])
    assert listed["rows"] == []
    listed, _ = dropped(bench, ["d_1___.csv"])
    assert listed["rows"][0]["id"] == 3  # an id is given once


def test_dead_channel_is_a_sentence_and_no_motion(bench: Bench) -> None:
    rows = [line.split(",") for line in ONE.read_text().splitlines()]
    still = "\n".join([",".join(rows[0]), *(f"{t},{a},0" for t, a, _ in rows[1:])])
    bench.keep("still.csv", still.encode())
    (listed,) = dropped(bench, ["still.csv"])
    assert listed["rows"][0]["problem"] and listed["shown"] == -1
    with pytest.raises(FasError, match="channel malleolus does not move"):
        bench.use(0)
    mm = "\n".join([",".join(rows[0]), *(f"{t},{float(a) * 1e3},{float(b) * 1e3}" for t, a, b, *_ in rows[1:])])
    bench.keep("mm.csv", mm.encode())
    dropped(bench, ["mm.csv"])
    with pytest.raises(FasError, match=r"^mm\.csv: the base amplitude is 8\.95e\+03.*; check its unit\.$"):
        bench.show.answer(bench.show.settings)
    told: list[dict[str, Any]] = []
    bench.send, bench.fits.job = told.append, bench._job([1], {})
    bench.fits.receive({"type": "problem", "of": "fit", "text": "every start was unstable."})
    assert told[0]["text"].startswith("every start was unstable. mm.csv: the base amplitude is 8.95e+03")
    assert told[0]["text"].endswith("check its unit.")
    text = page_json({"percent": float("nan"), "rows": [1.5, float("inf")]})
    assert json.loads(text, parse_constant=lambda word: pytest.fail(word)) == {"percent": None, "rows": [1.5, None]}


def test_fit_belongs_to_its_model_and_recordings(bench: Bench) -> None:
    """It goes with another model and comes back with its own; it is marked where what it is of is another by now."""
    bench.keep("20hz.csv", ONE.read_bytes())
    dropped(bench, ["20hz.csv"])
    question = bench._job([0], {})
    assert (question.model, question.script.count("20hz.csv")) == ("two_dof", 1)
    document = bench.history.add(question, {"fit": {"branches": []}})
    bench.show.fit = document["fit"]
    assert document in bench.documents() and bench.document()["stale"] == ""
    bench.correct({0: {"body_mass_kg": 60}})
    assert "20hz.csv was read in another way" in bench.document()["stale"]
    bench.remove([0])
    assert "20hz.csv was removed" in bench.document()["stale"]
    assert "20hz.csv was removed" in bench.show.description()["fit"]["stale"]  # and in a page that is taken away
    assert (bench.folder / "20hz.csv").is_file()  # the report of the fit may still read it
    bench.choose("foot_arch")
    assert document not in bench.documents() and bench.show.fit == {}
    assert bench.show.description()["name"] == "foot_arch"
    assert document in bench.choose("two_dof") and bench.show.fit == document["fit"]


def test_fit_is_out_of_date_when_an_included_file_changes(tmp_path: Path) -> None:
    text = mjcf.text("two_dof")
    start, end = text.index("<worldbody>"), text.index("</worldbody>") + len("</worldbody>")
    (tmp_path / "body.xml").write_text(f"<mujoco>{text[start:end]}</mujoco>")
    own = tmp_path / "own.xml"
    own.write_text(f'{text[:start]}<include file="body.xml"/>{text[end:]}')
    bench = Bench(Show([str(own)]))
    bench.fits.prepare = lambda: None  # type: ignore[method-assign]
    try:
        bench.keep("20hz.csv", ONE.read_bytes())
        dropped(bench, ["20hz.csv"])
        bench.history.add(bench._job([0], {}), {"fit": {"branches": []}})
        assert bench.document()["stale"] == ""
        (tmp_path / "body.xml").write_text(f"<mujoco>{text[start:end]}<!-- another --></mujoco>")
        assert "the model's file was changed" in bench.document()["stale"]
    finally:
        bench.close()


def test_progress_has_steps_share_and_time_left(bench: Bench) -> None:
    told: list[dict[str, Any]] = []
    bench.send = told.append
    bench.fits._state |= {"running": True, "what": "reading the recordings"}
    for done, total in ((0, 1000), (300, 1000), (300, 2000), (1150, 2000)):
        bench.fits.receive({"type": "progress", "what": "searching", "done": done, "total": total})
    assert [(d["done"], d["total"]) for d in told[1:3]] == [(300, 1000), (300, 2000)]
    assert [d["share"] for d in told] == pytest.approx([0.0, 0.3, 0.3, 0.65])
    assert all(d["left_s"] is None or d["left_s"] >= 0 for d in told)
    bench.fits.receive({"type": "problem", "of": "fit", "text": "no end"})
    assert {"share": 0.0, "left_s": None, "total": 0}.items() <= bench.fits.progress().items()


def test_report_that_fails_leaves_a_running_fit(bench: Bench) -> None:
    told: list[dict[str, Any]] = []
    bench.send = told.append
    bench.fits._state |= {"running": True, "what": "exploring starts"}
    bench.fits.reporting = True
    bench.fits.receive({"type": "problem", "of": "report", "text": "no room"})
    assert bench.fits.progress()["running"] and not bench.fits.reporting
    assert told[0] == {"type": "complaint", "of": "report", "text": "no room"}
    bench.fits.reporting = True
    bench.fits.receive({"type": "problem", "of": "fit", "text": "no end"})
    assert not bench.fits.progress()["running"] and bench.fits.reporting  # which the process does next


def test_tables_that_cannot_be_read_are_told_what_the_page_can_do(bench: Bench) -> None:
    """Each is refused by the reader itself, and nothing of study.toml or of a command is left in its sentence."""
    numbers = [line.split(",") for line in ONE.read_text().splitlines()[1:]]
    rows = "\n".join(",".join(row[:3]) for row in numbers)
    heads = {
        "none": "", "strange": "a,b,c\n", "timeless": "t,base_m_s2,malleolus_m_s2\n",
        "bare": "time,base_m_s2,malleolus_m_s2\n", "half": "time_s,base_m_s2,c\n",
        "volts": "time_s,base [V],malleolus_m_s2\n", "unitless": "time_s,base,malleolus_m_s2\n",
    }  # fmt: skip
    for name, head in heads.items():
        bench.keep(f"{name}.csv", (head + rows).encode())
    turned = "\n".join(f"{t},{a},{-float(b)}" for t, a, b, *_ in numbers)
    bench.keep("turned.csv", f"time_s,base_m_s2,malleolus_m_s2\n{turned}".encode())
    (listed, *_) = dropped(bench, [f"{name}.csv" for name in (*heads, "turned")])
    for row in listed["rows"]:
        sentences = [row["unread"], row["problem"], *row["warnings"]]
        assert any(sentences), row["file"]
        assert not [s for s in sentences if "study.toml" in s or "--" in s or "fasbody " in s], sentences
    assert "“…”" in listed["rows"][1]["unread"]


def test_a_name_that_is_a_device_is_kept_beside_it(bench: Bench) -> None:
    for name, kept in (("CON.csv", "_CON.csv"), ("a/lpt1.CSV", "a/_lpt1.CSV"), ("console.csv", "console.csv")):
        assert bench.keep(name, ONE.read_bytes()) == [kept]


def test_progress_says_how_long_a_fit_has_run(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """A page that is loaded again counts on from there."""
    asked: list[Any] = []
    monkeypatch.setattr(bench.fits, "_ask", asked.append)
    bench.keep("20hz.csv", ONE.read_bytes())
    dropped(bench, ["20hz.csv"])
    (progress,) = bench.fit([0], {"starts": 1})
    bench.fits._began -= 100
    assert progress["seconds"] < 50 and 100 <= bench.documents()[2]["seconds"] < 150
    assert Job.of(json.loads(json.dumps(asked[0]["job"]))) == bench.fits.job  # as the process reads it
    with pytest.raises(FasError, match="a fit is already running"):
        bench.fit([0], {})
    bench.fits.receive({"type": "problem", "of": "fit", "text": "no end"})
    assert bench.fits.progress()["seconds"] == 0


def test_fit_calls_parameters_as_its_table_does(bench: Bench) -> None:
    row = {"value": 0.0, "identifiability": ""}
    fit = fitted({"parameters": {"c_13_per_m": row}}, bench.show.feet["a"].parameters)
    assert fit["branches"][0]["rows"][0]["name"] == "c_13"


def test_session_holds_only_so_much(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("viz.uploads.LARGEST", 10)
    with pytest.raises(FasError, match="split it into recordings"):
        bench.keep("a.csv", b"x" * 11)
    monkeypatch.setattr("viz.uploads.MOST", 15)
    bench.keep("a.csv", b"x" * 9)
    with pytest.raises(FasError, match="as many files as it may"):
        bench.keep("b.csv", b"x" * 9)


@pytest.mark.long
def test_fit_is_what_a_script_finds() -> None:
    """The worker's numbers are those of the lines of Python beside them, run in a process of their own."""
    told = Told()
    bench = Bench(Show(["two_dof"]), told)
    try:
        bench.keep("20hz.csv", ONE.read_bytes())
        dropped(bench, ["20hz.csv"])
        bench.correct({0: {"body_mass_kg": 72.57}})
        said = {
            "starts": 2,
            "free": ["k_T", "k_F", "c_11", "c_21"],
            "bounds": {"k_F": [5e3, 5e5]},
            "values": {"c_12": 40},
        }
        with told.deaf:  # nothing is heard of the fit, so it cannot have ended in between
            bench.fit([0], said)
            with pytest.raises(FasError, match="a fit is already running"):
                bench.fit([0], {})
        answer = told.wait("fitted", "complaint")
        assert answer["type"] == "fitted", answer
        fit = answer["fit"]
        assert [branch["name"] for branch in fit["branches"]] == ["stiff pad", "stiff ankle"] or len(
            fit["branches"]
        ) == 2
        assert fit["reason"] and fit["sentence"]
        # what was held stays where it was held, in both branches
        assert [branch["values"]["c_12"] for branch in fit["branches"]] == [40, 40]
        assert [set(branch["values"]) for branch in fit["branches"]] == 2 * [{*said["free"], "c_12"}]
        assert any(d["type"] == "progress" and d["running"] for d in told.heard)
        # both branches have their trace and their harmonics
        (trace,) = answer["traces"]
        assert {name: model["fit_percent"] for name, model in trace["models"].items()} == {
            branch["name"]: pytest.approx(branch["fit_percent"]) for branch in fit["branches"]
        }
        measured = np.array(trace["measured"])
        for branch in fit["branches"]:
            model = trace["models"][branch["name"]]
            assert fit_percent(measured, np.array(model["model"])) == pytest.approx(model["fit_percent"], abs=0.3)
            rows = [r for r in answer["chi_square"] if r["branch"] == branch["name"]]
            chi = [r["chi_square"] or r["chi_square_if_model_true"] for r in rows]
            assert len(chi) >= 2 and min(chi) >= 0
        code = answer["script"].replace('result.write("results")', "print(result.best['k_T'].interval())")
        code += "import json; print(json.dumps(result.values()))\n"
        run = subprocess.run(
            [sys.executable, "-c", code], cwd=bench.folder, capture_output=True, text=True, timeout=WAIT, check=True
        )
        values = json.loads(run.stdout.splitlines()[-1])
        best = fit["branches"][0]
        for row in best["rows"]:
            if row["key"] in values:
                assert row["value"] == pytest.approx(values[row["key"]], rel=1e-9)
        assert best["rows"][0]["interval"] in run.stdout
        assert fit["sentence"] in run.stdout

        # stopped: the process is gone, another one waits, and the page may begin anew
        told.heard.clear()
        bench.fit([0], {"starts": 64})
        first = bench.fits._worker
        (stopped,) = bench.stop()
        assert (stopped["running"], stopped["what"]) == (False, "stopped")
        assert first is not None and not first.alive
        assert bench.fits._worker is not first
        assert not [d for d in told.heard if d["type"] == "complaint"]
    finally:
        bench.close()


@pytest.mark.long
def test_rivals_are_what_a_script_compares(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The worker's table is that of `compare_rivals`, whose lines stand beside it."""
    from identification.rivals import compare
    from viz import worker

    for file in ("10hz_0kg.csv", "20hz_0kg.csv", "40hz_0kg.csv"):
        bench.keep(file, (BUNDLED / "recordings" / file).read_bytes())
    dropped(bench, ["10hz_0kg.csv", "20hz_0kg.csv", "40hz_0kg.csv"])
    for number in range(3):
        bench.correct({number: {"body_mass_kg": 72.57}})
    asked: list[Any] = []
    monkeypatch.setattr(bench, "_begin", asked.append)  # a job
    bench.rivals([0, 1, 2], {})
    monkeypatch.setattr(compare, "LADDER", tuple(rung for rung in compare.LADDER if rung.name in ("linear", "model")))
    told: list[Any] = []
    worker._rivals(asked[0], told.append)
    (progress, *_), found = told, told[-1]
    assert progress["type"] == "progress" and found["rows"][0][0] == "the two-mass foot"
    assert found["adequate"] == [True, False] and found["notes"][0].startswith("Preferred model: the two-mass foot")
    bench.fits.job = asked[0]
    bench.fits.receive(found)
    scope: dict[str, Any] = {}
    monkeypatch.chdir(bench.folder)
    monkeypatch.setattr("builtins.print", lambda result: None)
    assert bench._rivals is not None
    exec(bench._rivals[1]["script"].replace('result.write("results")', ""), scope)
    assert [list(row) for row in scope["result"].sheet().rows] == [list(row) for row in found["rows"]]
    bench.choose("foot_arch")
    with pytest.raises(FasError, match="exist for the two-mass foot only"):
        bench.rivals([0, 1, 2], {})


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        ({"starts": 0}, "give 1 to 64"), ({"starts": "many"}, "give 1 to 64"),
        ({"free": []}, "all parameters are held"),
        ({"bounds": {"k_F": [2, 1]}}, "must be the smaller one"), ({"bounds": {"k_F": 3}}, "give two numbers"),
        ({"values": {"k_F": float("nan")}}, "give a number"),
    ],
)  # fmt: skip
def test_fits_that_cannot_be_meant(bench: Bench, said: dict[str, Any], sentence: str) -> None:
    with pytest.raises(FasError, match="choose at least one"):
        bench.fit([], {})
    bench.keep("20hz.csv", ONE.read_bytes())
    dropped(bench, ["20hz.csv"])
    with pytest.raises(FasError, match=sentence):
        bench.fit([0], said)


def test_typed_model_moves_and_is_saved_when_it_is_said(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = bench.model.document()["text"]
    assert text == mjcf.text("two_dof")
    before = bench.show.answer(bench.show.settings)["feet"]["a"]["ratio"]

    (wrong,) = bench.check(text.replace("<joint name", "<jont name", 1))
    line = 1 + text[: text.index("<joint name")].count("\n")
    assert wrong["line"] == line and f"two_dof, line {line}: MuJoCo cannot compile it" in wrong["text"]
    assert bench.show.answer(bench.show.settings)["feet"]["a"]["ratio"] == before

    softer = text.replace('stiffness="1.0e5"', 'stiffness="0.5e5"')
    told, model = bench.check(softer)
    assert told["text"] == "" and model["type"] == "model"
    assert bench.show.answer(bench.show.settings)["feet"]["a"]["ratio"] != pytest.approx(before, rel=1e-3)
    assert not list(tmp_path.iterdir())  # typed is not saved
    bench.keep("20hz.csv", ONE.read_bytes())
    dropped(bench, ["20hz.csv"])
    with pytest.raises(FasError, match="is not saved yet"):
        bench.fit([0], {})
    bench.sine()

    # a shipped model is saved as a copy of its own, never over another file
    (tmp_path / "my_two_dof.xml").write_text("mine")
    with pytest.raises(FasError, match="a copy has to be sound"):
        bench.save("<mujoco", "")
    saved, models, *_ = bench.save(softer, bench.model.document()["digest"])
    assert (tmp_path / "my_two_dof.xml").read_text() == "mine"
    own = tmp_path / saved["file"]
    assert (own.name, own.read_text(), models["now"]) == ("my_two_dof_2.xml", softer, saved["file"])
    assert bench.show.files() == [own.resolve()]
    again, models, *_ = bench.save(text, saved["digest"])
    assert own.read_text() == text and models["digest"] == again["digest"]

    # another program's work is not written over; a slip is written, said, and the last good model shown
    own.write_text(softer)
    refused, models = bench.save(text, again["digest"])
    assert (refused["file"], own.read_text()) == ("", softer) and "another program" in refused["text"]
    assert models["text"] == softer
    slip, models = bench.save("<mujoco", models["digest"])
    assert own.read_text() == "<mujoco" and "the last good model is shown" in slip["text"]
    bench.save(text, models["digest"])
    for name in bench.model.document()["names"]:
        assert bench.choose(name)[1]["type"] == "model"
        assert bench.show.answer(bench.show.settings)["type"] == "motion"
    with pytest.raises(FasError, match="no such model"):
        bench.choose("nowhere.xml")
    assert bench.show.models[0] == bench.model.document()["names"][-1] == "my_two_dof_2.xml"


def test_page_to_take_away_has_the_sliders_where_they_are(bench: Bench) -> None:
    said = {"frequency": 31.0, "peak_to_peak": 9.0, "added_mass": 2.3, "values": {"k_T": 2e5}}
    assert bench.take(said) == [{"type": "taken"}]
    text = (bench.folder / ".foot.html").read_text()
    data = json.loads(text.partition('id="exported">')[2].partition("</script>")[0])
    assert (data["model"]["settings"]["frequency"], data["model"]["settings"]["added_mass"]) == (31.0, 2.3)
    assert data["motion"]["feet"]["a"]["duration"] == pytest.approx(1 / 31)
    assert data["live"]["twin"]["values"]["k_F"] == bench.show.feet["a"].values()["k_F"]
    assert bench.show.settings.frequency == 20.0


def test_changes_need_the_session_key() -> None:
    """Upload and every message beyond a slider; strangers' Host and Origin are refused as anywhere."""
    show = Show(["two_dof"])
    bench = Bench(show)

    async def post(server: Server, body: bytes, name: str = "20hz.csv", **headers: str) -> Any:
        client = tornado.httpclient.AsyncHTTPClient(force_instance=True)
        try:
            url = f"{at(server.url, 'upload')}&name={name}"
            return await client.fetch(url, method="POST", body=body, headers=headers, raise_error=False)
        finally:
            client.close()

    async def both() -> None:
        server = Server(show, 0, bench)
        running = asyncio.create_task(server.run())
        try:
            good, key = ONE.read_bytes(), {"X-Key": server.key}
            assert (await post(server, good)).code == 403
            assert (await post(server, good, **{"X-Key": "wrong"})).code == 403
            assert (await post(server, good, Host="evil.example", **key)).code == 403
            assert (await post(server, good, Origin="http://evil.example", **key)).code == 403
            assert not list(bench.folder.rglob("*.csv"))
            refused = await post(server, good, name="..%2Fevil.csv", **key)
            assert refused.code == 400 and "is no name" in json.loads(refused.body)["text"]
            large = bytes(2_000_000)  # only a page of this session may send as much
            assert (await post(server, large)).code == 403
            assert (await post(server, large, name="large.wav", **key)).code == 200
            client = tornado.httpclient.AsyncHTTPClient(force_instance=True)
            here = tornado.httpclient.HTTPRequest(server.url, "POST", key, large)
            assert (await client.fetch(here, raise_error=False)).code in (
                400,
                599,
            )  # refused or cut off, and never read
            client.close()
            assert (await post(server, good, **key)).code == 200
            socket = await upgrade(server, Origin=server.origin)
            assert (await documents(socket, "models"))["now"] == "two_dof"
            other = await upgrade(server, Origin=server.origin)  # a second tab sees what the first one does
            for path in ("report", "results", "take"):
                assert (await status(at(server.url, path))).code == 404  # nothing is made yet
                assert (await status(at(server.url, path), Host="evil.example")).code == 403
                assert (await status(at(server.url, path), Origin="http://evil.example")).code == 403
            for asked in ({"type": "open", "names": ["20hz.csv"]}, {"type": "save", "text": "x", "key": "wrong"}):
                await socket.write_message(json.dumps(asked))
                assert "another session" in (await documents(socket, "complaint"))["text"]
            await socket.write_message(json.dumps({"type": "explode", "key": server.key}))
            assert "which it cannot do" in (await documents(socket, "complaint"))["text"]
            await socket.write_message(json.dumps({"type": "open", "names": ["20hz.csv"], "key": server.key}))
            for page in (socket, other):
                while (await documents(page, "data"))["shown"] != 0:
                    pass  # before the file was opened
                assert (await documents(page, "model"))["recorded"]
            for page, number in ((socket, 0), (other, 7)):  # a form, and a complaint, are for the page that asked
                await page.write_message(json.dumps({"type": "columns", "number": number, "key": server.key}))
            assert (await documents(socket, "columns"))["number"] == 0
            while (heard := json.loads(await other.read_message() or ""))["type"] != "complaint":
                assert heard["type"] != "columns"
            assert heard["of"] == "columns"
            await leave(socket)
            await leave(other)
        finally:
            server.stop()
            await asyncio.wait_for(running, WAIT)

    asyncio.run(both())
    assert not bench.folder.exists()
