"""Estimation of foot and ankle parameters from measured accelerations.

    import fasbody as fb
    import identification as idn

    result = idn.fit_foot(fb.bundled(), fb.load("two_dof"), free=["k_T", "k_F"], starts=4)
    result["k_T"].interval()

A name is imported when it is first asked for, so that `import identification` costs nothing.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from identification.blackbox.data import Series as Series
    from identification.blackbox.data import from_recording
    from identification.blackbox.frequency import Points as Points
    from identification.blackbox.frequency import Rational as Rational
    from identification.blackbox.identify import ChosenModel as ChosenModel
    from identification.blackbox.identify import Report as Report
    from identification.blackbox.identify import identify as identify
    from identification.blackbox.polynomial import Orders as Orders
    from identification.blackbox.polynomial import PolynomialModel as PolynomialModel
    from identification.blackbox.state_space import StateSpaceModel as StateSpaceModel
    from identification.estimates import Estimate as Estimate
    from identification.fitting import fit_foot as fit_foot
    from identification.result import Branch as Branch
    from identification.result import FitResult as FitResult
    from identification.result import RecordingFit as RecordingFit
    from identification.rivals.compare import compare_rivals as compare_rivals
    from identification.rivals.result import Rival as Rival
    from identification.rivals.result import Rivals as Rivals
    from identification.setup import Settings as Settings

    series_of = from_recording
else:

    def __getattr__(name: str) -> object:
        from fasbody.lazy import attribute

        return attribute(__name__, name)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__getattr__("__all__")})
