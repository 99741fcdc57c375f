"""The commands: record a study from a serial accelerometer board, or recover a recording from its capture."""

import math
import shlex
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import typer

from fasbody.acquire import capture, firmware, folder, options
from fasbody.acquire.calibrate import calibrator, flip
from fasbody.acquire.devices import SERIAL, Equipment, file_of, kind
from fasbody.acquire.display import Display
from fasbody.acquire.folder import Converted, convert
from fasbody.acquire.level import Safety
from fasbody.acquire.person import ACTION, VDV_LIMIT, Dose
from fasbody.acquire.plan import Plan, PlannedSession, PlannedStep, within
from fasbody.acquire.port import ports, probe
from fasbody.acquire.session import Session, terminated
from fasbody.acquire.wire import ROLES
from fasbody.console import console, print_json, results, run_app
from fasbody.exceptions import AcquisitionError, FasError, InputFileError, SettingError
from fasbody.foot.shaker import PEAK_TO_PEAK
from fasbody.presentation import counted
from fasbody.recording.recording import Condition

_Seconds = Annotated[float, typer.Option(help="length of each recording in s")]
_Level = Annotated[float, typer.Option(help="required base acceleration in m/s^2")]
_Json = Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")]
#: A mass has no exposure; this is a day at 100 g.
_NOBODY = 1000.0
#: No calibration listens longer [s].
_LONGEST_S = 600.0
app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def record(
    port: options.Port = None,
    generator: options.Generator = None,
    frequency: Annotated[float | None, typer.Option(help="one recording at this excitation in Hz")] = None,
    sweep: Annotated[str | None, typer.Option(help="START:STOP:STEP in Hz, one recording each")] = None,
    plan_: Annotated[
        Path | None, typer.Option("--plan", help="planned session, as fasbody plan --protocol writes it")
    ] = None,
    first: Annotated[int, typer.Option(min=1, help="with --plan: begin at this step of the file")] = 1,
    seconds: _Seconds = 10.0,
    out: Annotated[Path | None, typer.Option(help="study folder; recordings are added to one that exists")] = None,
    subject: Annotated[str | None, typer.Option(help="name or number of the subject (1 if not given)")] = None,
    body_mass: Annotated[float | None, typer.Option(help="body mass in kg, with a subject's first recordings")] = None,
    added_mass: Annotated[
        float | None,
        typer.Option(help="mass on the knee in kg (default 0); with --plan: only its steps under this load"),
    ] = None,
    posture: Annotated[str, typer.Option(help="posture of the foot")] = "midstance",
    peak_to_peak: _Level = PEAK_TO_PEAK,
    max_volts: options.MaxVolts = Safety.volts,
    max_acceleration: Annotated[
        float, typer.Option(help="highest base acceleration in m/s^2; at most 0.86 of it can be requested")
    ] = Safety.peak_m_s2,
    max_displacement: Annotated[
        float, typer.Option(help="largest base motion in m, peak to peak")
    ] = Safety.displacement_m,
    max_exposure: Annotated[
        float, typer.Option(help="largest daily exposure A(8) of the subject in m/s^2, W_k-weighted")
    ] = ACTION,
    max_vdv: Annotated[
        float, typer.Option(help="largest vibration dose value of the subject in a day in m/s^1.75, W_k-weighted")
    ] = VDV_LIMIT,
    retries: Annotated[int, typer.Option(min=0, help="how often to repeat a recording that lost samples")] = 2,
    baud: options.Baud = 921600,
    generator_baud: options.GeneratorBaud = 115200,
    simulate: options.Simulate = False,
    list_: Annotated[
        bool, typer.Option("--list", help="show the serial ports, or with --board audio the sound cards, and stop")
    ] = False,
    probe_: Annotated[
        bool, typer.Option("--probe", help="show which device answers on --port (or on all ports) and stop")
    ] = False,
    board_: options.Board = SERIAL,
    calibration: options.Calibration = None,
    firmware_: Annotated[
        Path | None, typer.Option("--firmware", help="write the firmware for an Arduino into this folder and stop")
    ] = None,
    json_: _Json = False,
) -> None:
    """Record accelerations of a foot on the shaker into a study folder.

    Examples:
      fasbody record --simulate --sweep 10:50:5 --seconds 4 --out my_study

      fasbody record --port /dev/ttyACM0 --generator /dev/ttyUSB0 --sweep 10:50:5 --body-mass 72 --out study

      fasbody record --port /dev/ttyACM0 --frequency 20 --body-mass 72.5 --out study

      fasbody record --port /dev/ttyACM0 --generator /dev/ttyUSB0 --plan protocol.json --out study

      fasbody record --list

      fasbody record --board audio --list

      fasbody record --port /dev/ttyACM0 --probe

      fasbody record --board audio --calibration sound_card.json --sweep 10:50:5 --body-mass 72 --out study

      fasbody record --firmware my_sketches

      fasbody recover study/captures/20hz_0kg.fascap
    """
    if firmware_ is not None:
        file = str(firmware.write(firmware_))
        how = "open it in the Arduino IDE, upload it, then record with --baud 500000"
        _result({"sketch": file}, f"{file}: {how}", json_)
        return
    if list_ or probe_:
        _look(port, probe_, json_, board_)
        return
    texts = {"--port": port, "--generator": generator, "--subject": subject, "--posture": posture}
    for name, text in texts.items():
        if text is not None and not (text.strip() and text.isprintable()):
            wrong = "no line of text" if text.strip() else "empty"
            raise SettingError(f"{name} is {wrong}; name it, or leave it out.")
    if out is None:
        raise SettingError("where to? Give --out STUDY, a folder that is made if needed.")
    if port is not None and generator is not None and Path(port).resolve() == Path(generator).resolve():
        raise SettingError(f"--port and --generator are both {port}; give the board's and the generator's.")
    equipment = Equipment(board_, port, baud, generator, generator_baud, calibration)
    if simulate and board_ != SERIAL:
        raise SettingError(f"--simulate brings its own board: leave out --board {board_}.")
    if not simulate:
        equipment.check()
    excited = simulate or equipment.excites
    if (sweep or plan_) and not excited:
        option = "--sweep" if sweep else "--plan"
        raise SettingError(f"{option} needs a function generator: give --generator PORT, or --frequency one by one.")
    steps: Mapping[int, PlannedStep] | None = None
    planned_kg: float | None = None
    if first > 1 and plan_ is None:
        raise SettingError("--first belongs to --plan: give both, or leave it out.")
    if plan_ is not None:
        if sweep or frequency is not None:
            raise SettingError("--plan has its own frequencies: leave out --frequency and --sweep.")
        session = PlannedSession.read(plan_)
        steps = _steps(plan_, session, added_mass, simulate, first)
        planned_kg = session.body_mass_kg
        if not simulate:
            subject = subject or session.subject
            body_mass = planned_kg if body_mass is None else body_mass
    truth: dict[str, Any] | None = None
    if simulate:
        ignored = {"--port": port, "--generator": generator, "--subject": subject, "--body-mass": body_mass}
        names = [name for name, value in ignored.items() if value is not None]
        if names:
            raise SettingError(f"--simulate brings its own board, generator and subject: leave out {', '.join(names)}.")
        from fasbody.acquire.bench import foot
        from fasbody.laboratory.foot import TRUTH

        subject, body_mass = str(foot.SUBJECT), foot.BODY_MASS_KG
        truth = {"origin": "synthetic", "parameters": TRUTH, "instrument": {"delay_s": 0.0}}
    if planned_kg is not None and body_mass is not None and not math.isclose(planned_kg, body_mass):
        whose = "the virtual bench's subject has" if simulate else "--body-mass is"
        raise SettingError(
            f"{plan_} is planned for {planned_kg:g} kg, and {whose} {body_mass:g} kg; plan anew with --body-mass "
            f"{body_mass:g}{'' if simulate else ', or leave it out here'}."
        )
    subject = subject or "1"
    mass = _body_mass(out, subject, body_mass)
    template = Plan(
        study=out,
        frequencies_hz=_frequencies(sweep, frequency),
        condition=Condition(subject, posture, added_mass or 0.0, mass),
        seconds=seconds,
        peak_to_peak=peak_to_peak,
        retries=retries,
        origin="synthetic" if simulate else "measured",
        safety=Safety(
            max_volts,
            peak_m_s2=max_acceleration,
            displacement_m=max_displacement,
            daily_a8=max_exposure,
            daily_vdv=max_vdv,
        ),
        truth=truth,
    )
    # Then another program plays, or another shaker is used; the card only records.
    by_hand = generator is None and not simulate and sweep is None and frequency is None and steps is None
    plans = [template]
    if steps is not None:
        again = f"--plan {shlex.quote(str(plan_))}" + ("" if added_mass is None else f" --added-mass {added_mass:g}")
        plans = [replace(step.of(template), again=f"{again} --first {number}") for number, step in steps.items()]
    for plan in plans:
        plan.check(excited and not by_hand)
    if excited and not by_hand:
        dose = sum((plan.dose for plan in plans), Dose())
        within(out, subject, dose, template.safety)
        console.print(dose.sentence(), soft_wrap=True, markup=False)
    if left := folder.left_behind(out):
        text = (
            f"{counted(len(left), 'capture')} of {out} became no recording, as after a crash: {folder.recovery(left)}"
        )
        console.print(text, soft_wrap=True, markup=False)
    made, bad = _record(plans, None if simulate else equipment, by_hand)
    good = counted(sum(not one.problems for one in made), "recording")
    text = f"{good} in {out}; next: fasbody fit {shlex.quote(str(out))}"
    _result({"study": str(out), "recordings": [one.document() for one in made]}, text, json_)
    if bad:
        are = "is" if len(bad) == 1 else "are"
        raise AcquisitionError(
            f"{counted(len(bad), 'recording')} {are} unusable and not listed in recordings.csv: {', '.join(bad)}."
        )


