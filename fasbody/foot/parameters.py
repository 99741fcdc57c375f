"""Parameters of a model, as the MJCF declares them: unit, bounds, where the number stands and where it comes from.

A model lists what may be edited, estimated and batched in its `<custom>` section, one `<text>` a parameter:

    <text name="k_F" data="N/m | 3e3 | 1e6 | joint fat_pad stiffness | bounds of section 4.5"/>

The fourth column is one place or several, separated by commas, each optionally with a share of the value:
`0.5 tendon heel_pad stiffness, 0.5 tendon forefoot_pad stiffness`. A number that stands there upside down, alone or in
a product of two columns of one field, is written

    1/ actuator branch gainprm 0 against dynprm 0     gainprm[0] = 1/value; dynprm[0] follows, their product stays
    1/ actuator branch dynprm 0 times gainprm 0       dynprm[0] gainprm[0] = 1/value; gainprm[0] stays
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fasbody.exceptions import ModelError, SettingError, unknown
from fasbody.foot import damper
from fasbody.presentation import Tabled

if TYPE_CHECKING:
    import mujoco

#: Units of parameters, and what they add to a name at the borders: k_T in N/m is ``k_T_n_per_m`` in JSON and CSV.
UNITS = {
    "N/m": "n_per_m", "N s/m": "n_s_per_m", "N m/rad": "n_m_per_rad", "N m s/rad": "n_m_s_per_rad", "1/m": "per_m",
    "1/rad": "per_rad",
    "kg": "kg", "s/m": "s_per_m", "N s^n": "n_s_n", "N s": "n_s", "N": "n", "m": "m", "s": "s", "": "",
}  # fmt: skip

#: What a declaration may point at: (element kind, attribute) -> mjModel field.
_FIELDS = {
    ("joint", "stiffness"): "jnt_stiffness",
    ("joint", "damping"): "dof_damping",
    ("joint", "user"): "jnt_user",
    ("joint", "armature"): "dof_armature",
    ("tendon", "stiffness"): "tendon_stiffness",
    ("tendon", "damping"): "tendon_damping",
    ("tendon", "user"): "tendon_user",
    ("body", "mass"): "body_mass",
    ("actuator", "biasprm"): "actuator_biasprm",
    ("actuator", "gainprm"): "actuator_gainprm",
    ("actuator", "dynprm"): "actuator_dynprm",
}


@dataclass(frozen=True)
class Place(Tabled):
    """Where a parameter stands in mjModel.

    Attributes:
        field: of mjModel.
        index: flat index within it.
        share: of the value, or of its reciprocal.
        reciprocal: one over the value stands there.
        times: another place (field, index): the product of both is what stands for the value, and it stays as it is.
        against: another place that is changed too, so that the product of both stays as it is.
    """

    field: str
    index: int
    share: float
    reciprocal: bool = False
    times: tuple[str, int] | None = None
    against: tuple[str, int] | None = None

    @property
    def fields(self) -> tuple[str, ...]:
        """Every field that is read or written."""
        return (self.field, *(partner[0] for partner in (self.times, self.against) if partner))

    def read(self, model: "mujoco.MjModel") -> float:
        """The value that stands here."""
        stored = getattr(model, self.field).ravel()[self.index]
        if self.times:
            stored = stored * getattr(model, self.times[0]).ravel()[self.times[1]]
        return float(self.share / stored if self.reciprocal else stored / self.share)

    def write(self, target: Mapping[str, np.ndarray], value: np.ndarray | float) -> None:
        """Write values into arrays by field name, each (nsim, size) or (size,)."""
        stored = self.share / np.asarray(value) if self.reciprocal else self.share * np.asarray(value)
        if self.times:
            stored = stored / target[self.times[0]][..., self.times[1]]
        if self.against:
            field, index = self.against
            target[field][..., index] *= target[self.field][..., self.index] / stored
        target[self.field][..., self.index] = stored


@dataclass(frozen=True)
class Parameter(Tabled):
    """One declared parameter.

    Attributes:
        name: thesis symbol, e.g. ``k_T``.
        unit: SI unit as written in the model.
        lower: lower bound, in that unit.
        upper: upper bound.
        places: where the number stands in mjModel.
        source: where the nominal value comes from.
    """

    name: str
    unit: str
    lower: float
    upper: float
    places: tuple[Place, ...]
    source: str

    @property
    def key(self) -> str:
        """Name with unit suffix, as used in JSON and CSV: ``k_T_n_per_m``."""
        return f"{self.name}_{UNITS[self.unit]}" if self.unit else self.name

    @property
    def label(self) -> str:
        """Name with unit, as tables have it: ``k_T [N/m]``."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def fields(self) -> tuple[str, ...]:
        """Every mjModel field that is read or written for it."""
        return tuple(dict.fromkeys(field for place in self.places for field in place.fields))

    @property
    def logarithmic(self) -> bool:
        """Stiffness and damping amplitudes are searched on a logarithmic scale."""
        return self.lower > 0.0

    def read(self, model: "mujoco.MjModel") -> float:
        """Value in the model, from its first place."""
        return self.places[0].read(model)

    def check(self, value: Any) -> None:
        """Refuse values that it cannot have, one or an array of them.

        Raises:
            SettingError: one is not finite, or below zero where none may be.
        """
        values = np.atleast_1d(np.asarray(value, float))
        bad = values[~np.isfinite(values) | ((values < 0) & (self.lower >= 0))]
        if bad.size:
            valid = "a number of zero or more" if self.lower >= 0 else "a finite number"
            raise SettingError(
                f"{self.name} is {bad[0]:g}; it must be {valid}{f', in {self.unit}' if self.unit else ''}."
            )

    def write(self, target: Mapping[str, np.ndarray], value: np.ndarray | float) -> None:
        """Write values into arrays by field name, each (nsim, size) or (size,)."""
        for place in self.places:
            place.write(target, value)


