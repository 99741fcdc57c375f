"""Estimation of foot and ankle parameters from measured accelerations.

    import fasbody as fb
    import identification as idn

    result = idn.fit_foot(fb.bundled(), fb.load("two_dof"), free=["k_T", "k_F"], starts=4)
    result["k_T"].interval()

A name is imported when it is first asked for, so that `import identification` costs nothing.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from identification.blackbox.data import Series
    from identification.blackbox.data import from_recording as series_of
    from identification.blackbox.frequency import Points, Rational
    from identification.blackbox.identify import ChosenModel, Report, identify
    from identification.blackbox.polynomial import Orders, PolynomialModel
    from identification.blackbox.state_space import StateSpaceModel
    from identification.estimates import Estimate
    from identification.fitting import Settings, fit_foot
    from identification.result import Branch, FitResult, RecordingFit
    from identification.rivals.compare import compare_rivals
    from identification.rivals.result import Rival, Rivals
else:
    _HOMES = {
        "Branch": "identification.result",
        "Estimate": "identification.result",
        "FitResult": "identification.result",
        "ChosenModel": "identification.blackbox.identify",
        "Orders": "identification.blackbox.polynomial",
        "Points": "identification.blackbox.frequency",
        "PolynomialModel": "identification.blackbox.polynomial",
        "Rational": "identification.blackbox.frequency",
        "RecordingFit": "identification.result",
        "Report": "identification.blackbox.identify",
        "Rival": "identification.rivals.result",
        "Rivals": "identification.rivals.result",
        "Series": "identification.blackbox.data",
        "Settings": "identification.fitting",
        "StateSpaceModel": "identification.blackbox.state_space",
        "compare_rivals": "identification.rivals.compare",
        "fit_foot": "identification.fitting",
        "identify": "identification.blackbox.identify",
        "series_of": "identification.blackbox.data:from_recording",
    }

    def __getattr__(name: str) -> object:
        from fasbody.lazy import attribute

        return attribute(__name__, _HOMES, name)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})


__all__ = [
    "Branch",
    "ChosenModel",
    "Estimate",
    "FitResult",
    "Orders",
    "Points",
    "PolynomialModel",
    "Rational",
    "RecordingFit",
    "Report",
    "Rival",
    "Rivals",
    "Series",
    "Settings",
    "StateSpaceModel",
    "compare_rivals",
    "fit_foot",
    "identify",
    "series_of",
]
