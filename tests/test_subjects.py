"""Table 2.1 and the segment masses against a second transcription."""

import numpy as np
import thesis

from fasbody.recording import condition as subjects
from fasbody.recording.recording import Condition


def test_every_row_of_table_2_1() -> None:
    rows = [(s.number, s.age_yr, s.height_m, s.mass_kg) for s in subjects.SUBJECTS.values()]
    assert rows == list(thesis.TABLE_2_1)
    assert list(subjects.SUBJECTS) == list(range(1, 21))


def test_table_2_1_agrees_with_its_printed_mean_and_deviation() -> None:
    table = np.array([[s.age_yr, s.height_m, s.mass_kg] for s in subjects.SUBJECTS.values()])
    one_digit = np.array([0.05, 0.005, 0.05])  # the printed means have one decimal and a zero: 22.35 -> 22.30
    assert (np.abs(table.mean(0) - thesis.TABLE_2_1_MEAN) <= one_digit + 1e-9).all()
    assert (np.abs(table.std(0, ddof=1) - thesis.TABLE_2_1_STD) <= one_digit + 1e-9).all()
    assert tuple(table.min(0)) == thesis.TABLE_2_1_MIN
    assert tuple(table.max(0)[:2]) == thesis.TABLE_2_1_MAX[:2]


def test_segment_masses() -> None:
    assert subjects.shank_mass(72.57, 2.3) == thesis.SHANK_SHARE * 72.57 + 2.3
    assert subjects.foot_mass(72.57) == thesis.FOOT_SHARE * 72.57
    assert subjects.ADDED_MASSES_KG == thesis.ADDED_MASSES_KG
    shank = 0.0465 * 80 + 4.5  # m_S of the two-mass foot, m_T of the arch
    assert Condition(body_mass_kg=80.0, added_mass_kg=4.5).masses == {
        "m_S": shank, "m_T": shank, "m_F": 0.0145 * 80, "added_mass": 4.5,
    }  # fmt: skip
    assert Condition(added_mass_kg=4.5).masses == {"added_mass": 4.5}