def symbol_and_unit(key: str) -> tuple[str, str]:
    """Thesis symbol and unit of a `Parameter.key`: ``k_T_n_per_m`` is k_T in N/m."""
    for unit, suffix in sorted(UNITS.items(), key=lambda item: -len(item[1])):  # _n_s_per_m also ends in _per_m
        if suffix and key.endswith(f"_{suffix}"):
            return key.removesuffix(f"_{suffix}"), unit
    return key, ""


class Fitted(Protocol):
    """What a fit returns: `identification.fit_foot`'s result, or one of its branches."""

    def values(self) -> Mapping[str, float]:
        """Key with unit -> value."""


def of_channel(name: str) -> bool:
    """Whether a fit's constant is one of a recording's channel and not of the foot: ``delay_s``, ``delay_foot_s``."""
    return name.startswith("delay")


class Parameters(Mapping[str, Parameter]):
    """All declared parameters of a model, in the order of the MJCF.

    Each is found by thesis symbol, ``k_T``, and as a fit names it: ``k_T_n_per_m`` in files, ``k_T [N/m]`` in tables.
    """

    def __init__(self, items: Iterable[Parameter], model_name: str) -> None:
        self._items = {item.name: item for item in items}
        named = {name: item for item in self._items.values() for name in (item.key, item.label)}
        self._keys = named | self._items
        self.model_name = model_name

    def __getitem__(self, name: str) -> Parameter:
        if name not in self._keys:
            raise SettingError(f"{unknown('parameter', name, self._items)} in model {self.model_name}.")
        return self._keys[name]

    def __contains__(self, name: object) -> bool:
        return name in self._keys

    def __iter__(self):  # type: ignore[no-untyped-def]
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def named(self, values: "Mapping[str, Any] | Fitted") -> dict[str, Any]:
        """Values by thesis symbol, of what a fit returns, a mapping or a pandas Series; no delay of a channel.

        Raises:
            SettingError: names that the model does not have, all of them in one sentence, or a value that is no number.
        """
        mapping: Any = values if hasattr(values, "items") else values.values()
        constants = {str(name): value for name, value in mapping.items() if not of_channel(str(name))}
        missing = [name for name in constants if name not in self]
        if len(missing) > 1:
            raise SettingError(f"model {self.model_name} has no {', '.join(missing)} (valid: {', '.join(self)}).")
        # a single unknown name is refused by self[name], with the nearest valid one
        by_symbol = {self[name].name: value for name, value in constants.items()}
        for name, value in by_symbol.items():
            if not np.issubdtype(np.asarray(value).dtype, np.number):
                raise SettingError(f"{name} is {value!r}; give a number, or the whole result of a fit.")
        return by_symbol

    @property
    def fields(self) -> tuple[str, ...]:
        """Every mjModel field that some parameter stands in."""
        return tuple(dict.fromkeys(field for item in self.values() for field in item.fields))


