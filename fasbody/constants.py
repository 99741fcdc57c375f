"""Constants of physics and statistics that several rooms share."""

#: Standard acceleration of free fall [m/s^2], the unit g of instruments.
GRAVITY = 9.80665
#: Acceleration of free fall [m/s^2] as thesis and models round it.
MODEL_GRAVITY = 9.81
#: Peak-to-peak base acceleration of the thesis [m/s^2], section 2.2.2.
PEAK_TO_PEAK = 17.9
#: Standard deviations that a two-sided 95 % interval reaches to each side.
Z95 = 1.959963984540054