def _body_mass(study: Path, subject: str, stated_kg: float | None) -> float:
    mass = stated_kg if stated_kg is not None else folder.body_mass(study, subject)
    if mass is None:
        raise SettingError(f"the body mass of subject {subject!r} is needed once: --body-mass, 20 to 300 kg.")
    if not 20 <= mass <= 300:
        raise SettingError(f"a body mass of {mass:g} kg is not plausible (valid: 20 to 300).")
    return mass


def _record(plans: Sequence[Plan], equipment: Equipment | None, by_hand: bool) -> tuple[list[Converted], list[str]]:
    """What was made of the plans, load after load, and the files that no attempt made usable.

    Args:
        plans: one after the other.
        equipment: on the bench; None for a virtual one under each load.
        by_hand: the excitation is somebody else's.
    """
    made: list[Converted] = []
    bad: list[str] = []
    loads = [list(group) for _, group in groupby(plans, lambda plan: plan.condition.added_mass_kg)]
    for group in loads:
        load = group[0].condition.added_mass_kg
        if len(loads) > 1 and equipment is not None:
            typer.confirm(f"{load:g} kg are on the knee", default=True, abort=True, err=True)
        with ExitStack() as stack:
            stack.enter_context(terminated())
            bench = equipment or Equipment.simulated(stack, added_mass=load)
            board, source = bench.open(stack)
            stack.enter_context(Display(board))
            session = Session(group[0], board, None if by_hand else source)
            for plan in group:
                session.plan = plan
                session.run()
        made += session.made
        bad += session.unusable()
    return made, bad


