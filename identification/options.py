"""Options that commands on recordings share."""

from pathlib import Path
from typing import Annotated

import typer

Data = Annotated[
    list[Path] | None, typer.Argument(help="study folder, or CSV recordings", show_default="bundled study")
]
BodyMass = Annotated[
    list[float] | None, typer.Option(help="body mass in kg, for bare files; once, or once per file in their order")
]
AddedMass = Annotated[
    list[float] | None, typer.Option(help="mass on the knee in kg, for bare files; once, or once per file")
]
Mapping = Annotated[
    Path | None, typer.Option("--study", help="study.toml that maps channels, units and sensitivities of files")
]
MassStd = Annotated[
    float | None, typer.Option(help="what the segment masses may be off, as a share (default 0.1; 0: exact)")
]
GainStd = Annotated[float | None, typer.Option(help="what the gain may be off, as a share (default 0.01)")]
DelayStd = Annotated[
    float | None, typer.Option(help="what the delay between channels may be, in s (default a tenth of a sample)")
]
