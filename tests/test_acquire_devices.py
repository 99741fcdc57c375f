"""One door for devices: what ships, what other packages add, and three vendors' drivers on their libraries' calls."""

import json
import sys
import types
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import vendors
from feeder import CONDITION, refusal

from fasbody.acquire import daq, devices
from fasbody.acquire.board import Board
from fasbody.acquire.commands import app
from fasbody.acquire.daq import Wiring
from fasbody.acquire.devices import Equipment, kind, opened
from fasbody.acquire.frames import Frames
from fasbody.acquire.plan import Plan
from fasbody.acquire.port import Unplugged
from fasbody.acquire.session import Session
from fasbody.acquire.timeline import Timeline
from fasbody.acquire.wire import Block, Decoder
from fasbody.exceptions import AcquisitionError, InputFileError, MissingPackageError, SettingError

pytestmark = pytest.mark.usefixtures("patient")
DEVICES = {"ni": ("Dev1", ("ai0", "ai1")), "mcc": ("01D8", ("0", "1")), "labjack": ("", ("AIN0", "AIN1"))}


def wiring(name: str, **others: Any) -> Wiring:
    device, inputs = DEVICES[name]
    return Wiring(**({"device": device, "inputs": inputs, "range_v": 5.0, "rate_hz": 1000.0} | others))


