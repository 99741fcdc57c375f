"""Command line of the cell and of other bodies: ``fasbody cell --help``."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fasbody.cell import options
from fasbody.cell.dome import Dome, Nucleus, shape
from fasbody.cell.materials import Material, Preset, preset
from fasbody.cell.options import by_region, named, report
from fasbody.console import command_line, console, stages, to_json, write_whole
from fasbody.exceptions import SettingError
from fasbody.lazy import command

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Options that only a dome, only a user's mesh, or only a closed surface has.
OF_DOME = {"--shape", "--height", "--profile", "--nucleus-centre", "--no-nucleus"}
OF_MESH = {"--um-per-unit", "--nucleus-tag", "--nucleus-surface"}
OF_STL = {"--size", "--nucleus-surface"}

app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)


@app.callback(invoke_without_command=True)
def analyse_cell(
    context: typer.Context,
    preset_name: options.PresetOption = "as-reproduced",
    shape_text: options.ShapeOption = "100x40",
    modulus: options.ModulusOption = None,
    modes: options.ModesOption = 10,
    size: options.SizeOption = 3.5,
    height: Annotated[float | None, typer.Option(help=r"height of the dome \[um]")] = None,
    profile: Annotated[str, typer.Option(help="ellipsoid or cap")] = "ellipsoid",
    nucleus_centre: Annotated[float, typer.Option(help=r"height of the nucleus' centre \[um]")] = 4.5,
    no_nucleus: Annotated[bool, typer.Option("--no-nucleus", help="leave the nucleus out")] = False,
    nucleus_modulus: Annotated[float | None, typer.Option(help="Young's modulus of the nucleus [Pa]")] = None,
    poisson: Annotated[float | None, typer.Option(help="Poisson's ratio of cytoplasm and nucleus")] = None,
    density: Annotated[float | None, typer.Option(help=r"density of cytoplasm and nucleus \[kg/m^3]")] = None,
    membrane: Annotated[bool, typer.Option("--membrane", help="add the elastic membrane of Table 5.1")] = False,
    filaments: Annotated[float, typer.Option(help="add a tensegrity with this many filaments per bar")] = 0.0,
    mesh: Annotated[Path | None, typer.Option(help="your own cell: .vtu, .msh or closed .stl, y up")] = None,
    um_per_unit: Annotated[float, typer.Option(help="micrometres in one length unit of --mesh")] = 1.0,
    nucleus_tag: Annotated[
        int | None,
        typer.Option(help="region number of the nucleus in --mesh", show_default="1, if there are several"),
    ] = None,
    nucleus_surface: Annotated[Path | None, typer.Option(help="closed .stl of the nucleus, for an .stl cell")] = None,
    solver: options.SolverOption = None,
    as_json: options.JsonOption = False,
    out: options.OutOption = None,
) -> None:
    """Natural frequencies and mode shapes of an adherent cell (Chapter 5 of the thesis).

    The presets say what the printed numbers mean: docs/cell.md. With --out, writes cell.json,
    cell.vtu (ParaView), cell.npz (for the browser) and the figures modes.png and mesh.png.

    Examples:
      fasbody cell

      fasbody cell --preset si --shape 67x60 --modulus 1000 --out results/cell

      fasbody cell --mesh my_cell.stl --preset si --json

      fasbody cell modes body.stl --material 2e6,0.4,200
    """
    check_together(context, mesh)
    if context.invoked_subcommand is not None:
        return
    chosen = chosen_preset(preset_name, modulus)
    cytoplasm, nucleus = chosen.materials
    for setting, field, value in (("poisson", "nu", poisson), ("density", "rho", density)):
        if value is not None:
            with named(setting):
                cytoplasm, nucleus = (replace(m, **{field: value}) for m in (cytoplasm, nucleus))
    if nucleus_modulus is not None:
        with named("nucleus_modulus"):
            nucleus = replace(nucleus, E=nucleus_modulus)
    chosen = replace(chosen, cytoplasm=cytoplasm, nucleus=nucleus)
    from fasbody.cell.analysis import analyse, assemblies
    from fasbody.cell.assembly import assemble
    from fasbody.cell.companion import pair
    from fasbody.cell.cytoskeleton import Tensegrity
    from fasbody.cell.membrane import Membrane
    from fasbody.cell.mesh import MeshSize
    from fasbody.cell.meshfile import read_mesh, write_browser, write_vtu

    settings: dict[str, Any] = {"count": modes, "way": solver}
    settings["membrane"] = Membrane() if membrane else None
    with named("filaments"):
        settings["cytoskeleton"] = Tensegrity(bundle=filaments) if filaments else None
    sizes = MeshSize.of(size)
    with console.status("meshing and solving"):
        if mesh is not None:
            fine, coarse = map(assemble, pair(read_mesh(
                mesh, um_per_unit=um_per_unit, nucleus_tag=nucleus_tag, nucleus=nucleus_surface,
                size=sizes,
            )))  # fmt: skip
        else:
            tall = chosen.height_um if height is None else height
            core = None if no_nucleus else Nucleus(centre=nucleus_centre)
            settings["dome"] = Dome(*shape(shape_text), tall, profile, core)
            fine, coarse = assemblies(settings["dome"], sizes)
        analysis = analyse(fine, coarse, chosen, **settings)
    if out is not None:
        from fasbody.cell.figures import mesh_views, mode_shapes

        write_vtu(out / "cell.vtu", analysis)
        write_browser(out / "cell.npz", analysis)
        figures = {"modes": mode_shapes(analysis), "mesh": mesh_views(analysis)}
        _write(out, "cell", analysis.document(), figures)
    report(analysis.document(), str(analysis), as_json)


@app.command("modes")
def modes_of_a_body(
    body: options.BodyArgument,
    material: options.MaterialOption,
    support: options.SupportOption = "free",
    held: options.HeldOption = None,
    unit: options.UnitOption = "mm",
    up: options.UpOption = "y",
    size: options.BodySizeOption = None,
    modes: options.ModesOption = 10,
    solver: options.SolverOption = None,
    as_json: options.JsonOption = False,
    out: options.OutOption = None,
) -> None:
    """Modes of any elastic body, free or fixed: a bone, an insole block, a shoe sole.

    The rigid motions of a free body are skipped. With --out, writes body.json, body.vtu
    (ParaView), body.npz (for fasbody view cell) and modes.png.

    Examples:
      fasbody cell modes calcaneus --material 7.3e9,0.3,1500 --size 5

      fasbody cell modes sole.stl --support base --up z --material 2e6,0.4,200

      fasbody cell modes soles.msh --support region --held 3 \
