"""Docstrings for the reference: one argument a line, and a dataclass' fields as arguments of its constructor."""

import re
from typing import Any

import griffe

from fasbody.presentation import unit_of

_HEAD = re.compile(r"^(Args|Attributes):\n((?:    .*\n?|\n(?=    ))+)", re.MULTILINE)


class OneArgumentALine(griffe.Extension):
    """Splits what the source puts on one line, so that each argument has its row with type and default."""

    def on_class(self, *, cls: griffe.Class, **_: Any) -> None:
        """Classes: fields of a dataclass are shown as what its constructor takes."""
        if cls.docstring:
            own = {name for name, attribute in cls.attributes.items() if attribute.annotation is not None}
            made = any(str(decorator.value).startswith("dataclass") for decorator in cls.decorators)
            start = cls.members.get("__init__")
            taken = [p.name for p in start.parameters] if isinstance(start, griffe.Function) else []
            cls.docstring.value = split(cls.docstring.value, [*cls.attributes, *taken], own if made else set())
            if made:
                cls.docstring.value = completed(cls.docstring.value, _fields(cls))

    def on_function(self, *, func: griffe.Function, **_: Any) -> None:
        """Functions and methods."""
        if func.docstring:
            func.docstring.value = split(func.docstring.value, [p.name.lstrip("*") for p in func.parameters], set())


def split(text: str, names: list[str], fields: set[str]) -> str:
    """A docstring with one of `names` a line; `Attributes` becomes `Args` where all of them are `fields`."""
    if not names:
        return text
    either = "|".join(sorted(map(re.escape, set(names)), key=len, reverse=True))
    item = re.compile(rf"(?:^|(?<=[.;,)\]] ))((?:\*{{0,2}}(?:{either})(?:, )?)+): ", re.MULTILINE)

    def listed(match: re.Match[str]) -> str:
        body = re.sub(r"^    ", "", match[2], flags=re.MULTILINE)
        flat = re.sub(r"\n(?! *\n)\s+(?=\S)", " ", body)
        pieces = item.split(flat)
        if pieces[0].strip():
            return match[0]  # it begins with something else: left as it is
        lines, seen = [], []
        for what, said in zip(pieces[1::2], pieces[2::2], strict=True):
            for name in what.split(", "):
                seen.append(name.strip())
                lines.append(f"    {name.strip()}: " + re.sub(r"\s*\n\s*", " ", said).strip().rstrip(";,"))
        head = "Args" if fields and set(seen) <= fields else match[1]
        return f"{head}:\n" + "\n".join(lines) + "\n" + ("\n" if match[2].endswith("\n\n") else "")

    return _HEAD.sub(listed, text)


def _fields(cls: griffe.Class) -> dict[str, str]:
    """Name of each field that the constructor takes -> what its line in the source says, else its name in words."""
    found = {}
    for name, attribute in cls.attributes.items():
        about = str(attribute.annotation)
        if attribute.annotation is None or "ClassVar" in about or "init=False" in str(attribute.value):
            continue
        _, _, said = (attribute.source or "").partition("  # ")
        said = "" if said.startswith(("type:", "fmt:", "noqa")) else said.strip()
        found[name] = said or in_words(name)
    return found


def in_words(name: str) -> str:
    """`added_mass_kg` is the added mass; a symbol such as `k_T` stays as it is."""
    parts, unit = name.split("_"), unit_of(name)
    ends = [i for i in range(1, len(parts)) if unit and unit_of("_".join(["", *parts[i:]])) == unit]
    kept = parts[: ends[-1]] if ends else parts
    symbol = any(len(part) == 1 or part != part.lower() for part in kept)
    return f"`{'_'.join(kept)}`" if symbol else " ".join(kept)


def completed(text: str, fields: dict[str, str]) -> str:
    """A docstring whose arguments are all of the `fields`: those that it leaves out follow."""
    head = re.search(r"^Args:\n((?:    .*\n?)+)", text, re.MULTILINE)
    has = set(re.findall(r"^    (\w+): ", head[1], re.MULTILINE)) if head else set()
    rows = "".join(f"    {name}: {said}\n" for name, said in fields.items() if name not in has)
    if not rows:
        return text
    if not head:
        return f"{text.rstrip()}\n\nArgs:\n{rows}"
    before, after = text[: head.end()].rstrip("\n"), text[head.end() :]
    return f"{before}\n{rows}{after}"


def one_a_line(code: str, _: int) -> str:
    """A function's head, one argument a line: a formatter would be started anew for each of eight hundred."""
    if not code.startswith("def "):
        return code
    code = code if '"' in code else code.replace("'", '"')
    depth, quote, pieces, begun = 0, "", [""], False
    for i, c in enumerate(code):
        if quote:
            quote = "" if c == quote and code[i - 1] != "\\" else quote
        elif c in "\"'":
            quote = c
        elif c in ")]}":
            depth -= 1
            if not depth and begun and c == ")":
                break
        if depth == 1 and begun and c == "," and not quote:
            pieces.append("")
        elif begun:
            pieces[-1] += c
        if not quote and c in "([{":
            depth, begun = depth + 1, True
    head, rest = code[: code.index("(") + 1], code[i:].removesuffix(": pass")
    lines = [f"    {piece.strip()},\n" for piece in pieces if piece.strip()]
    return f"{head}\n{''.join(lines)}{rest}:\n    pass\n"