@app.command()
def check(
    out: Annotated[Path, typer.Option(help="study folder, made if needed: check.json and study.toml are written")],
    port: options.Port = None,
    generator: options.Generator = None,
    board: options.Board = SERIAL,
    calibration: options.Calibration = None,
    frequencies: Annotated[str, typer.Option(help="frequencies of the sines in Hz, at least two")] = "10,20,40",
    seconds: _Seconds = 4.0,
    peak_to_peak: _Level = 10.0,
    max_volts: options.MaxVolts = Safety.volts,
    baud: options.Baud = 921600,
    generator_baud: options.GeneratorBaud = 115200,
    simulate: options.Simulate = False,
    json_: _Json = False,
) -> None:
    """Check shaker and sensors with both sensors on one mass, and nobody on the shaker.

    Gain and delay, with their standard deviations, go into study.toml, where every fit of this study finds them.

    Examples:
      fasbody record check --port /dev/ttyACM0 --generator /dev/ttyUSB0 --out study

      fasbody record check --simulate --seconds 1 --out my_study
    """
    from fasbody.acquire.one_mass import measure

    try:
        frequencies_hz = tuple(float(part) for part in frequencies.split(","))
    except ValueError:
        raise SettingError(f"--frequencies {frequencies!r} holds no numbers with commas between them.") from None
    if len(set(frequencies_hz)) < 2:
        raise SettingError("--frequencies needs at least two, because one cannot determine a delay.")
    equipment = Equipment(board, port, baud, generator, generator_baud, calibration)
    origin = "synthetic" if simulate else "measured"
    plan = Plan(
        out / "check", frequencies_hz, Condition("one mass"), seconds, peak_to_peak, origin=origin,
        safety=Safety(max_volts, daily_a8=_NOBODY, daily_vdv=_NOBODY), one_mass=True,
    )  # fmt: skip
    plan.check(True)
    with ExitStack() as stack:
        stack.enter_context(terminated())
        if simulate:
            equipment = Equipment.simulated(stack, one_mass=1.02)
        equipment.check()
        source_board, source = equipment.open(stack)
        if source is None:
            raise SettingError("the check needs a generator: give --generator, or --board audio.")
        stack.enter_context(Display(source_board))
        chain = measure(plan, source_board, source)
    files = chain.write(out, origin)
    text = f"{chain}; written to {', '.join(map(str, files))}"
    _result(vars(chain) | {"files": list(map(str, files))}, text, json_)
    if texts := chain.remarks():
        raise AcquisitionError(f"{'; '.join(texts)}.")


