"""A number that came out and what is asked of it: in the rows of docs/reproduction.md and of the benchmarks."""

import math
import os
import platform
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fasbody.runner import versions


@dataclass(frozen=True)
class Check:
    """A measured value and where it should lie; whether it does is never written down, but follows.

    Attributes:
        what: the number, in words. value: it. low, high: limits, which belong to the range. unit: of all three.
        said: what was measured, in words, where the number alone does not say it. beside: the requirement, too, or
            what it is compared with. ratio: how many times better than something else that was measured, too.
        asked: whether anything is required. source: where that is from: a group of an outcome, a topic of benchmarks.
    """

    what: str
    value: float = math.nan
    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    said: str = ""
    beside: str = ""
    ratio: float | None = None
    asked: bool = True
    source: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the number lies where it should, None if nothing is asked; one that is not finite never does."""
        return math.isfinite(self.value) and self.low <= self.value <= self.high if self.asked else None

    @property
    def criterion(self) -> str:
        """The limits in words."""
        if self.low == self.high:
            return f"{self.low:.4g}"
        if self.low == -math.inf:
            return f"at most {self.high:.4g}"
        if self.high == math.inf:
            return f"at least {self.low:.4g}"
        middle, half = (self.low + self.high) / 2, (self.high - self.low) / 2
        narrow = half < 1e-3 * abs(middle) or middle == 0
        return f"{middle:.6g} ± {half:.2g}" if narrow else f"{self.low:.4g} to {self.high:.4g}"

    @property
    def measured(self) -> str:
        """What came out, with its unit."""
        return self.said or _number(self.value, self.unit)

    @property
    def against(self) -> str:
        """The requirement, or what it is compared with."""
        if self.beside or not self.asked:
            return self.beside
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"{_number(self.low)} to {_number(self.high, self.unit)}"
        word, limit = ("at most", self.high) if math.isfinite(self.high) else ("at least", self.low)
        return f"{word} {_number(limit, self.unit)}"

    @property
    def margin(self) -> float | None:
        """How many times better than its one limit: limit over value, or value over least."""
        one = math.isfinite(self.low) != math.isfinite(self.high)
        if self.beside or not one:
            return None
        return over(self.high, self.value) if math.isfinite(self.high) else over(self.value, self.low)

    def __str__(self) -> str:
        if self.said and not self.asked:
            return f"{self.what}: {self.said}"
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.what}: {self.value:.4g}{unit} ({'' if self.met else 'NOT '}{self.criterion})"

    def document(self) -> dict[str, Any]:
        """As plain data for JSON, which knows no infinity: a limit that is not there is null."""
        plain = {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in asdict(self).items()}
        told = {"measured": self.measured, "against": self.against, "margin": self.margin}
        return plain | told | {"holds": self.met, "text": str(self)}

    @classmethod
    def of(cls, document: dict[str, Any]) -> "Check":
        """The check of a document."""
        given: dict[str, Any] = {k: v for k in cls.__dataclass_fields__ if (v := document[k]) is not None}
        return cls(**given)  # what is absent has its default


def over(a: float, b: float) -> float | None:
    """How many times `a` is `b`; None where that is no finite number."""
    return float(a / b) if b > 0 and math.isfinite(a / b) else None


def near(what: str, value: float, wanted: float, tolerance: float, unit: str = "") -> Check:
    """`value` within `tolerance` (in the same unit) of `wanted`."""
    return Check(what, float(value), wanted - tolerance, wanted + tolerance, unit)


def within(what: str, value: float, low: float, high: float, unit: str = "") -> Check:
    """`value` from `low` to `high`."""
    return Check(what, float(value), low, high, unit)


def at_most(what: str, value: float, limit: float, unit: str = "") -> Check:
    """`value` not above `limit`."""
    return Check(what, float(value), high=limit, unit=unit)


def at_least(what: str, value: float, limit: float, unit: str = "") -> Check:
    """`value` not below `limit`."""
    return Check(what, float(value), low=limit, unit=unit)


def exactly(what: str, value: float, wanted: float, unit: str = "") -> Check:
    """A count that must be `wanted`."""
    return Check(what, float(value), wanted, wanted, unit)


def told(what: str, said: str, beside: str = "", ratio: float | None = None) -> Check:
    """Something measured of which nothing is required."""
    return Check(what, said=said, beside=beside, ratio=ratio, asked=False)


def _number(value: float, unit: str = "") -> str:
    return f"{rounded(value)} {unit}".strip()


def rounded(value: float) -> str:
    """Three digits, without an exponent below a million."""
    return f"{float(f'{value:.3g}'):g}"


def machine(*libraries: str) -> str:
    """Processor, cores, system and versions in one line."""
    cpu = Path("/proc/cpuinfo")
    lines = cpu.read_text().splitlines() if cpu.is_file() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return (
        f"{models[0] if models else platform.machine()}, {os.cpu_count()} cores; {platform.system()}, "
        f"Python {platform.python_version()}, {versions(*libraries)}"
    )
