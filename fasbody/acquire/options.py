"""Options that commands which record share."""

from pathlib import Path
from typing import Annotated

import typer

Port = Annotated[str | None, typer.Option(help="port of the accelerometer board")]
Generator = Annotated[
    str | None, typer.Option(help="SCPI function generator: its port or VISA name")
]
Board = Annotated[
    str,
    typer.Option(
        "--board",
        help="serial; audio, a sound card that plays and records; ni, mcc, labjack; "
        "or a device of another package",
    ),
]
Calibration = Annotated[
    Path | None,
    typer.Option(
        "--calibration",
        help="settings of a device other than a serial board "
        "(default sound_card.json, ni.json and so on)",
    ),
]
MaxVolts = Annotated[float, typer.Option(help="highest generator amplitude in V peak to peak")]
Baud = Annotated[int, typer.Option(min=1, help="baud rate of the board")]
GeneratorBaud = Annotated[int, typer.Option(min=1, help="baud rate of the generator")]
Simulate = Annotated[
    bool, typer.Option("--simulate", help="simulated devices instead of hardware")
]
