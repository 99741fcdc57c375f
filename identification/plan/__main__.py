"""`fasbody plan`: the next recording worth making, a session, and the session itself."""

import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields, replace
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from shlex import join
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from fasbody.acquire import options as acquire
from fasbody.console import (
    command_line,
    console,
    make_folder,
    print_json,
    run_app,
    to_json,
    write_whole,
)
from fasbody.constants import PEAK_TO_PEAK
from fasbody.exceptions import AcquisitionError, SettingError, Stopped, unknown
from identification.options import DelayStd, GainStd, MassStd

if TYPE_CHECKING:
    from fasbody.recording.recording import Recording
    from identification.plan.director import Director
    from identification.plan.prior import Person
    from identification.plan.shaker import Shaker

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

#: --ask with this word asks for what the thesis' three loads would leave.
_AS_THESIS = "thesis"
#: Minutes of shaking, as long as the thesis shook.
_MINUTES = 4.5
#: The body mass where nobody says one: that of the laboratory's subject 16 [kg].
BODY_MASS_KG = 72.57


def _finite(minutes: float | None) -> float | None:
    if minutes is not None and not minutes < 1e4:
        raise SettingError(f"--minutes is {minutes:g}; give a number above 0 and below 10000.")
    return minutes


@dataclass(frozen=True)
class Options:
    """Options of a plan and of a session alike."""

    model: Annotated[str, Option(help="two-mass model, or its file")] = "two_dof"
    body_mass: Annotated[
        float | None, Option(help="body mass in kg (default: that of the recordings, or 72.57)")
    ] = None
    ask: Annotated[
        list[str] | None,
        Option(
            help="NAME=SHARE, half-width of a 95 % interval, for example k_T=0.05; repeat for several. "
            "Other constants then have no goal. thesis: the intervals that the thesis' three loads would give",
            show_default="k_T=0.03, k_F=0.03, c_11=0.06, c_21=0.06",
        ),
    ] = None
    minutes: Annotated[
        float | None,
        Option(
            help="largest time of shaking in minutes (default: 4.5, or what the daily exposure allows)",
            callback=_finite,
        ),
    ] = None
    # a third of the thesis' recordings
    recordings: Annotated[int, Option(help="largest number of recordings", min=1)] = 9
    frequencies: Annotated[str, Option(help="START:STOP:STEP in Hz")] = "10:50:2"
    loads: Annotated[str, Option(help="masses on the knee in kg, separated by commas")] = (
        "0,2.3,4.5"
    )
    amplitude: Annotated[
        float, Option(help="largest amplitude of the base in m/s^2, half of peak to peak")
    ] = 0.5 * PEAK_TO_PEAK
    displacement: Annotated[float, Option(help="largest travel of the base in m, peak to peak")] = (
        0.008
    )
    force: Annotated[float | None, Option(help="largest force of the shaker in N")] = None
    table_mass: Annotated[float, Option(help="moving mass of the shaker in kg, for --force")] = 5.0
    seconds: Annotated[float, Option(help="recordings last a multiple of this time, in s")] = 10.0
    noise: Annotated[
        float | None,
        Option(
            help="noise of a sensor, rms of a sample in m/s^2 (default: that of the earlier recordings, or about 0.5)"
        ),
    ] = None
    repeatability: Annotated[
        float | None,
        Option(
            metavar="SHARE",
            help="relative scatter of a harmonic between recordings (default: about 0.03, or as estimated from "
            "earlier recordings)",
        ),
    ] = None
    exclude: Annotated[
        str | None,
        Option(
            help="nuisance parameters to exclude, as in a fit: mount, relaxation, load, share, rocking, drift, "
            "seating, or all"
        ),
    ] = None
    mass_std: MassStd = None
    gain_std: GainStd = None
    delay_std: DelayStd = None
    draws: Annotated[int, Option(help="number of simulated feet; 0 means 32, or 12 if there are recordings")] = 0
    seed: Annotated[int, Option(min=0, help="seed of the simulated feet")] = 0
    json_: Annotated[bool, Option("--json", help="print one JSON document on stdout")] = False

    @property
    def shaking_s(self) -> float:
        """Largest time of shaking [s]."""
        return 60 * (_MINUTES if self.minutes is None else self.minutes)

    def shaker(self, **more: Any) -> "Shaker":
        """The shaker's limits."""
        from identification.plan.shaker import Shaker

        try:
            low, high, step = (float(part) for part in self.frequencies.split(":"))
        except ValueError:
            raise SettingError(
                f"--frequencies {self.frequencies!r} is not START:STOP:STEP, for example 10:50:2."
            ) from None
        return Shaker(
            low, high, step, self.amplitude, self.displacement, self.force, self.table_mass,
            loads_kg=_numbers(self.loads, "--loads"), seconds=self.seconds, noise_m_s2=self.noise,
            repeatability=self.repeatability, **more
        )  # fmt: skip

    def person(self, earlier: "Sequence[Recording]", subject: str = "1") -> "Person":
        """Who stands on the shaker, as earlier recordings know the person."""
        from fasbody.foot.model import load
        from fasbody.recording.known import Known
        from identification.parameters import names
        from identification.plan.prior import Person

        known = Known.of_all([recording.known for recording in earlier])
        known = known.overruled_by(self.mass_std, self.gain_std, self.delay_std, names(self.exclude) or ())
        conditions = [r.condition for r in earlier]
        if len({(c.subject, c.posture, c.body_mass_kg) for c in conditions}) > 1:
            raise SettingError(
                "the earlier recordings are of several people or postures; plan for one."
            )
        first = conditions[0] if conditions else None
        stated = first.body_mass_kg if first and self.body_mass is None else self.body_mass
        return Person(
            load(self.model), BODY_MASS_KG if stated is None else stated, known,
            first.subject or subject if first else subject, first.posture if first else "midstance"
        )  # fmt: skip

    def director(
        self, person: "Person", shaker: "Shaker", earlier: "Sequence[Recording]" = ()
    ) -> "Director":
        """A director with what is asked for."""
        from identification.plan.director import Director

        as_thesis = self.ask == [_AS_THESIS]
        asked = {} if as_thesis else self.asked()
        director = Director(person, shaker, asked, earlier, self.seed, self.draws)
        if as_thesis:
            director.aim(director.as_thesis())
        return director

    def asked(self) -> dict[str, float]:
        """Half-widths by constant; none where nobody asks."""
        shares: dict[str, float] = {}
        for text in self.ask or ():
            name, _, share = (part.strip() for part in text.partition("="))
            if text.strip() == _AS_THESIS:
                raise SettingError(
                    f"--ask {_AS_THESIS} sets all intervals; leave out the other --ask."
                )
            if name in shares:
                raise SettingError(
                    f"--ask names {name} twice, {shares[name]:g} and {share}; give it once."
                )
            try:
                shares[name] = float(share)
            except ValueError:
                raise SettingError(
                    f"--ask {text!r} is not NAME=SHARE, for example k_T=0.05."
                ) from None
        return shares


