"""The map of all commands: one table, for the command `fasbody` and for `python -m fasbody`.

A row says all that it takes to show and to start a command, so that the map imports none of them and needs no extra.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import fasbody
from fasbody.exceptions import SettingError, unknown


@dataclass(frozen=True)
class Command:
    """One command.

    Attributes:
        words: what follows `fasbody`, "" for the map itself.
        module: what `python -m` runs.
        name: its sub-command, "" for none.
        does: the first line of its help.
        at: the module that holds its Typer app, where that is not the one that runs.
        needs: a room above that does the work, where it is not the one that runs.
    """

    words: str
    module: str
    name: str
    does: str
    at: str = ""
    needs: str = ""

    @property
    def call(self) -> str:
        """What to type without an installed `fasbody`."""
        return f"python -m {self.module} {self.name}".rstrip()

    @property
    def home(self) -> str:
        """The module that holds its Typer app."""
        return self.at or (f"{self.module}.__main__" if _folder(self.module).is_dir() else self.module)

    @property
    def installed(self) -> bool:
        """Whether it is there; those of a checkout only are not, once the packages are installed."""
        place = _folder(self.module)
        if self.needs and not _folder(self.needs).is_dir():
            return False
        return (place / "__main__.py").is_file() or place.with_suffix(".py").is_file()

    @property
    def group(self) -> str:
        """What it is for, one of `GROUPS`."""
        return next(title for title, group in GROUPS.items() if self in group)

    def __str__(self) -> str:
        return f"{self.call}: {self.does}"


def _folder(module: str) -> Path:
    return Path(fasbody.__file__).parent.parent.joinpath(*module.split("."))


#: The map: what for, and the commands in the order in which one meets them.
GROUPS: dict[str, tuple[Command, ...]] = {
    "A foot from its recordings": (
        Command("fit", "identification.fit", "", "Estimate the parameters of a foot from recordings of its vibration."),
        Command(
            "plan", "identification.plan", "propose",
            "Plan what to record next: a session that decides between the mirror feet and narrows the intervals.",
        ),
        Command(
            "plan run", "identification.plan", "run",
            "Record, fit and plan in turn; report each recording, the intervals so far, and the next step.",
        ),
        Command(
            "rivals", "identification.rivals", "",
            "Compare rival models on the same recordings, ranked by BIC and by held-out prediction.",
        ),
        Command(
            "recording", "fasbody.recording", "",
            "Recordings: check what was understood of a file, convert it, make a study of a folder.",
        ),
        Command(
            "check", "fasbody.recording", "check",
            "Say what was understood of a recording or a study, and what is wrong with it.",
        ),
        Command(
            "convert", "fasbody.recording", "convert",
            "Write a recording in another format, in m/s^2, signs, sensitivities and delays applied.",
        ),
        Command(
            "merge", "fasbody.recording", "merge",
            "Make one recording of two loggers, one on the foot and one on the table, by a knock in both.",
        ),
        Command(
            "study init", "fasbody.recording", "init",
            "Make a study of a folder of recordings: study.toml, subjects.csv and recordings.csv, to be completed.",
        ),
        Command(
            "transmissibility", "fasbody.transmissibility", "",
            "Transmissibility and phase for MB, TB and TM by load and posture, with statistics and figures.",
        ),
        Command(
            "study", "identification.study", "",
            "Fit every recording of a study and check the fits, computing only what is missing.",
            "identification.study.command",
        ),
        Command(
            "blackbox", "identification.blackbox", "",
            "Linear and Hammerstein-Wiener models of recordings with one input and one output.",
        ),
        Command(
            "heel", "identification.heel", "", "Compare laws of the heel pad with measured heel strikes of people.",
            "fasbody.heel.command",
        ),
        Command("laboratory", "fasbody.laboratory", "", "Make a synthetic study with known truth."),
        Command(
            "record", "fasbody.acquire", "record",
            "Record accelerations of a foot on the shaker into a study folder.",
            "fasbody.acquire.commands",
        ),
        Command(
            "record check", "fasbody.acquire", "check",
            "Measure the chain with both sensors on one mass, and nobody on the shaker: their ratio must be 1.",
            "fasbody.acquire.commands",
        ),
        Command(
            "recover", "fasbody.acquire", "recover",
            "Make a recording from a capture file, for example after a crash; several captures make one each.",
            "fasbody.acquire.commands",
        ),
        Command(
            "calibrate", "fasbody.acquire", "calibrate",
            "Calibrate a sound card: loopback first (output to both inputs), then calibrator or flip for each sensor.",
            "fasbody.acquire.commands",
        ),
        Command(
            "board", "fasbody.acquire.bench", "board",
            "The accelerometer board: samples the shaken foot and sends frames (or, with --bits 0, text lines).",
        ),
        Command(
            "generator", "fasbody.acquire.bench", "generator",
            "The function generator: a small SCPI instrument whose output drives the shaker.",
        ),
    ),
    "The models": (
        Command(
            "view", "viz.foot", "",
            "Watch a foot on the shaker in slow motion; move a slider and the real model runs again.",
        ),
        Command(
            "arch sensitivity", "fasbody.arch", "sensitivity",
            "Do only k_T, c_T, k_F, c_F matter? Relative sensitivity of the five-body arch to all 13 constants.",
        ),
        Command(
            "arch reduction", "fasbody.arch", "reduction",
            "What the reduction of the five-body arch to two masses costs at the malleolus, 1-100 Hz.",
        ),
        Command(
            "arch load", "fasbody.arch", "load",
            "Sag of the arch under a static load, and its resonance under the added masses of Chapter 2.",
        ),
        Command(
            "arch validate", "fasbody.arch", "validate",
            "Predict each published number of feet from the others, and show which numbers no arch can meet.",
            needs="reproduction",
        ),
        Command(
            "leg peaks", "fasbody.leg", "peaks",
            "Where a leg's MB, TB and TM are highest under 0, 2.3 and 4.5 kg; which statements of the thesis hold.",
        ),
        Command(
            "leg crosscheck", "fasbody.leg", "crosscheck",
            "Matrices and stepped response of a leg from the equations, Pinocchio and MuJoCo; exit 1 on disagreement.",
        ),
        Command(
            "leg drop", "fasbody.leg", "drop",
            "Kinoshita's drop, 5 kg at 0.93 m/s on a heel pad, stepped by MuJoCo with gravity.",
            needs="reproduction",
        ),
        Command(
            "leg decide", "fasbody.leg", "decide",
            "Which mechanism made a recording: how often an analysis of virtual subjects names the right one.",
            needs="reproduction",
        ),
        Command(
            "leg name", "fasbody.leg", "name",
            "Name the mechanism that made a person's recordings: a second mode, stiffening, lift-off, both, or none of "
            "these.",
        ),
        Command(
            "load effect", "fasbody.load_effect", "",
            "Find which mechanisms can raise the resonance with the load, and for what share of the values in the "
            "literature.",
            needs="reproduction",
        ),
        Command(
            "arch crosscheck", "fasbody.arch", "crosscheck",
            "Compare mass matrix and velocity terms of the arch: equations, Pinocchio, MuJoCo; exit 1 on disagreement.",
        ),
        Command(
            "cell", "fasbody.cell", "",
            "Natural frequencies and mode shapes of an adherent cell (Chapter 5 of the thesis).",
        ),
        Command(
            "cell modes", "fasbody.cell", "modes",
            "Modes of any elastic body: a bone, an insole block, a shoe sole; free, on its base, or held somewhere.",
        ),
        Command(
            "cell sweep", "fasbody.cell", "sweep",
            "Figures 5.9 (four shapes), 5.10 (seven moduli) and 5.11 (power law with both ways of fitting).",
            needs="reproduction",
        ),
        Command(
            "cell verify", "fasbody.cell", "verify",
            "Known bodies: free sphere, beams, plates, scaling laws; and the cell's mesh convergence. "
            "Takes about a minute.",
            needs="reproduction",
        ),
        Command(
            "cell shake", "fasbody.cell", "shake",
            "Beyond the thesis: damping of a viscoelastic cell, and its response to a shaken base from 5 Hz up.",
        ),
        Command(
            "cell response", "fasbody.cell", "response",
            "Damping of any viscoelastic body, and its response: to a shaken support, or, of a free body, to a force.",
        ),
        Command(
            "view cell", "viz.cell", "",
            "Watch the mode shapes of a cell, a bone or any body in slow motion; the page follows its result's file.",
        ),
        Command(
            "anatomy", "viz.anatomy", "",
            "Make the meshes of the foot from their shapes, check that they are closed, and write them as assets.",
        ),
    ),
    "Checks and benchmarks": (
        Command("", "fasbody", "", "Show what there is: every command of the project, and what it does."),
        Command(
            "reproduce", "reproduction", "",
            "Run every equation, table, figure and statement of the thesis, and say what came out. Takes some minutes.",
        ),
        Command(
            "bench", "benchmarks", "",
            "Measure everything that the documentation states, and write one table. Takes about an hour.",
        ),
        Command("bench accuracy", "benchmarks.accuracy", "", "Errors of MuJoCo and twin against DOP853."),
        Command(
            "bench acquire", "benchmarks.acquire", "",
            "Measure acquisition. Takes as long as the long recording, and at least ten minutes.",
        ),
        Command("bench arch", "benchmarks.arch", "", "Error, cost and stability of the stepped arch."),
        Command(
            "bench black-box", "benchmarks.black_box", "",
            "Compare black-box estimators with the truth and with other packages. Takes some minutes.",
        ),
        Command("bench callbacks", "benchmarks.callbacks", "", "Cost of the callbacks and gain of a second thread."),
        Command("bench bodies", "benchmarks.bodies", "", "Bodies of every kind by themselves: how far off, how long."),
        Command("bench cell", "benchmarks.cell", "", "Time and memory of the cell's modes, solver by solver."),
        Command(
            "bench coverage", "benchmarks.coverage", "",
            "Coverage of the confidence intervals, distribution of chi-square, and verdicts.",
        ),
        Command(
            "bench edits", "benchmarks.edits", "",
            "Edits of the models at three amplitudes and frequencies, and in pairs.",
        ),
        Command("bench findings-by-seed", "benchmarks.findings_by_seed", "", "Print how often each finding holds."),
        Command("bench fitting", "benchmarks.fitting", "", "Compare fits with those of scipy, which take minutes."),
        Command("bench long-file", "benchmarks.long_file", "", "Seconds and memory that a long CSV takes."),
        Command(
            "bench responses", "benchmarks.responses", "",
            "Frequency responses with a known answer, for every kind of excitation, beside the earlier estimates.",
        ),
        Command(
            "bench mutate", "benchmarks.mutate", "",
            "Plant faults in decision rules, one at a time, and say which the tests kill. Takes some minutes.",
        ),
        Command(
            "bench public-data", "benchmarks.public_data", "",
            "Black-box models of public recordings. Takes some minutes.",
        ),
        Command(
            "bench peak-to-peak", "benchmarks.peak_to_peak", "",
            "Sine fit and peak to peak on signals whose answer is known.",
        ),
        Command(
            "bench reality", "benchmarks.reality", "",
            "Verdicts and intervals in worlds that depart from the model, made by a separate simulator.",
        ),
        Command(
            "bench search", "benchmarks.search", "",
            "Whether a fit finds the best end on each side, or says that it may not have.",
        ),
        Command(
            "bench director", "benchmarks.director", "",
            "Compare what a plan foretells with what the fit says, on feet that the plan did not know.",
        ),
        Command(
            "bench rivals", "benchmarks.rivals", "",
            "Which rival is named in worlds that depart from the model, made by a separate simulator.",
        ),
        Command(
            "bench heel", "benchmarks.heel", "",
            "Count how often the intervals of the heel's laws hold the truth, and time the analysis.",
        ),
        Command(
            "bench sensors", "benchmarks.sensors", "",
            "What a second sensor on the foot decides, on legs made by a separate simulator.",
        ),
        Command(
            "bench study", "benchmarks.study", "",
            "Speed of a study from its first to its last fit. Takes about ten minutes on two idle cores.",
        ),
        Command(
            "bench study-end-to-end", "benchmarks.study_end_to_end", "",
            "540 recordings from the laboratory to the figures: time and memory.",
        ),
        Command(
            "bench study-population", "benchmarks.study_population", "",
            "Coverage of a population's intervals, drawn and fitted. Takes about ten minutes.",
        ),
        Command("bench viewer", "benchmarks.viewer", "", "Frames per second, time from slider to picture, and memory."),
    ),
}  # fmt: skip


def commands() -> list[Command]:
    """Every installed command, in the map's order."""
    return [command for group in GROUPS.values() for command in group if command.installed]


def resolve(arguments: Sequence[str]) -> tuple[Command, list[str]]:
    """The command that the first words of a command line name, and the arguments that are left for it.

    Raises:
        SettingError: no command is called so.
    """
    known = {tuple(command.words.split()): command for command in commands() if command.words}
    for count in range(min(len(arguments), max(map(len, known))), 0, -1):
        if command := known.get(tuple(arguments[:count])):
            return command, list(arguments[count:])
    listed = [words for words in map(" ".join, known) if words.split()[0] == arguments[0]]
    if listed:
        raise SettingError(f"{unknown('command', ' '.join(arguments[:2]), listed)}.")
    names = list(dict.fromkeys(word for words in known for word in (words[0], " ".join(words))))
    near = get_close_matches(arguments[0], names, n=3, cutoff=0.6)
    hint = f", did you mean {' or '.join(map(repr, near))}?" if near else ";"
    raise SettingError(f"unknown command {arguments[0]!r}{hint} python -m fasbody shows all {len(known)}.")
