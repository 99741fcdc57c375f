"""The arch with dampers that bend as those of the two masses do: what makes mjcf/foot_arch/foot_arch_bent.xml.

No source has the bends of a whole foot. Pads and ankle have the nominal ones of two_dof.xml; a hinge has those of a
ligament at the arch's height of 40 mm from it, so that one metre there is 25 rad.
"""

import mjcf as shipped

#: c_2 and c_3 of the law 4.25 of pads and ankle [1/m] and of the three hinges [1/rad], all nominal.
PADS, ANKLE, HINGES = (-50.0, 100.0), (50.0, 100.0), (2.0, 4.0)
_PADS, _HINGES = ("heel_pad", "forefoot_pad"), ("spring_ligament", "short_plantar_ligament", "long_plantar_ligament")
_ABOUT = """
       This is foot_arch.xml with bends c_2 and c_3 of pads, ankle and hinges, which are nominal: made by
       simulator.bends, and equal to it for small motion."""


def mjcf() -> str:
    """The model as MJCF."""
    text = shipped.path("foot_arch").read_text()
    places = {
        "F": ("1/m", "600", [f"tendon {pad}" for pad in _PADS]),
        "T": ("1/m", "600", ["joint talocrural"]),
        "L": ("1/rad", "30", [f"joint {hinge}" for hinge in _HINGES]),
    }
    lines = "".join(
        f'    <text name="c_{symbol}{column}" data="{unit} | {f"-{most}" if column == 2 else 0} | {most} | '
        f'{", ".join(f"{element} user {column}" for element in elements)} | nominal"/>\n'
        for symbol, (unit, most, elements) in places.items()
        for column in (2, 3)
    )
    changes = {
        '<mujoco model="foot_arch">': '<mujoco model="foot_arch_bent">',
        "nominal: our fit. -->": f"nominal: our fit.{_ABOUT} -->",
        '    <text name="m_T"': f'{lines}    <text name="m_T"',
        'user="4.25 1500 0 0"': f'user="4.25 1500 {PADS[0]:g} {PADS[1]:g}"',
        'user="4.25 430 0 0"': f'user="4.25 430 {ANKLE[0]:g} {ANKLE[1]:g}"',
        'user="4.25 2 0 0"': f'user="4.25 2 {HINGES[0]:g} {HINGES[1]:g}"',
    }
    for old, new in changes.items():
        text = text.replace(old, new)
    return text
