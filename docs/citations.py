"""The paper as a page: its title, author and year for each [@key], and the list of references."""

import re
from pathlib import Path
from typing import Any

ENTRY = re.compile(r"^@\w+\{(\w+),\n(.*?)^\}", re.MULTILINE | re.DOTALL)
FIELD = re.compile(r"^\s*(\w+) = \{(.*)\},?$", re.MULTILINE)
CITED = re.compile(r"\[@(\w+)\]")
#: Where it appeared, by the kind of the work.
PLACES = ("journal", "booktitle", "publisher", "school")


def page(markdown: str, meta: dict[str, Any], bibliography: Path) -> str:
    """The text of the page.

    Args:
        markdown: the paper without its head, with a heading of the first level each chapter, the last "References".
        meta: its head, with the authors of CITATION.cff. bibliography: the BibTeX file.

    Raises:
        KeyError: a work is cited that the file does not have.
    """
    entries = ENTRY.findall(bibliography.read_text(encoding="utf-8"))
    works = {key: {name: value.translate({123: None, 125: None}) for name, value in FIELD.findall(text)}
             for key, text in entries}  # fmt: skip
    cited = CITED.sub(lambda match: f"([{_short(works[match[1]])}](#{match[1]}))", markdown)
    chapters = re.sub(r"^(#+ )", r"#\1", cited, flags=re.MULTILINE)
    used = {key: works[key] for key in CITED.findall(markdown)}
    listed = [_entry(key, work) for key, work in sorted(used.items(), key=lambda item: item[1]["author"])]
    authors = ", ".join(_named(author) for author in meta["authors"])
    head = f"# {meta['title']}\n\n{authors}, {meta['date']}\n\n"
    return "\n\n".join([head + chapters.strip(), *listed]) + "\n"


def _named(author: dict[str, str]) -> str:
    """An author of CITATION.cff: a person or a group."""
    return author.get("name") or f"{author['given-names']} {author['family-names']}"


def _authors(work: dict[str, str]) -> list[tuple[str, str]]:
    """Family and given name of each; those that are not named are one, "et al."."""
    named = [author.partition(", ")[::2] for author in work["author"].split(" and ")]
    return [("et al.", "") if family == "others" else (family, given) for family, given in named]


def _joined(names: list[str]) -> str:
    *first, last = names
    return " ".join([", ".join(first), *(["and"] if first and last != "et al." else []), last]).strip()


def _short(work: dict[str, str]) -> str:
    families = [family for family, _ in _authors(work)]
    return f"{_joined(families if len(families) < 3 else [families[0], 'et al.'])}, {work['year']}"


def _entry(key: str, work: dict[str, str]) -> str:
    initials = [
        " ".join([f"{family},", *(f"{part[0]}." for part in given.split())]) if given else family
        for family, given in _authors(work)
    ]
    place = next((work[name] for name in PLACES if name in work), "")
    doi = f" [doi:{work['doi']}](https://doi.org/{work['doi']})" if "doi" in work else ""
    return f'<span id="{key}"></span>{_joined(initials)} ({work["year"]}). {work["title"]}. *{place}*.{doi}'
