"""A constant, a mass or a nuisance as a fit estimates it: value, 95 % interval, identified or not."""

from dataclasses import dataclass

import numpy as np

from fasbody.constants import Z95
from fasbody.foot.parameters import symbol_and_unit
from fasbody.presentation import Sheet, Tabled, grouped, readable


def label(key: str) -> str:
    """Symbol and unit of a key, for a table: ``k_T [N/m]``."""
    symbol, unit = symbol_and_unit(key)
    return f"{symbol} [{unit}]" if unit else symbol


#: Heads of the two columns of intervals.
WHATEVER, IF_TRUE = "95 % CI, model and sensor errors included", "95 % CI, model assumed exact"
#: What a status ends in that assumes the model, the masses and the instrument exact.
EXACT = ", model assumed exact"
#: Standard error up to which a parameter counts as identified, and as weakly identified: as a share of its value, or
#: of a tenth of its range for parameters that may be zero.
IDENTIFIED, WEAK = 0.1, 0.5
#: The same in words, as every report and page has them.
RULE = (
    f"A constant is identified if its standard error is at most {100 * IDENTIFIED:.0f} % of its value, both by the "
    "profile and by the curvature, and if the search found the minimum twice. It is weak up to "
    f"{100 * WEAK:.0f} %, and not identifiable beyond or at a bound. For a constant that may be zero (c_12, c_13, "
    "c_22, c_23) the standard error is divided by its value or by a tenth of its largest bound, whichever is larger."
)
#: Share of a mass's standard deviation that the recordings must take away to have weighed it.
WEIGHED = 0.3


def quantile(repeatability: float, dof: int) -> float:
    """How many standard errors a 95 % interval reaches to each side: Student's where the scatter was estimated."""
    from scipy.special import stdtrit  # slow to import, and needed for results only

    return Z95 if repeatability == 0 else float(stdtrit(max(2, dof), 0.975))


def identifiability(value: float, std_error: float, size: float, at_bound: bool) -> str:
    """identified / weak / not identifiable.

    Args:
        value, std_error: of the estimate.
        size: a size that matters for a parameter that may be zero, else 0.
        at_bound: it rests on a bound.
    """
    relative = std_error / max(abs(value), size, 1e-300)
    if at_bound or not np.isfinite(relative) or relative > WEAK:
        return "not identifiable"
    return "identified" if relative <= IDENTIFIED else "weak"


@dataclass(frozen=True, repr=False)
class Estimate(Tabled):
    """One parameter: value, standard error, 95 % limits, whether it ended at its bound, and how well it is known.

    They include errors of model and sensors (`Departures`), and `if_model_true` has those that assume
    the model, the masses and the instrument exact. Where no such fit was made (time domain, one frequency,
    all excluded) that is None, and these assume it; where the sines hold fewer numbers than there are
    parameters, none is offered (NaN). A spring or damper that may relax is dynamic, at the reference
    frequency, and `at_rest` says what it is without that.
    """

    value: float
    std_error: float
    lower: float
    upper: float
    at_bound: bool
    identifiability: str
    if_model_true: "Estimate | None" = None
    at_rest: "Estimate | None" = None

    def __repr__(self) -> str:
        return f"{self.interval()}, {self.known}"

    def sheet(self) -> Sheet:
        """The interval, and beside it that with the model assumed exact."""
        columns = [(WHATEVER, self), (IF_TRUE, self.if_model_true)] if self.if_model_true else [(IF_TRUE, self)]
        rows = [(head, e.interval(), e.known) for head, e in columns if e]
        return Sheet(str(self), ("interval", "value", ""), rows)

    def interval(self) -> str:
        """Value and half width of the 95 % interval, rounded to what is known."""
        if np.isnan(self.lower):  # of a fit that offers none
            return "–"
        below, above = self.value - self.lower, self.upper - self.value
        if self.at_bound or not np.isfinite(self.std_error):
            return f"{readable(self.value, 4)} (bound)" if self.at_bound else "unknown"
        if max(below, above) > 1.2 * min(below, above):  # cut by a bound, or wide on a logarithmic scale
            return f"{self._end(self.lower)} to {self._end(self.upper)}"
        return f"{self.text(self.value)} ± {self.text(0.5 * (below + above))}"

    @property
    def known(self) -> str:
        """How well it is known, for a table."""
        return self.identifiability + (", at bound" if self.at_bound else "")

    def text(self, x: float, places: int | None = None) -> str:
        """A number of this parameter's kind with two digits of its uncertainty; a dash if there is none.

        Args:
            x: the number.
            places: after the point, where those are more.
        """
        half = 0.5 * (self.upper - self.lower)
        if not np.isfinite(x):
            return "–"
        if not np.isfinite(half) or half <= 0:
            return readable(x, 4)
        digits = 1 - int(np.floor(np.log10(half)))
        digits = digits if places is None else max(digits, places)
        return grouped(f"{round(x, digits) + 0.0:.{max(0, digits)}f}")  # no minus before zero

    def _end(self, x: float) -> str:
        """An end of a lopsided interval, with three digits of its own at least: one may be far below the other."""
        if not np.isfinite(x) or x == 0 or abs(x) < 1e-4:
            return readable(x) if np.isfinite(x) else self.text(x)
        return self.text(x, 2 - int(np.floor(np.log10(abs(x)))))


@dataclass(frozen=True)
class Mass(Tabled):
    """A segment's mass without the load [kg]: as stated, and as the recordings weigh it.

    Attributes:
        name: thesis symbol.
        stated: [kg].
        prior_std: its relative standard deviation.
        value, lower, upper: estimate and 95 % interval [kg].
        learned: by which share the recordings made the standard deviation smaller.
        assumed: no body mass was stated, so `stated` is the model's own.
        weighed: the recordings say more of it than what was stated: they learned it, by several
            loads, in a fit that follows them and has come to rest. Under one load all constants
            scale with the mass, whatever was learned of the ratio of two masses.
    """

    name: str
    stated: float
    prior_std: float
    value: float
    lower: float
    upper: float
    learned: float
    weighed: bool = False
    assumed: bool = False

    @property
    def basis(self) -> str:
        """How its value before the recordings was known."""
        return "assumed" if self.assumed else "stated"

    def interval(self) -> str:
        """Value and half width of the 95 % interval [kg]."""
        std = (self.upper - self.lower) / 3.92
        return Estimate(self.value, std, self.lower, self.upper, False, "").interval()


@dataclass(frozen=True)
class Allowance(Tabled):
    """Something else that may be true, and what the recordings say of it.

    Attributes:
        name, group: what it is, and what is excluded together.
        does: to the recordings.
        unit: "" for a share.
        prior, prior_lower, prior_upper: what was held possible.
        value, lower, upper: estimate with 95 % interval.
        off: how many standard deviations of the prior it lies from where it was expected.
        seen: how many standard errors.
        source: where the prior comes from.
        kind: of the nuisance.
        constant: that it changes, "" for none.
        sensor: whose it is, "" for all.
        person: whose it is, None for everybody.
    """

    name: str
    group: str
    does: str
    unit: str
    prior: float
    prior_lower: float
    prior_upper: float
    value: float
    lower: float
    upper: float
    off: float
    seen: float
    source: str
    kind: str = ""
    constant: str = ""
    sensor: str = ""
    person: str | None = None
