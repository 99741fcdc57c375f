"""What a fit found, as one document: printed, JSON, CSV."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fasbody.exceptions import SettingError, unknown
from fasbody.foot.parameters import of_channel, symbol_and_unit
from fasbody.presentation import Presented, Sheet, Tabled, csv_table, readable
from fasbody.recording.recording import UNSTATED, Recording
from fasbody.sentences import Sentence, begun, called
from identification.branches import misses
from identification.contact import Contact
from identification.contact import summary as lifted
from identification.estimates import EXACT, IF_TRUE, WHATEVER, Allowance, Estimate, Mass, label
from identification.misfit import Misfit
from identification.parameters import MASSES
from identification.sensors import SensorFit, summary

if TYPE_CHECKING:
    from identification.evidence import Evidence


#: Chance below which the model is said to miss the recordings.
UNLIKELY = 1e-3


def chance(p_value: float) -> str:
    """A p-value for people: below 1e-16 rounding alone decides what is left."""
    return "p < 1e-16" if p_value < 1e-16 else f"p = {p_value:.2g}"


def _flat(e: Estimate) -> dict[str, Any]:
    """An estimate as a row, with the limits of the exact model (the same where no others are known)."""
    row = asdict(e)
    narrow = e.if_model_true or e
    del row["if_model_true"], row["at_rest"]
    return row | {"lower_if_model_true": narrow.lower, "upper_if_model_true": narrow.upper}


@dataclass(frozen=True)
class Departures(Tabled):
    """A branch fitted with everything else that may be true.

    Attributes:
        chi_square: of the recordings, for dof degrees of freedom.
        objective: that and the squares of the prior's rows.
        dof: see chi_square.
        follows: it describes the recordings; if not, no constant is offered.
        masses, nuisances: what was estimated beside the constants.
        constant: the objective where no constant follows the load; None where that is not compared.
        exponents: thesis symbol -> the power of the weight on the pad that it follows, and its 95 %
            interval.
        repeatability: relative standard deviation of a first harmonic from recording to recording,
            as estimated.
        reference_frequency_hz: at which dynamic stiffness and damping are reported.
        scale_std: standard error of the logarithm of the leg's mass, a factor that all constants
            share.
        exhausted: the search found its end more than once.
        misfit: where in the recordings chi-square comes from.
        repeats_by_itself: `repeatability` as recordings of one condition show it, without a model;
            None where no condition was recorded twice.
        constants_repeat: standard deviation of the logarithm of each spring and damper from one
            recording to the next; a part of `repeatability`.
    """

    chi_square: float
    objective: float
    dof: int
    follows: bool
    masses: tuple[Mass, ...]
    nuisances: tuple[Allowance, ...]
    constant: float | None = None
    exponents: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    repeatability: float = 0.0
    reference_frequency_hz: float | None = None
    scale_std: float = 0.0
    exhausted: bool = True
    misfit: Misfit | None = None
    repeats_by_itself: float | None = None
    constants_repeat: float = 0.0

    @property
    def repeats(self) -> str:
        """How well recordings repeat, in words."""
        if self.repeatability < 5e-4:
            return "recordings repeat within sensor noise"
        return f"recordings repeat to {100 * self.repeatability:.2g} %"

    @property
    def per_dof(self) -> float:
        """Chi-square per degree of freedom."""
        return self.chi_square / max(1, self.dof)


@dataclass(frozen=True, repr=False)
class Branch(Presented):
    """One of the two mirror solutions.

    Attributes:
        name: "stiff ankle", "stiff pad", or "best" where no mirror exists.
        cost: weighted sum of squares.
        deviance: -2 log likelihood up to a constant.
        fit_percent: mean over recordings, Eq. (3.20).
        parameters: key with unit -> estimate.
        correlation: (p, p) of the search variables, in the order of parameters.
        chi_square, dof, p_value: goodness of fit of the model alone (steady state; in the time
            domain chi_square is only a ratio).
        departures: the fit with errors of model and sensors, None where none was made.
    """

    name: str
    cost: float
    deviance: float
    fit_percent: float
    parameters: Mapping[str, Estimate]
    correlation: list[list[float]]
    chi_square: float
    dof: int
    p_value: float | None
    departures: Departures | None = None

    def __getitem__(self, name: str) -> Estimate:
        """The estimate of a parameter, by thesis symbol or by its key with the unit.

        Raises:
            SettingError: it was not estimated.
        """
        for key, estimate in self.parameters.items():
            if name in (key, symbol_and_unit(key)[0]):
                return estimate
        raise SettingError(f"{unknown('estimate', name, (symbol_and_unit(key)[0] for key in self.parameters))}.")

    def values(self) -> dict[str, float]:
        """Key -> value of the foot's parameters, as `Foot.with_values` takes them; the channels' delay is none.

        They are those of the headline, as tables, report and page show them, with the masses of the one person that
        belong to them: all constants scale with these.
        """
        masses = self.departures.masses if self.departures else ()
        one = {mass.name: mass.value for mass in masses if mass.name in MASSES}
        return {key: e.value for key, e in self.parameters.items() if not of_channel(key)} | one

    def document(self) -> dict[str, Any]:
        """As in result.json, where the departures have the key `world`."""
        row = asdict(self)
        row["world"] = row.pop("departures")
        return row

    def records(self) -> list[dict[str, Any]]:
        """One row a parameter: as parameters.csv has it."""
        return [{"branch": self.name, "parameter": key, **_flat(e)} for key, e in self.parameters.items()]

    def sheet(self) -> Sheet:
        """Parameters with their intervals."""
        rows = [(label(key), e.interval(), e.known) for key, e in self.parameters.items()]
        return Sheet(f"{self.name}: fit {self.fit_percent:.1f} %", ("parameter", "95 % interval", ""), rows)

    def stiffness(self, named: bool = False) -> str:
        """Springs with their 95 % intervals, or all parameters of a model without springs; `named`: with the name."""
        p = self.parameters
        parts = [f"{key.split('_n_')[0]} = {p[key].interval()}" for key in p if key.endswith("_n_per_m")]
        text = f"{', '.join(parts)} N/m (95 %)" if parts else ", ".join(f"{key} {e.interval()}" for key, e in p.items())
        return f"{text} on the {self.name} branch" if named else text


@dataclass(frozen=True, eq=False)
class RecordingFit(Tabled):
    """One recording: measured and model traces, and how well they agree; `base` is what shook both.

    `sensors` has every accelerometer that was fitted, the malleolus first. `part_s` are the first and last second that
    were used, where that was not all of the file.
    """

    file: str
    frequency_hz: float | None
    added_mass_kg: float
    fit_percent: float
    time_s: np.ndarray
    measured: np.ndarray
    model: np.ndarray
    base: np.ndarray
    sensors: tuple[SensorFit, ...] = ()
    part_s: tuple[float, float] | None = None

    @classmethod
    def of(
        cls, recording: Recording, fit_percent: float, model: np.ndarray, sensors: tuple[SensorFit, ...] = ()
    ) -> "RecordingFit":
        """A recording beside the model's malleolus (n,) [m/s^2]."""
        c, r = recording.condition, recording
        about = (r.file, c.frequency_hz, c.added_mass_kg, fit_percent)
        return cls(*about, r.time_s, r.malleolus_m_s2, model, r.base_m_s2, sensors, r.part_s)

    def __repr__(self) -> str:
        return f"{self.file}: fit {self.fit_percent:.1f} %, {self.time_s.size} samples"


