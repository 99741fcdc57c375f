"""All rows in the order of the thesis."""

from reproduction import (
    appendices,
    chapter2,
    chapter2_findings,
    chapter2_trends,
    chapter3,
    chapter3_findings,
    chapter3_tables,
    chapter4_arch,
    chapter4_energy,
    chapter4_fit,
    chapter4_foot,
    chapter4_linear,
    chapter4_results,
    chapter4_sensitivity,
    chapter5,
    chapter5_findings,
    conclusions,
    validation,
)
from reproduction.row import Row

#: Title -> rows, as they stand in docs/reproduction.md.
CHAPTERS: dict[str, list[Row]] = {
    "Chapter 2: transmissibility": [*chapter2.ROWS, *chapter2_findings.ROWS, *chapter2_trends.ROWS],
    "Chapter 3: black-box models": [*chapter3.ROWS, *chapter3_findings.ROWS, *chapter3_tables.ROWS],
    "Chapter 4: the five-body arch": [*chapter4_arch.ROWS, *chapter4_linear.ROWS],
    "Chapter 4: sensitivity, dampers and the two-mass foot": [*chapter4_sensitivity.ROWS, *chapter4_foot.ROWS],
    "Chapter 4: estimation": [*chapter4_fit.ROWS, *chapter4_results.ROWS, *chapter4_energy.ROWS],
    "Chapter 5: the cell": [*chapter5.ROWS, *chapter5_findings.ROWS],
    "Chapter 6: conclusions": list(conclusions.ROWS),
    "Appendices": [*appendices.ROWS, *chapter4_results.APPENDIX],
}
#: Not in the thesis: the models beside measurements of others, counted apart.
OUTSIDE: list[Row] = list(validation.ROWS)
ROWS: list[Row] = [*(row for rows in CHAPTERS.values() for row in rows), *OUTSIDE]
