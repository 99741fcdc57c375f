"""The vibrating foot in a browser: `python -m viz.foot`."""

import asyncio
import json as json_module
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fasbody.console import command_line, console
from fasbody.exceptions import InputFileError, SettingError

if TYPE_CHECKING:
    from fasbody.foot.parameters import Parameter

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    model: Annotated[str, typer.Option(help="model or MJCF file; foot_arch@25 is an arch 25 mm high")] = "foot_arch",
    compare: Annotated[str, typer.Option(help="a second model, shown as a ghost")] = "",
    frequency: Annotated[float | None, typer.Option(help="of the shaker [Hz]; 20 unless given")] = None,
    peak_to_peak: Annotated[
        float | None, typer.Option(help=r"acceleration of the table \[m/s^2]; 17.9 unless given")
    ] = None,
    added_mass: Annotated[float, typer.Option(help=r"on the knee \[kg]")] = 0.0,
    sweep: Annotated[bool, typer.Option(help="a swept sine, 5 to 50 Hz in 4 s, in place of the sine")] = False,
    recording: Annotated[Path | None, typer.Option(help="drive the table by it; its ankle is a ghost")] = None,
    seconds: Annotated[
        float | None, typer.Option(help=r"how much of the recording, 1 unless given, or length of the sweep, 4 \[s]")
    ] = None,
    result: Annotated[Path | None, typer.Option(help="parameters of a fit, result.json")] = None,
    slow: Annotated[float, typer.Option(help="slow motion, times")] = 20.0,
    amplify: Annotated[float, typer.Option(help="motion shown larger, times")] = 10.0,
    watch: Annotated[bool, typer.Option(help="load the model again whenever its file is saved")] = False,
    export: Annotated[Path | None, typer.Option(help="write .html, .png, .gif or .mp4 and end")] = None,
    port: Annotated[int, typer.Option(help="0 takes a free one")] = 0,
    browser: Annotated[bool, typer.Option(help="open the browser")] = True,
    json: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Watch a foot on the shaker in slow motion; move a slider and the real model runs again.

    Examples:
      python -m viz.foot

      python -m viz.foot --model my_foot.xml --watch

      python -m viz.foot --compare foot_arch@25

      python -m viz.foot --export foot.html
    """
    for name, value in (("--slow", slow), ("--amplify", amplify), ("--seconds", seconds)):
        if value is not None and not 0 < value < 1e4:
            raise SettingError(f"{name} is {value:g}, but must be between 0 and 10000.")
    if not 0 <= port <= 65535:
        raise SettingError(f"--port is {port}, but must be between 0 (a free one) and 65535.")
    if watch and export is not None:
        raise SettingError("--watch and --export exclude each other: an exported file follows nothing.")
    look = {"slow": slow, "amplify": amplify}
    show = _show(model, compare, frequency, peak_to_peak, added_mass, sweep, recording, seconds, result, look)
    if export is not None:
        from viz.exported import export_to

        export_to(show, export, json=json)
        return
    file = Path(model.partition("@")[0])
    if watch and not file.is_file():
        raise SettingError(f"--watch needs a model in a file of your own, not {model!r}; copy a shipped one first.")
    from viz.server import serve

    asyncio.run(serve(show, "the foot", port=port, browser=browser, watch=watch, json=json))


def _show(
    model: str, compare: str, frequency: float | None, peak_to_peak: float | None, added_mass: float, sweep: bool,
    recording: Path | None, seconds: float | None, result: Path | None, look: Mapping[str, float],
) -> Any:  # fmt: skip
    from viz.feet import Show
    from viz.load import load_foot
    from viz.settings import RECORDED_S, SWEEP_S, Excitation, Settings

    if sweep and recording:
        raise SettingError("--sweep and --recording exclude each other.")
    for name, value in (("--frequency", frequency), ("--peak-to-peak", peak_to_peak)):
        if value is not None and (sweep or recording):
            raise SettingError(f"{name} is of the sine; leave it out with --{'sweep' if sweep else 'recording'}.")
    if seconds is not None and not (sweep or recording):
        raise SettingError("--seconds is of a --recording or a --sweep; a sine is shown for one period.")
    excitation = Excitation.swept(seconds or SWEEP_S) if sweep else Excitation()
    if recording is not None:
        excitation = Excitation.recorded(recording, seconds or RECORDED_S)
    values = parameters_of(result, load_foot(model).parameters) if result else {}
    settings = Settings(
        Settings.frequency if frequency is None else frequency,
        Settings.peak_to_peak if peak_to_peak is None else peak_to_peak, added_mass, values,
    )  # fmt: skip
    with console.status("loading the model and its meshes"):
        return Show([model, *([compare] if compare else [])], excitation, settings, look)


def parameters_of(result: Path, parameters: "Mapping[str, Parameter]") -> dict[str, float]:
    """Values of a fit's result.json for a model's parameters, by thesis symbol.

    Raises:
        InputFileError: no such file, it is no result, or it holds none of the model's parameters.
        SettingError: a value is no number or outside the bounds that the model declares.
    """
    valid = "give the result.json of python -m identification.fit"
    from viz.settings import within

    try:
        entries = json_module.loads(result.read_text())["parameters"]
        values = {name: float(entries[p.key]["value"]) for name, p in parameters.items() if p.key in entries}
    except OSError as error:
        raise InputFileError(result, f"cannot be read ({error.strerror})", valid) from None
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        raise InputFileError(result, "is not a result", valid) from None
    if not values:
        raise InputFileError(result, "holds no parameter of this model", "give the --model that was fitted")
    for name, value in values.items():
        if not isfinite(value):
            raise SettingError(f"{result}: {name} is {value}, but must be a finite number.")
        within(parameters[name], value, result)
    return values


if __name__ == "__main__":
    command_line(app)
