"""What a result was made from: kept beside it, so that figures and tables can be computed when they are asked for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fasbody.foot.model import Foot
    from fasbody.recording.recording import Recording
    from identification.certification import Certified
    from identification.intervals import Solution
    from identification.parameters import Space
    from identification.replay import Replayed


@dataclass(frozen=True, eq=False)
class Evidence:
    """The fits behind a result.

    Attributes:
        foot: the model.
        recordings: as fitted.
        two_mass: the model is the two-mass foot.
        solutions: of steady recordings, the headline, best first; none in the time domain.
        exact: the same branches by name with the model assumed exact; none where the headline is
            that.
        replays: of the headline's ends in MuJoCo, by name.
        space: of the time domain.
        certified: its branches.
    """

    foot: "Foot"
    recordings: Sequence["Recording"]
    two_mass: bool
    solutions: tuple["Solution", ...]
    exact: Mapping[str, "Solution"]
    replays: Mapping[str, "Replayed"]
    space: "Space | None" = None
    certified: Sequence["Certified"] = ()
