"""Options that the cell's commands share: their types, and what their values mean."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fasbody.cell.materials import Preset, preset
from fasbody.exceptions import SettingError

if TYPE_CHECKING:
    from fasbody.cell.meshsize import MeshSize

PresetOption = Annotated[str, typer.Option("--preset", help="as-printed, as-reproduced or si")]
ShapeOption = Annotated[str, typer.Option("--shape", help=r"base axes, long x short \[um]")]
SizeOption = Annotated[float, typer.Option("--size", help=r"element size \[um]; finer at nucleus and rim")]
ModesOption = Annotated[int, typer.Option("--modes", help="number of modes")]
ModulusOption = Annotated[float | None, typer.Option("--modulus", help="Young's modulus of the cytoplasm [Pa]")]
JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")]
OutOption = Annotated[Path | None, typer.Option("--out", help="folder for results and figures")]

#: Parameters that only a dome, only a mesh of the user's own, or only a closed surface has.
OF_DOME = {"shape_text", "height", "profile", "nucleus_centre", "no_nucleus"}
OF_MESH = {"um_per_unit", "nucleus_tag", "nucleus_surface"}
OF_STL = {"size", "nucleus_surface"}


def chosen_preset(name: str, modulus: float | None) -> Preset:
    """The preset of that name, with another modulus of the cytoplasm [Pa] if one is given."""
    chosen = preset(name)
    with named("--modulus, cytoplasm"):
        return chosen if modulus is None else chosen.with_modulus(modulus)


def chosen_materials(chosen: Preset, nucleus_E: float | None, nu: float | None, rho: float | None) -> Preset:
    """The preset with modulus of the nucleus [Pa], Poisson's ratio and density [kg/m^3] of both, where given."""
    for name, both in (("--poisson", {"nu": nu}), ("--density", {"rho": rho})):
        values: dict[str, float] = {key: value for key, value in both.items() if value is not None}
        with named(name):
            cytoplasm, nucleus = (replace(material, **values) for material in chosen.materials)
        chosen = replace(chosen, cytoplasm=cytoplasm, nucleus=nucleus)
    if nucleus_E is None:
        return chosen
    with named("--nucleus-modulus"):
        return replace(chosen, nucleus=replace(chosen.nucleus, E=nucleus_E))


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


def check_together(context: typer.Context, mesh: Path | None) -> None:
    """Refuse options that have no meaning beside the others given, or before a sub-command.

    Raises:
        SettingError: naming the option.
    """
    given = {
        option.name: option.opts[0]
        for option in context.command.params
        if option.name and getattr(context.get_parameter_source(option.name), "name", "") == "COMMANDLINE"
    }

    def refuse(names: set[str], why: str) -> None:
        for name in sorted(names & set(given)):
            raise SettingError(f"{given[name]} {why}.")

    if context.invoked_subcommand is not None:
        refuse(set(given), f"stands before {context.invoked_subcommand!r} and would be lost: write it after")
    elif mesh is None:
        refuse(OF_MESH, "needs --mesh")
    else:
        refuse(OF_DOME, "shapes the dome, not the cell of --mesh: leave it out")
        if mesh.suffix.lower() != ".stl":
            refuse(OF_STL, f"serves an .stl surface; {mesh} brings its own tetrahedra: leave it out")


def mesh_size(size: float) -> "MeshSize":
    """Element sizes from the one of the command line [um]."""
    from fasbody.cell.meshsize import MeshSize

    with named("--size"):
        return MeshSize.of(size)