@dataclass(frozen=True, eq=False, repr=False)
class FitResult(Presented):
    """Everything `fasbody fit` reports; `document()` is result.json.

    `result["k_T"]` is an estimate of the likelier branch, `result.mirror` the other branch.
    """

    figures: ClassVar[str] = "identification.figures"
    plots: ClassVar[tuple[str, ...]] = (
        "transmissibility", "chi_square", "modes", "dampers", "energies", "traces", "residuals", "parameters",
        "waterfall", "correlation", "sensors", "contact",
    )  # fmt: skip

    source: str
    origin: str
    model: str
    domain: str
    branches: tuple[Branch, ...]
    recordings: tuple[RecordingFit, ...]
    verdict: str
    reason: str
    log_likelihood_ratio: float
    excitation_rank: int
    twin_mujoco_difference: float | None
    base_acceleration_error: float
    starts: tuple[Mapping[str, Any], ...]
    warnings: tuple[str, ...]
    truth: Mapping[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    contact: tuple[Contact, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
    evidence: "Evidence | None" = None

    @property
    def best(self) -> Branch:
        """The likelier branch; of two that are equally likely, the first by name."""
        return self.branches[0]

    @property
    def mirror(self) -> Branch | None:
        """The other branch, which fits a steady sine as well; None where there is none."""
        return self.branches[1] if len(self.branches) > 1 else None

    def __getitem__(self, name: str) -> Estimate:
        """The likelier branch's estimate of a parameter, by thesis symbol or by its key with the unit.

        Raises:
            SettingError: it was not estimated.
        """
        return self.best[name]

    @property
    def trusting(self) -> bool:
        """Whether intervals that trust the model are shown: the fit follows, and the sines hold numbers enough for it.

        Where only distortion tells the rest, a small error of the model moves the constants by far more than these
        intervals are wide (14 of 16 missed the truth of a linear foot with two sines).
        """
        return (self.departures is None or self.departures.follows) and self.excitation_rank >= len(self.parameters)

    @property
    def offered(self) -> bool:
        """Whether any constant has an interval; if none has, no number that follows from them is offered either."""
        return not all(np.isnan(e.lower) for e in self.parameters.values())

    def values(self) -> dict[str, float]:
        """Key -> value of the likelier branch, as `Foot.with_values` takes them."""
        return self.best.values()

    def records(self) -> list[dict[str, Any]]:
        """One row a parameter and branch: as parameters.csv has it."""
        return [row for branch in self.branches for row in branch.records()]

    def sheet(self) -> Sheet:
        """Parameters of both branches, the truth where it is known, and the result in a sentence."""
        mirrors = [f"mirror: {branch.name}" for branch in self.branches[1:]]
        rows = []
        for key, e in self.parameters.items():
            truth = self.truth_of(key)
            known = ["" if truth is None else readable(truth, 6)] if self.truth else []
            others = [branch.parameters[key].interval() for branch in self.branches[1:]]
            trusting = e.if_model_true if self.trusting else None
            narrow = [trusting.interval() if trusting else "–"] if self.departures else []
            rows.append([label(key), e.interval(), *narrow, *others, *known, e.known])
        for i, mass in enumerate(self.departures.masses if self.departures else ()):
            truth = self.truth_of(f"{mass.name}_kg")
            known = ["" if truth is None else f"{truth:.4g}"] if self.truth else []
            others = [b.departures.masses[i].interval() if b.departures else "" for b in self.branches[1:]]
            word = "estimated" if mass.weighed else "assumed" if mass.assumed else "as stated"
            prior = f"{mass.stated:.4g} {mass.basis}"
            rows.append([f"{mass.name} [kg]", mass.interval(), prior, *others, *known, word])
        columns = ["parameter", *self.intervals, *mirrors, *(["truth"] if self.truth else []), "status"]
        notes = [
            self.sentence(),
            self.reason,
            *self.by_sensor,
            *self.impossible,
            *(f"note: {text}" for text in self.warnings),
        ]
        origin = "" if self.origin == UNSTATED else f" ({self.origin})"
        return Sheet(f"{self.source}{origin}, model {self.model}", columns, rows, notes)

    def write(self, folder: Path | str) -> list[Path]:
        """Write result.json, parameters.csv and report.html into a folder, each whole or not at all."""
        return list(import_module("identification.report").write(self, Path(folder)))

    @property
    def impossible(self) -> list[str]:
        """That the foot would leave the table, in a sentence; nothing where the table only presses."""
        text = lifted(self.contact)
        best = self.best
        if text and self.domain == "periodic" and misses(best.chi_square, best.dof):
            text += " This force is approximate, as the model without sensor errors does not fit these recordings."
        return [text] if text else []

    @property
    def by_sensor(self) -> list[str]:
        """How each sensor is followed, in a line; nothing where the malleolus is alone."""
        return summary([recording.sensors for recording in self.recordings])

    @property
    def departures(self) -> Departures | None:
        """The fit with errors of model and sensors, of the likelier branch; None where none was made."""
        return self.best.departures

    @property
    def intervals(self) -> tuple[str, ...]:
        """What the intervals of a table allow for, in the order of its columns."""
        return (WHATEVER, IF_TRUE) if self.departures else (IF_TRUE,)

    @property
    def open(self) -> tuple[Branch, ...]:
        """The branches that the data leave open: both where they do not decide."""
        return self.branches if self.verdict == "undecided" else self.branches[:1]

    @property
    def parameters(self) -> Mapping[str, Estimate]:
        """Estimates of the likelier branch."""
        return self.best.parameters

    @property
    def fit_percent(self) -> float:
        """Mean fit of the likelier branch."""
        return self.best.fit_percent

    def truth_of(self, key: str) -> float | None:
        """Known value of a parameter given with its unit suffix, None if there is none."""
        return next((value for name, value in self.truth.items() if key == name or key.startswith(f"{name}_")), None)

    def with_source(self, source: str, truth: Mapping[str, float] | None = None) -> "FitResult":
        """The result under another name of its data, beside the known parameters of synthetic ones."""
        return replace(self, source=source, truth=dict(truth or {}))

    def document(self) -> dict[str, Any]:
        """The result as plain data; numbers that do not exist are null."""
        return {
            "source": self.source,
            "origin": self.origin,
            "model": self.model,
            "domain": self.domain,
            "fit_percent": self.fit_percent,
            "recordings": [
                {name: getattr(r, name) for name in ("file", "frequency_hz", "added_mass_kg", "fit_percent")}
                | {"sensors": [sensor.document() for sensor in r.sensors]}
                | ({"part_s": list(r.part_s)} if r.part_s else {})
                for r in self.recordings
            ],
            "parameters": {key: asdict(value) for key, value in self.parameters.items()},
            "branches": [branch.document() for branch in self.branches],
            "verdict": self.verdict,
            "verdict_reason": self.reason,
            "log_likelihood_ratio": self.log_likelihood_ratio,
            "goodness_of_fit": {
                "chi_square": self.best.chi_square, "dof": self.best.dof, "p_value": self.best.p_value,
            },
            "chi_square_wide": self.departures.chi_square if self.departures else None,
            "masses": [asdict(mass) for mass in self.departures.masses] if self.departures else [],
            "nuisances": [asdict(item) for item in self.departures.nuisances] if self.departures else [],
            "contact": [item.document() for item in self.contact],
            "excitation_rank": self.excitation_rank,
            "twin_mujoco_difference": self.twin_mujoco_difference,
            "base_acceleration_error": self.base_acceleration_error,
            "starts": [dict(start) for start in self.starts],
            "truth": dict(self.truth),
            "warnings": list(self.warnings),
            "provenance": dict(self.provenance),
            "seconds": self.seconds,
        }  # fmt: skip

    def csv(self) -> str:
        """parameters.csv: one row a parameter and branch."""
        return csv_table(self.records())

    def misfit(self) -> str:
        """That the model misses the recordings, in words; nothing where it does not."""
        best = self.best
        if self.domain != "periodic" or not best.dof:
            return ""
        p = best.p_value
        alone = f"chi-square {best.chi_square / best.dof:.2f} per degree of freedom"
        alone += "" if p is None else f", {chance(p)}"
        if self.departures and not self.departures.follows:
            return Sentence(
                "The model does not follow the recordings: it deviates from them by "
                f"{100 * self.departures.repeatability:.2g} %, and 2 to 5 % is assumed as usual for people. No "
                f"constant is reported. {self._to_check} ",
                begun(called("compare_rivals")),
                " compares other models. ",
            )
        if p is None or p >= UNLIKELY:
            return ""
        if self.departures:
            return Sentence(
                f"With the model assumed exact, it does not fit the recordings ({alone}; ",
                called("compare_rivals"),
                " compares other models). With model and sensor errors it does: ",
            )
        return f"The model does not fit the recordings ({alone}): "

    @property
    def _to_check(self) -> str:
        """What to look at where the model does not follow: of a user's model first what it does not estimate."""
        usual = "heck the added masses, the body mass and the units"
        if not self.model.endswith(".xml"):
            return f"C{usual} first."
        return f"{self.model} may not suit this foot: fit two_dof for comparison. Also c{usual}."

    def sentence(self) -> str:
        """The result in one sentence, with the values of both branches where the data do not decide; a misfit first."""
        values = " or ".join(branch.stiffness(len(self.open) > 1) for branch in self.open)
        if not self.offered:
            count = len(self.parameters)
            rank = f"the recordings determine at most {self.excitation_rank} of {count} free parameters"
            why = rank if self.excitation_rank < count else "the model does not follow the recordings"
            values = f"No constant is reported, as {why}"
        goodness = ""
        if self.domain == "periodic":
            per = f"chi-square {self.best.chi_square / max(1, self.best.dof):.2f} per degree of freedom"
            goodness = f", {per}" if self.best.dof else ", no degrees of freedom left"
        if self.misfit():  # which gives it
            goodness = ""
        word = self.verdict if self.departures or self.verdict == "not compared" else f"{self.verdict}{EXACT}"
        word = "no second branch was compared" if word == "not compared" else word
        if self.departures and not self.departures.follows:
            return Sentence(self.misfit(), f"Fit {self.fit_percent:.1f} %; {word}.")
        at = f" at {self.departures.reference_frequency_hz:.3g} Hz" if self.departures and self.relaxes else ""
        repeats = f", {self.departures.repeats}" if self.departures else ""
        return Sentence(self.misfit(), f"{values}{at}; fit {self.fit_percent:.1f} %{goodness}{repeats}; {word}.")

    @property
    def relaxes(self) -> bool:
        """Whether a spring or damper may be another at rest than at the frequency it is reported at."""
        return bool(self.departures and any(e.at_rest for e in self.parameters.values()))

    def __str__(self) -> str:
        lines = [self.sentence(), self.reason]
        for branch in self.open:
            lines += [f"{branch.name}:"] if len(self.open) > 1 else []
            lines += [f"  {key:>18} {e.interval()}  {e.identifiability}" for key, e in branch.parameters.items()]
        return "\n".join(lines)


def trusting(branch: Branch) -> Branch:
    """A branch whose model was assumed exact: its words say so."""
    estimates = {
        key: e if e.identifiability == "not identifiable" else replace(e, identifiability=e.identifiability + EXACT)
        for key, e in branch.parameters.items()
    }
    return replace(branch, parameters=estimates)


def without_exact(branch: Branch) -> Branch:
    """A branch that offers no interval of the exact model, and calls no constant known by it."""
    word = "not identifiable"
    estimates = {}
    for key, e in branch.parameters.items():
        if branch.departures is None:
            estimates[key] = replace(e, std_error=np.nan, lower=np.nan, upper=np.nan, identifiability=word)
        else:
            estimates[key] = replace(
                e, if_model_true=e.if_model_true and replace(e.if_model_true, identifiability=word)
            )
    return replace(branch, parameters=estimates)