--material 1=2e6,0.4,200 --material 1e7,0.4,300
    """
    from fasbody.cell.body import STEPS, body_modes, read_body

    materials = by_region("material", material, Material, "17e9,0.3,1900")
    with stages() as advance:
        advance("meshing", 0, STEPS)
        meshed = read_body(body, unit=unit, up=up, size=size)
        result = body_modes(meshed, materials, support, part=held, count=modes, way=solver, advance=advance)
    if out is not None:
        from fasbody.cell.figures import mode_shapes
        from fasbody.cell.meshfile import write_browser, write_vtu

        write_vtu(out / "body.vtu", result, meshed.tags, result.unit[1])
        write_browser(out / "body.npz", result, inner=None)
        _write(out, "body", result.document(), {"modes": mode_shapes(result)})
    report(result.document(), str(result), as_json)


@app.command("response")
def shake_a_body(
    body: options.BodyArgument,
    material: options.MaterialOption,
    relaxation: options.RelaxationOption,
    support: options.SupportOption = "base",
    held: options.HeldOption = None,
    unit: options.UnitOption = "mm",
    up: options.UpOption = "y",
    size: options.BodySizeOption = None,
    modes: options.BasisOption = 20,
    as_json: options.JsonOption = False,
    out: options.OutOption = None,
) -> None:
    """Damped modes of any viscoelastic body, and its response to a shaken support or a force.

    Examples:
      fasbody cell response sole.stl --up z --material 2e6,0.4,200 --relaxation 0.5,0.001

      fasbody cell response calcaneus --support free --material 7.3e9,0.3,1500 \
