"""The mode shapes of the cell, or of any elastic body, in a browser: `fasbody view cell`."""

import asyncio
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from fasbody.console import command_line, console, progress_bar
from fasbody.exceptions import SettingError

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

#: Shown without an argument, if it is there.
USUAL = Path("results/cell/cell.npz")
#: Element size of the result that is computed when there is none [um].
QUICK = 5.0


@app.command()
def main(
    result: Annotated[
        Path | None, typer.Argument(help="result folder of fasbody cell, or of its command modes")
    ] = None,
    mode: Annotated[int, typer.Option(help="mode that is shown first")] = 1,
    export: Annotated[Path | None, typer.Option(help="write a .html, .png, .gif or .mp4 file, and quit")] = None,
    port: Annotated[int, typer.Option(help="port of the server; 0 takes a free one")] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", "--open/--no-open", help="open the browser")
    ] = True,
    json: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Watch the mode shapes of a cell, a bone or any body in slow motion.

    Without a result it shows results/cell, or a quick one that it computes.

    Examples:
      fasbody view cell

      fasbody view cell results/cell --mode 3

      fasbody view cell results/calcaneus   # of fasbody cell modes calcaneus --out results/calcaneus

      fasbody view cell results/cell --export cell.html
    """
    if mode < 1:  # before a result is computed for it
        raise SettingError(f"--mode is {mode}, but the first mode of a result is 1.")
    with tempfile.TemporaryDirectory() as folder:
        if result is None:
            result = USUAL if USUAL.is_file() else quick(Path(folder))
        _show(result, mode, export, port, browser, json)


def _show(result: Path, mode: int, export: Path | None, port: int, browser: bool, json: bool) -> None:
    from viz.modes import ModeShow

    show = ModeShow(result, mode)
    console.print(f"showing {show.shapes.file}: {show.shapes.title()}")
    if export is not None:
        from viz.exported import export_to

        export_to(show, export, json=json)
        return
    from viz.server import serve

    asyncio.run(serve(show, show.shapes.body or "the cell", port=port, browser=browser, watch=True, json=json))


def quick(folder: Path) -> Path:
    """Compute the cell of `fasbody cell` on a coarser mesh, without error estimate, into a folder."""
    console.print(f"no result was named and there is no {USUAL}: computing a quick one, elements of {QUICK:g} um")
    from fasbody.cell.analysis import analyse
    from fasbody.cell.assembly import assemble
    from fasbody.cell.dome import Dome
    from fasbody.cell.materials import preset
    from fasbody.cell.mesh import MeshSize
    from fasbody.cell.mesher import dome_mesh
    from fasbody.cell.meshfile import write_browser

    chosen = preset("as-reproduced")
    dome = Dome(height=chosen.height_um)
    with progress_bar() as progress:
        task = progress.add_task("meshing", total=3)
        mesh = dome_mesh(dome, MeshSize.of(QUICK))
        progress.update(task, advance=1, description="assembling")
        fine = assemble(mesh)
        progress.update(task, advance=1, description="solving")
        analysis = analyse(fine, None, chosen, dome=dome)
        progress.advance(task)
    return write_browser(folder / "cell.npz", analysis)


if __name__ == "__main__":
    command_line(app)
