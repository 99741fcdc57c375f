"""What MuJoCo's compiler says of a model, in a clause and with its line."""

import re

#: What the compiler's message means; groups of the pattern and of its place fill the clause.
_MEANINGS = (
    (r"transmission target '(?P<x>[^']*)' not found", "acts on {x!r}, which is not in the model"),
    (r"unknown transmission target '(?P<x>[^']*)'", "acts on {x!r}, which is not in the model"),
    (r"unknown element '(?P<x>[^']*)' in equality", "ties {x!r}, which is not in the model"),
    (r"(?P<k>site|geom|joint|body) '(?P<x>[^']*)' not found", "names the {k} {x!r}, which is not in the model"),
    (r"unrecognized name '(?P<x>[^']*)'", "names {x!r}, which is not in the model"),
    (r"path cannot be empty", "names no sites to run through"),
    (r"unrecognized attribute: '(?P<x>[^']*)'", "has the attribute {x!r}, which MJCF does not know there"),
    (r"unrecognized element", "stands where MJCF knows no such element"),
    (r"bad format in attribute '(?P<x>[^']*)'", "has something other than numbers in the attribute {x!r}"),
    (r"unknown default class name '(?P<x>[^']*)'", "names the class {x!r}, which no default declares"),
    (r"repeated name '(?P<x>[^']*)'", "has the name {x!r} a second time"),
)
_BROKEN = {
    "MISMATCHED_ELEMENT": "the element <{x}> that begins there is not closed where it should be",
    "PARSING_ATTRIBUTE": 'an attribute of <{x}> is not written as name="value"',
    "PARSING_ELEMENT": 'an element is not written as <name attribute="value">',
    "PARSING": "an element that begins there or later is never closed",
    "EMPTY_DOCUMENT": "the file is empty",
}


def compiler_complaint(message: str) -> tuple[str, int | None]:
    """The clause that says what is wrong with a model, and the line it stands in.

    Args:
        message: what MuJoCo raised.
    """
    text = " ".join(message.split())
    line_match = re.search(r"[Ll]ine(?: number=|\s)(\d+)", text)
    line = int(line_match[1]) if line_match else None
    broken = re.search(r"Error=XML_ERROR_(\w+)", text)
    if broken:
        element = re.search(r"XMLElement name=(\S+)", text)
        clause = _BROKEN.get(broken[1], "its XML is not well-formed").format(x=element[1] if element else "?")
        return clause, line
    head, _, place = re.sub(r"^(XML )?Error: ", "", text).partition(" Element ")
    name = re.search(r"name '([^']*)'", place) or re.match(r"'([^']*)'", place)
    where = "" if not name else f"{name[1]!r} " if place.startswith("name") else f"<{name[1]}> "
    for pattern, meaning in _MEANINGS:
        match = re.search(pattern, head)
        if match:
            return where + meaning.format(**match.groupdict()), line
    plain = re.sub(r" ?\(id = \d+\)|^Schema violation: ", "", head).rstrip(".")
    return f"{where.strip()}: {plain}" if where else plain, line