@app.command()
def recover(
    captures: Annotated[list[Path], typer.Argument(help="capture files")],
    out: Annotated[Path | None, typer.Option(help="study folder (default: the one around captures/)")] = None,
    longest: Annotated[
        bool, typer.Option("--longest", help="keep only the longest stretch without a gap, however short")
    ] = False,
    json_: _Json = False,
) -> None:
    """Make recordings from capture files, for example after a crash.

    Examples:
      fasbody recover study/captures/20hz_0kg.fascap

      fasbody recover study/captures/*.fascap
    """
    made: list[Converted] = []
    bad: list[str] = []
    hint = "" if longest else "; --longest keeps and lists the longest stretch without a gap"
    single = len(captures) == 1
    for number, file in enumerate(captures):
        if file.resolve() in (other.resolve() for other in captures[:number]):
            raise InputFileError(file, "is given twice", "name each capture file once")
        around = file.resolve().parent
        try:
            next(capture.read(file), None)  # refuses what is none, whatever lies around it
            if out is None and around.name != folder.CAPTURES:
                raise SettingError(f"{file} is not in the captures of a study; give --out STUDY.")
            one = convert(file, out or around.parent, longest=longest)
        except FasError as error:
            if single:
                raise
            bad.append(str(error))
            continue
        made.append(one)
        if not json_:
            results.print(str(one), soft_wrap=True, markup=False)
        if one.problems:
            why = "; ".join(one.problems)
            bad.append(f"{one.file} is written and not listed in recordings.csv: {why}{hint}.")
    if json_:
        documents = [one.document() for one in made]
        print_json(documents[0] if single else documents)
    if bad:
        raise AcquisitionError(" ".join(bad))


