"""Options that the commands of the cell share, and what they make of them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from fasbody.console import make_folder, print_json
from fasbody.exceptions import SettingError

T = TypeVar("T")
PresetOption = Annotated[str, typer.Option("--preset", help="as-printed, as-reproduced or si")]
ShapeOption = Annotated[str, typer.Option("--shape", help=r"base axes, long x short \[um]")]
SizeOption = Annotated[float, typer.Option("--size", help=r"element size \[um]; finer at nucleus and rim")]
ModesOption = Annotated[int, typer.Option("--modes", min=1, help="number of modes")]
BasisOption = Annotated[int, typer.Option("--modes", min=1, help="modes in the basis; the highest ends the range")]
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
BodyArgument = Annotated[
    str, typer.Argument(help="a .stl, .obj, .vtu or .msh file, or a bundled bone such as calcaneus")
]
MaterialOption = Annotated[
    list[str],
    typer.Option(
        help=r"Young's modulus \[Pa], Poisson's ratio, density \[kg/m^3]; of one region: "
        "REGION=E,NU,RHO"
    ),
]
RelaxationOption = Annotated[
    list[str],
    typer.Option(help=r"relaxing share of stiffness, relaxation time \[s]; of one region: REGION=G,TAU"),
]
SupportOption = Annotated[str, typer.Option(help="free, base (flat on the lowest plane) or region (see --held)")]
HeldOption = Annotated[
    str | None,
    typer.Option(help="number or name of the fixed region; triangles:1 or tetrahedra:1 if both have this number"),
]
UnitOption = Annotated[str, typer.Option(help="length unit of the file: nm, um, mm, cm or m")]
UpOption = Annotated[str, typer.Option(help="axis that points up from the base: x, y or z")]
BodySizeOption = Annotated[
    float | None,
    typer.Option(
        "--size",
        help="element size in a surface, in its unit",
        show_default="two through its thickness",
    ),
]


@contextmanager
def named(setting: str) -> Iterator[None]:
    """A refusal of the block is of this option, by its name in Python."""
    try:
        yield
    except SettingError as error:
        error.setting = setting
        raise


def by_region(setting: str, texts: list[str], kind: Callable[..., T], example: str) -> dict[str | None, T]:
    """What ``REGION=NUMBERS`` gives to each region, and ``NUMBERS`` to None, all others.

    Args:
        setting: the option.
        texts: of it.
        kind: what the numbers make.
        example: of the numbers.

    Raises:
        SettingError: a text does not have that form, or a region is given twice.
    """
    values: dict[str | None, T] = {}
    for text in texts:
        region, _, numbers = text.rpartition("=")
        with named(setting):
            if (region or None) in values:
                whose = f"region {region}" if region else "all regions that have none of their own"
                raise SettingError(f"there is one of {whose} already: give each once.")
            try:
                values[region or None] = kind(*map(float, numbers.split(",")))
            except (TypeError, ValueError):  # another count, or no numbers
                text = f"{text!r} is not {example.count(',') + 1} numbers, such as {example}."
                raise SettingError(text) from None
    return values


def report(document: dict[str, Any], text: str, as_json: bool) -> None:
    """Print the document, or the text for people."""
    if as_json:
        print_json(document)
    else:
        print(text)
