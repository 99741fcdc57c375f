"""`python -m identification.plan`: the next recording worth making, a whole session, and the session itself."""

import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from shlex import join
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from fasbody.console import command_line, console, make_folder, print_json, results, run_app
from fasbody.exceptions import AcquisitionError, SettingError, Stopped, unknown
from fasbody.foot.shaker import PEAK_TO_PEAK
from identification.options import DelayStd, GainStd, MassStd

if TYPE_CHECKING:
    from fasbody.presentation import Presented
    from fasbody.recording.recording import Recording
    from identification.plan.director import Director
    from identification.plan.prior import Person
    from identification.plan.shaker import Shaker

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

_Data = Annotated[
    list[Path] | None, typer.Argument(help="earlier recordings: study folder, or CSV files", show_default="none")
]
_Whose = Annotated[
    str | None, typer.Option("--subject", help="whose recordings of an earlier study of several people count")
]
_Posture = Annotated[str | None, typer.Option(help="in which posture, of several")]
_Model = Annotated[str, typer.Option(help="two-mass model, or its file")]
_BodyMass = Annotated[float | None, typer.Option(help="body mass in kg (72.57 unless a recording gives it)")]
_Ask = Annotated[
    list[str] | None,
    typer.Option(
        help="NAME=SHARE, half-width of a 95 % interval, for example k_T=0.05; repeat for several. What is not named "
        "is not asked for. thesis: all as narrow as its three loads would make them here",
        show_default="k_T=0.03, k_F=0.03, c_11=0.06, c_21=0.06",
    ),
]


def _finite(minutes: float) -> float:
    """Minutes that end."""
    if not minutes < 1e4:
        raise SettingError(f"--minutes is {minutes:g}; give a number above 0 and below 10000.")
    return minutes


_Minutes = Annotated[float, typer.Option(help="most minutes of shaking", callback=_finite)]
_Recordings = Annotated[int, typer.Option(help="recordings at most", min=1)]
_Frequencies = Annotated[str, typer.Option(help="START:STOP:STEP in Hz")]
_Loads = Annotated[str, typer.Option(help="masses for the knee in kg, separated by commas")]
_Amplitude = Annotated[float, typer.Option(help="largest amplitude of the base in m/s^2, half of peak to peak")]
_Amplitudes = Annotated[str | None, typer.Option(help="amplitudes to try, separated by commas (default: the largest)")]
_Displacement = Annotated[float, typer.Option(help="largest travel of the base in m, peak to peak")]
_Force = Annotated[float | None, typer.Option(help="largest force of the shaker in N")]
_Table = Annotated[float, typer.Option(help="moving mass of the shaker in kg, for --force")]
_Kinds = Annotated[str, typer.Option(help="sine, multisine; separated by commas")]
_Sensors = Annotated[str, typer.Option(help="accelerometers that are worn, e.g. malleolus,foot")]
_Seconds = Annotated[float, typer.Option(help="length of a recording in s")]
_Noise = Annotated[
    float, typer.Option(help="noise of a sensor, rms of a sample in m/s^2, until recordings determine it")
]
_Repeatability = Annotated[
    float,
    typer.Option(metavar="SHARE", help="relative scatter of a harmonic between recordings, until they determine it"),
]
_Exclude = Annotated[
    str | None,
    typer.Option(help="nuisances to exclude, as in a fit: mount, relaxation, load, share, rocking, drift, or all"),
]
_Draws = Annotated[int, typer.Option(help="feet to average over (default 32, after recordings 12)")]
_Seed = Annotated[int, typer.Option(min=0, help="seed of the drawn feet")]
_Json = Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")]

#: --ask with this word asks for what the thesis' three loads would leave.
_AS_THESIS = "thesis"
#: A third of the thesis' recordings, and as long as it shook [min].
RECORDINGS, MINUTES = 9, 4.5
#: The body mass where nobody says one: that of the laboratory's subject 16 [kg].
BODY_MASS_KG = 72.57


