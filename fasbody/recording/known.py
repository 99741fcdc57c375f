"""What a laboratory knows of its measurement beyond the recordings: the [known] table of study.toml.

A fit allows for masses that are stated a little wrong, channels that are not quite alike, and departures of the world
from the model. What a laboratory has excluded need not be allowed for, and the intervals become narrower.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fasbody.exceptions import InputFileError, SettingError, unknown
from fasbody.presentation import Tabled

#: Departures of the world from the model that a laboratory can exclude.
DEPARTURES = ("mount", "relaxation", "load", "rocking", "drift", "share")
_SIZES = {"mass_std": 0.5, "gain_std": 0.5, "delay_std_s": 0.01}
_FORCE = "static_force_n"


@dataclass(frozen=True)
class Known(Tabled):
    """What is known; None where nothing is said.

    Attributes:
        mass_std: relative standard deviation of the segment masses, 0 where they are exact. gain_std: that of the
            malleolus' gain against the base's. delay_std_s: standard deviation of the delay between them [s].
        excluded: departures that cannot be (`DEPARTURES`). static_force_n: with which the foot rests on the table
            without vibration [N], default the weight of leg and load.
    """

    mass_std: float | None = None
    gain_std: float | None = None
    delay_std_s: float | None = None
    excluded: frozenset[str] = frozenset()
    static_force_n: float | None = None
    load_share: float | None = None

    @classmethod
    def from_toml(cls, file: Path, table: Mapping[str, Any]) -> "Known":
        """From the [known] table of study.toml: sizes, and for a departure the words for how it was excluded.

        Raises:
            InputFileError: a key or value that does not exist.
        """
        sizes: dict[str, float] = {}
        force = table.get(_FORCE)
        if force is not None and (isinstance(force, bool) or not isinstance(force, int | float) or not 0 < force < 1e4):
            raise InputFileError(file, f"known.{_FORCE} = {force!r}", "valid: a force in N, above 0 and below 10000")
        for name, value in table.items():
            place = f"known.{name} = {value!r}"
            if name in _SIZES:
                if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= _SIZES[name]:
                    raise InputFileError(file, place, f"valid: a standard deviation, 0 to {_SIZES[name]:g}")
                sizes[name] = float(value)
            elif name not in (*DEPARTURES, _FORCE):
                raise InputFileError(file, unknown("key of [known]", name, (*_SIZES, _FORCE, *DEPARTURES)))
            elif name != _FORCE and not (isinstance(value, str) and value.strip()):
                raise InputFileError(file, place, 'valid: how it was excluded, for example mount = "tapped"')
        excluded = frozenset(table) & frozenset(DEPARTURES)
        return cls(**sizes, excluded=excluded, static_force_n=None if force is None else float(force))

    @classmethod
    def of_all(cls, each: Sequence["Known"]) -> "Known":
        """What holds for all of several recordings: the largest uncertainties, and what all exclude."""

        def largest(name: str) -> float | None:
            said = [getattr(known, name) for known in each]
            return None if None in said or not said else max(said)

        excluded = frozenset.intersection(*(known.excluded for known in each)) if each else frozenset()
        return cls(largest("mass_std"), largest("gain_std"), largest("delay_std_s"), excluded)

    def told(
        self,
        mass_std: float | None = None,
        gain_std: float | None = None,
        delay_std_s: float | None = None,
        exclude: Iterable[str] = (),
    ) -> "Known":
        """The same with what a user says, who overrules the study; "all" excludes every departure.

        Raises:
            SettingError: a size or a departure that does not exist.
        """
        given = {"mass_std": mass_std, "gain_std": gain_std, "delay_std_s": delay_std_s}
        for name, value in given.items():
            if value is not None and not 0 <= value <= _SIZES[name]:
                what = name.replace("_", " ").removesuffix(" s")
                raise SettingError(f"the {what} is {value:g}; give a standard deviation from 0 to {_SIZES[name]:g}.")
        excluded = set(self.excluded)
        for name in exclude:
            if name not in (*DEPARTURES, "all"):
                raise SettingError(f"{unknown('departure to exclude', name, (*DEPARTURES, 'all'))}.")
            excluded |= set(DEPARTURES) if name == "all" else {name}
        sizes = {name: getattr(self, name) if value is None else value for name, value in given.items()}
        return Known(**sizes, excluded=frozenset(excluded), static_force_n=self.static_force_n)
