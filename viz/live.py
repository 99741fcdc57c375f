"""What moves the sliders of an exported page: the two masses as a program of it, or motions computed beforehand.

A model that the compiled twin stands for is solved by `page/twin.js` with the twin's numbers; all its sliders move.
Of any other model the file holds the motions over frequency and load, as MuJoCo computed them.
"""

import base64
import gzip
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fasbody.console import progress_bar
from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from identification.engines.twin import twin_applies
from viz.display import page_json
from viz.excitation import Excitation
from viz.settings import CARRIERS, Settings, can_add_mass

#: Bodies of the two masses: the world, the table, foot and shank.
BODIES = 4
#: Frequencies [Hz] and loads on the knee [kg] of the motions that a file holds.
FREQUENCIES, LOADS = tuple(np.arange(2.0, 61.0, 2.0).tolist()), (0.0, 2.3, 4.5)


def of(
    feet: Mapping[str, Foot],
    excitation: Excitation,
    settings: Settings,
    answer: Callable[[Settings], dict[str, Any]],
) -> dict[str, Any] | None:
    """What the page's sliders need; None where none of them can move.

    They cannot in a sweep, or beside a recording of another model.

    Args:
        feet: of the page.
        excitation: of the base.
        settings: of the page.
        answer: the motion for other settings.
    """
    foot, *others = feet.values()
    if not excitation.periodic:
        return None
    if not others and foot.model.nbody == BODIES and twin_applies(foot):
        steady = excitation.steady
        carrier = next(name for name in CARRIERS if name in foot.parameters)
        twin: dict[str, Any] = {"values": foot.values(), "step": foot.step, "carrier": carrier}
        if steady is not None:
            twin["frequency"] = steady.frequency_hz
            twin["harmonics"] = [[float(u.real), float(u.imag)] for u in steady.base]
        return {"twin": twin}
    if excitation.recording is not None:
        return None
    frequencies = sorted({*FREQUENCIES, settings.frequency})
    loads = sorted({*LOADS, settings.added_mass}) if can_add_mass(feet.values()) else [settings.added_mass]
    with progress_bar() as progress:
        points = [(load, f) for load in loads for f in frequencies]
        motions = []
        for load, f in progress.track(points, description="computing what the sliders show"):
            try:
                motions.append(answer(replace(settings, frequency=f, added_mass=load)))
            except SimulationError as error:
                motions.append({"type": "error", "text": str(error)})
    packed = base64.b64encode(gzip.compress(page_json(motions).encode(), 6)).decode()
    return {"frequencies": frequencies, "loads": loads, "grid": packed}
