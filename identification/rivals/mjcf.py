"""Rivals as MJCF: the given file with a few edits and the fitted constants, to be looked at, run and fitted.

What each rung writes:

- linear: the dampers' bends are zero.
- polynomial: `stiffness` of a joint gets MuJoCo's two further coefficients, k p and k d.
- exponential: the joint's spring becomes an actuator of the law 4.22 without relaxation, A (exp(B e) - 1); it may act
  either way, by the sign of its gear.
- relaxing: a Maxwell element beside each spring, an actuator of the law 4.22 of which nearly all relaxes.
- mount: the site malleolus moves onto a body of a milligram on a spring and a damper.
- third: a share of the shank's mass moves to a body on a spring and a damper; the load gets a separate body.
- load: one file a load, with the springs and dampers that hold under it.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

import mjcf
from fasbody.console import write_whole
from fasbody.exceptions import InputFileError, ModelError
from fasbody.foot.model import load
from fasbody.foot.steady_state import Balance
from identification.rivals.motion import felt, under_load
from identification.rivals.result import LOAD, Rivals

#: Mass of the sensor's body [kg], too small to act on the shank, and its inertia [kg m^2].
_SENSOR_KG, _TINY = 1e-6, "1e-9 1e-9 1e-9"
#: Strain at rest of a pad of 1 m, farther than it moves, and the least exponent that is written as one [1/m].
_REST, _LEAST = 0.02, 1e-3
#: Of a Maxwell element: stiffness that relaxes over that which stays, exponent of a pad that is as good as linear
#: [1/m], and how far apart the two ends of its spectrum are.
_RELAXES, _STRAIGHT, _APART = 1e8, 1e-4, 1e-4
#: Share of the fundamental by which MuJoCo's motion of a written model may be off.
_MOST_APART = 1e-3
#: What the comment of a file says of a rung's edits.
_EDITS = {
    "linear": ", dampers that do not bend",
    "polynomial": ", springs with a quadratic and a cubic term",
    "exponential": ", springs as actuators with A (exp(B e) - 1), Eq. 4.22",
    "relaxing": ", a Maxwell element beside each spring, Eq. 4.22",
    "mount": ", the malleolus' sensor on a body, a spring and a damper",
    "third": ", a share of the shank on a spring and a damper",
}


def write_models(result: Rivals, file: Path, folder: Path) -> dict[Path, float]:
    """Write every rung of a comparison, as edits of an MJCF file, and run each.

    Returns:
        Each file, and the largest difference of MuJoCo's motion from the equations, as a share of its peak.

    Raises:
        ModelError: the file has no such joints, or they are not where the edits expect them, so that MuJoCo moves
            otherwise; such a model is not written.
    """
    hz = min((p.frequency_hz for p in result.points), key=lambda f: abs(f - 20.0))
    U = next(p.base for p in result.points if p.frequency_hz == hz)
    loads = sorted({p.load_kg for p in result.points})
    differences = {}
    for rival in result.rivals:
        if not rival.values:
            continue
        by_load = loads if rival.name == LOAD else [0.0]
        for load_kg in by_load:
            name = f"{rival.name}_{load_kg:g}kg.xml" if len(by_load) > 1 else f"{rival.name}.xml"
            text = edited_text(file, rival.name, rival.title, rival.values, load_kg)
            gap = difference(text, rival.values, hz, U, load_kg)
            if gap > _MOST_APART:
                raise ModelError(
                    f"{file.name}: with the constants of {rival.name!r} written into it, MuJoCo's motion is off by "
                    f"{100 * gap:.2g} %; rivals are made from files with the ankle at the joint 'talocrural' and the "
                    "pad at 'fat_pad'."
                )
            differences[write_whole(folder / name, text)] = gap
    return differences


def edited_text(file: Path, name: str, title: str, values: Mapping[str, float], load_kg: float = 0.0) -> str:
    """The MJCF of a rung.

    Args:
        file: the model to edit.
        name, title: of the rung.
        values: constants by name.
        load_kg: under which springs and dampers hold that follow the load; it is not in the masses.
    """
    try:
        root = ET.fromstring(mjcf.whole(file.read_text()), ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    except (OSError, ET.ParseError) as error:
        raise InputFileError(file, f"cannot be edited as XML ({error})") from None
    if (include := next(root.iter("include"), None)) is not None:
        parts = f"includes {include.get('file')!r}, which a rival elsewhere would not find"
        raise InputFileError(file, parts, "write it into the file")
    v = under_load(values, load_kg)
    shank, ankle = _moved_by(root, "talocrural", file)
    foot, pad = _moved_by(root, "fat_pad", file)
    for number, letter, joint in ((1, "T", ankle), (2, "F", pad)):
        c = [v[f"c_{number}{power}"] for power in (1, 2, 3)]
        joint.set("user", " ".join(["4.25", *(f"{x:.9g}" for x in c)]))
        joint.set("damping", f"{c[0]:.9g}")  # for MuJoCo without the callbacks
        k = v[f"k_{letter}"]
        bent = [k * v[f"p_{letter}"], k * v[f"d_{letter}"]]
        joint.set("stiffness", " ".join(f"{x:.12g}" for x in (k, *(bent if any(bent) else ()))))
        if name == "exponential":
            _exponential(root, joint, letter, v)
        elif name == "relaxing":
            _maxwell(root, joint, letter, v)
    _mass(shank, v["m_S"])
    _mass(foot, v["m_F"])
    if name == "mount":
        _mount(shank, v, file)
    elif name == "third":
        _third(root, shank, v)
    under = f" under {load_kg:g} kg" if load_kg else ""
    root.set("model", f"{root.get('model', 'foot')}_{name}")
    done = f"the fitted constants{under}{_EDITS.get(name, '')}"
    root.insert(0, ET.Comment(f" {title}: {file.name} with {done}. "))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def difference(
    model: str | Path, values: Mapping[str, float], hz: float, U: np.ndarray, load_kg: float
) -> float:
    """How far MuJoCo's motion of a rung's model is from the equations, as a share of the fundamental.

    Args:
        model: its MJCF, or the file of it.
        values: constants of the rung.
        hz: fundamental.
        U: (H,) base [m/s^2].
        load_kg: on it.
    """
    foot = load(model)
    masses = {"m_S": values["m_S"] + load_kg, "m_F": values["m_F"], "added_mass": load_kg}
    stated = {name: kg for name, kg in masses.items() if name in foot.parameters}
    moved = Balance(foot).orbit(hz, U, stated).harmonics()[: U.size]
    expected = felt(values, hz, U, load_kg)[: U.size]
    return float(np.abs(moved - expected).max() / abs(expected[0]))


def _moved_by(root: ET.Element, name: str, file: Path) -> tuple[ET.Element, ET.Element]:
    """The body that a joint moves, and the joint."""
    for body in root.iter("body"):
        if (joint := body.find(f"joint[@name='{name}']")) is not None:
            return body, joint
    raise ModelError(
        f"{file.name}: there is no body with the joint {name!r}, so rivals cannot be made from it."
    )


def _mass(body: ET.Element, mass: float) -> None:
    inertial = body.find("inertial")
    if inertial is None:
        raise ModelError(f"body {body.get('name')!r} has no <inertial>, so rivals cannot be made from it.")
    inertial.set("mass", f"{mass:.12g}")


def _swinging(name: str, mass: float, hz: float, zeta: float) -> ET.Element:
    """A body on a spring and a damper along the model's vertical."""
    w = 2 * np.pi * hz
    body = ET.Element("body", name=name)
    options = {"name": name, "type": "slide", "axis": "0 1 0", "armature": "0"}
    options |= {"stiffness": f"{mass * w * w:.12g}", "damping": f"{2 * zeta * mass * w:.12g}"}
    ET.SubElement(body, "joint", options)
    ET.SubElement(body, "inertial", pos="0 0 0", mass=f"{mass:.12g}", diaginertia=_TINY)
    return body


