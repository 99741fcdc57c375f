"""Options that commands on recordings share."""

from pathlib import Path
from typing import Annotated

import typer

Data = Annotated[
    list[Path] | None, typer.Argument(help="study folder, or recordings in any format", show_default="bundled study")
]
BodyMass = Annotated[
    list[float] | None,
    typer.Option(metavar="KG", help="body mass, for files without a study; once, or once per file in their order"),
]
AddedMass = Annotated[
    list[float] | None,
    typer.Option(metavar="KG", help="mass on the knee, for files without a study; once, or once per file"),
]
Mapping = Annotated[
    Path | None, typer.Option("--study", help="study.toml that maps channels, units and sensitivities of files")
]
MassStd = Annotated[
    float | None,
    typer.Option(
        metavar="SHARE",
        help="standard deviation of the segment masses, as a share (default 0.15 shank, 0.1 foot; 0: exact)",
    ),
]
GainStd = Annotated[
    float | None,
    typer.Option(metavar="SHARE", help="standard deviation of the gain, as a share (default 0.01)"),
]
DelayStd = Annotated[
    float | None,
    typer.Option(
        metavar="S",
        help="standard deviation of the delay between channels, in s (default: a tenth of a sample)",
    ),
]
