"""Command line of the cell and of other bodies: ``python -m fasbody.cell --help``."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from fasbody.cell.dome import Dome, Nucleus, shape
from fasbody.cell.materials import Material, Preset, preset
from fasbody.cell.options import (
    JsonOption,
    ModesOption,
    ModulusOption,
    OutOption,
    PresetOption,
    ShapeOption,
    SizeOption,
    SolverOption,
    check_count,
    mesh_size,
    named,
    report,
)
from fasbody.console import command_line, console, to_json, write_whole
from fasbody.exceptions import SettingError
from fasbody.lazy import command

if TYPE_CHECKING:
    from fasbody.cell.analysis import Analysis
    from fasbody.cell.viscoelastic import StandardLinearSolid

T = TypeVar("T")
BodyArgument = Annotated[
    str, typer.Argument(help="a .stl, .obj, .vtu or .msh file, or a bundled bone such as calcaneus")
]
MaterialOption = Annotated[
    list[str],
    typer.Option(help=r"Young's modulus \[Pa], Poisson's ratio, density \[kg/m^3]; of one region: REGION=E,NU,RHO"),
]
SupportOption = Annotated[str, typer.Option(help="free, base (flat on the lowest plane) or region (see --held)")]
HeldOption = Annotated[
    str | None,
    typer.Option(help="number or name of what stands still; triangles:1, tetrahedra:1 if both are"),
]
UnitOption = Annotated[str, typer.Option(help="length unit of the file: nm, um, mm, cm or m")]
UpOption = Annotated[str, typer.Option(help="axis that points up from the base: x, y or z")]
BodySizeOption = Annotated[
    float | None,
    typer.Option("--size", help="element size in a surface, in its unit", show_default="two through its thickness"),
]

#: Parameters that only a dome, only a user's mesh, or only a closed surface has.
OF_DOME = {"shape_text", "height", "profile", "nucleus_centre", "no_nucleus"}
OF_MESH = {"um_per_unit", "nucleus_tag", "nucleus_surface"}
OF_STL = {"size", "nucleus_surface"}

app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)


@app.callback(invoke_without_command=True)
def analyse_cell(
    context: typer.Context,
    preset_name: PresetOption = "as-reproduced",
    shape_text: ShapeOption = "100x40",
    modulus: ModulusOption = None,
    modes: ModesOption = 10,
    size: SizeOption = 3.5,
    height: Annotated[float | None, typer.Option(help=r"height of the dome \[um]")] = None,
    profile: Annotated[str, typer.Option(help="ellipsoid or cap")] = "ellipsoid",
    nucleus_centre: Annotated[float, typer.Option(help=r"height of the nucleus' centre \[um]")] = 4.5,
    no_nucleus: Annotated[bool, typer.Option("--no-nucleus", help="leave the nucleus out")] = False,
    nucleus_modulus: Annotated[float | None, typer.Option(help="Young's modulus of the nucleus [Pa]")] = None,
    poisson: Annotated[float | None, typer.Option(help="Poisson's ratio of both")] = None,
    density: Annotated[float | None, typer.Option(help=r"density of both \[kg/m^3]")] = None,
    membrane: Annotated[bool, typer.Option("--membrane", help="add the elastic membrane of Table 5.1")] = False,
    filaments: Annotated[float, typer.Option(help="add a tensegrity with this many filaments per bar")] = 0.0,
    mesh: Annotated[Path | None, typer.Option(help="your own cell: .vtu, .msh or closed .stl, y up")] = None,
    um_per_unit: Annotated[float, typer.Option(help="micrometres in one length unit of --mesh")] = 1.0,
    nucleus_tag: Annotated[
        int | None, typer.Option(help="region number of the nucleus in --mesh", show_default="1, if there are several")
    ] = None,
    nucleus_surface: Annotated[Path | None, typer.Option(help="closed .stl of the nucleus, for an .stl cell")] = None,
    solver: SolverOption = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Natural frequencies and mode shapes of an adherent cell (Chapter 5 of the thesis).

    The presets say what the printed numbers mean: docs/cell.md. With --out, writes cell.json, cell.vtu (ParaView),
    cell.npz (for the browser) and the figures modes.png and mesh.png.

    Examples:
      python -m fasbody.cell

      python -m fasbody.cell --preset si --shape 67x60 --modulus 1000 --out results/cell

      python -m fasbody.cell --mesh my_cell.stl --preset si --json

      python -m fasbody.cell sweep --out results/cell
    """
    check_together(context, mesh)
    if context.invoked_subcommand is not None:
        return
    chosen = chosen_materials(chosen_preset(preset_name, modulus), nucleus_modulus, poisson, density)
    check_count(modes)
    from fasbody.cell.analysis import analyse, assemblies
    from fasbody.cell.cytoskeleton import Tensegrity
    from fasbody.cell.membrane import Membrane

    options: dict[str, Any] = {"count": modes, "way": solver}
    options["membrane"] = Membrane() if membrane else None
    with named("--filaments"):
        options["cytoskeleton"] = Tensegrity(bundle=filaments) if filaments else None
    if mesh is not None:
        from fasbody.cell.assembly import assemble
        from fasbody.cell.companion import pair
        from fasbody.cell.meshfile import read_mesh

        fine, rough = pair(read_mesh(
            mesh, um_per_unit=um_per_unit, nucleus_tag=nucleus_tag, nucleus=nucleus_surface, size=mesh_size(size)
        ))  # fmt: skip
        with console.status("solving"):
            analysis = analyse(assemble(fine), assemble(rough), chosen, **options)
    else:
        nucleus = None if no_nucleus else Nucleus(centre=nucleus_centre)
        dome = Dome(*shape(shape_text), chosen.height_um if height is None else height, profile, nucleus)
        with console.status("meshing and solving"):
            analysis = analyse(*assemblies(dome, mesh_size(size)), chosen, dome=dome, **options)
    if out is not None:
        _write(out, analysis)
    report(analysis.document(), str(analysis), as_json)


