"""Models to keep: saved to JSON or .mat, loaded again, and run beyond the end of a recording."""

import io
import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fasbody.console import to_json, write_whole
from fasbody.exceptions import InputFileError, SettingError, unknown
from identification.blackbox.data import Series
from identification.blackbox.mimo import MimoModel
from identification.blackbox.narx import Narx
from identification.blackbox.nonlinear import HammersteinWiener
from identification.blackbox.polynomial import Orders, PolynomialModel
from identification.blackbox.selection import Single
from identification.blackbox.state_space import StateSpaceModel, innovations

FORMAT = "fasbody black-box model 1"
KINDS = {kind.__name__: kind for kind in (Orders, PolynomialModel, StateSpaceModel, HammersteinWiener, Narx, MimoModel)}
Model = Single | MimoModel


def named(model: Model) -> dict[str, dict[str, float]]:
    """Value and standard error of each coefficient by its name: b1, f1, ...; the products of a NARX model."""
    if isinstance(model, MimoModel):
        parts = {letter: getattr(model, letter) for letter in "ABCDK"}
        return {
            f"{letter}{i + 1}_{j + 1}": {"value": value, "std_error": np.nan}
            for letter, part in parts.items() for (i, j), value in np.ndenumerate(part)
        }  # fmt: skip
    if isinstance(model, StateSpaceModel):
        return named(model.transfer)
    if isinstance(model, HammersteinWiener):
        more = [f"input{k}" for k in range(2, len(model.input_terms) + 2)]
        more += [f"output{k}" for k in (0, *range(2, len(model.output_terms) + 1))][: len(model.output_terms)]
        values = np.concatenate([model.input_terms, model.output_terms])
        return named(model.linear) | {n: {"value": v, "std_error": np.nan} for n, v in zip(more, values, strict=True)}
    rows = zip(model.names, model.theta, model.std_error, strict=True)
    return {name: {"value": value, "std_error": error} for name, value, error in rows}


def document(model: Model) -> dict[str, Any]:
    """The model as one JSON document: all that `load` needs, and its coefficients by name for people."""
    return {"format": FORMAT, "label": model.label, "coefficients": named(model), "model": _plain(model)}


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return {"kind": type(value).__name__} | {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    return value


def save(model: Model, path: Path) -> Path:
    """Write a model to a .json file, which `load` reads, or to a .mat file for others.

    Raises:
        SettingError: another ending.
    """
    if path.suffix == ".json":
        return write_whole(path, to_json(document(model)) + "\n")
    if path.suffix == ".mat":
        from scipy.io import savemat

        buffer = io.BytesIO()
        savemat(buffer, _for_matlab(document(model)))
        return write_whole(path, buffer.getvalue())
    raise SettingError(
        f"{path.name}: a model is saved as .json or .mat, not as {path.suffix or 'a file without ending'}."
    )


def _for_matlab(value: Any) -> Any:
    if isinstance(value, dict):
        return {_identifier(str(key)): _for_matlab(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        cells = np.empty(len(value), dtype=object)  # rows of unequal length, as MATLAB's cells
        cells[:] = [np.array(item) for item in value]
        return cells
    return value


def _identifier(key: str) -> str:
    """A name that MATLAB takes for a field: `y(t-1) u(t)` is y_t_1_u_t."""
    words = "_".join("".join(c if c.isalnum() else " " for c in key).split())[:60]
    return words if words[:1].isalpha() else f"x{words}"


def load(path: Path) -> Model:
    """The model saved at `path` as JSON.

    Raises:
        InputFileError: it cannot be read or is no such model.
    """
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise InputFileError(path, "cannot be read as JSON", "name a .json file written by save") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputFileError(path, "is no saved black-box model", f'its "format" has to be "{FORMAT}"')
    try:
        model = _made(content.get("model"))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputFileError(path, f"holds an incomplete model ({error})", "save it again") from error
    if not isinstance(model, Model):
        raise InputFileError(path, "holds no model", "save it again")
    return model


def _made(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    if value["kind"] not in KINDS:
        raise ValueError(unknown("kind", str(value["kind"]), KINDS))
    kind = KINDS[value["kind"]]
    parts: dict[str, Any] = {}
    for one in fields(kind):
        if one.name == "spread" and kind is MimoModel and one.name not in value:
            continue  # saved before it was kept
        part = value[one.name]
        if one.type is np.ndarray:
            parts[one.name] = np.array(part, dtype=float)
        elif one.name == "terms":
            parts[one.name] = tuple(tuple(int(k) for k in term) for term in part)
        elif one.type is float:
            parts[one.name] = float("nan") if part is None else float(part)
        else:
            parts[one.name] = tuple(part) if isinstance(part, list) else _made(part)
    return kind(**parts)


def forecast(model: Model, series: Series, steps: int, u: ArrayLike | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Output for `steps` samples after the end of a recording, and its standard deviation.

    Args:
        model: of any structure.
        series: what was measured so far, in the unit and about the mean of the model's estimation data.
        steps: samples ahead.
        u: the input there, shape (steps,); default: zero, the mean of the estimation data.

    Returns:
        Forecast (steps,) and standard deviation (steps,), that of future disturbances alone; NaN for NARX.

    Raises:
        SettingError: `steps` or the shape of `u` is invalid, or a model of several outputs.
    """
    if isinstance(model, MimoModel):
        raise SettingError("forecasts are of models with one input and one output.")
    if steps != int(steps) or steps < 1:
        raise SettingError(f"a forecast is of one step or more, a whole number, not of {steps:g}.")
    ahead = np.zeros(steps) if u is None else np.asarray(u, dtype=float)
    if ahead.shape != (steps,) or not np.isfinite(ahead).all():
        raise SettingError(
            f"a forecast of {steps} steps needs an input of {steps} finite samples, not one of shape {ahead.shape}."
        )
    if isinstance(model, Narx | HammersteinWiener):
        spread = np.nan if isinstance(model, Narx) else np.sqrt(model.loss)
        return model.extend(series, ahead), np.full(steps, spread)
    return innovations(model).forecast(series, ahead)
