"""Edited copies of the shipped five-body arch, as a modeller would make them."""

from pathlib import Path

import mujoco
import numpy as np

import mjcf

XML = Path(mjcf.path("foot_arch")).read_text()


def edited(*edits: tuple[str, str]) -> str:
    """The shipped XML with some texts replaced; each must be there."""
    text = XML
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    return text


def compiled(*edits: tuple[str, str]) -> mujoco.MjModel:
    """The same, compiled."""
    return mujoco.MjModel.from_xml_string(edited(*edits))


# Another foot: 20 % higher metatarsals, theta_1 from the closure, a heavier cuneiform, stiffer fascia.
HIGH = (
    ('euler="0 0 3.4"', 'euler="0 0 -5.0"'),
    ('mass="0.025"', 'mass="0.040"'),
    ('stiffness="15e3"', 'stiffness="40e3"'),
)


def high_arch_xml() -> str:
    """The edits of `HIGH` with theta_1 and the apex as the closure wants them."""
    links = ((0.01474, 69.7), (0.02606, 65.1), (0.06527, 60.1))
    height = float(sum(length * np.cos(np.radians(angle)) for length, angle in links))
    theta_1 = float(np.degrees(np.arccos(height / 0.07929)))
    turned = (
        ('"0 0 -59.697016617339465"', f'"0 0 {-theta_1!r}"'),
        ('"0 0 129.397016617339465"', f'"0 0 {theta_1 + 69.7!r}"'),
        ('"0 0.0400075598688415 0"', f'"0 {height!r} 0"'),
    )
    return edited(*HIGH, *turned)


def high_arch() -> mujoco.MjModel:
    """The same, compiled."""
    return mujoco.MjModel.from_xml_string(high_arch_xml())