@app.command()
def propose(
    data: _Data = None,
    subject: _Whose = None,
    posture: _Posture = None,
    model: _Model = "two_dof",
    body_mass: _BodyMass = None,
    ask: _Ask = None,
    minutes: _Minutes = MINUTES,
    recordings: _Recordings = RECORDINGS,
    frequencies: _Frequencies = "10:50:2",
    loads: _Loads = "0,2.3,4.5",
    amplitude: _Amplitude = 0.5 * PEAK_TO_PEAK,
    amplitudes: _Amplitudes = None,
    displacement: _Displacement = 0.008,
    force: _Force = None,
    table_mass: _Table = 5.0,
    kinds: _Kinds = "sine",
    sensors: _Sensors = "malleolus",
    seconds: _Seconds = 10.0,
    noise: _Noise = 0.5,
    repeatability: _Repeatability = 0.03,
    exclude: _Exclude = None,
    mass_std: MassStd = None,
    gain_std: GainStd = None,
    delay_std: DelayStd = None,
    draws: _Draws = 0,
    seed: _Seed = 0,
    json_: _Json = False,
    protocol: Annotated[
        Path | None, typer.Option(help="write the steps to this file, which python -m fasbody.acquire --plan runs")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="folder for report.html, protocol.json, plan.json, plan.csv and figures")
    ] = None,
) -> None:
    """Plan what to record next: a session that decides between the mirror feet and narrows the intervals.

    Examples:
      python -m identification.plan --body-mass 80

      python -m identification.plan my_study --ask k_T=0.05 --ask k_F=0.05 --out next

      python -m identification.plan my_study --subject 3 --posture midstance

      python -m identification.plan --ask thesis --out as_thesis

      python -m identification.plan --frequencies 15:40:5 --loads 0,5 --displacement 0.004 --protocol steps.json

      python -m identification.plan --exclude all --sensors malleolus,foot --json

      python -m identification.plan run --simulate --auto --out my_study
    """
    from identification.parameters import names
    from identification.plan.result import planned

    began = time.perf_counter()
    shaker = _shaker(
        frequencies, loads, amplitude_m_s2=amplitude, amplitudes_m_s2=_numbers(amplitudes, "--amplitudes"),
        displacement_m=displacement, force_n=force, table_kg=table_mass, kinds=names(kinds) or (),
        sensors=names(sensors) or (), seconds=seconds, noise_m_s2=noise, repeatability=repeatability,
    )  # fmt: skip
    if not 60 * minutes >= seconds:
        raise SettingError(f"--minutes {minutes:g} leaves no room for a recording of {seconds:g} s; give more.")
    if (subject or posture) and not data:
        raise SettingError("--subject and --posture choose among earlier recordings; name their study.")
    earlier = _of(_earlier(data, body_mass), subject, posture)
    person = _person(model, body_mass, earlier, exclude, mass_std, gain_std, delay_std)
    director = _director(person, shaker, ask, earlier, seed, draws)
    if out is not None:
        make_folder(out)
    result = planned(director, recordings, 60 * minutes, time.perf_counter() - began)
    if protocol is not None:
        result.protocol.write(protocol)
    if json_:
        print_json(result.document())
    else:
        show(result)
    if out is not None:
        from identification import page  # its figures take seconds that the table need not wait

        words = sys.argv[2:] if sys.argv[1:2] == ["propose"] else sys.argv[1:]
        page.write(result, out, join(["fasbody", "plan", *words]))
        console.print(
            f"report: [bold]{out}/report.html[/], with protocol.json, plan.json, plan.csv and figures beside it",
            soft_wrap=True,
        )


