"""A name says what it holds: no variable, argument or attribute is called by a word of our own dialect."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
BANNED = {
    "found", "each", "own", "told", "said", "those", "them", "its", "here", "there", "both", "untold", "misled",
    "wanted", "given", "wide", "lost", "poor", "heard", "shown", "settle",
}  # fmt: skip
#: Arguments and attributes that users write, and keys of JSON files that they read.
PUBLIC = {
    ("fasbody/acquire/timeline.py", "lost_frames"),
    ("fasbody/acquire/timeline.py", "lost_samples"),
    ("fasbody/laboratory/foot.py", "settle"),
    ("fasbody/laboratory/recording.py", "settle"),
    ("identification/rivals/result.py", "own"),
}


def assigned(text: str) -> Iterator[tuple[int, str]]:
    """Line and name of every variable, argument and attribute that a source assigns."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id if isinstance(node, ast.Name) else node.attr
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg


def dialect(text: str) -> list[tuple[int, str]]:
    """The assigned names of which a part, between underscores, is banned."""
    return [(line, name) for line, name in assigned(text) if BANNED & set(name.lower().split("_"))]


FILES = sorted(file for room in ("fasbody", "identification", "viz") for file in (ROOT / room).rglob("*.py"))


def test_names_say_what_they_hold() -> None:
    named = ((str(file.relative_to(ROOT)), *place) for file in FILES for place in dialect(file.read_text()))
    assert [(where, line, name) for where, line, name in named if (where, name) not in PUBLIC] == []


def test_dialect_is_seen() -> None:
    text = (
        "found = 1\nfor _told in x: a.own_mass = 2\ndef f(*, Here): return [each for each in Here]\nfounder = given()"
    )
    assert sorted({name for _, name in dialect(text)}) == ["Here", "_told", "each", "found", "own_mass"]
