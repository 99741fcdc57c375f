"""The formulas of docs/equations.md as numbers: enough LaTeX to evaluate what is printed there."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

PAGE = (Path(__file__).parent.parent / "docs" / "equations.md").read_text()
TOKEN = re.compile(r"\\[A-Za-z]+|[A-Za-z]|\d+|[-+/()\[\]{}^_|]")
SKIPPED = {"\\left", "\\right"}
FUNCTIONS = {
    "sin": np.sin,
    "cos": np.cos,
    "arccos": np.arccos,
    "sqrt": np.sqrt,
    "log": np.log,
    "abs": np.abs,
    "e": np.e,
}
CLOSED = {"(": ")", "[": "]", "{": "}", "|": "|"}


def formulas(number: str) -> dict[str, str]:
    """Left-hand side -> right-hand side of what stands in the blocks of an equation; a second rate is `ddz_1`."""
    section = re.split(rf"\n### Eq\. {number}(?:-[\d.]+)?: ", PAGE)[1].split("\n### ")[0]
    text = "\n\\\\\n".join(re.findall(r"```math\n(.+?)\n```", section, re.DOTALL))
    text = re.sub(r"\\(begin|end)\{aligned\}|\\[,;]", " ", text)
    text = re.sub(r"\\\\\s*&(?= *[-+])", " ", text)  # a line that goes on
    found = {}
    for statement in re.split(r"\\\\|,\s*(?:&|\\q?quad)", text):
        *names, value = re.split(r"=|\\approx", statement.replace("&", "").replace("{}", ""))
        for name in names:
            found[_python(name).strip("() ")] = value
    return found


def value(formula: str, names: Mapping[str, Any]) -> Any:
    """The number that a right-hand side has."""
    return eval(_python(formula), {"__builtins__": {}}, FUNCTIONS | dict(names))


def matrices(number: str) -> list[list[list[str]]]:
    """The cells of each matrix in an equation."""
    section = PAGE.split(f"\n### Eq. {number}: ")[1].split("```math\n")[1].split("\n```")[0].replace("\\,", " ")
    each = re.findall(r"\\begin\{bmatrix\}(.+?)\\end\{bmatrix\}", section, re.DOTALL)
    return [[row.split("&") for row in matrix.split("\\\\")] for matrix in each]


def _python(latex: str) -> str:
    latex = re.sub(r"\\tfrac(\d)(\d)", r"(\1/\2)", latex)
    tokens = [token for token in TOKEN.findall(latex) if token not in SKIPPED]
    text, rest = _sum(tokens, "")
    assert not rest, latex
    return text


def _sum(tokens: list[str], until: str) -> tuple[str, list[str]]:
    """Everything up to a closing bracket, with the signs of multiplication that print leaves out."""
    out, after_value = "", False
    while tokens and tokens[0] != until:
        token = tokens[0]
        if token in "+-/":
            out, after_value, tokens = out + token, False, tokens[1:]
        elif token == "^":
            power, tokens = _atom(tokens[1:])
            out += f"**({power})"
        else:
            factor, tokens = _atom(tokens)
            out, after_value = out + ("*" if after_value else "") + factor, True
    return out, tokens[1:] if until else tokens


def _atom(tokens: list[str]) -> tuple[str, list[str]]:
    token, *rest = tokens
    if token in CLOSED:
        inside, rest = _sum(rest, CLOSED[token])
        return f"abs({inside})" if token == "|" else f"({inside})", rest
    if token in ("\\frac", "\\dfrac"):
        above, rest = _atom(rest)
        below, rest = _atom(rest)
        return f"({above}/{below})", rest
    if token.lstrip("\\") in FUNCTIONS and token != "e":
        of, rest = _atom(rest)
        return f"{token[1:]}({of})", rest
    if token in ("\\dot", "\\ddot", "\\mathrm"):
        base, rest = _atom(rest)
        name = {"\\dot": "d", "\\ddot": "dd", "\\mathrm": ""}[token] + base.strip("()").replace("*", "")
    else:
        name = token.lstrip("\\")
    if rest and rest[0] == "_" and not name.isdigit():
        below, rest = _atom(rest[1:])
        name += "_" + re.sub(r"\W", "", below)
    return name, rest