@pytest.mark.parametrize("name", DEVICES)
def test_a_driver_gives_the_volts_of_its_library_as_accelerations(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    """0.5 V at 0.1 V per m/s^2 are 5 m/s^2, in every sample of a recording without a gap."""
    signal = vendors.install(monkeypatch, name)
    board, output = opened(kind(name), wiring(name))
    assert output is None
    assert board.wait_for_hello().roles == ("base", "malleolus")
    (made,) = Session(Plan(tmp_path / "study", (20.0,), CONDITION, seconds=0.8), board).run()
    board.close()
    assert made.problems == () and made.quality.lost_samples == 0 and made.recording.rate_hz == pytest.approx(1000)
    base, malleolus = made.recording.base_m_s2, made.recording.malleolus_m_s2
    wave = np.exp(2j * np.pi * 20 * np.arange(800) / 1000)
    lines = [2 / 800 * (x[:800] @ wave.conj()) for x in (base, malleolus)]
    assert abs(lines[0]) == pytest.approx(5, rel=1e-4) and abs(lines[1] / lines[0]) == pytest.approx(1.2, rel=1e-4)
    assert np.angle(lines[1] / lines[0]) == pytest.approx(-0.4, abs=1e-4)
    assert signal.calls[-1][0] == "close"


@pytest.mark.parametrize("name", DEVICES)
def test_an_overrun_is_a_gap_and_a_device_that_is_not_there_says_so(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    signal = vendors.install(monkeypatch, name)
    board, _ = opened(kind(name), wiring(name))
    board.wait_for_hello()
    signal.broken = "overrun"
    while not board.unplugs:
        board.pump()
    signal.broken = ""
    board.collect(0.1)
    board.close()
    signal.broken = "open"
    with pytest.raises(Unplugged, match="cannot be opened"):
        kind(name)(wiring(name))


def decoded(device: Any, reads: int) -> list[Block]:
    decoder = Decoder()
    messages = [message for _ in range(reads) for message in decoder.feed(device.read())]
    return [message for message in messages if isinstance(message, Block)]


def test_scans_that_a_labjack_skipped_are_a_gap_of_their_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    signal = vendors.install(monkeypatch, "labjack")
    device = kind("labjack")(wiring("labjack"))
    before = decoded(device, 4)
    signal.broken = "skip"
    decoder = Decoder(device._frames.hello)
    blocks = [m for _ in range(8) for m in decoder.feed(device.read()) if isinstance(m, Block)]
    device.close()
    numbers = [block.sequence for block in (*before, *blocks)]
    missing = set(range(numbers[-1] + 1)) - set(numbers)
    assert len(missing) == 1 and device.events() == ["skipped scans"]
    timeline = Timeline(decoder.hello)  # type: ignore[arg-type]
    timeline.add([*before, *blocks], 1.0)
    assert timeline.quality().lost_samples == 16


def test_libraries_are_told_range_supply_and_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    signal = vendors.install(monkeypatch, "ni")
    kind("ni")(wiring("ni", iepe=True)).close()
    accel = [call for call in signal.calls if call[0] == "accel"]
    assert [call[1][0] for call in accel] == ["Dev1/ai0", "Dev1/ai1"]
    assert accel[0][2] == {"current": 0.004, "sensitivity": 1.0, "max": 5.0}
    assert ("timing", (1000.0,), {"sample_mode": "CONTINUOUS", "samps_per_chan": 10_000}) in signal.calls
    with pytest.raises(AcquisitionError, match="which device"):
        kind("ni")(wiring("ni", device=""))
    signal = vendors.install(monkeypatch, "mcc")
    kind("mcc")(wiring("mcc", iepe=True)).close()
    assert [call[1] for call in signal.calls if call[0] == "iepe"] == [(0, "ENABLED"), (1, "ENABLED")]
    assert ("scan", (0, 1, "BIP5VOLTS"), {}) in signal.calls
    for others, text in (
        ({"device": "other"}, "USB-1808 01D8"), ({"range_v": 7.0}, r"has no range of \+-7 V"),
        ({"inputs": ("0", "2")}, "must be neighbours"),
    ):  # fmt: skip
        with pytest.raises(Unplugged, match=text):
            kind("mcc")(wiring("mcc", **others))
    signal = vendors.install(monkeypatch, "labjack")
    kind("labjack")(wiring("labjack", inputs=("0", "AIN1"))).close()
    assert ("write", ("AIN0_RANGE", 5.0), {}) in signal.calls and ("stream", (20, [0, 2]), {}) in signal.calls
    with pytest.raises(Unplugged, match="supplies no IEPE"):
        kind("labjack")(wiring("labjack", iepe=True))


def test_a_reader_too_late_for_the_buffer_is_a_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    signal = vendors.install(monkeypatch, "mcc")
    device = kind("mcc")(wiring("mcc"))
    full = len(device._buffer) // 2
    signal.began -= 0.89 * full / signal.rate
    assert len(device.take()) >= 0.89 * full
    signal.began -= 0.91 * full / signal.rate
    with pytest.raises(Unplugged, match="too late for its buffer"):
        device.take()


def test_a_device_that_gives_nothing_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    vendors.install(monkeypatch, "ni")
    device = kind("ni")(wiring("ni"))
    monkeypatch.setattr(type(device), "take", lambda self: np.zeros((0, 2)))
    assert device.read() == b""
    device._came -= daq._GONE_S
    with pytest.raises(Unplugged, match="no scan for 3 s"):
        device.read()


@pytest.mark.parametrize("facts", [
    {"gain": 1}, {"rate_hz": -1}, {"inputs": ["0"]}, {"sensitivity": [0.1]}, {"iepe": 1}, {"device": 5},
    {"range_v": float("nan")}, {"rate_hz": True}, {"inputs": "01"},
])  # fmt: skip
def test_a_value_of_a_wiring_that_cannot_be_meant_is_named(tmp_path: Path, facts: dict[str, Any]) -> None:
    file = tmp_path / "ni.json"
    file.write_text(json.dumps(facts))
    ((quantity, value),) = json.loads(file.read_text()).items()
    with pytest.raises(InputFileError) as caught:
        Wiring.read(file)
    error = caught.value
    assert (error.file, error.quantity, str(error.value)) == (str(file), quantity, str(value)) and error.valid


@pytest.mark.parametrize(("text", "problem"), [
    ("{", "is no JSON document"), ("[]", "is no table"), ('{"sensitivity": [0.1, 1, 2]}', "sensitivity for each"),
    ('{"sensitivity": ["100 m/g", 1]}', "sensitivity"),
])  # fmt: skip
def test_wiring_that_cannot_be_meant_is_refused(tmp_path: Path, text: str, problem: str) -> None:
    file = tmp_path / "ni.json"
    file.write_text(text)
    with pytest.raises(InputFileError, match=problem):
        Wiring.read(file)
    with pytest.raises(InputFileError, match="cannot be read"):
        Wiring.read(tmp_path / "none.json")


def test_sensitivities_and_over_range() -> None:
    one = Wiring(sensitivity=("100 mV/g", -0.02), range_v=5.0)
    assert one.volts == pytest.approx([0.1 / 9.80665, -0.02])
    decoder = Decoder()
    decoder.feed(Frames("made", 1000.0, one.range_v / one.volts).hello)
    assert decoder.hello is not None
    base, malleolus = decoder.hello.channels
    assert base.range_m_s2 == pytest.approx(5 / 0.1 * 9.80665, rel=1e-3) and malleolus.counts_per_m_s2 < 0
    assert one.with_scale(1, 250.0).volts[1] == pytest.approx(0.02)


class Mine:
    """A device of somebody's own: the settings are its rate."""

    def __init__(self, settings: float) -> None:
        self.device = daq.Wiring(rate_hz=settings)

    @classmethod
    def settings(cls, file: Path) -> float:
        return float(file.read_text())

    def read(self) -> bytes:
        raise Unplugged("mine: always away.")

    def write(self, data: bytes) -> None: ...

    def events(self) -> list[str]:
        return []

    def close(self) -> None: ...


def test_a_package_adds_a_device_by_an_entry_point(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    module = types.ModuleType("their_package")
    module.Mine = Mine  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "their_package", module)
    entry = EntryPoint("mine", "their_package:Mine", devices.GROUP)
    monkeypatch.setattr(devices, "entry_points", lambda group: [entry] if group == devices.GROUP else [])
    assert devices.names() == ["serial", "audio", "ni", "mcc", "labjack", "mine"] and kind("mine") is Mine
    file = tmp_path / "mine.json"
    file.write_text("1000")
    board, _ = opened(Mine, Mine.settings(file))
    assert isinstance(board, Board)
    while not board.unplugs:  # what it raises is what a pulled plug is
        board.pump()
    board.close()
    equipment = Equipment("mine", settings=file)
    equipment.check()
    assert not equipment.excites
    with pytest.raises(SettingError, match="mine"):
        kind("mien")


def test_the_door_refuses_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    monkeypatch.delitem(sys.modules, "fasbody.acquire.daq.ni", raising=False)
    with pytest.raises(MissingPackageError, match=r"fasbody\[ni\]"):
        kind("ni")
    words = ["record", "--out", str(tmp_path / "x"), "--body-mass", "70"]
    assert "labjack" in refusal(*words, "--board", "labjck")
    vendors.install(monkeypatch, "labjack")
    assert "cannot be read" in refusal(*words, "--board", "labjack", "--calibration", str(tmp_path / "none.json"))
    assert "leave out --port" in refusal(*words, "--board", "labjack", "--port", "/dev/ttyACM0")
    assert "--calibration belongs to a device" in refusal(*words, "--port", "p", "--calibration", "x.json")
    file = tmp_path / "labjack.json"
    wiring("labjack").write(file)
    text = refusal(*words, "--board", "labjack", "--calibration", str(file), "--sweep", "10:20:5")
    assert "needs a function generator" in text


def test_calibrator_and_flip_find_a_sensitivity_on_any_device(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A calibrator of 159.155 Hz and 10 m/s^2 rms that gives 0.7 V at its peak: 0.0495 V per m/s^2."""
    vendors.install(monkeypatch, "labjack")
    file = tmp_path / "labjack.json"
    wiring("labjack", rate_hz=4000.0).write(file)
    tone = 0.7 * np.sin(2 * np.pi * 159.155 * np.arange(12_000) / 4000)
    both = np.column_stack([0 * tone, tone]) / 5.0
    monkeypatch.setattr(kind("labjack"), "listen", classmethod(lambda cls, known, seconds: (both, 4000.0)))
    app(["calibrate", "calibrator", "malleolus", "--board", "labjack", "--calibration", str(file)],
        standalone_mode=False)  # fmt: skip
    assert json.loads(file.read_text())["sensitivity"] == pytest.approx([0.1, 0.7 / np.sqrt(2) / 10], rel=1e-4)
    assert "not for --board labjack" in refusal("calibrate", "loopback", "--board", "labjack")


def test_listening_gives_shares_of_the_range(monkeypatch: pytest.MonkeyPatch) -> None:
    vendors.install(monkeypatch, "labjack")
    both, rate = kind("labjack").listen(wiring("labjack"), 0.3)
    assert rate == 1000 and len(both) >= 300 and np.abs(both[:, 0]).max() == pytest.approx(0.1, rel=3e-3)
    signal = vendors.install(monkeypatch, "labjack")
    signal.broken = "skip"
    with pytest.raises(AcquisitionError, match="it lost scans"):
        kind("labjack").listen(wiring("labjack"), 0.1)
