"""Settings of the displayed foot: the values of the sliders, and their limits by the foot."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fasbody.exceptions import SettingError
from fasbody.foot.model import Foot
from fasbody.foot.parameters import Parameter
from fasbody.foot.shaker import PEAK_TO_PEAK
from fasbody.presentation import Tabled
from fasbody.sentences import Sentence, called

#: Parameters that an added mass on the knee raises.
CARRIERS = ("m_S", "m_T", "added_mass")


def can_add_mass(feet: Iterable[Foot]) -> bool:
    """Whether each foot has a parameter that an added mass raises."""
    return all(any(name in foot.parameters for name in CARRIERS) for foot in feet)


#: What the parameters of the shipped models are: the page says these words before the thesis symbol.
WORDS = {
    "k_T": "ankle stiffness", "c_T": "ankle damping", "k_F": "fat pad stiffness", "c_F": "fat pad damping",
    "c_11": "ankle damping", "c_12": "its decrease with stretch", "c_13": "its oscillation with stretch",
    "c_21": "fat pad damping", "c_22": "its decrease with stretch", "c_23": "its oscillation with stretch",
    "k_11": "fascia stiffness, relaxed", "k_12": "fascia stiffness, fast part", "c_1": "fascia damping",
    "k_2": "apex stiffness", "k_3": "navicular stiffness", "k_4": "midfoot stiffness",
    "c_2": "apex damping", "c_3": "navicular damping", "c_4": "midfoot damping",
    "m_S": "shank mass", "m_T": "shank mass", "m_F": "foot mass",
}  # fmt: skip


@dataclass(frozen=True)
class Settings(Tabled):
    """Values of the sliders: frequency [Hz], peak to peak of the base [m/s^2], mass on the knee [kg], parameters.

    `delay_s` is how late a measured malleolus is, as a fit found it; model and measurement are compared without it.
    """

    frequency: float = 20.0
    peak_to_peak: float = PEAK_TO_PEAK
    added_mass: float = 0.0
    values: Mapping[str, float] = field(default_factory=dict)
    delay_s: float = 0.0

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("frequency", self.frequency, 0.5, 100.0),
            ("peak to peak", self.peak_to_peak, 0.0, 200.0),
            ("added mass", self.added_mass, 0.0, 100.0),
            ("delay", self.delay_s, -0.1, 0.1),
        ):
            if not low <= value <= high:
                raise SettingError(
                    setting=name.replace(" ", "_"), quantity=name, value=value,
                    problem=f"{name} is {value:g}, but must be between {low:g} and {high:g}",
                )  # fmt: skip

    def held(self, foot: Foot) -> "Settings":
        """These settings with each parameter brought to the nearest value that the foot declares as possible.

        Raises:
            SettingError: unknown parameter.
        """
        values = {
            name: float(np.clip(value, foot.parameters[name].lower, foot.parameters[name].upper))
            for name, value in self.values.items()
        }
        return replace(self, values=values)

    def apply(self, foot: Foot) -> Foot:
        """The foot with these parameters and the added mass.

        Raises:
            SettingError: a parameter is unknown or outside its declared bounds, or nothing carries the added mass.
        """
        values = dict(self.values)
        for name, value in values.items():
            within(foot.parameters[name], value, foot.name)
        if self.added_mass:
            carrier = next((name for name in CARRIERS if name in foot.parameters), None)
            if carrier is None:
                mass = called("added_mass")
                raise SettingError(
                    file=foot.name,
                    problem=Sentence(
                        mass, f" needs the parameter {' or '.join(CARRIERS)}, which this model does not declare"
                    ),
                    remedy=Sentence("leave ", mass, " out, or declare it as the shipped models do"),
                )
            values[carrier] = values.get(carrier, foot.values()[carrier]) + self.added_mass
        return foot.with_values(values)


def within(parameter: Parameter, value: float, where: object) -> None:
    """Refuse a value outside a parameter's declared bounds.

    Raises:
        SettingError: names parameter, value and bounds.
    """
    slack = 1e-9 * max(abs(parameter.lower), abs(parameter.upper))  # a fit that ended on a bound, rounded
    if not parameter.lower - slack <= value <= parameter.upper + slack:
        raise SettingError(
            f"{where}: {parameter.name} is {value:g} {parameter.unit}, but must be between {parameter.lower:g} and "
            f"{parameter.upper:g}, the bounds that the model declares."
        )


def settings_from(message: Mapping[str, Any]) -> Settings:
    """The page's settings, checked.

    Raises:
        SettingError: something is missing, or no finite number.
    """
    try:
        values = {str(name): float(value) for name, value in dict(message.get("values", {})).items()}
        numbers = {name: float(message[name]) for name in ("frequency", "peak_to_peak", "added_mass")}
        numbers["delay_s"] = float(message.get("delay_s", 0.0))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise SettingError(f"the page's settings cannot be read ({error}); reload it.") from None
    for name, value in (numbers | values).items():
        if not math.isfinite(value):
            raise SettingError(f"{name} from the page is {value}, but that is no number; reload it.")
    return Settings(**numbers, values=values)
