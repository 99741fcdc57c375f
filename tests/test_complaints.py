"""A model that MuJoCo refuses: one sentence that names the file, the line and the element, without MuJoCo's jargon."""

from pathlib import Path

import pytest
from arch_copies import XML, edited

from fasbody.exceptions import InputFileError
from fasbody.foot.model import load

FASCIA = XML[XML.index('    <spatial name="plantar_aponeurosis"') : XML.index("  </tendon>")]
PAD = next(line for line in XML.splitlines() if '<spatial name="heel_pad"' in line)


@pytest.mark.parametrize(
    ("edit", "clause", "token"),
    [
        ((FASCIA, ""), "'aponeurosis_branch' acts on 'plantar_aponeurosis', which is not in the model", "<dcmotor"),
        ((PAD, ""), "'closure' ties 'heel_pad', which is not in the model", '<tendon name="closure"'),
        (('<site site="heads"/>\n', '<site site="hads"/>\n'), "names the site 'hads', which is not in the model", ""),
        (('objname="malleolus"/>\n    <!--', 'objname="ankle"/>\n    <!--'),
         "'malleolus' names 'ankle', which is not in the model", 'objname="ankle"'),
        (('<joint name="hindfoot"/>', '<joint name="hindfoot">'),
         "the element <joint> that begins there is not closed where it should be", '<joint name="hindfoot">'),
        (('<mujoco model="foot_arch">', '<mujoco model="foot_arch>'),
         'an attribute of <mujoco> is not written as name="value"', ""),
        (("</mujoco>", ""), "an element that begins there or later is never closed", ""),
        (('mass="2.36"', 'mass="heavy"'),
         "<inertial> has something other than numbers in the attribute 'mass'", 'mass="heavy"'),
        (('<joint name="hindfoot"/>', '<joint name="hindfoot" stif="1"/>'),
         "<joint> has the attribute 'stif', which MJCF does not know there", "stif="),
        (('<joint name="hindfoot"/>', '<jont name="hindfoot"/>'), "<jont> stands where MJCF knows no such", "<jont"),
        (('mass="2.36"', 'mass="-1"'), "'tibia': mass and inertia of moving bodies", '<body name="tibia"'),
    ],
)  # fmt: skip
def test_one_clear_sentence(tmp_path: Path, edit: tuple[str, str], clause: str, token: str) -> None:
    file = tmp_path / "copy.xml"
    file.write_text(edited(edit))
    with pytest.raises(InputFileError) as caught:
        load(file)
    sentence = str(caught.value)
    assert clause in sentence
    assert "copy.xml, line " in sentence
    for jargon in ("Error", "id ", "XML_", "transmission", "0x", "\n"):
        assert jargon not in sentence, sentence
    if token:
        (line,) = [i for i, text in enumerate(file.read_text().splitlines(), 1) if token in text]
        assert f"line {line}:" in sentence