@app.command()
def run(
    out: Annotated[Path | None, typer.Option(help="study folder; recordings that are there count")] = None,
    auto: Annotated[bool, typer.Option("--auto", help="take each step without asking")] = False,
    port: Annotated[str | None, typer.Option(help="port of the accelerometer board")] = None,
    generator: Annotated[str | None, typer.Option(help="SCPI function generator: its port or VISA name")] = None,
    board: Annotated[str, typer.Option(help="serial, audio, ni, mcc, labjack, or a device of a package")] = "serial",
    calibration: Annotated[
        Path | None, typer.Option(help="settings of a device that is no serial board (default sound_card.json ...)")
    ] = None,
    baud: Annotated[int, typer.Option(help="baud rate of the board")] = 921600,
    generator_baud: Annotated[int, typer.Option(help="baud rate of the generator")] = 115200,
    max_volts: Annotated[float, typer.Option(help="highest generator amplitude in V peak to peak")] = 5.0,
    max_acceleration: Annotated[float, typer.Option(help="highest base acceleration in m/s^2")] = 15.0,
    max_exposure: Annotated[float, typer.Option(help="largest daily exposure A(8) of the person in m/s^2")] = 0.5,
    max_vdv: Annotated[float, typer.Option(help="largest vibration dose value of a day in m/s^1.75")] = 21.0,
    simulate: Annotated[bool, typer.Option("--simulate", help="a virtual bench instead of hardware")] = False,
    subject: Annotated[str, typer.Option(help="name or number of the subject")] = "1",
    model: _Model = "two_dof",
    body_mass: _BodyMass = None,
    ask: _Ask = None,
    minutes: _Minutes = MINUTES,
    recordings: _Recordings = RECORDINGS,
    frequencies: _Frequencies = "10:50:2",
    loads: _Loads = "0,2.3,4.5",
    amplitude: _Amplitude = 0.5 * PEAK_TO_PEAK,
    amplitudes: _Amplitudes = None,
    displacement: _Displacement = 0.008,
    force: _Force = None,
    table_mass: _Table = 5.0,
    seconds: _Seconds = 10.0,
    noise: _Noise = 0.5,
    repeatability: _Repeatability = 0.03,
    exclude: _Exclude = None,
    mass_std: MassStd = None,
    gain_std: GainStd = None,
    delay_std: DelayStd = None,
    load_change: Annotated[
        float, typer.Option(help="what laying another load costs, in seconds of shaking", min=0, max=3600)
    ] = 60.0,
    draws: _Draws = 0,
    seed: _Seed = 0,
    json_: _Json = False,
) -> None:
    """Record, fit and plan in turn; report each recording, the intervals so far, and the next step.

    However it ends, also by Ctrl-C, the result so far is printed and written to session.json in the study folder; the
    same command goes on from the recordings that are there.

    Examples:
      python -m identification.plan run --simulate --auto --seconds 4 --out my_study

      python -m identification.plan run --port /dev/ttyACM0 --generator /dev/ttyUSB0 --body-mass 72 --out my_study

      python -m identification.plan run --board audio --body-mass 72 --out my_study
    """
    from fasbody.acquire.devices import Equipment
    from fasbody.acquire.level import COMMANDED, Safety
    from fasbody.acquire.session import terminated
    from identification.plan.record import Laboratory, Offer
    from identification.plan.session import BROKEN, INTERRUPTED, Session

    if out is None:
        raise SettingError("where to? Give --out STUDY, a folder that is made if needed.")
    if simulate:
        from fasbody.acquire.bench import foot as bench

        of_bench = {"--port": port, "--generator": generator, "--body-mass": body_mass, "--calibration": calibration}
        if misplaced := [name for name, value in of_bench.items() if value] + ["--board"] * (board != "serial"):
            raise SettingError(
                f"--simulate brings its own board, generator and subject: leave out {', '.join(misplaced)}."
            )
        body_mass, subject = bench.BODY_MASS_KG, str(bench.SUBJECT)
    equipment = None if simulate else Equipment(board, port, baud, generator, generator_baud, calibration)
    if equipment is not None:
        equipment.check()
        if not equipment.excites:
            raise SettingError("a session needs a generator: give --generator, --board audio, or --simulate.")
    if not auto and not sys.stdin.isatty():
        raise SettingError("nobody is at the terminal to take a step: give --auto.")
    if amplitude > COMMANDED * max_acceleration:
        raise SettingError(
            f"an amplitude of {amplitude:g} m/s² leaves no room to --max-acceleration {max_acceleration:g}; give "
            f"--amplitude {int(1000 * COMMANDED * max_acceleration) / 1000:g} or less."
        )
    shaker = _shaker(
        frequencies, loads, amplitude_m_s2=amplitude, displacement_m=displacement, force_n=force, table_kg=table_mass,
        seconds=seconds, noise_m_s2=noise, repeatability=repeatability,
    )  # fmt: skip
    earlier = _earlier([out] if (out / "recordings.csv").is_file() else None, None)
    if len({r.condition.subject for r in earlier}) > 1:  # a study of several people: those of this one count
        earlier = [r for r in earlier if r.condition.subject == subject]
    person = _person(model, body_mass, earlier, exclude, mass_std, gain_std, delay_std, subject)
    asked = _director(person, shaker, ask, (), seed, draws).asked if ask == [_AS_THESIS] else _asked(ask)
    safety = Safety(
        max_volts, peak_m_s2=max_acceleration, displacement_m=displacement, daily_a8=max_exposure, daily_vdv=max_vdv
    )
    with ExitStack() as stack:
        stack.enter_context(terminated())
        laboratory = stack.enter_context(Laboratory(out, person, safety, equipment))
        session = Session(
            person, shaker, asked, recordings, 60 * minutes, seed, draws, laboratory.record, Offer(auto), earlier,
            load_change,
        )  # fmt: skip
        result = session.run()
    if json_:
        print_json(result.document())
    else:
        show(result)
    if result.taken:
        written = result.write(out)[0]
        console.print(f"written to {written}; the same command goes on from there", soft_wrap=True, markup=False)
    if result.ended == INTERRUPTED:
        raise Stopped(result.reason)
    if result.ended == BROKEN:
        raise AcquisitionError(result.reason)


def _shaker(frequencies: str, loads: str, **limits: Any) -> "Shaker":
    """A shaker from texts, and from limits by their names."""
    from identification.plan.shaker import Shaker

    try:
        low, high, step = (float(part) for part in frequencies.split(":"))
    except ValueError:
        raise SettingError(f"--frequencies {frequencies!r} is not START:STOP:STEP, for example 10:50:2.") from None
    return Shaker(low, high, step, loads_kg=_numbers(loads, "--loads"), **limits)


