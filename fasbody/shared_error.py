"""Errors that all samples of a recording share: gain and delay of its channels, as far as study.toml states them."""

import numpy as np

from fasbody.channels import Channel
from fasbody.recording import Recording


def gain_and_delay(recording: Recording, out: str, into: str) -> tuple[float, float]:
    """Standard uncertainty of one channel's gain relative to another's, and of its delay behind that [s].

    The channels are taken for independent. Repeating a recording with the same sensors does not make these smaller.

    Args:
        recording: with its calibration. out, into: names of the channels.
    """
    a, b = (recording.calibration.get(name, Channel()) for name in (out, into))
    return float(np.hypot(a.gain_std, b.gain_std)), float(np.hypot(a.delay_std_s, b.delay_std_s))