def _declare(root: ET.Element, name: str, data: str) -> None:
    """Declare a constant, in place of another declaration of that name."""
    custom = root.find("custom")
    if custom is None:
        custom = ET.SubElement(root, "custom")
    text = custom.find(f"text[@name='{name}']")
    if text is None:
        text = ET.SubElement(custom, "text", name=name)
    text.set("data", data)


def _declared(root: ET.Element, name: str) -> list[str]:
    text = root.find(f".//text[@name='{name}']")
    if text is None:
        return ["N/m", "1e3", "1e7", "", "fitted"]
    return [part.strip() for part in text.get("data", "").split("|")]


def _pad(
    root: ET.Element, name: str, joint: ET.Element, numbers: Sequence[float], gear: int = 1
) -> None:
    """An actuator of the law 4.22 on a joint."""
    actuators = root.find("actuator")
    assert actuators is not None  # every foot has its shaker there
    prm = " ".join(f"{x:.17g}" for x in (4.22, *numbers))
    options = {"name": name, "joint": joint.get("name", ""), "gear": str(gear)}
    options |= {"dyntype": "user", "actdim": "8", "gainprm": "0"}
    ET.SubElement(actuators, "general", options | {"biastype": "user", "biasprm": prm})


def _exponential(root: ET.Element, joint: ET.Element, letter: str, v: Mapping[str, float]) -> None:
    b, k = v[f"b_{letter}"], v[f"k_{letter}"]
    if abs(b) < _LEAST:
        return
    joint.set("stiffness", "0")
    share = 1 / (abs(b) * np.exp(abs(b) * _REST))
    name = f"spring_{letter}"
    _pad(root, name, joint, (share * k, abs(b), 0, 1e-3, 2e-3, 1, _REST), 1 if b < 0 else -1)
    unit, low, high, _, source = _declared(root, f"k_{letter}")
    _declare(root, f"k_{letter}", f"{unit} | {low} | {high} | {share:.17g} actuator {name} biasprm 1 | {source}")


