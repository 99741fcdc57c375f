"""Numbers printed in the thesis, transcribed here a second time so that a slip in the code shows."""

#: Table 2.1: subject, age [yr], height [m], mass [kg].
TABLE_2_1 = (
    (1, 21, 1.70, 50.8), (2, 22, 1.75, 77.11), (3, 26, 1.75, 79.38), (4, 18, 1.60, 63.50), (5, 25, 1.75, 76.66),
    (6, 24, 1.60, 45.36), (7, 23, 1.65, 54.43), (8, 20, 1.75, 70.31), (9, 20, 1.83, 70.31), (10, 22, 1.75, 77.11),
    (11, 23, 1.83, 81.65), (12, 27, 1.83, 88.00), (13, 22, 1.63, 61.23), (14, 21, 1.83, 79.38), (15, 22, 1.70, 74.84),
    (16, 27, 1.85, 72.57), (17, 22, 1.78, 61.23), (18, 22, 1.88, 72.57), (19, 20, 1.78, 71.21), (20, 20, 1.70, 86.18),
)  # fmt: skip
#: The last rows of Table 2.1: mean, standard deviation, smallest, largest of age, height, mass.
TABLE_2_1_MEAN = (22.30, 1.75, 70.70)
TABLE_2_1_STD = (2.43, 0.08, 11.44)
TABLE_2_1_MIN = (18, 1.60, 45.36)
TABLE_2_1_MAX = (27, 1.88, 86.18)  # the mass of subject 12 is larger than this "Max"

#: Section 2.2.2.
FREQUENCIES_HZ = (10, 15, 20, 25, 30, 35, 40, 45, 50)
PEAK_TO_PEAK_M_S2 = 17.9
ADDED_MASSES_KG = (0, 2.3, 4.5)

#: Section 4.5: segment masses as shares of the body mass, and the bounds of the fat pad's stiffness [N/m].
SHANK_SHARE = 0.0465
FOOT_SHARE = 0.0145
K_F_BOUNDS = (3000, 10e5)