def _numbers(text: str | None, option: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(",") if part.strip()) if text else ()
    except ValueError:
        raise SettingError(f"{option} {text!r} holds no numbers with commas between them.") from None


def _asked(texts: Sequence[str] | None) -> dict[str, float]:
    """Half-widths by constant; none where nobody asks."""
    shares: dict[str, float] = {}
    for text in texts or ():
        name, _, share = (part.strip() for part in text.partition("="))
        if text.strip() == _AS_THESIS:
            raise SettingError(f"--ask {_AS_THESIS} asks for all intervals; leave out the other --ask.")
        if name in shares:
            raise SettingError(f"--ask names {name} twice, {shares[name]:g} and {share}; give it once.")
        try:
            shares[name] = float(share)
        except ValueError:
            raise SettingError(f"--ask {text!r} is not NAME=SHARE, for example k_T=0.05.") from None
    return shares


def _earlier(data: Sequence[Path] | None, body_mass: float | None) -> "list[Recording]":
    """Earlier recordings that can serve: settled sines."""
    if not data:
        return []
    from fasbody.recording.checks import checked
    from fasbody.recording.sources import gather

    recordings = [checked(recording) for recording in gather(data, None if body_mass is None else [body_mass], None)[1]]
    if other := [r.file for r in recordings if r.condition.frequency_hz is None]:
        raise SettingError(f"{other[0]} is no sine; the director goes on from settled sines.")
    return recordings


def _of(earlier: "list[Recording]", subject: str | None, posture: str | None) -> "list[Recording]":
    """Those of one person in one posture.

    Raises:
        SettingError: nobody is called so, or they are of several people or postures.
    """
    for option, named, name in (("--subject", subject, "subject"), ("--posture", posture, "posture")):
        recorded = list(dict.fromkeys(str(getattr(r.condition, name)) for r in earlier))
        if named is not None and named not in recorded:
            raise SettingError(f"{option}: {unknown(name, named, recorded)}.")
        if named is None and len(recorded) > 1:
            raise SettingError(
                f"the earlier recordings are of several {'people' if name == 'subject' else 'postures'} "
                f"({', '.join(recorded)}); choose one with {option}."
            )
        earlier = [r for r in earlier if named is None or str(getattr(r.condition, name)) == named]
    return earlier


def _person(
    model: str,
    body_mass: float | None,
    earlier: "Sequence[Recording]",
    exclude: str | None,
    mass_std: float | None,
    gain_std: float | None,
    delay_std: float | None,
    subject: str = "1",
) -> "Person":
    from fasbody.foot.model import load
    from fasbody.recording.known import Known
    from identification.parameters import names
    from identification.plan.prior import Person

    known = Known.of_all([recording.known for recording in earlier])
    known = known.overruled_by(mass_std, gain_std, delay_std, names(exclude) or ())
    if earlier:
        first = earlier[0].condition
        body_mass, subject = first.body_mass_kg if body_mass is None else body_mass, first.subject or subject
        people = {(r.condition.subject, r.condition.posture, r.condition.body_mass_kg) for r in earlier}
        if len(people) > 1:
            raise SettingError("the earlier recordings are of several people or postures; plan for one.")
        return Person(load(model), BODY_MASS_KG if body_mass is None else body_mass, known, subject, first.posture)
    return Person(load(model), BODY_MASS_KG if body_mass is None else body_mass, known, subject)


def _director(
    person: "Person",
    shaker: "Shaker",
    ask: Sequence[str] | None,
    earlier: "Sequence[Recording]",
    seed: int,
    draws: int,
) -> "Director":
    from identification.plan.director import Director

    if ask != [_AS_THESIS]:
        return Director(person, shaker, _asked(ask), earlier, seed, draws)
    director = Director(person, shaker, {}, earlier, seed, draws)
    director.aim(director.as_thesis())
    return director


def show(result: "Presented") -> None:
    """Print a plan, or a session, for a person."""
    from rich import box
    from rich.table import Table

    sheet = result.sheet()
    table = Table(title=escape(sheet.title), title_justify="left", box=box.SIMPLE_HEAD, show_edge=False, padding=0)
    for number, column in enumerate(sheet.columns):
        table.add_column(escape(column), justify="left" if number == 1 else "right")
    for row in sheet.rows:
        table.add_row(*map(escape, row))
    results.print(table)
    first, *others = sheet.notes
    results.print(f"[bold]{escape(first)}[/]", soft_wrap=True)
    for text in others:
        results.print(escape(text), soft_wrap=True)


def start() -> None:
    """Run the command that the arguments name; `propose` if none is named."""
    run_app(app, name="python -m identification.plan", default="propose")


if __name__ == "__main__":
    command_line(start)
