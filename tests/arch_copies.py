"""Edited copies of the shipped five-body arch, as a modeller would make them."""


import mujoco
import numpy as np

import mjcf

XML = mjcf.text("foot_arch")


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


# Another foot, beside metatarsals that stand 20 % higher: a heavier cuneiform, stiffer fascia.
HIGH = (
    ('mass="0.025"', 'mass="0.040"'),
    ('stiffness="15e3"', 'stiffness="40e3"'),
)


def reshaped(*edits: tuple[str, str], theta_4: float = 68.5, L_4: float = 0.06527) -> str:
    """An arch with other metatarsals, with theta_1 and the apex as the closure wants them, and further edits.

    Args:
        edits: further texts to replace.
        theta_4: angle of the metatarsals [degrees].
        L_4: their length [m].
    """
    links = ((0.01474, 69.7), (0.02606, 65.1), (L_4, theta_4))
    height = float(sum(length * np.cos(np.radians(angle)) for length, angle in links))
    theta_1 = float(np.degrees(np.arccos(height / 0.07929)))
    front = float(sum(length * np.sin(np.radians(angle)) for length, angle in links))
    turned = (
        ('euler="0 0 3.4"', f'euler="0 0 {theta_4 - 65.1!r}"'),
        ("-0.06527 ", f"{-L_4!r} "),
        ("-0.032635 ", f"{-L_4 / 2!r} "),
        ("0.09819040", f"{front!r}"),
        ("-0.06845655", f"{float(-0.07929 * np.sin(np.radians(theta_1)))!r}"),
        ('"0 0 -59.697016617339465"', f'"0 0 {-theta_1!r}"'),
        ('"0 0 129.397016617339465"', f'"0 0 {theta_1 + 69.7!r}"'),
        ('"0 0.0400075598688415 0"', f'"0 {height!r} 0"'),
    )
    return edited(*turned, *edits)


def high_arch_xml() -> str:
    """The edits of `HIGH` with metatarsals of 60.1 degrees."""
    return reshaped(*HIGH, theta_4=60.1)


def high_arch() -> mujoco.MjModel:
    """The same, compiled."""
    return mujoco.MjModel.from_xml_string(high_arch_xml())
