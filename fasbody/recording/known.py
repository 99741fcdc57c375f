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
from fasbody.recording.study_toml import LARGEST_STD, SHARES, KnownTable, validated

#: Departures of the foot from the model that a laboratory can exclude.
DEPARTURES = ("mount", "relaxation", "load", "rocking", "drift", "share", "seating")
#: The weight of a load and the load_share that is stated may differ by this.
_SAME_SHARE = 0.02


@dataclass(frozen=True)
class Known(Tabled):
    """What is known; None where nothing is stated.

    Attributes:
        mass_std: relative standard deviation of the segment masses, 0 where they are exact.
        gain_std: that of the malleolus' gain against the base's.
        delay_std_s: standard deviation of the delay between them [s].
        excluded: departures that cannot be (`DEPARTURES`).
        static_forces: load on the knee [kg] and force [N] of the resting foot; default the weight of both.
        load_share: of the added mass that the leg carries, as stated or by two static forces.
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
        """From the [known] table of study.toml: sizes, and for a departure the words for how it was excluded."""
        stated = validated(KnownTable, file, table, "known")
        forces = tuple(stated.static_force_n.items())
        share, measured = stated.load_share, _share(file, forces)
        if share is not None and measured is not None and abs(share - measured) > _SAME_SHARE:
            problem = f"known.load_share = {share:g}, and known.static_force_n says {measured:.3g}"
            raise InputFileError(file, f"{problem} (force over weight of the load)", "leave out one of them")
        excluded = frozenset(name for name in DEPARTURES if getattr(stated, name) is not None)
        share = measured if share is None else share
        return cls(stated.mass_std, stated.gain_std, stated.delay_std_s, excluded, forces, share)

    @classmethod
    def of_all(cls, items: Sequence["Known"]) -> "Known":
        """What holds for all of several recordings: the largest uncertainties, and what all exclude."""

        def largest(name: str) -> float | None:
            values = [getattr(known, name) for known in items]
            return None if None in values or not values else max(values)

        excluded = frozenset.intersection(*(known.excluded for known in items)) if items else frozenset()
        share = items[0].load_share if len({known.load_share for known in items}) == 1 else None
        return cls(largest("mass_std"), largest("gain_std"), largest("delay_std_s"), excluded, load_share=share)

    def overruled_by(
        self,
        mass_std: float | None = None,
        gain_std: float | None = None,
        delay_std_s: float | None = None,
        exclude: Iterable[str] = (),
    ) -> "Known":
        """The same with a user's values, which overrule the study; "all" excludes every nuisance parameter.

        Raises:
            SettingError: a size or a nuisance parameter that does not exist.
        """
        sizes = (("mass_std", mass_std), ("gain_std", gain_std), ("delay_std_s", delay_std_s))
        stated: dict[str, Any] = {name: value for name, value in sizes if value is not None}
        for name, value in stated.items():
            if not 0 <= value <= LARGEST_STD[name]:
                what, setting = name.replace("_", " ").removesuffix(" s"), name.removesuffix("_s")
                most = LARGEST_STD[name]
                raise SettingError(f"the {what} is {value:g}; give a standard deviation from 0 to {most:g}.", setting)
        excluded = set(exclude)
        for name in excluded - {*DEPARTURES, "all"}:
            raise SettingError(f"{unknown('nuisance parameter', name, (*DEPARTURES, 'all'))}.")
        excluded = set(DEPARTURES) if "all" in excluded else excluded
        return replace(self, **stated, excluded=self.excluded | excluded)


def _share(file: Path, forces: tuple[tuple[float | None, float], ...]) -> float | None:
    """The share of the load that the leg carries: by how much the force grows over the weight added."""
    loaded = [(kg, force) for kg, force in forces if kg is not None]
    if len(loaded) < 2:
        return None
    kg, force = (np.array(column) for column in zip(*loaded, strict=True))
    share = float(np.polyfit(kg, force, 1)[0] / GRAVITY)
    low, high = SHARES
    if not low <= share <= high:
        problem = f"known.static_force_n: the force grows by {share:.2g} of the weight of the load"
        hint = f"valid: between {low:g} and {high:g}; check loads (kg) and forces (N)"
        raise InputFileError(file, problem, hint)
    return share