def declared(model: "mujoco.MjModel", name: str) -> Parameters:
    """Read the declarations of a compiled model.

    Args:
        model: the model.
        name: what to call it in messages.

    Raises:
        ModelError: a declaration cannot be understood or points at nothing.
    """
    import mujoco  # names and units are wanted without it

    items = []
    for number in range(model.ntext):
        symbol = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, number)
        start = model.text_adr[number]
        data = model.text_data[start : start + model.text_size[number]].decode().rstrip("\0")
        if "|" in data:  # other custom texts declare no parameter
            items.append(_parse(model, symbol, data, name))
    return Parameters(_follow_laws(model, _at_dampers(model, items)), name)


def _at_dampers(model: "mujoco.MjModel", items: list[Parameter]) -> list[Parameter]:
    """Where a damper's constant acts: at the law 4.25, whose c_1 `damping` only repeats, or where there is none, there.

    What bends a damper that has no law is dropped.
    """
    moved: dict[tuple[str, int], tuple[str, int] | None] = {}
    for user, damping, address in (
        ("jnt_user", "dof_damping", model.jnt_dofadr),
        ("tendon_user", "tendon_damping", range(model.ntendon)),
    ):
        laws = getattr(model, user)
        for number, law in enumerate(laws):
            first = number * law.size
            if law.size and law[0] == damper.DAMPER:
                moved[damping, int(address[number])] = user, first + 1
            elif law.size and not law.any():
                moved |= dict.fromkeys((user, first + column) for column in range(law.size))
                moved[user, first + 1] = damping, int(address[number])
    kept = []
    for item in items:
        to = [(place, moved.get(at := (place.field, place.index), at)) for place in item.places]
        places = tuple(replace(place, field=at[0], index=at[1]) for place, at in to if at)
        kept += [replace(item, places=places)] if places else []
    return kept


