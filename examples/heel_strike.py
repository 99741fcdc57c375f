"""One measured heel strike, from volts to force over compression: `python examples/heel_strike.py [FIGURE.png]`.

Subject 05 of the bundled walkers at normal speed (doi 10.1371/journal.pone.0197428), each correction in its panel. The
compression is the travel of a heel point fixed to the shank, so everything between skin and shank is in it.
"""

import sys
from pathlib import Path

from fasbody.heel.figures import corrections
from fasbody.heel.strike import Strike
from fasbody.heel.study import Person
from fasbody.presentation import write_figure


def main(picture: Path = Path("heel_strike.png")) -> Strike:
    """Draw the corrections of one strike and return it."""
    person = Person.bundled("05")
    speed, number = person.names()[1]
    strike = person.strike(person.trial(speed, number))
    write_figure(corrections(person.steps(speed, number), strike), picture)
    return strike


if __name__ == "__main__":
    found = main(*map(Path, sys.argv[1:2])).published
    print(f"{1e3 * found.compression_at_peak_m:.1f} mm and {found.work_to_peak_j:.2f} J to the first force peak")
