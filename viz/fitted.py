"""What a fit found, as the page shows it: both branches with values and intervals, verdict, fit and notes.

The sentences are those of the report: they come from the result, or from its result.json.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fasbody.exceptions import InputFileError, SettingError
from fasbody.foot.parameters import Parameter, symbol_and_unit
from identification.estimates import Estimate
from viz.settings import within

_VALID = "give the result.json of fasbody fit"


def fitted(
    document: Mapping[str, Any], parameters: Mapping[str, Parameter], sentence: str = "",
    held: Mapping[str, float] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """A result's document as the page shows it.

    Args:
        document: `FitResult.document()`, or what was read from its file.
        parameters: of the model.
        sentence: the result in one sentence, where it is at hand.
        held: constants that the fit had at other values than the model's, and did not change.

    Raises:
        KeyError, TypeError, ValueError: it is no such document.
    """
    alone = {"name": "best", "parameters": document.get("parameters"), "world": {"masses": document.get("masses")}}
    branches = document.get("branches") or [alone]
    world, best = branches[0].get("world") or {}, branches[0]["parameters"].values()
    hz = world.get("reference_frequency_hz") if any(entry.get("at_rest") for entry in best) else None
    return {
        "at": f"at {hz:.3g} Hz" if hz else "",
        "source": str(document.get("source", "")),
        "model": str(document.get("model", "")),
        "sentence": sentence,
        "fit_percent": document.get("fit_percent"),
        "verdict": str(document.get("verdict", "")),
        "reason": str(document.get("verdict_reason", "")),
        "warnings": list(map(str, document.get("warnings", []))),
        "branches": [_branch(branch, parameters, dict(held or {})) for branch in branches],
        "recordings": [
            {name: r.get(name) for name in ("file", "frequency_hz", "added_mass_kg", "fit_percent")}
            for r in document.get("recordings", [])
        ],
    }


def _branch(
    branch: Mapping[str, Any], parameters: Mapping[str, Parameter], held: Mapping[str, float]
) -> dict[str, Any]:
    """One branch: its values and masses, which belong together, and its intervals."""
    rows, delay = [], 0.0
    masses = (branch.get("world") or {}).get("masses") or []
    values = {m["name"]: float(m["value"]) for m in masses if m["name"] in parameters} | dict(held)
    symbols = {p.key: name for name, p in parameters.items()}
    for key, entry in branch["parameters"].items():
        value = float(entry["value"])
        name = symbols.get(key, symbol_and_unit(key)[0])
        if key in symbols:
            values[name] = value
        elif name == "delay":
            delay = value
        row = {"name": name, "unit": symbol_and_unit(key)[1], "key": key, "value": value}
        row |= {"known": str(entry.get("identifiability", ""))}
        if "lower" in entry:
            whole = _estimate(entry)
            finite = math.isfinite(whole.lower) and math.isfinite(whole.upper)
            row |= {"interval": whole.interval(), "known": whole.known}
            row |= {"lower": whole.lower, "upper": whole.upper} if finite else {}
            if entry.get("at_rest"):
                row["at_rest"] = _estimate(entry["at_rest"]).interval()
        rows.append(row)
    about = {"name": str(branch.get("name", "best")), "fit_percent": branch.get("fit_percent")}
    return about | {"values": values, "delay_s": delay, "rows": rows}


def _estimate(entry: Mapping[str, Any]) -> Estimate:
    """An entry of a document, with NaN for what does not exist."""
    value, std_error, lower, upper = (
        math.nan if entry[name] is None else float(entry[name]) for name in ("value", "std_error", "lower", "upper")
    )
    return Estimate(value, std_error, lower, upper, bool(entry["at_bound"]), str(entry["identifiability"]))


def model_of(file: Path) -> str:
    """The model that a fit was made with, by its result.json; empty where it does not say."""
    try:
        document = json.loads(file.read_text())
        return str(document.get("provenance", {}).get("model") or document.get("model") or "")
    except (OSError, ValueError, AttributeError):  # which `read` tells
        return ""


def read(file: Path, parameters: Mapping[str, Parameter]) -> dict[str, Any]:
    """The result.json of a fit of a model with these parameters, as the page shows it.

    Raises:
        InputFileError: no such file, it is no result, or it holds none of the model's parameters.
        SettingError: a value is no number or outside the bounds that the model declares.
    """
    try:
        fit = fitted(json.loads(file.read_text()), parameters)
    except OSError as error:
        raise InputFileError(file, f"cannot be read ({error.strerror})", _VALID) from None
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        raise InputFileError(file, "is not a result", _VALID) from None
    for branch in fit["branches"]:
        if not branch["values"]:
            raise InputFileError(file, "holds no parameter of this model", "give the --model that was fitted")
        for name, value in branch["values"].items():
            if not math.isfinite(value):
                raise SettingError(f"{file}: {name} is {value}, but must be a finite number.")
            within(parameters[name], value, file)
    return fit | {"reported": (file.parent / "report.html").is_file()}
