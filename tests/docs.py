"""The project's documents as data: code blocks, commands, links."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fasbody.commands import resolve

ROOT = Path(__file__).parent.parent
FOLDERS = (".", "docs", "mjcf", "benchmarks", "fasbody/acquire")
DOCUMENTS = sorted(file for folder in FOLDERS for file in (ROOT / folder).glob("*.md"))
#: What a line of a shell block begins with.
SHELL = re.compile(r"^(\w+=\S* )*(make|fasbody|python|pip|source|git|(\.venv/bin|/\S+)/\w+)\b")
FENCE = re.compile(r"^(?P<indent> *)```(?P<language>\w*)\s*$")
#: A comment above a block that says why it is not run: <!-- not run: needs a browser -->
TAG = re.compile(r"<!-- not run: (?P<reason>.+?) -->")


@dataclass(frozen=True)
class Block:
    """A code block; `language` is python, shell, output, or anything else for blocks that are only read."""

    file: Path
    line: int
    language: str
    text: str
    not_run: str = ""

    @property
    def commands(self) -> list[str]:
        """The commands of a shell block, lines ending in a backslash joined."""
        return [line.strip() for line in self.text.replace("\\\n", " ").splitlines() if SHELL.match(line.strip())]


def blocks(file: Path) -> list[Block]:
    """Fenced blocks, and those indented by four spaces after an empty line."""
    found, lines, i = [], file.read_text(encoding="utf-8").splitlines(), 0
    while i < len(lines):
        fence, start = FENCE.match(lines[i]), i
        if fence:
            end = next(j for j in range(i + 1, len(lines)) if lines[j].strip() == "```")
            body, language, after = lines[i + 1 : end], fence["language"], end + 1
        elif lines[i].startswith("    ") and (i == 0 or not lines[i - 1].strip()):
            end = i
            while end < len(lines) and (lines[end].startswith("    ") or not lines[end].strip()):
                end += 1
            body, language, after = lines[i:end], "", end
        else:
            i += 1
            continue
        dedent = min((len(line) - len(line.lstrip()) for line in body if line.strip()), default=0)
        text = "\n".join(line[dedent:] for line in body).strip("\n")
        above = TAG.search(next((line for line in reversed(lines[max(0, start - 2) : start]) if line.strip()), ""))
        found.append(Block(file, start + 1, language or _guess(text), text, above["reason"] if above else ""))
        i = after
    return found


def _guess(text: str) -> str:
    if re.match(r"(from|import) \w", text):
        return "python"
    return "shell" if any(SHELL.match(line.strip()) for line in text.splitlines()) else "text"


def words(command: str) -> list[str]:
    """A command as the shell would split it, without its comment, environment and path of the interpreter.

    `fasbody fit` comes back as the `python -m identification.fit` that it runs.
    """
    found = shlex.split(command, comments=True)
    while found and re.match(r"\w+=", found[0]):
        found = found[1:]
    if not found:
        return []
    program = found[0].removeprefix(".venv/bin/")
    if program != "fasbody":
        return [program, *found[1:]]
    if len(found) == 1 or found[1].startswith("-"):
        return ["python", "-m", "fasbody", *found[1:]]
    command, rest = resolve(found[1:])
    return ["python", "-m", command.module, *filter(None, [command.name]), *rest]


def inline_commands(file: Path) -> Iterator[str]:
    """`fasbody ...`, `python -m ...` and `make ...` in running text."""
    text = re.sub(r"^ *```.*?^ *```", "", file.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for span in re.findall(r"`([^`]+)`", text):
        for joined in " ".join(span.split()).split(" && "):
            if re.match(r"(\w+=\S* )*(fasbody [a-z]|(\.venv/bin/)?python -m \w|make \w)", joined):
                yield joined


def links(file: Path) -> Iterator[tuple[str, str]]:
    """(path, anchor) of every link and picture that leads to a place inside the project."""
    text = re.sub(r"^ *```.*?^ *```", "", file.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for target in re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r"(?:src|href)=\"([^\"]+)\"", text):
        if not re.match(r"[a-z]+:", target):
            path, _, anchor = target.partition("#")
            yield path, anchor


def anchors(file: Path) -> set[str]:
    """Anchors of a document's headings, by the rule of the usual hosts of repositories."""
    text = re.sub(r"^ *```.*?^ *```", "", file.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ +(.+?) *$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def mentioned_files(file: Path) -> Iterator[str]:
    """Paths of the project in `code spans`."""
    folders = "examples|simulator|tests|docs|benchmarks|mjcf|fasbody|identification|viz"
    yield from re.findall(rf"`((?:{folders})/[\w./-]+\.\w+)`", file.read_text(encoding="utf-8"))