--relaxation 0.1,1e-5
    """
    from fasbody.cell.body import STEPS, read_body, shaken_body
    from fasbody.cell.viscoelastic import StandardLinearSolid

    materials = by_region("material", material, Material, "17e9,0.3,1900")
    solids = by_region("relaxation", relaxation, StandardLinearSolid, "0.5,1e-3")
    with stages() as advance:
        advance("meshing", 0, STEPS)
        meshed = read_body(body, unit=unit, up=up, size=size)
        result = shaken_body(meshed, materials, solids, support, part=held, count=modes, advance=advance)
    if out is not None:
        from fasbody.cell.figures import response

        _write(out, "shake", result.document(), {"shake": response(result.response)})
    report(result.document(), str(result), as_json)


app.command("sweep")(command("reproduction.cell.command:sweep"))
app.command("verify")(command("reproduction.cell.command:verify"))


@app.command("shake")
def shake(
    preset_name: options.PresetOption = "si",
    shape_text: options.ShapeOption = "100x40",
    modulus: options.ModulusOption = None,
    modes: options.BasisOption = 40,
    size: options.SizeOption = 3.5,
    g: Annotated[float, typer.Option(help="relaxing share of stiffness: instantaneous / rest - 1")] = 0.5,
    tau: Annotated[float, typer.Option(help=r"relaxation time \[s]")] = 2e-5,
    nucleus_g: Annotated[float | None, typer.Option(help="the same for the nucleus")] = None,
    nucleus_tau: Annotated[float | None, typer.Option(help=r"the same for the nucleus \[s]")] = None,
    as_json: options.JsonOption = False,
    out: options.OutOption = None,
) -> None:
    """Damped modes and response of a viscoelastic cell on a shaken base.

    Examples:
      fasbody cell shake

      fasbody cell shake --g 1 --tau 0.001 --nucleus-tau 0.01 --out results/cell
    """
    from fasbody.cell.assembly import assemble
    from fasbody.cell.mesh import MeshSize
    from fasbody.cell.mesher import dome_mesh
    from fasbody.cell.modal import CellModel
    from fasbody.cell.viscoelastic import (
        ReducedCell,
        StandardLinearSolid,
        base_response,
        damped_modes,
    )

    solid = nucleus = StandardLinearSolid(g, tau)
    changes = ("nucleus_g", "g", nucleus_g), ("nucleus_tau", "tau", nucleus_tau)
    for setting, field, value in changes:
        if value is not None:
            with named(setting):
                nucleus = replace(nucleus, **{field: value})
    chosen = chosen_preset(preset_name, modulus)
    dome = Dome(*shape(shape_text), chosen.height_um)
    sizes = MeshSize.of(size)
    with console.status("meshing and solving"):
        assembly = assemble(dome_mesh(dome, sizes))
        cell = ReducedCell.of(CellModel(assembly, chosen.materials, chosen.metres_per_um), modes)
        damped = damped_modes(cell, (solid, nucleus))
        response = base_response(cell, (solid, nucleus), damped.grid(5, cell.reach_hz))
    document = {"preset": chosen.name, "dof": assembly.dof, "damped_modes": damped.document()}
    document["response"] = response.document()
    if out is not None:
        from fasbody.cell.figures import response as drawn

        _write(out, "shake", document, {"shake": drawn(response)})
    report(document, f"{damped}\n{response}", as_json)


def chosen_preset(name: str, modulus: float | None) -> Preset:
    """The preset of that name, with another modulus of the cytoplasm [Pa] if one is given."""
    chosen = preset(name)
    with named("modulus"):
        return chosen if modulus is None else chosen.with_modulus(modulus)


def check_together(context: typer.Context, mesh: Path | None) -> None:
    """Refuse options that have no meaning beside the others given, or before a sub-command.

    Raises:
        SettingError: naming the option.
    """
    typed = {
        option.opts[0]
        for option in context.command.params
        if getattr(context.get_parameter_source(option.name or ""), "name", "") == "COMMANDLINE"
    }
    wrong, why = typed & OF_MESH, "needs --mesh"
    if context.invoked_subcommand is not None:
        wrong = typed
        why = f"stands before {context.invoked_subcommand!r} and would be lost: write it after"
    elif mesh is not None:
        wrong, why = typed & OF_DOME, "shapes the dome, not the cell of --mesh: leave it out"
        if not wrong and mesh.suffix.lower() != ".stl":
            wrong = typed & OF_STL
            why = f"serves an .stl surface; {mesh} brings its own tetrahedra: leave it out"
    for option in sorted(wrong):
        raise SettingError(f"{why}.", option.lstrip("-").replace("-", "_"))


def _write(out: Path, name: str, document: dict[str, Any], figures: "dict[str, Figure]") -> None:
    from fasbody.presentation import write_figure

    write_whole(out / f"{name}.json", to_json(document))
    for figure, drawn in figures.items():
        write_figure(drawn, out / f"{figure}.png")
    console.print(f"written: {out}")


if __name__ == "__main__":
    command_line(app)