def _follow_laws(model: "mujoco.MjModel", items: list[Parameter]) -> list[Parameter]:
    """Where the law on an element is another than its declarations were made for, its own names and units.

    Where a declaration in a `user` field has another unit than the law's parameter there, it is dropped with all others
    of the element but those with the law's symbol and unit. The law declares the rest, all where nothing is declared:
    `fat_pad_E` [N], from a hundredth to a hundred times its value. A stiffness or damping of zero beside a law is no
    parameter.
    """
    law_parameters: list[Parameter] = []
    for kind, field in (("joint", "jnt_user"), ("tendon", "tendon_user")):
        rows = getattr(model, field)
        for number, row in enumerate(rows):
            law = next((law for law in damper.LAWS if row.size and law.code == row[0] != damper.DAMPER), None)
            if law is None:
                continue
            width, label = len(row), getattr(model, kind)(number).name
            units = [symbol_and_bracket(text) for text in law.parameters]
            on_element = [p for p in items if any(x.field == field and x.index // width == number for x in p.places)]
            columns = {x.index % width: p.unit for p in on_element for x in p.places}
            items = [p for p in items if not _unused(model, p, kind, number)]
            if columns and all(0 < c <= len(units) and units[c - 1][1] == unit for c, unit in columns.items()):
                continue
            expected = dict(enumerate(units, 1))
            meant = {c for p in on_element for x in p.places if expected.get(c := x.index % width) == (p.name, p.unit)}
            items = [p for p in items if p not in on_element or {x.index % width for x in p.places} <= meant]
            for column, (symbol, unit) in enumerate(units, 1):
                value = float(row[column])
                if column not in meant and symbol not in damper.FIXED and value > 0:
                    place = Place(field, number * width + column, 1.0)
                    source = f"as written; law {law.equation}"
                    law_parameters.append(
                        Parameter(f"{label}_{symbol}", unit, value / 100, 100 * value, (place,), source)
                    )
    return items + law_parameters


def _unused(model: "mujoco.MjModel", item: Parameter, kind: str, number: int) -> bool:
    """Whether a parameter is the stiffness or damping of an element that has none."""
    damper = ("dof_damping", int(model.jnt_dofadr[number])) if kind == "joint" else ("tendon_damping", number)
    linear = {("jnt_stiffness" if kind == "joint" else "tendon_stiffness", number), damper}
    return {(x.field, x.index) for x in item.places} <= linear and item.read(model) == 0


def symbol_and_bracket(text: str) -> tuple[str, str]:
    """Symbol and unit of a law's parameter as `damper.LAWS` writes it: "k_0 [N/m]" is k_0 in N/m."""
    symbol, _, unit = text.partition(" [")
    return symbol, unit.removesuffix("]")


def _parse(model: "mujoco.MjModel", symbol: str, data: str, name: str) -> Parameter:
    where = f"{name}: parameter {symbol!r}"
    parts = [part.strip() for part in data.split("|")]
    if len(parts) != 5:
        raise ModelError(f"{where} has {len(parts)} parts, not five: unit | lower | upper | where | source.")
    unit, lower, upper, places, source = parts
    if unit not in UNITS:
        raise ModelError(f"{where} has the unit {unit!r} (valid: {', '.join(filter(None, UNITS))}).")
    try:
        low, high = float(lower), float(upper)
    except ValueError:
        raise ModelError(f"{where} has bounds {lower!r} and {upper!r}; both must be numbers.") from None
    if not low < high:
        raise ModelError(f"{where} has a lower bound {low:g} that is not below its upper bound {high:g}.")
    return Parameter(symbol, unit, low, high, tuple(_place(model, p, where) for p in places.split(",")), source)


def _place(model: "mujoco.MjModel", text: str, where: str) -> Place:
    words = text.split()
    share, reciprocal = 1.0, bool(words) and words[0].endswith("/")
    try:
        share = float(words[0].removesuffix("/"))
        words = words[1:]
    except (ValueError, IndexError):
        pass
    partner = words[4:]  # "times" or "against" another column of the same element
    field, index = _slot(model, words[:4], text, where)
    if not partner:
        return Place(field, index, share, reciprocal)
    if len(partner) != 3 or partner[0] not in ("times", "against"):
        raise ModelError(f"{where} stands at {text.strip()!r}; behind it only 'times' or 'against ATTRIBUTE column'.")
    other = _slot(model, [*words[:2], *partner[1:]], text, where)
    return Place(field, index, share, reciprocal, **{partner[0]: other})


def _slot(model: "mujoco.MjModel", words: list[str], text: str, where: str) -> tuple[str, int]:
    """Field and flat index of `kind name attribute [column]`."""
    if len(words) not in (3, 4) or (words[0], words[2]) not in _FIELDS:
        valid = ", ".join(f"{kind} NAME {attribute}" for kind, attribute in _FIELDS)
        raise ModelError(
            f"{where} stands at {text.strip()!r}, which is no place (valid: {valid}, with a number behind; a NAME has "
            "no spaces)."
        )
    kind, element, attribute = words[:3]
    if element not in names(model, kind):
        raise ModelError(f"{where}: {unknown(kind, element, names(model, kind))}.")
    number = getattr(model, kind)(element).id
    field = _FIELDS[kind, attribute]
    if field.startswith("dof_"):
        number = int(model.jnt_dofadr[number])
    array = getattr(model, field)
    width = array.size // array.shape[0]
    if (len(words) == 4) != (width > 1) or not (width == 1 or words[3].isdigit()):
        expected = f"{kind} {element} {attribute}" + (f" and a column from 0 to {width - 1}" if width > 1 else "")
        raise ModelError(f"{where} stands at {text.strip()!r}; write {expected}.")
    column = int(words[3]) if width > 1 else 0
    if column >= width:
        raise ModelError(f"{where} stands in column {column} of {attribute!r}, which has {width} (0 to {width - 1}).")
    return field, number * width + column


def names(model: "mujoco.MjModel", kind: str) -> list[str]:
    """Names of all elements of a kind (``joint``, ``tendon``, ``body``, ``actuator``, ``sensor``, ``site``)."""
    counts = {"joint": model.njnt, "tendon": model.ntendon, "body": model.nbody, "actuator": model.nactuator}
    counts |= {"sensor": model.nsensor, "site": model.nsite}
    return [name for number in range(counts[kind]) if (name := getattr(model, kind)(number).name)]