def _steps(
    file: Path, session: PlannedSession, added_mass: float | None, simulate: bool, first: int
) -> Mapping[int, PlannedStep]:
    """The steps of a planned session by number from 1, or its part under one load, from one step on."""
    all_ = session.protocol
    if first > len(all_):
        raise SettingError(f"--first is {first}, and {file} has {counted(len(all_), 'step')}.")
    steps = {number: step for number, step in enumerate(all_, start=1) if number >= first}
    loads = sorted({step.added_mass_kg for step in steps.values()})
    listed = ", ".join(f"{load:g}" for load in loads)
    if other := [step.kind for step in steps.values() if step.kind != "sine"]:
        raise SettingError(f"{file}: a step is a {other[0]}, and a generator makes sines only; plan with --kinds sine.")
    if added_mass is not None:
        steps = {number: step for number, step in steps.items() if step.added_mass_kg == added_mass}
        if not steps:
            raise SettingError(
                f"{file}: no step has {added_mass:g} kg on the knee (it has {', '.join(map('{:g}'.format, loads))})."
            )
    elif len(loads) > 1 and not simulate and not sys.stdin.isatty():
        raise SettingError(
            f"{file} has loads of {listed} kg, and nobody is at the terminal to lay them "
            "on the knee: give --added-mass, one after the other."
        )
    return steps


def _look(port: str | None, probing: bool, json_: bool, board: str) -> None:
    devices: list[object]
    if board != SERIAL:
        if probing:
            raise SettingError(f"--probe listens on serial ports; for others give --board {board} --list.")
        devices = list(getattr(kind(board), "listed", list)())
        none = f"--board {board} lists nothing; is it plugged in, and may you use it (groups audio, plugdev)?"
    else:
        devices = list(ports())
        if probing:
            names = [port] if port else [info.device for info in ports()]
            devices = [probe(name) for name in names]
        none = "this computer has no serial port; is the board plugged in, and may you use it (group dialout)?"
    _result([vars(device) for device in devices], "\n".join(map(str, devices)), json_)
    if not devices:
        console.print(none, soft_wrap=True)


