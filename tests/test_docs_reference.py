"""The reference shows every argument of every constructor: name, type, default and unit, from the signature."""

import re
import sys
from pathlib import Path

import pytest

pytest.importorskip("griffe", reason="pip install 'fasbody[dev]'")
sys.path.append(str(Path(__file__).parent.parent / "docs"))

import arguments
import citations


def test_what_a_docstring_leaves_out_is_added() -> None:
    fields = {"file": "file", "mass_kg": "of the body"}
    bare = arguments.completed("One row.\n", fields)
    assert bare == "One row.\n\nArgs:\n    file: file\n    mass_kg: of the body\n"
    assert arguments.completed(bare, fields) == bare
    half = "One row.\n\nArgs:\n    file: where it lies.\n\nRaises:\n    Error: never.\n"
    added = half.replace("lies.\n", "lies.\n    mass_kg: of the body\n")
    assert arguments.completed(half, fields) == added


def test_the_paper_cites_what_it_lists() -> None:
    """Each work that paper.md cites is a link to one entry; one that the bibliography lacks is an error."""
    folder = Path(__file__).parent.parent / "docs" / "paper"
    head = {"title": "A foot", "authors": [{"name": "A. Person"}], "date": "2026"}
    _, _, text = (folder / "paper.md").read_text(encoding="utf-8").split("---\n", 2)
    page = citations.page(text, head, folder / "paper.bib")
    assert page.startswith("# A foot\n\nA. Person, 2026\n\n## Summary")
    assert set(re.findall(r"\]\(#(\w+)\)", page)) == set(re.findall(r'<span id="(\w+)">', page)) >= {"wee2012"}
    assert "[Pintelon and Schoukens, 2012]" in page and "Virtanen, P. et al. (2020). SciPy" in page
    assert "[@" not in page
    with pytest.raises(KeyError, match="nobody"):
        citations.page("[@nobody]", head, folder / "paper.bib")
