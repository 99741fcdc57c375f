"""Generators by VISA name: on a socket that speaks SCPI, on PyVISA's simulated instruments, and the guard's way."""

import socket
import socketserver
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from fasbody.acquire.bench.generator import VirtualGenerator
from fasbody.acquire.generator import Generator, Refused
from fasbody.acquire.port import Unplugged
from fasbody.acquire.visa import VisaPort, is_visa
from fasbody.exceptions import AcquisitionError

pytest.importorskip("pyvisa_py", reason="VISA generators are not tested: pip install 'fasbody[visa]'")
pytestmark = [
    pytest.mark.usefixtures("patient"),
    pytest.mark.filterwarnings("ignore::UserWarning:pyvisa_py"),  # it misses packages that it does not need
]


class Scope(socketserver.ThreadingTCPServer):
    """An instrument on a socket of this computer."""

    daemon_threads, block_on_close = True, False

    def __init__(self) -> None:
        self.instrument, self.silent = VirtualGenerator(), False
        super().__init__(("127.0.0.1", 0), _Speaker)
        self.name = f"TCPIP0::127.0.0.1::{self.server_address[1]}::SOCKET"


class _Speaker(socketserver.StreamRequestHandler):
    def handle(self) -> None:
        assert isinstance(self.server, Scope)
        for line in self.rfile:
            answer = self.server.instrument.do(line.decode().strip())
            if answer is not None and not self.server.silent:
                self.wfile.write(answer.encode() + b"\n")


@pytest.fixture
def scope() -> Iterator[Scope]:
    with Scope() as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def test_generator_on_a_socket(scope: Scope) -> None:
    with Generator(scope.name, 0, guard=False) as generator:
        assert generator.identity == "FAS,virtual generator,0,1"
        generator.sine(20.0, 0.5)
        generator.on()
        assert scope.instrument.output() == {"frequency_hz": 20.0, "volts": 0.5}
        with pytest.raises(Refused, match="out of range"):
            generator.set_volts(30.0)
        scope.silent = True
        with pytest.raises(AcquisitionError, match="no answer to"):
            generator.query("*IDN?", 0.2)
        scope.silent = False
    assert not scope.instrument.on


def test_nothing_there_is_said() -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        with pytest.raises(AcquisitionError, match=r"SOCKET: (cannot be opened|unplugged|no answer)"):
            Generator(f"TCPIP0::127.0.0.1::{closed.getsockname()[1]}::SOCKET", 0)
    with pytest.raises(Unplugged, match=r"cannot be opened"):
        VisaPort("NONSENSE::1::INSTR", 0)
    assert is_visa("USB0::0x0957::0x2C07::MY1::INSTR") and not is_visa("/dev/ttyUSB0")


def test_guard_switches_a_socket_off(scope: Scope) -> None:
    """A driver that is killed with the output on cannot do it itself."""
    driver = (
        "import os, signal, sys; from fasbody.acquire import generator; generator._ANSWER_S = 60.0; "
        "g = generator.Generator(sys.argv[1], 0); g.sine(20.0, 0.5); g.on(); os.kill(os.getpid(), signal.SIGKILL)"
    )
    done = subprocess.run([sys.executable, "-c", driver, scope.name], capture_output=True, text=True)
    assert done.returncode == -9, done.stderr
    deadline = time.monotonic() + 300.0
    while scope.instrument.on:
        assert time.monotonic() < deadline
        time.sleep(0.05)


SIMULATED = """
spec: "1.1"
devices:
  generator:
    eom:
      {kind} INSTR:
        q: "\\n"
        r: "\\n"
    error: ERROR
    dialogues:
      - {{q: "*IDN?", r: "Made up,3000,17,2.1"}}
      - {{q: "*CLS"}}
      - {{q: "*RST"}}
      - {{q: "FUNC SIN"}}
      - {{q: "VOLT:UNIT VPP"}}
      - {{q: "SYST:ERR?", r: "+0,none"}}
    properties:
      output: {{default: "0", getter: {{q: "OUTP?", r: "{{}}"}}, setter: {{q: "OUTP {{}}"}}}}
      volts: {{default: 1.0, getter: {{q: "VOLT?", r: "{{:.6f}}"}}, setter: {{q: "VOLT {{}}"}}, specs: {{type: float}}}}
      offset: {{default: "0", getter: {{q: "VOLT:OFFS?", r: "{{}}"}}, setter: {{q: "VOLT:OFFS {{}}"}}}}
      hertz: {{default: 1.0, getter: {{q: "FREQ?", r: "{{:.4f}}"}}, setter: {{q: "FREQ {{}}"}}, specs: {{type: float}}}}
resources:
  "{name}":
    device: generator
"""


@pytest.mark.parametrize("kind", ["USB", "GPIB", "ASRL"])
def test_simulated_instruments(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pyvisa_sim")
    name = {"USB": "USB0::0x1111::0x2222::S1::INSTR", "GPIB": "GPIB0::8::INSTR", "ASRL": "ASRL1::INSTR"}[kind]
    file = tmp_path / "instruments.yaml"
    file.write_text(SIMULATED.format(kind=kind, name=name))
    monkeypatch.setenv("PYVISA_LIBRARY", f"{file}@sim")
    with Generator(name, 9600, guard=False) as generator:
        assert generator.identity == "Made up,3000,17,2.1"
        generator.sine(20.0, 0.5)
        generator.on()
        assert (generator.query("VOLT?"), generator.query("FREQ?"), generator.query("OUTP?")) == (
            "0.500000", "20.0000", "ON",
        )  # fmt: skip
        generator.off()
        assert generator.query("OUTP?") == "OFF"
