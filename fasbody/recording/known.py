"""What a laboratory has measured or excluded beyond the recordings: the [known] table of study.toml.

A fit allows for masses that are stated a little wrong, channels that are not quite alike, and departures of the foot
from the model. What a laboratory has excluded need not be allowed for, and the intervals become narrower.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.constants import GRAVITY
from fasbody.exceptions import InputFileError, SettingError, unknown
from fasbody.presentation import Tabled

#: Departures of the foot from the model that a laboratory can exclude.
DEPARTURES = ("mount", "relaxation", "load", "rocking", "drift", "share", "seating")
_SIZES = {"mass_std": 0.5, "gain_std": 0.5, "delay_std_s": 0.01}
_FORCE, _SHARE = "static_force_n", "load_share"
#: Limits of the share of the load that the leg carries.
_SHARES = (0.3, 1.2)


@dataclass(frozen=True)
class Known(Tabled):
    """What is known; None where nothing is stated.

    Attributes:
        mass_std: relative standard deviation of the segment masses, 0 where they are exact.
        gain_std: that of the malleolus' gain against the base's.
        delay_std_s: standard deviation of the delay between them [s].
        excluded: departures that cannot be (`DEPARTURES`).
        static_forces: load on the knee [kg] and force [N] with which the foot rests on the table
            under it without vibration; default the weight of leg and load.
        load_share: of the added mass that the leg carries, as stated or by two static forces.
            None if unknown.
    """

    mass_std: float | None = None
    gain_std: float | None = None
    delay_std_s: float | None = None
    excluded: frozenset[str] = frozenset()
    static_forces: tuple[tuple[float | None, float], ...] = ()
    load_share: float | None = None

    def static_force_n(self, load_kg: float) -> float | None:
        """The force [N] under a load [kg]; None where nothing is stated of it."""
        forces = dict(self.static_forces)
        return forces.get(load_kg, forces.get(None))

    @classmethod
    def from_toml(cls, file: Path, table: Mapping[str, Any]) -> "Known":
        """From the [known] table of study.toml: sizes, and for a departure the words for how it was excluded.

        Raises:
            InputFileError: a key or value that does not exist.
        """
        sizes: dict[str, float] = {}
        forces = _forces(file, table.get(_FORCE))
        share = table.get(_SHARE)
        if share is not None and not (_number(share) and _SHARES[0] <= share <= _SHARES[1]):
            low, high = _SHARES
            raise InputFileError(file, f"known.{_SHARE} = {share!r}", f"valid: a share from {low:g} to {high:g}")
        measured = _share(file, forces)
        if share is not None and measured is not None and abs(share - measured) > 0.02:
            raise InputFileError(
                file,
                f"known.{_SHARE} = {share:g}, and known.{_FORCE} says {measured:.3g} (force over weight of the load)",
                "leave out one of them",
            )
        for name, value in table.items():
            place = f"known.{name} = {value!r}"
            if name in _SIZES:
                if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= _SIZES[name]:
                    raise InputFileError(file, place, f"valid: a standard deviation, 0 to {_SIZES[name]:g}")
                sizes[name] = float(value)
            elif name not in (*DEPARTURES, _FORCE, _SHARE):
                raise InputFileError(file, unknown("key of [known]", name, (*_SIZES, _FORCE, _SHARE, *DEPARTURES)))
            elif name not in (_FORCE, _SHARE) and not (isinstance(value, str) and value.strip()):
                raise InputFileError(file, place, 'valid: how it was excluded, for example mount = "tapped"')
        excluded = frozenset(table) & frozenset(DEPARTURES)
        return cls(
            **sizes, excluded=excluded, static_forces=forces, load_share=measured if share is None else float(share)
        )

    @classmethod
    def of_all(cls, items: Sequence["Known"]) -> "Known":
        """What holds for all of several recordings: the largest uncertainties, and what all exclude."""

        def largest(name: str) -> float | None:
            values = [getattr(known, name) for known in items]
            return None if None in values or not values else max(values)

        excluded = frozenset.intersection(*(known.excluded for known in items)) if items else frozenset()
        shares = {known.load_share for known in items}
        share = shares.pop() if len(shares) == 1 else None
        return cls(largest("mass_std"), largest("gain_std"), largest("delay_std_s"), excluded, load_share=share)

    def told(
        self,
        mass_std: float | None = None,
        gain_std: float | None = None,
        delay_std_s: float | None = None,
        exclude: Iterable[str] = (),
    ) -> "Known":
        """The same with a user's values, which overrule the study; "all" excludes every departure.

        Raises:
            SettingError: a size or a departure that does not exist.
        """
        stated = {"mass_std": mass_std, "gain_std": gain_std, "delay_std_s": delay_std_s}
        for name, value in stated.items():
            if value is not None and not 0 <= value <= _SIZES[name]:
                what = name.replace("_", " ").removesuffix(" s")
                raise SettingError(
                    f"the {what} is {value:g}; give a standard deviation from 0 to {_SIZES[name]:g}.",
                    name.removesuffix("_s"),
                )
        excluded = set(self.excluded)
        for name in exclude:
            if name not in (*DEPARTURES, "all"):
                raise SettingError(f"{unknown('departure to exclude', name, (*DEPARTURES, 'all'))}.")
            excluded |= set(DEPARTURES) if name == "all" else {name}
        sizes = {name: getattr(self, name) if value is None else value for name, value in stated.items()}
        return replace(
            self, mass_std=sizes["mass_std"], gain_std=sizes["gain_std"], delay_std_s=sizes["delay_std_s"],
            excluded=frozenset(excluded),
        )  # fmt: skip


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _forces(file: Path, stated: Any) -> tuple[tuple[float | None, float], ...]:
    """Static forces as study.toml states them: one for all loads, or a table of load in kg and force in N."""
    rows = [] if stated is None else [(None, stated)] if not isinstance(stated, Mapping) else list(stated.items())
    forces: list[tuple[float | None, float]] = []
    for load, force in rows:
        place = f"known.{_FORCE} = {stated!r}"
        try:
            kg = None if load is None else float(load)
        except ValueError:
            raise InputFileError(
                file, place, 'valid: a load in kg and a force in N, { "0" = 43.0, "2.3" = 62.5 }'
            ) from None
        if not (_number(force) and 0 < force < 1e4):
            raise InputFileError(file, place, "valid: a force in N, above 0 and below 10000")
        forces.append((kg, float(force)))
    return tuple(forces)


def _share(file: Path, forces: tuple[tuple[float | None, float], ...]) -> float | None:
    """The share of the load that the leg carries: by how much the force grows over the weight added."""
    loaded = [(kg, force) for kg, force in forces if kg is not None]
    if len(loaded) < 2:
        return None
    kg, force = (np.array(column) for column in zip(*loaded, strict=True))
    share = float(np.polyfit(kg, force, 1)[0] / GRAVITY)
    low, high = _SHARES
    if not low <= share <= high:
        raise InputFileError(
            file,
            f"known.{_FORCE}: the force grows by {share:.2g} of the weight of the load",
            f"valid: between {low:g} and {high:g}; check loads (kg) and forces (N)",
        )
    return share
