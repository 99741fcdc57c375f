"""The vibrating foot in a browser: `fasbody view`."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from fasbody.console import command_line, console
from fasbody.exceptions import SettingError

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
#: Without a name: the arch whose dampers bend.
DEFAULT_MODEL = "foot_arch_bent"


@app.command()
def main(
    model: Annotated[
        str | None,
        typer.Option(
            help="shipped model or MJCF file; foot_arch@25 is an arch 25 mm high (default: the model of --result, "
            "or else my_foot.xml, a copy of the arch that is written to this folder)"
        ),
    ] = None,
    compare: Annotated[str, typer.Option(help="second model, drawn transparent")] = "",
    frequency: Annotated[float | None, typer.Option(help="frequency of the shaker [Hz] (default 20)")] = None,
    peak_to_peak: Annotated[
        float | None, typer.Option(help=r"acceleration of the table \[m/s^2] (default 17.9)")
    ] = None,
    added_mass: Annotated[float, typer.Option(help=r"mass on the knee \[kg]")] = 0.0,
    sweep: Annotated[bool, typer.Option(help="sweep from 5 to 50 Hz in 4 s, in place of the sine")] = False,
    recording: Annotated[
        Path | None, typer.Option(help="recording that drives the table; its malleolus is drawn transparent")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(help=r"length of the recording or sweep to show \[s] (default 4)")
    ] = None,
    study: Annotated[Path | None, typer.Option(help="study.toml that describes the columns of the recording")] = None,
    result: Annotated[
        Path | None,
        typer.Option(help="result.json of a fit; its model is used unless --model names another"),
    ] = None,
    slow: Annotated[float, typer.Option(help="slow motion: how many times slower than real time")] = 20.0,
    amplify: Annotated[
        float | None, typer.Option(help="factor by which the motion is enlarged (default: so that it is visible)")
    ] = None,
    watch: Annotated[
        bool | None,
        typer.Option(help="reload the model whenever its file is saved (default for your own files)"),
    ] = None,
    export: Annotated[Path | None, typer.Option(help="write a .html, .png, .gif or .mp4 file, and quit")] = None,
    port: Annotated[int, typer.Option(help="port of the server; 0 takes a free one")] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", "--open/--no-open", help="open the browser")
    ] = True,
    json: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Watch a foot on the shaker in slow motion, and move sliders to change the model.

    Examples:
      fasbody view

      fasbody view --model my_foot.xml

      fasbody view --model two_dof --recording 20hz.csv --result results/result.json

      fasbody view --compare foot_arch@25

      fasbody view --export foot.html
    """
    for name, value in (("--slow", slow), ("--amplify", amplify), ("--seconds", seconds)):
        if value is not None and not 0 < value < 1e4:
            raise SettingError(f"{name} is {value:g}, but must be between 0 and 10000.")
    if not 0 <= port <= 65535:
        raise SettingError(f"--port is {port}, but must be between 0 (a free one) and 65535.")
    if watch and model is not None and not Path(model.partition("@")[0]).is_file():
        raise SettingError(f"--watch needs a model in a file of your own, not {model!r}; copy a shipped one first.")
    if watch and export is not None:
        raise SettingError("--watch and --export exclude each other.")
    if study is not None and recording is None:
        raise SettingError("--study says what the columns of --recording are; give both, or neither.")
    look = {"slow": slow, "amplify": amplify}
    arch_copy = None  # a copy of the arch to edit, made once nothing of the input is refused
    if model is None and result is not None:
        from viz.fitted import model_of

        model = model_of(result) or None
    if model is None:
        model = DEFAULT_MODEL
        if export is None and watch is not False:
            arch_copy = Path.cwd() / "my_foot.xml"
    if arch_copy is not None and arch_copy.exists():
        model, arch_copy = str(arch_copy), None
    show = _show(model, compare, frequency, peak_to_peak, added_mass, sweep, (recording, study), seconds, result, look)
    if export is not None:
        from viz.exported import export_to

        export_to(show, export, json=json)
        return
    from viz.bench import Bench
    from viz.server import serve

    if arch_copy is not None:
        _copy_arch(arch_copy)
        show.models[0] = str(arch_copy)
        show.reload()
    follow, bench = watch is not False, Bench(show, results=result.parent if result else None)
    asyncio.run(serve(show, "the foot", port=port, browser=browser, watch=follow, json=json, bench=bench))


def _copy_arch(file: Path) -> None:
    import mjcf
    from fasbody.console import write_whole

    write_whole(file, mjcf.text(DEFAULT_MODEL))
    console.print(f"{file.name} is a copy of the arch that you can edit; the page reloads it when it changes")


def _show(
    model: str, compare: str, frequency: float | None, peak_to_peak: float | None, added_mass: float, sweep: bool,
    recorded: tuple[Path | None, Path | None], seconds: float | None, result: Path | None,
    look: Mapping[str, float | None],
) -> Any:  # fmt: skip
    from viz import fitted
    from viz.excitation import SWEEP_S, Excitation
    from viz.feet import Show
    from viz.load import load_foot
    from viz.settings import Settings

    recording, study = recorded
    if sweep and recording:
        raise SettingError("--sweep and --recording exclude each other.")
    for name, value in (("--frequency", frequency), ("--peak-to-peak", peak_to_peak)):
        if value is not None and (sweep or recording):
            raise SettingError(f"{name} applies to the sine; leave it out with --{'sweep' if sweep else 'recording'}.")
    if seconds is not None and not (sweep or recording):
        raise SettingError("--seconds goes with --recording or --sweep; a sine is shown for one period.")
    excitation = Excitation.swept(seconds or SWEEP_S) if sweep else Excitation()
    if recording is not None:
        excitation = Excitation.recorded(recording, seconds, study)
    fit = fitted.read(result, load_foot(model).parameters) if result else {}
    best: dict[str, Any] = fit["branches"][0] if fit else {"values": {}, "delay_s": 0.0}
    if recording is not None and not added_mass and excitation.recording is not None:
        made = excitation.recording.condition
        fitted_under = {Path(r["file"]).name: r["added_mass_kg"] for r in fit.get("recordings", [])}
        loose = fitted_under.get(recording.name) or 0.0  # a file that lies in no study says nothing of its load
        added_mass = made.added_mass_kg if made.body_mass_kg else loose
    settings = Settings(
        Settings.frequency if frequency is None else frequency,
        Settings.peak_to_peak if peak_to_peak is None else peak_to_peak,
        added_mass, best["values"], best["delay_s"],
    )  # fmt: skip
    with console.status("loading the model and its meshes"):
        return Show([model, *([compare] if compare else [])], excitation, settings, look, fit)


if __name__ == "__main__":
    command_line(app)
