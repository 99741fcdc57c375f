"""The notebooks of the documentation: each runs, and prints what it is kept with."""

import copy
import importlib.util
import json
import re
from base64 import b64decode
from pathlib import Path
from typing import Any

import pytest
from test_docs_blocks import same

ROOT = Path(__file__).parent.parent


def module() -> Any:
    """docs/cells.py, which lies beside the pages."""
    spec = importlib.util.spec_from_file_location("cells", ROOT / "docs" / "cells.py")
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


cells = module()
NOTEBOOKS = cells.notebooks()


def lies(kept: list[list[dict[str, Any]]], found: list[list[dict[str, Any]]]) -> list[str]:
    """Outputs that are not what running the cell shows, but for the last digits of numbers."""
    told = []
    for number, (old, new) in enumerate(zip(kept, found, strict=True), 1):
        for one, other in zip(old, new, strict=False):
            (was, pictures), (now, others) = shown(one), shown(other)
            if not same(now, was) or pictures != others:
                told.append(f"cell {number} shows now\n{now}")
        if len(old) != len(new):
            told.append(f"cell {number} shows {len(new)} things, not {len(old)}")
    return told


def shown(output: dict[str, Any]) -> tuple[str, list[bool]]:
    """Its words without what rounding makes, and whether its pictures are some."""
    data = {"text": output.get("text", []), **output.get("data", {})}
    words = "\n".join("".join(text) for kind, text in data.items() if not kind.startswith("image/"))
    pictures = [b64decode(text)[:4] == b"\x89PNG" for kind, text in data.items() if kind.startswith("image/")]
    return re.sub(r"base error \S+?(?=[<\s])", "", words), pictures


@pytest.mark.long
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_prints_what_it_is_kept_with(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    notebook = json.loads(file.read_text())
    kept = [cell["outputs"] for cell in cells.code_cells(notebook)]
    assert sum(map(len, kept)) > 2
    assert not (told := lies(kept, cells.run(notebook, file.stem))), f"run docs/cells.py {file.stem}:\n" + told[0]


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_is_one_that_jupyter_opens(file: Path) -> None:
    """By the format's rules, small, run from top to bottom, and a page of the site."""
    notebook = json.loads(file.read_text())
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in notebook["cells"]}) == len(notebook["cells"])
    code = cells.code_cells(notebook)
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    assert file.stat().st_size < 350_000
    assert f"{file.stem}.md" in (ROOT / "mkdocs.yml").read_text()
    page = cells.page(file)
    assert page.startswith("# ") and page.count("```python") == len(code)
    assert page.count("data:image/png") == sum(len(shown(output)[1]) for cell in code for output in cell["outputs"])


def test_a_number_that_is_no_longer_true_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    source = "import numpy as np\nprint('peak', 2.5)\nnp.float64(7)"
    notebook = {"cells": [{"cell_type": "code", "source": source.splitlines(keepends=True)}]}
    kept = cells.run(notebook)
    assert [output["output_type"] for output in kept[0]] == ["stream", "execute_result"]
    assert lies(kept, cells.run(notebook)) == []
    for old, new in (("2.5", "2.6"), ("peak", "valley")):
        other = copy.deepcopy(notebook)
        other["cells"][0]["source"] = [source.replace(old, new)]
        assert lies(kept, cells.run(other))
    other["cells"][0]["source"] = ["import matplotlib.pyplot as plt\nplt.plot([1, 2])\nprint(1)"]
    (outputs,) = cells.run(other)
    assert shown(outputs[-1])[1] == [True] and lies(kept, [outputs])
