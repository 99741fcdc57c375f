"""Which accelerometers a fit compares with the model, and how well each is followed."""

from collections.abc import Sequence

from fasbody.exceptions import SettingError, unknown
from fasbody.foot.model import Foot
from fasbody.recording.recording import Recording
from identification.engines.engine import MALLEOLUS


def chosen(
    recordings: Sequence[Recording], foot: Foot, wanted: Sequence[str] | None
) -> tuple[tuple[str, ...], list[str]]:
    """The sensors to fit, the malleolus first, and a sentence on each column that is not fitted.

    A column of a recording belongs to the accelerometer of its name in the model.

    Args:
        recordings: checked. foot: the model. wanted: names that were asked for, None for all that match.

    Raises:
        SettingError: a sensor that the model, or no recording, has; or the malleolus is left out.
    """
    there = [name for name in foot.sensors if name != "base"]
    read = list(dict.fromkeys(name for recording in recordings for name in recording.sensors))
    if wanted is None:
        lost = [name for name in read if name not in there]
        text = f"Not fitted, as no accelerometer of the model {foot.name} has such a name: {', '.join(lost)}."
        return (*MALLEOLUS, *(n for n in there if n in read and n not in MALLEOLUS)), [text] if lost else []
    for name in wanted:
        if name not in there:
            raise SettingError(f"{unknown('sensor', name, there)} in model {foot.name}; an accelerometer has its name.")
        if name not in read:
            raise SettingError(
                f"sensor {name!r} is asked for, and no recording has a column {name}_m_s2 that can serve."
            )
    if MALLEOLUS[0] not in wanted:
        raise SettingError(f"the malleolus is always fitted; give malleolus,{','.join(wanted)}.")
    return (*MALLEOLUS, *(name for name in dict.fromkeys(wanted) if name not in MALLEOLUS)), []
