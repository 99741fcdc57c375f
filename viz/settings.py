"""What is asked of the shown foot: what the sliders say, what of it a foot can have, and what drives the base."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fasbody.exceptions import InputFileError, SettingError
from fasbody.foot.model import Foot
from fasbody.foot.parameters import Parameter
from fasbody.foot.shaker import PEAK_TO_PEAK, BaseMotion, samples, sweep
from fasbody.recording.recording import Recording

#: Parameters that an added mass on the knee raises.
CARRIERS = ("m_S", "m_T", "added_mass")
#: What the parameters of the shipped models are: the page says these words before the thesis symbol.
WORDS = {
    "k_T": "ankle stiffness", "c_T": "ankle damping", "k_F": "fat pad stiffness", "c_F": "fat pad damping",
    "c_11": "ankle damping", "c_12": "its decay with stretch", "c_13": "its wave over stretch",
    "c_21": "fat pad damping", "c_22": "its decay with stretch", "c_23": "its wave over stretch",
    "k_11": "fascia stiffness, relaxed", "k_12": "fascia stiffness, fast part", "c_1": "fascia damping",
    "k_2": "apex stiffness", "k_3": "navicular stiffness", "k_4": "midfoot stiffness",
    "c_2": "apex damping", "c_3": "navicular damping", "c_4": "midfoot damping",
    "m_S": "shank mass", "m_T": "shank mass", "m_F": "foot mass",
}  # fmt: skip
#: Length of the swept sine and of what is shown of a recording [s], unless asked for; ends of the sweep [Hz].
SWEEP_S, RECORDED_S, SWEEP_HZ = 4.0, 1.0, (5.0, 50.0)
#: Fewest samples of a recording that make a motion: the cubic spline through them.
LEAST_SAMPLES = 4


@dataclass(frozen=True)
class Settings:
    """What the sliders say: frequency [Hz], peak to peak of the base [m/s^2], mass on the knee [kg], parameters."""

    frequency: float = 20.0
    peak_to_peak: float = PEAK_TO_PEAK
    added_mass: float = 0.0
    values: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("frequency", self.frequency, 0.5, 100.0),
            ("peak to peak", self.peak_to_peak, 0.0, 200.0),
            ("added mass", self.added_mass, 0.0, 50.0),
        ):
            if not low <= value <= high:
                raise SettingError(f"{name} is {value:g}, but must be between {low:g} and {high:g}.")

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
                raise SettingError(
                    f"{foot.name}: --added-mass needs the parameter {' or '.join(CARRIERS)}, which this model does "
                    "not declare; leave --added-mass out, or declare it as the shipped models do."
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


@dataclass(frozen=True, eq=False)
class Excitation:
    """What drives the base: a sine (base None), or a motion of its own, with what was measured beside it."""

    base: BaseMotion | None = None
    recording: Recording | None = None

    @classmethod
    def swept(cls, seconds: float = SWEEP_S) -> "Excitation":
        """A swept sine of `seconds`."""
        return cls(sweep(*SWEEP_HZ, seconds))

    @classmethod
    def recorded(cls, file: Path, seconds: float) -> "Excitation":
        """The first `seconds` of a recording; its mean is taken out.

        Raises:
            InputFileError: no such file, or too few samples within `seconds`.
        """
        if not file.is_file():
            valid = "give a recording, such as a CSV file with the columns time_s, base_m_s2 and malleolus_m_s2"
            raise InputFileError(file, "there is no such file", valid)
        whole = Recording.read(file)
        keep = whole.time_s - whole.time_s[0] <= seconds
        if keep.sum() < LEAST_SAMPLES:
            problem = f"has {keep.sum()} of its {len(keep)} samples within --seconds {seconds:g}"
            raise InputFileError(file, problem, f"at least {LEAST_SAMPLES} are needed")
        cut = replace(whole, **{
            name: getattr(whole, name)[keep] - (0 if name == "time_s" else getattr(whole, name).mean())
            for name in ("time_s", "base_m_s2", "malleolus_m_s2")
        })  # fmt: skip
        time = cut.time_s - cut.time_s[0]
        return cls(samples(time, cut.base_m_s2, cut.file), cut)
