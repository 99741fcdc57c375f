"""`fasbody rivals`: rival models compared on the same recordings."""

import sys
from pathlib import Path
from shlex import join
from typing import Annotated

import typer

from fasbody.console import command_line, console, make_folder, print_json, stages
from identification.options import AddedMass, BodyMass, Data, DelayStd, GainStd, Mapping, MassStd

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    data: Data = None,
    model: Annotated[str, typer.Option(help="two-mass model, or its file")] = "two_dof",
    rival: Annotated[list[Path] | None, typer.Option(help="your own MJCF file to compare; repeat for several")] = None,
    compare: Annotated[
        str | None,
        typer.Option(
            help="models to compare it with: exponential, polynomial, relaxing, mount, third, load (default: all)"
        ),
    ] = None,
    rungs: Annotated[str | None, typer.Option(hidden=True, help="earlier name of --compare")] = None,
    body_mass: BodyMass = None,
    added_mass: AddedMass = None,
    study: Mapping = None,
    mass_std: MassStd = None,
    gain_std: GainStd = None,
    delay_std: DelayStd = None,
    write_model: Annotated[Path | None, typer.Option(help="folder for each fitted model as an MJCF file")] = None,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
    out: Annotated[
        Path | None, typer.Option(help="folder for report.html, rivals.csv, rivals.json and figures")
    ] = None,
) -> None:
    """Compare other models on the same recordings, by BIC and by predictions of held-out recordings.

    Examples:
      fasbody rivals

      fasbody rivals my_study --rival my_foot.xml --out results

      fasbody rivals my_study --compare relaxing,mount --write-model models

      fasbody rivals bare.csv loaded.csv --body-mass 72.5 --added-mass 0 --added-mass 2.3
    """
    import mjcf
    from fasbody import page
    from fasbody.foot.model import load
    from fasbody.recording.sources import gather
    from fasbody.recording.study import BUNDLED
    from identification.parameters import names
    from identification.rivals.compare import compare_rivals
    from identification.rivals.result import SPARED

    source, recordings, _ = gather(data or [BUNDLED], body_mass, added_mass, study)
    foot = load(model)
    for folder in (write_model, out):
        if folder is not None:
            make_folder(folder)
    with stages() as advance:
        result = compare_rivals(
            recordings, foot, models=names(compare or rungs), files=rival or (), mass_std=mass_std, gain_std=gain_std,
            delay_std_s=delay_std, source=source, advance=advance,
        )  # fmt: skip
    if json_:
        print_json(result.document())
    else:
        page.show(result.sheet(), "model", "branch", "adequate", spared=SPARED)
    if write_model is not None:
        from identification.rivals.mjcf import write_models

        file = mjcf.path(model) if model in mjcf.names() else Path(model)
        for path, gap in write_models(result, file, write_model).items():
            console.print(f"{path}: MuJoCo moves as fitted to {gap:.1e} of the peak", soft_wrap=True)
    if out is not None:
        page.write(result, out, join(["fasbody", "rivals", *sys.argv[1:]]))


if __name__ == "__main__":
    command_line(app)
