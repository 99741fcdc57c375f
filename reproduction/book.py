"""All rows in the order of the thesis."""

from reproduction import (
    appendices,
    chapter2,
    chapter2_findings,
    chapter3,
    chapter4_arch,
    chapter4_fit,
    chapter4_foot,
    chapter5,
    conclusions,
    validation,
)
from reproduction.row import Row

#: Title -> rows, as they stand in docs/reproduction.md.
CHAPTERS: dict[str, list[Row]] = {
    "Chapter 2: transmissibility": chapter2.ROWS,
    "Chapter 2: findings": chapter2_findings.ROWS,
    "Chapter 3: black-box models": chapter3.ROWS,
    "Chapter 4: the five-body arch": chapter4_arch.ROWS,
    "Chapter 4: sensitivity, dampers and the two-mass foot": chapter4_foot.ROWS,
    "Chapter 4: estimation": chapter4_fit.ROWS,
    "Chapter 5: the cell": chapter5.ROWS,
    "Chapter 6: conclusions": conclusions.ROWS,
    "Appendices": appendices.ROWS,
    "Outside data: the model against published measurements": validation.ROWS,
}
ROWS: list[Row] = [row for rows in CHAPTERS.values() for row in rows]