@app.command("modes")
def modes_of_a_body(
    body: BodyArgument,
    material: MaterialOption,
    support: SupportOption = "free",
    held: HeldOption = None,
    unit: UnitOption = "mm",
    up: UpOption = "y",
    size: BodySizeOption = None,
    modes: ModesOption = 10,
    solver: SolverOption = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Modes of any elastic body: a bone, an insole block, a shoe sole; free, on its base, or held somewhere.

    The rigid motions of a free body are skipped. With --out, writes body.json, body.vtu (ParaView), body.npz (for
    python -m viz.cell) and modes.png.

    Examples:
      python -m fasbody.cell modes calcaneus --material 7.3e9,0.3,1500 --size 5

      python -m fasbody.cell modes sole.stl --support base --up z --material 2e6,0.4,200 --out results/sole

      python -m fasbody.cell modes soles.msh --support region --held 3 --material 1=2e6,0.4,200 --material 1e7,0.4,300
    """
    check_count(modes)
    check_held(held, support)
    from fasbody.cell.body import body_modes, read_body

    materials = by_region("--material", map(named_material, material))
    meshed = read_body(body, unit=unit, up=up, size=size)
    with console.status("solving"):
        result = body_modes(meshed, materials, support, part=held, count=modes, way=solver)
    if out is not None:
        from fasbody.cell import figures
        from fasbody.cell.meshfile import write_browser, write_vtu

        write_whole(out / "body.json", to_json(result.document()))
        write_vtu(out / "body.vtu", result, meshed.tags, result.unit[1])
        write_browser(out / "body.npz", result, inner=None)
        figures.save(figures.mode_shapes(result), out / "modes.png")
        console.print(f"written: {out}")
    report(result.document(), str(result), as_json)


@app.command("response")
def shake_a_body(
    body: BodyArgument,
    material: MaterialOption,
    relaxation: Annotated[
        list[str],
        typer.Option(help=r"relaxing share of stiffness, relaxation time \[s]; of one region: REGION=G,TAU"),
    ],
    support: SupportOption = "base",
    held: HeldOption = None,
    unit: UnitOption = "mm",
    up: UpOption = "y",
    size: BodySizeOption = None,
    modes: Annotated[int, typer.Option("--modes", help="modes in the basis; the highest ends the range")] = 20,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Damping of any viscoelastic body, and its response: to a shaken support, or, of a free body, to a force.

    Examples:
      python -m fasbody.cell response sole.stl --up z --material 2e6,0.4,200 --relaxation 0.5,0.001

      python -m fasbody.cell response calcaneus --support free --material 7.3e9,0.3,1500 --relaxation 0.1,1e-5
    """
    check_count(modes)
    check_held(held, support)
    from fasbody.cell.body import read_body, shaken_body

    materials = by_region("--material", map(named_material, material))
    solids = by_region("--relaxation", map(named_solid, relaxation))
    meshed = read_body(body, unit=unit, up=up, size=size)
    with console.status("solving"):
        result = shaken_body(meshed, materials, solids, support, part=held, count=modes)
    if out is not None:
        from fasbody.cell import figures

        write_whole(out / "shake.json", to_json(result.document()))
        figures.save(figures.response(result.response), out / "shake.png")
        console.print(f"written: {out}")
    report(result.document(), str(result), as_json)


app.command("sweep")(command("reproduction.cell.command:sweep"))
app.command("verify")(command("reproduction.cell.command:verify"))


@app.command("shake")
def shake(
    preset_name: PresetOption = "si",
    shape_text: ShapeOption = "100x40",
    modulus: ModulusOption = None,
    modes: Annotated[int, typer.Option("--modes", help="modes in the basis; the highest ends the range")] = 40,
    size: SizeOption = 3.5,
    g: Annotated[float, typer.Option(help="relaxing share of stiffness: instantaneous / rest - 1")] = 0.5,
    tau: Annotated[float, typer.Option(help=r"relaxation time \[s]")] = 2e-5,
    nucleus_g: Annotated[float | None, typer.Option(help="the same for the nucleus")] = None,
    nucleus_tau: Annotated[float | None, typer.Option(help=r"the same for the nucleus \[s]")] = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Beyond the thesis: damping of a viscoelastic cell, and its response to a shaken base from 5 Hz up.

    Examples:
      python -m fasbody.cell shake

      python -m fasbody.cell shake --g 1 --tau 0.001 --nucleus-tau 0.01 --out results/cell
    """
    from fasbody.cell.viscoelastic import ReducedCell, StandardLinearSolid, damped_modes

    with named("--g, --tau"):
        solid = StandardLinearSolid(g, tau)
    with named("--nucleus-g, --nucleus-tau"):
        other = StandardLinearSolid(g if nucleus_g is None else nucleus_g, tau if nucleus_tau is None else nucleus_tau)
    chosen = chosen_preset(preset_name, modulus)
    dome = Dome(*shape(shape_text), chosen.height_um)
    check_count(modes)
    from fasbody.cell.assembly import assemble
    from fasbody.cell.mesh import dome_mesh
    from fasbody.cell.modal import CellModel
    from fasbody.cell.viscoelastic import base_response

    with console.status("meshing and solving"):
        model = CellModel(assemble(dome_mesh(dome, mesh_size(size))), chosen.materials, chosen.metres_per_um)
        cell = ReducedCell.of(model, modes)
        damped = damped_modes(cell, (solid, other))
        response = base_response(cell, (solid, other), damped.grid(5, cell.reach_hz))
    document = {"preset": chosen.name, "dof": model.assembly.dof, "damped_modes": damped.document()}
    document["response"] = response.document()
    if out is not None:
        from fasbody.cell import figures

        write_whole(out / "shake.json", to_json(document))
        figures.save(figures.response(response), out / "shake.png")
        console.print(f"written: {out}")
    report(document, f"{damped}\n{response}", as_json)


def chosen_preset(name: str, modulus: float | None) -> Preset:
    """The preset of that name, with another modulus of the cytoplasm [Pa] if one is given."""
    chosen = preset(name)
    with named("--modulus, cytoplasm"):
        return chosen if modulus is None else chosen.with_modulus(modulus)


def chosen_materials(chosen: Preset, nucleus_E: float | None, nu: float | None, rho: float | None) -> Preset:
    """The preset with modulus of the nucleus [Pa], Poisson's ratio and density [kg/m^3] of both, where given."""
    for name, changes in (("--poisson", {"nu": nu}), ("--density", {"rho": rho})):
        values: dict[str, float] = {key: value for key, value in changes.items() if value is not None}
        with named(name):
            cytoplasm, nucleus = (replace(material, **values) for material in chosen.materials)
        chosen = replace(chosen, cytoplasm=cytoplasm, nucleus=nucleus)
    if nucleus_E is None:
        return chosen
    with named("--nucleus-modulus"):
        return replace(chosen, nucleus=replace(chosen.nucleus, E=nucleus_E))


def named_material(text: str) -> "tuple[str | None, Material]":
    """Region and material from ``REGION=E,NU,RHO``, or None and the material of all from ``E,NU,RHO``."""
    return named_values("--material", text, "three numbers are needed, such as 17e9,0.3,1900.", Material)


def named_solid(text: str) -> "tuple[str | None, StandardLinearSolid]":
    """Region and solid from ``REGION=G,TAU``, or None and the solid of all from ``G,TAU``."""
    from fasbody.cell.viscoelastic import StandardLinearSolid

    return named_values("--relaxation", text, "two numbers are needed, such as 0.5,1e-3.", StandardLinearSolid)


def named_values(option: str, text: str, needed: str, kind: Callable[..., T]) -> tuple[str | None, T]:
    """Region and what its numbers make, or None and what those of all make.

    Raises:
        SettingError: the text does not have that form, or the numbers are invalid.
    """
    region, _, values = text.rpartition("=")
    with named(f"{option} {text}"):
        try:
            return region or None, kind(*map(float, values.split(",")))
        except (TypeError, ValueError):  # another count, or no numbers
            raise SettingError(needed) from None


def by_region(option: str, pairs: Iterable[tuple[str | None, T]]) -> dict[str | None, T]:
    """What is given of each region, and by None of all others.

    Raises:
        SettingError: a region is given twice.
    """
    values: dict[str | None, T] = {}
    for region, value in pairs:
        if region in values:
            whose = "all regions that have none of their own" if region is None else f"region {region}"
            raise SettingError(f"there is a {option} of {whose} already: give each once.")
        values[region] = value
    return values


def check_held(held: str | None, support: str) -> None:
    """Refuse a held part of a body that is supported otherwise."""
    if held is not None and support != "region":
        raise SettingError(f"--held {held} goes with --support region, and the support is {support}.")


def check_together(context: typer.Context, mesh: Path | None) -> None:
    """Refuse options that have no meaning beside the others given, or before a sub-command.

    Raises:
        SettingError: naming the option.
    """
    flags = {
        option.name: option.opts[0]
        for option in context.command.params
        if option.name and getattr(context.get_parameter_source(option.name), "name", "") == "COMMANDLINE"
    }

    def refuse(names: set[str], why: str) -> None:
        for name in sorted(names & set(flags)):
            raise SettingError(f"{flags[name]} {why}.")

    if context.invoked_subcommand is not None:
        refuse(set(flags), f"stands before {context.invoked_subcommand!r} and would be lost: write it after")
    elif mesh is None:
        refuse(OF_MESH, "needs --mesh")
    else:
        refuse(OF_DOME, "shapes the dome, not the cell of --mesh: leave it out")
        if mesh.suffix.lower() != ".stl":
            refuse(OF_STL, f"serves an .stl surface; {mesh} brings its own tetrahedra: leave it out")


def _write(out: Path, analysis: "Analysis") -> None:
    from fasbody.cell import figures
    from fasbody.cell.meshfile import write_browser, write_vtu

    write_whole(out / "cell.json", to_json(analysis.document()))
    write_vtu(out / "cell.vtu", analysis)
    write_browser(out / "cell.npz", analysis)
    figures.save(figures.mode_shapes(analysis), out / "modes.png")
    figures.save(figures.mesh_views(analysis), out / "mesh.png")
    console.print(f"written: {out}")


if __name__ == "__main__":
    command_line(app)