def _maxwell(root: ET.Element, joint: ET.Element, letter: str, v: Mapping[str, float]) -> None:
    k, tau, name = v[f"r_{letter}"] * v[f"k_{letter}"], v["tau"], f"relaxing_{letter}"
    tau_1, tau_2 = tau / (1 + _APART), tau * (1 + _APART)
    c = _RELAXES / np.log(tau_2 / tau_1)
    share = 1 / _STRAIGHT
    _pad(root, name, joint, (max(k, 1e-6) * share, _STRAIGHT, c, tau_1, tau_2, 1, _REST))
    place = f"{share:.17g} actuator {name} biasprm 1"
    _declare(root, f"k_R{letter}", f"N/m | 1 | 1e7 | {place} | spring of the Maxwell element beside k_{letter}")
    times = ", ".join(
        f"{ratio:.17g} actuator relaxing_{side} biasprm {column}"
        for side in "TF" for column, ratio in ((4, 1 / (1 + _APART)), (5, 1 + _APART))
    )  # fmt: skip
    if letter == "F":  # after both elements
        _declare(root, "tau_R", f"s | 5e-4 | 5e-2 | {times} | their relaxation time")


def _mount(shank: ET.Element, v: Mapping[str, float], file: Path) -> None:
    site = shank.find("site[@name='malleolus']")
    if site is None:
        raise ModelError(f"{file.name}: the site malleolus is not on the body that the joint talocrural moves.")
    hz = max(v["u"], 1e-8) ** -0.5
    body = _swinging("sensor", _SENSOR_KG, hz, v["zeta_u"])
    shank.remove(site)
    body.append(site)
    shank.append(body)


def _third(root: ET.Element, shank: ET.Element, v: Mapping[str, float]) -> None:
    swings = max(v["w"], 1e-6) * v["m_S"]
    _mass(shank, v["m_S"] - swings)
    shank.append(_swinging("tissue", swings, v["f_w"], v["zeta_w"]))
    load_body = ET.SubElement(shank, "body", name="load")
    ET.SubElement(load_body, "inertial", pos="0 0.42 0", mass="1e-9", diaginertia=_TINY)
    custom = root.find("custom")
    if custom is not None and (stated := custom.find("text[@name='m_S']")) is not None:
        custom.remove(stated)  # a load is rigid, so its mass is separate from the shank's
    _declare(root, "added_mass", "kg | 0 | 100 | body load mass | on the knee")
    _declare(root, "k_W", "N/m | 10 | 1e6 | joint tissue stiffness | spring of what swings")
    _declare(root, "c_W", "N s/m | 0.1 | 1e4 | joint tissue damping | damper of what swings")
