"""Options that the commands of the cell share."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fasbody.console import make_folder, print_json
from fasbody.exceptions import SettingError

if TYPE_CHECKING:
    from fasbody.cell.mesh import MeshSize

PresetOption = Annotated[str, typer.Option("--preset", help="as-printed, as-reproduced or si")]
ShapeOption = Annotated[str, typer.Option("--shape", help=r"base axes, long x short \[um]")]
SizeOption = Annotated[float, typer.Option("--size", help=r"element size \[um]; finer at nucleus and rim")]
ModesOption = Annotated[int, typer.Option("--modes", help="number of modes")]
SolverOption = Annotated[
    str | None, typer.Option("--solver", help="pardiso, superlu or multigrid; default: the fastest")
]
ModulusOption = Annotated[float | None, typer.Option("--modulus", help="Young's modulus of the cytoplasm [Pa]")]
JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        help="folder for results and figures",
        callback=lambda out: out and make_folder(out),
    ),
]


def check_count(modes: int) -> None:
    """Refuse a number of modes below one."""
    if modes < 1:
        raise SettingError(f"--modes: the number of modes must be 1 or more, not {modes}.")


@contextmanager
def named(option: str) -> Iterator[None]:
    """Put the option before the sentence on its value."""
    try:
        yield
    except SettingError as error:
        raise SettingError(f"{option}: {error}") from error


def mesh_size(size: float) -> "MeshSize":
    """Element sizes from the one of the command line [um]."""
    from fasbody.cell.mesh import MeshSize

    with named("--size"):
        return MeshSize.of(size)


def report(document: dict[str, Any], text: str, as_json: bool) -> None:
    """Print the document, or the text for people."""
    if as_json:
        print_json(document)
    else:
        print(text)