@app.command()
def calibrate(
    what: Annotated[str, typer.Argument(help="loopback, calibrator or flip")],
    role: Annotated[str, typer.Argument(help="base or malleolus, for calibrator and flip")] = "",
    device: Annotated[str | None, typer.Option(help="sound card, by part of its name; for loopback")] = None,
    board: Annotated[str, typer.Option(help="device: audio, ni, mcc or labjack")] = "audio",
    calibration: Annotated[
        Path | None, typer.Option(help="file to write, or to add to (default sound_card.json, ni.json and so on)")
    ] = None,
    seconds: Annotated[float, typer.Option(help="length of the recording of a calibrator or a flip, in s")] = 9.0,
    hz: Annotated[float, typer.Option(help="frequency of the hand calibrator")] = 159.155,
    rms: Annotated[float, typer.Option(help="rms acceleration of the hand calibrator in m/s^2")] = 10.0,
    latency: Annotated[float, typer.Option(help="buffer of the card's output in s; for loopback")] = 0.5,
    output: Annotated[
        int, typer.Option(min=1, max=2, help="output that plays, here and in recordings; for loopback")
    ] = 1,
    full_scale_volts: Annotated[float, typer.Option(help="voltage of the output at full scale, peak to peak")] = 2.0,
    yes: Annotated[bool, typer.Option("--yes", help="the amplifier is off: play the loopback without asking")] = False,
    json_: _Json = False,
) -> None:
    """Calibrate a sound card or another device: loopback first, then calibrator or flip for each sensor.

    The loopback (output to both inputs) plays noise, so the amplifier must be off or the shaker unplugged. The command
    asks first.

    For a flip, hold the sensor in its mounting direction, still, for three seconds; turn it upside down; hold it still.

    Examples:
      fasbody record --board audio --list

      fasbody calibrate loopback --device "USB Audio"

      fasbody calibrate calibrator base --rms 10 --hz 159.155

      fasbody calibrate flip malleolus
    """
    numbers = {"--seconds": seconds, "--hz": hz, "--rms": rms, "--latency": latency}
    for name, value in (numbers | {"--full-scale-volts": full_scale_volts}).items():
        if not 0 < value < math.inf:
            raise SettingError(f"{name} is {value:g}; it must be positive.")
    if seconds > _LONGEST_S:
        raise SettingError(f"--seconds is {seconds:g}; {_LONGEST_S:g} are enough for any calibration.")
    known: Any
    calibration = file_of(board, calibration)
    if what == "loopback":
        if board != "audio":
            raise SettingError(f"the loopback is for a sound card, --board audio, and not for --board {board}.")
        from fasbody.acquire import audio

        if device is None or not device.strip():
            raise SettingError(f"which card? Give --device; {audio.cards()}.")
        before = audio.Calibration.read(calibration) if calibration.is_file() else audio.Calibration(device)
        _amplifier_is_off(output, full_scale_volts, audio.PEAK, audio.PERIODS * audio.PERIOD_S, yes)
        with terminated():
            loop = audio.measure_loop(device, latency, output)
        known = replace(loop, full_scale_v=full_scale_volts, scale_m_s2=before.scale_m_s2)  # the sensors' stay
    elif what in ("calibrator", "flip"):
        if role not in ROLES[:2]:
            raise SettingError(f"the sensor of which input? {role or 'nothing'!r} is neither base nor malleolus.")
        digitiser = kind(board)
        known, channel = digitiser.known(calibration), ROLES.index(role)
        samples, rate_hz = digitiser.listen(known, seconds)
        how = (samples[:, channel], known.at_corner(channel), rate_hz)
        known = known.with_scale(channel, flip(*how) if what == "flip" else calibrator(*how, hz, rms))
    else:
        raise SettingError(f"{what!r} is none of loopback, calibrator, flip.")
    known.write(calibration)
    _result(vars(known), str(known), json_)


def _amplifier_is_off(output: int, full_scale_volts: float, peak: float, seconds: float, yes: bool) -> None:
    """Print what is about to be played, and have the user confirm that the amplifier is off."""
    text = f"The loopback plays noise on output {output} for {seconds:g} s, at most {100 * peak:g} % of full scale "
    text += f"({peak * full_scale_volts:g} V peak to peak). No guard watches a shaker meanwhile: switch the amplifier "
    text += f"off or unplug the shaker, and connect output {output} to both inputs."
    console.print(text, soft_wrap=True, markup=False)
    if yes:
        return
    if not sys.stdin.isatty():
        raise SettingError("nobody is at the terminal to say that the amplifier is off; if it is, add --yes.")
    typer.confirm("The amplifier is off, or the shaker unplugged", abort=True, err=True)


def _frequencies(sweep: str | None, frequency: float | None) -> tuple[float | None, ...]:
    if sweep is None:
        return (frequency,)
    if frequency is not None:
        raise SettingError("give --frequency or --sweep, not both.")
    try:
        start, stop, step = (float(part) for part in sweep.split(":"))
    except ValueError:
        raise SettingError(f"--sweep {sweep!r} is not START:STOP:STEP, for example 10:50:5.") from None
    if not (step > 0 and stop >= start and (stop - start) / step <= 1000):
        raise SettingError(f"--sweep {sweep!r} holds no frequencies; START must not exceed STOP, and STEP be positive.")
    import numpy as np

    return tuple(float(f) for f in np.arange(start, stop + 1e-9 * step, step))


def _result(document: Any, text: str, json_: bool) -> None:
    if json_:
        print_json(document)
    elif text:
        results.print(text, soft_wrap=True, markup=False)


def run() -> None:
    """Run the command that the arguments name; `record` if none is named."""
    run_app(app, name="python -m fasbody.acquire", default="record")
