"""What a result was made from: kept beside it, so that figures and tables can be computed when they are asked for."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from platform import python_version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fasbody.foot.model import Foot
    from fasbody.recording.recording import Recording
    from identification.certification import Certified
    from identification.estimate import Settings
    from identification.intervals import Solution
    from identification.replay import Replayed
    from identification.space import Space

#: Packages whose versions a reader needs to repeat a fit.
_PACKAGES = ("fasbody", "mujoco", "numpy", "scipy", "numba")


@dataclass(frozen=True, eq=False)
class Evidence:
    """The fits behind a result.

    Attributes:
        foot: the model. recordings: as fitted. two_mass: the model is the two-mass foot.
        solutions: of steady recordings, the headline, best first; none in the time domain.
        exact: the same branches by name with the model assumed exact; none where the headline is that.
        replays: of the headline's ends in MuJoCo, by name.
        space: of the time domain. certified: its branches.
    """

    foot: "Foot"
    recordings: Sequence["Recording"]
    two_mass: bool
    solutions: tuple["Solution", ...]
    exact: Mapping[str, "Solution"]
    replays: Mapping[str, "Replayed"]
    space: "Space | None" = None
    certified: Sequence["Certified"] = ()


def provenance(settings: "Settings", space: "Space", recordings: Sequence["Recording"]) -> dict[str, Any]:
    """What is needed to make a result again: settings with the seed, bounds, versions, digests of the files."""
    bounds = {
        item.key: [float(low), float(high)]
        for item, low, high in zip(space.free, space.lower, space.upper, strict=True)
    }
    chosen = asdict(settings)
    return {
        "seed": settings.seed,
        "settings": {name: value for name, value in chosen.items() if name not in ("bounds", "seed")},
        "bounds": bounds,
        "versions": {"python": python_version()} | {name: _version(name) for name in _PACKAGES},
        "sha256": {recording.file: recording.digest for recording in recordings if recording.digest},
    }


@functools.cache  # each asks for files, and a study for hundreds of fits
def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:  # run from a folder that was never installed
        return "not installed"
