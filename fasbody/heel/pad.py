"""A law of the heel as the fat pad of a model: the numbers of its `user` field, and the model that has them."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

import mjcf
from fasbody.exceptions import SettingError
from fasbody.heel.laws import REFERENCE_M, THICKNESS_M, HeelLaw

#: Laws that a joint can carry; the law 4.22 has a memory and needs an actuator, the others are no sum of powers.
CARRIED = ("nonlinear", "strain_damper", "power", "hunt_crossley")


def pad(law: HeelLaw, theta: np.ndarray, load_n: float) -> tuple[float, ...]:
    """The `user` (8,) numbers of the joint `fat_pad` of a model: a law of the heel resting under a load [N].

    The last is the strain at which it rests.

    Args:
        law: one of `CARRIED`.
        theta: (p,) its parameters.
        load_n: what the foot presses with at rest [N].

    Raises:
        SettingError: a joint cannot carry the law.
    """
    from scipy.optimize import brentq

    if law.key not in CARRIED:
        raise SettingError(f"a joint cannot carry the {law.name} (valid: {', '.join(CARRIED)}).")
    h, values = THICKNESS_M, [float(value) for value in theta]
    force = lambda x: float(law.static_force(np.array([x]), theta)[0]) - load_n  # noqa: E731
    e0 = brentq(force, 0.0, 10.0 * h, xtol=1e-14) / h
    if law.key == "strain_damper":
        return (4.24, *values, h, e0)
    if law.key == "nonlinear":
        return (4.23, *values, h, e0)
    F_5, n = values[:2]
    j = F_5 * (h / REFERENCE_M) ** n
    c = values[2] if law.key == "hunt_crossley" else 0.0
    return (4.23, j, n, j * c * h, n, 1.0, h, e0)


def write_model(file: Path, law: HeelLaw, theta: np.ndarray, load_n: float) -> Path:
    """`two_dof.xml` with a measured law as its fat pad; the constants that the pad had are no parameters of it.

    Raises:
        SettingError: a joint cannot carry the law. InputFileError: the file cannot be written.
    """
    from fasbody.console import write_whole

    user = " ".join(f"{value:.6g}" for value in pad(law, theta, load_n))
    root = ElementTree.fromstring(mjcf.text("two_dof"))
    root.set("model", "two_dof_measured_pad")
    (joint,) = (item for item in root.iter("joint") if item.get("name") == "fat_pad")
    joint.set("stiffness", "0")
    joint.set("user", user)
    (custom,) = root.iter("custom")
    for text in list(custom):
        if text.get("name") in ("k_F", "c_21", "c_22", "c_23"):
            custom.remove(text)
    ElementTree.indent(root)
    head = f"<!-- The fat pad is the {law.name} of measured people, {law.formula}, resting under {load_n:g} N. -->\n"
    return write_whole(file, head + ElementTree.tostring(root, encoding="unicode") + "\n")