def _with_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command with its own options, then those of `Options`, which it gets as one object."""
    shared = [
        Parameter(f.name, Parameter.KEYWORD_ONLY, default=f.default, annotation=f.type)
        for f in fields(Options)
    ]

    @wraps(command)
    def called(**values: Any) -> None:
        options = Options(**{item.name: values.pop(item.name) for item in shared})
        command(options, **values)

    _, *mine = signature(command).parameters.values()
    parameters = [*(item.replace(kind=Parameter.KEYWORD_ONLY) for item in mine), *shared]
    called.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {item.name: item.annotation for item in parameters}
    return called


@app.command()
@_with_options
def propose(
    options: Options,
    data: Annotated[
        list[Path] | None,
        Argument(help="earlier recordings: study folder, or CSV files", show_default="none"),
    ] = None,
    subject: Annotated[
        str | None, Option(help="subject, if the earlier study has several")
    ] = None,
    posture: Annotated[str | None, Option(help="posture, if there are several")] = None,
    amplitudes: Annotated[
        str | None, Option(help="amplitudes to try, separated by commas (default: the largest)")
    ] = None,
    kinds: Annotated[str, Option(help="sine, multisine; separated by commas")] = "sine",
    sensors: Annotated[
        str, Option(help="accelerometers to use, e.g. malleolus,foot")
    ] = "malleolus",
    protocol: Annotated[
        Path | None,
        Option(help="file for the steps, for fasbody record --plan"),
    ] = None,
    out: Annotated[
        Path | None,
        Option(help="folder for report.html, protocol.json, plan.json, plan.csv and figures"),
    ] = None,
) -> None:
    """Plan what to record next, to narrow the intervals and to exclude the mirror solution.

    Examples:
      fasbody plan --body-mass 80

      fasbody plan my_study --ask k_T=0.05 --ask k_F=0.05 --out next

      fasbody plan my_study --subject 3 --posture midstance

      fasbody plan --ask thesis --out as_thesis

      fasbody plan --frequencies 15:40:5 --loads 0,5 --protocol steps.json

      fasbody plan --exclude all --sensors malleolus,foot --json

      fasbody plan run --simulate --auto --out my_study
    """
    from fasbody import page
    from identification.parameters import names
    from identification.plan.result import planned

    began = time.perf_counter()
    shaker = options.shaker(
        amplitudes_m_s2=_numbers(amplitudes, "--amplitudes"),
        kinds=names(kinds) or (),
        sensors=names(sensors) or (),
    )
    if not options.shaking_s >= options.seconds:
        raise SettingError(
            f"--minutes {options.shaking_s / 60:g} leaves no room for a recording of {options.seconds:g} s; "
            "give more."
        )
    if (subject or posture) and not data:
        raise SettingError(
            "--subject and --posture choose among earlier recordings; name their study."
        )
    earlier = _of(_earlier(data, options.body_mass), subject, posture)
    director = options.director(options.person(earlier), shaker, earlier)
    if out is not None:
        make_folder(out)
    spent = time.perf_counter() - began
    result = planned(director, options.recordings, options.shaking_s, spent, options.minutes is None)
    if protocol is not None:
        write_whole(protocol, to_json(result.protocol) + "\n")
    if options.json_:
        print_json(result.document())
    else:
        page.show(result.sheet(), "kind")
    if out is not None:
        words = sys.argv[2:] if sys.argv[1:2] == ["propose"] else sys.argv[1:]
        page.write(result, out, join(["fasbody", "plan", *words]))


@app.command()
@_with_options
def run(
    options: Options,
    out: Annotated[
        Path | None, Option(help="study folder; its recordings are used")
    ] = None,
    auto: Annotated[bool, Option("--auto", help="take each step without asking")] = False,
    port: acquire.Port = None,
    generator: acquire.Generator = None,
    board: acquire.Board = "serial",
    calibration: acquire.Calibration = None,
    baud: acquire.Baud = 921600,
    generator_baud: acquire.GeneratorBaud = 115200,
    max_volts: acquire.MaxVolts = 5.0,
    max_acceleration: Annotated[float, Option(help="highest base acceleration in m/s^2")] = 15.0,
    max_exposure: Annotated[
        float, Option(help="largest daily exposure A(8) of the person in m/s^2")
    ] = 0.5,
    max_vdv: Annotated[
        float, Option(help="largest vibration dose value of a day in m/s^1.75")
    ] = 21.0,
    simulate: acquire.Simulate = False,
    subject: Annotated[str, Option(help="name or number of the subject")] = "1",
    load_change: Annotated[
        float, Option(help="cost of a change of load, in seconds of shaking", min=0, max=3600)
    ] = 60.0,
) -> None:
    """Record, fit and plan in turn, and report the intervals after each recording.

    The result is always printed and written to session.json in the study folder, even after Ctrl-C. The
    same command continues from the existing recordings.

    Examples:
      fasbody plan run --simulate --auto --seconds 4 --out my_study

      fasbody plan run --port /dev/ttyACM0 --generator /dev/ttyUSB0 --body-mass 72 --out my_study

      fasbody plan run --board audio --body-mass 72 --out my_study
    """
    from fasbody import page
    from fasbody.acquire.devices import Equipment
    from fasbody.acquire.level import COMMANDED, Safety
    from fasbody.acquire.session import terminated
    from identification.plan.record import Laboratory, Offer
    from identification.plan.session import BROKEN, INTERRUPTED, Session

    if out is None:
        raise SettingError("where to? Give --out STUDY, a folder that is made if needed.")
    if simulate:
        from fasbody.acquire.bench import foot as bench

        of_bench = {
            "--port": port, "--generator": generator, "--body-mass": options.body_mass,
            "--calibration": calibration, "--board": board != "serial",
        }  # fmt: skip
        if misplaced := [name for name, value in of_bench.items() if value]:
            raise SettingError(
                "--simulate brings its own board, generator and subject: leave out "
                f"{', '.join(misplaced)}."
            )
        options = replace(options, body_mass=bench.BODY_MASS_KG)
        subject = str(bench.SUBJECT)
    equipment = (
        None if simulate else Equipment(board, port, baud, generator, generator_baud, calibration)
    )
    if equipment is not None:
        equipment.check()
        if not equipment.excites:
            raise SettingError(
                "a session needs a generator: give --generator, --board audio, or --simulate."
            )
    if not auto and not sys.stdin.isatty():
        raise SettingError("nobody is at the terminal to take a step: give --auto.")
    if options.amplitude > COMMANDED * max_acceleration:
        raise SettingError(
            f"an amplitude of {options.amplitude:g} m/s² leaves no room to --max-acceleration "
            f"{max_acceleration:g}; give --amplitude "
            f"{int(1000 * COMMANDED * max_acceleration) / 1000:g} or less."
        )
    shaker = options.shaker()
    earlier = _earlier([out] if (out / "recordings.csv").is_file() else None, None)
    if len({r.condition.subject for r in earlier}) > 1:  # of several people: those of this one
        earlier = [r for r in earlier if r.condition.subject == subject]
    person = options.person(earlier, subject)
    as_thesis = options.ask == [_AS_THESIS]
    asked = options.director(person, shaker).asked if as_thesis else options.asked()
    safety = Safety(
        max_volts, peak_m_s2=max_acceleration, displacement_m=options.displacement,
        daily_a8=max_exposure, daily_vdv=max_vdv,
    )  # fmt: skip
    with ExitStack() as stack:
        stack.enter_context(terminated())
        laboratory = stack.enter_context(Laboratory(out, person, safety, equipment))
        session = Session(
            person, shaker, asked, options.recordings, options.shaking_s, options.seed,
            options.draws, laboratory.record, Offer(auto), earlier, load_change
        )  # fmt: skip
        result = session.run()
    if options.json_:
        print_json(result.document())
    else:
        page.show(result.sheet())
    if result.taken:
        written = result.write(out)[0]
        text = f"written to {written}; the same command goes on from there"
        console.print(text, soft_wrap=True, markup=False)
    if result.ended == INTERRUPTED:
        raise Stopped(result.reason)
    if result.ended == BROKEN:
        raise AcquisitionError(result.reason)


def _numbers(text: str | None, option: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(",") if part.strip()) if text else ()
    except ValueError:
        raise SettingError(
            f"{option} {text!r} holds no numbers with commas between them."
        ) from None


def _earlier(data: Sequence[Path] | None, body_mass: float | None) -> "list[Recording]":
    if not data:
        return []
    from fasbody.recording.checks import checked
    from fasbody.recording.sources import gather

    stated = None if body_mass is None else [body_mass]
    recordings = [checked(recording) for recording in gather(data, stated, None)[1]]
    if other := [r.file for r in recordings if r.condition.frequency_hz is None]:
        raise SettingError(f"{other[0]} is no sine; the director goes on from settled sines.")
    return recordings


def _of(earlier: "list[Recording]", subject: str | None, posture: str | None) -> "list[Recording]":
    for name, several, chosen in (("subject", "people", subject), ("posture", "postures", posture)):
        recorded = list(dict.fromkeys(str(getattr(r.condition, name)) for r in earlier))
        if chosen is not None and chosen not in recorded:
            raise SettingError(f"--{name}: {unknown(name, chosen, recorded)}.")
        if chosen is None and len(recorded) > 1:
            raise SettingError(
                f"the earlier recordings are of several {several} ({', '.join(recorded)}); "
                f"choose one with --{name}."
            )
        earlier = [r for r in earlier if chosen in (None, str(getattr(r.condition, name)))]
    return earlier


def start() -> None:
    """Run the command that the arguments name; `propose` if none is named."""
    run_app(app, name="python -m identification.plan", default="propose")


if __name__ == "__main__":
    command_line(start)
