"""The notebooks of docs/notebooks: run cell by cell, kept with what they show, and turned into pages of the site.

    python docs/cells.py              # run all of them anew
    python docs/cells.py plots        # or those that are named

A notebook is plain: top-level Python, no magics. A cell shows what it prints, its last expression (as a table or a
picture where it has one), and the figures that pyplot made, as Jupyter does.
"""

import ast
import contextlib
import io
import json
import os
import re
import sys
import tempfile
from base64 import b64encode
from html import escape
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "notebooks"


def notebooks() -> list[Path]:
    """All of them."""
    return sorted(FOLDER.glob("*.ipynb"))


def code_cells(notebook: dict[str, Any]) -> list[dict[str, Any]]:
    """The cells that run."""
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def run(notebook: dict[str, Any], name: str = "notebook") -> list[list[dict[str, Any]]]:
    """The outputs of each code cell, run one after the other in the present folder."""
    import matplotlib

    matplotlib.use("Agg")
    names: dict[str, Any] = {"__name__": "__main__"}
    return [_outputs("".join(cell["source"]), names, f"{name}[{i}]") for i, cell in enumerate(code_cells(notebook), 1)]


def _outputs(source: str, names: dict[str, Any], place: str) -> list[dict[str, Any]]:
    from matplotlib import pyplot

    tree, printed, value = ast.parse(source, place), io.StringIO(), None
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, place, "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), place, "eval"), names)
    found = [{"output_type": "stream", "name": "stdout", "text": _lines(printed.getvalue())}] if printed.tell() else []
    if value is not None:
        found.append({"output_type": "execute_result", "metadata": {}, "data": _data(value), "execution_count": None})
    for number in pyplot.get_fignums():
        out = io.BytesIO()
        pyplot.figure(number).savefig(out, format="png", dpi=110, bbox_inches="tight")
        pyplot.close(number)
        found.append({"output_type": "display_data", "metadata": {}, "data": {"image/png": _text(out.getvalue())}})
    return found


def _data(value: Any) -> dict[str, Any]:
    """A value as text, and as the table or picture that it has."""
    data: dict[str, Any] = {"text/plain": _lines(repr(value))}
    for kind, method, written in (("text/html", "_repr_html_", _lines), ("image/png", "_repr_png_", _text)):
        if (shown := getattr(value, method, lambda: None)()) is not None:
            data[kind] = written(shown)
    return data


def _text(picture: bytes) -> str:
    return b64encode(picture).decode()


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def page(file: Path) -> str:
    """A notebook as Markdown: its text, its code, and below each cell what it showed."""
    parts = []
    for cell in json.loads(file.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        parts += [_shown(output, source.splitlines()[-1]) for output in cell["outputs"]]
    copy = f'<p><a href="notebooks/{file.name}" download>This page as a notebook: {file.name}</a></p>'
    return "\n\n".join([*parts, copy]) + "\n"


def _shown(output: dict[str, Any], line: str) -> str:
    """One output; `line` is the code that made it, in place of a picture where there is none."""
    data = output.get("data", {})
    if picture := data.get("image/png"):
        return f'<p><img alt="{escape(line)}" src="data:image/png;base64,{"".join(picture.split())}"></p>'
    if html := "".join(data.get("text/html", [])):
        plain = re.sub(r"<style.*?</style>|\n\s*(?=\n)| (?:class|border|style)=\"[^\"]*\"", "", html, flags=re.DOTALL)
        return f'<div style="overflow-x: auto">{plain}</div>'  # tables look as all others of the site
    text = "".join(output.get("text") or data["text/plain"]).rstrip("\n")
    return f"```text\n{text}\n```"


def main(chosen: list[str]) -> None:
    """Run notebooks anew and keep what they show."""
    for file in notebooks():
        if chosen and file.stem not in chosen:
            continue
        notebook = json.loads(file.read_text(encoding="utf-8"))
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            found = run(notebook, file.stem)
        for count, (cell, outputs) in enumerate(zip(code_cells(notebook), found, strict=True), 1):
            numbered = [{**o, "execution_count": count} if "execution_count" in o else o for o in outputs]
            cell |= {"execution_count": count, "outputs": numbered}
        file.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        print(f"{file.name}: {file.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main(sys.argv[1:])
