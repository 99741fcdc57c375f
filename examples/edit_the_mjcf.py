"""A shoe, by editing the model: `python examples/edit_the_mjcf.py [FIGURE.png]`.

The shipped MJCF is text. Here a sole with its own spring and damper is put between table and foot, and MuJoCo
runs the edited file: nothing else has to be told.
"""

import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from matplotlib.figure import Figure

import mjcf
from fasbody.foot.model import Foot, load
from fasbody.foot.shaker import sine
from fasbody.foot.simulate import simulate
from fasbody.presentation import printed, write_figure
from fasbody.recording.harmonics import fit_harmonics

FREQUENCIES_HZ = np.r_[6:25:0.5, 25:61:2.5]  # finer where the peaks are
SOLE = """
<body name="sole">
  <joint name="sole" stiffness="6e4" damping="150"/>
  <inertial pos="0 0 0" mass="0.3" diaginertia="1e-6 1e-6 1e-6"/>
</body>"""


def with_shoe(folder: Path) -> Foot:
    """The two-mass foot in a shoe of 0.3 kg on a sole of 60 kN/m."""
    model, sole = ElementTree.fromstring(mjcf.text("two_dof")), ElementTree.fromstring(SOLE)
    base, foot = model.find(".//body[@name='base']"), model.find(".//body[@name='foot']")
    sole.set("childclass", "bone")
    base.remove(foot)
    base.append(sole)
    sole.append(foot)
    (folder / "in_a_shoe.xml").write_text(ElementTree.tostring(model, encoding="unicode"))
    return load(folder / "in_a_shoe.xml")


def transmissibility(foot: Foot) -> np.ndarray:
    """Malleolus over table of the settled motion at each frequency, all in one batch."""
    run = simulate(foot, [sine(f, 1.0) for f in FREQUENCIES_HZ])
    late = run.time[0] > 0.5
    return np.array([
        abs(fit_harmonics(run.time[i, late], run.malleolus[i, late], f, 3).amplitudes[0]
            / fit_harmonics(run.time[i, late], run.base[i, late], f, 3).amplitudes[0])
        for i, f in enumerate(FREQUENCIES_HZ)
    ])  # fmt: skip


@printed
def main(picture: Path = Path("edit_the_mjcf.png")) -> dict[str, np.ndarray]:
    """Draw both; return their transmissibilities."""
    with tempfile.TemporaryDirectory() as folder:
        curves = {"as shipped": transmissibility(load("two_dof"))}
        curves["in a shoe"] = transmissibility(with_shoe(Path(folder)))
    figure = Figure(figsize=(5, 3), layout="constrained")
    ax = figure.subplots()
    for (name, curve), style in zip(curves.items(), ("-", "--"), strict=True):
        ax.plot(FREQUENCIES_HZ, curve, style, label=name)
    ax.axhline(1, color="0.6", lw=0.8)
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel("transmissibility, table to malleolus")
    ax.legend()
    write_figure(figure, picture)
    return curves


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
