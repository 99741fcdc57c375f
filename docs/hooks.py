"""What mkdocs cannot know: pages that live elsewhere in the project, and those made from the commands and the code.

Links are written for readers of the repository; here they are turned to the pages of the site, and links to files that
are no pages become plain text.
"""

import importlib
import re
from itertools import groupby
from pathlib import Path
from typing import Any

import arguments  # beside this file
import cells  # beside this file
import citations  # beside this file
import reference  # beside this file
import typer
import yaml
from markdown import Markdown
from markdown.extensions import Extension
from markdown.extensions.toc import slugify
from markdown.inlinepatterns import InlineProcessor
from math_core import LatexToMathML
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from mkdocstrings_handlers.python._internal import rendering

from fasbody.commands import Command, commands
from fasbody.presentation import unit_of

ROOT = Path(__file__).parent.parent
#: Page of the site -> file of the repository outside docs/.
ELSEWHERE = {
    "index.md": "README.md",
    "models.md": "mjcf/README.md",
    "foot_arch.md": "mjcf/foot_arch/README.md",
    "two_dof.md": "mjcf/two_dof/README.md",
    "leg.md": "mjcf/leg/README.md",
    "mounted_arch.md": "mjcf/mounted_arch/README.md",
    "board_protocol.md": "fasbody/acquire/README.md",
    "benchmarks.md": "benchmarks/RESULTS.md",
    "contributing.md": "CONTRIBUTING.md",
    "changelog.md": "CHANGELOG.md",
} | {f"{file.stem}.md": f"docs/notebooks/{file.name}" for file in cells.notebooks()}
PAGES = {file: page for page, file in ELSEWHERE.items()}
#: Pages of wide tables, and of pictures beside code: no contents beside them.
WIDE = ("reproduction.md", "benchmarks.md", "examples.md")
#: Pages that the search puts before others that have the same word, and words that it shall find them by.
BOOST = {
    "install.md": 3.0, "mirror.md": 3.0, "tutorial.md": 2.0, "identification.md": 3.0, "cell.md": 3.0, "which.md": 2.0,
    "transmissibility.md": 2.0, "edit_model.md": 2.0,
}  # fmt: skip
WORDS = {
    "transmissibility.md": ["t-test", "ANOVA", "effect size", "folder"],
    "identification.md": ["confidence interval", "standard error", "nuisance parameter", "repeatability"],
    "edit_model.md": ["insole", "shoe", "orthosis"],
    "symbols.md": ["k_T", "k_F", "c_T", "c_F", "m_S", "m_T", "m_F", "z_T", "z_F", "L_1", "c_11", "theta_20"],
}
#: Modules that have a place in the reference.
REFERENCE = {module for modules in reference.listed().values() for module in modules}
#: A picture of the gallery, and the example that draws it.
EXAMPLE = re.compile(r"^!\[[^\]]*\]\(figures/example_(\w+)\.\w+\)$", re.MULTILINE)
#: A link to a module, and functions of it.
FUNCTIONS = re.compile(r"(\[`[\w/]+\.py`\]\[([\w.]+)\])((?: `[\w.]+`)+)")
#: A table of arguments as mkdocstrings makes it; a row of it up to the description: all, name, description.
TABLE = re.compile(r"<table>\s*<thead>\s*<tr>\s*<th>Name</th>.*?</table>", re.DOTALL)
ROW = re.compile(
    r'(<tr class="doc-section-item">\s*<td>\s*<code>([^<]+)</code>\s*</td>\s*<td>.*?</td>\s*<td>)(.*?)</td>', re.DOTALL
)
#: A unit in brackets.
UNIT = re.compile(r"\[((?:1/)?(?:[munk]?[mgNsVJW]|[kM]?Hz|[kMG]?Pa|rad|deg|degree|yr|%|dB)(?:[ /^][\w^/. ]+)?)\]")
#: A block of code with its fences.
FENCE = re.compile(r"(^`{3,}[^`\n]*\n.*?^`{3,} *$)", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s#]*)(#[^)\s]*)?\)")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Leave out pages that do not exist yet, and fill in those of the Python reference."""
    config.nav = _existing(config.nav or [], reference.navigation())
    fence = {"name": "math", "class": "math", "format": lambda source, *_, **__: _formula(source, display=True)}
    config.mdx_configs["pymdownx.superfences"] = {"custom_fences": [fence]}
    config.markdown_extensions.append(Formulas())  # type: ignore[arg-type]
    if hasattr(rendering, "_get_formatter"):  # else mkdocstrings starts ruff for each head, which takes a third of all
        rendering._get_formatter = lambda: arguments.one_a_line
    return config


def _formula(latex: str, *, display: bool) -> str:
    """A formula in LaTeX as MathML, which browsers typeset without a script."""
    mathml = LatexToMathML().convert_with_local_state(latex, displaystyle=display)
    return f'<div class="formula">{mathml}</div>' if display else mathml


class Formulas(Extension):
    """Formulas between dollar signs; blocks of the language `math` are those of a line of their own."""

    def extendMarkdown(self, md: Markdown) -> None:
        """Look for them after code in backticks (priority 190) and before escaped characters (180)."""
        md.inlinePatterns.register(Dollars(r"(?<![\\\w$])\$(?![\s$])([^$\n]+?)(?<![\s\\])\$(?!\w)", md), "formula", 185)


class Dollars(InlineProcessor):
    """One formula within a line."""

    def handleMatch(self, m: re.Match[str], data: str) -> tuple[str, int, int]:  # type: ignore[override]
        """Keep the MathML as it is."""
        return self.md.htmlStash.store(_formula(m[1], display=False)), m.start(0), m.end(0)


def _existing(entries: list[Any], python: list[Any]) -> list[Any]:
    kept: list[Any] = []
    for entry in entries:
        ((title, target),) = entry.items()
        if title == "Python":
            kept.append({title: python})
        elif isinstance(target, list):
            inside = _existing(target, python)
            kept += [{title: inside}] if inside else []
        elif target == "commands.md" or (ROOT / ELSEWHERE.get(target, f"docs/{target}")).is_file():
            kept.append(entry)
    return kept


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are not in docs/."""
    for page, file in ELSEWHERE.items():
        if (source := ROOT / file).is_file():
            text = cells.page(source) if source.suffix == ".ipynb" else source.read_text(encoding="utf-8")
            files.append(File.generated(config, page, content=text))
    files.append(File.generated(config, "commands.md", content=command_reference()))
    for page, text in reference.pages().items():
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Turn links between files of the repository into links between pages; give wide tables the whole page."""
    if page.file.src_uri in BOOST:
        page.meta["search"] = {"boost": BOOST[page.file.src_uri]}
    if page.file.src_uri.startswith("paper/"):
        page.meta["search"] = {"exclude": True}
        authors = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["authors"]
        return citations.page(markdown, {**page.meta, "authors": authors}, ROOT / "docs/paper/paper.bib")
    page.meta |= {"tags": words} if (words := WORDS.get(page.file.src_uri)) else {}
    if page.file.src_uri in WIDE:
        page.meta["hide"] = ["toc"]
        for title in re.findall(r"^## (.+)$", markdown, re.MULTILINE):  # the table at the top leads to its chapters
            markdown = markdown.replace(f"\n| {title} |", f"\n| [{title}](#{slugify(title, '-')}) |", 1)
    here = (ROOT / ELSEWHERE.get(page.file.src_uri, f"docs/{page.file.src_uri}")).parent

    def turned(match: re.Match[str]) -> str:
        image, text, target, anchor = match[1], match[2], match[3], match[4] or ""
        if not target or "://" in target:
            return match[0]
        place = (here / target).resolve()
        if not place.is_relative_to(ROOT):
            raise PluginError(f"{page.file.src_uri} links to {target}, which lies outside the repository.")
        file = place.relative_to(ROOT).as_posix()
        if (module := file.removesuffix(".py").replace("/", ".")) in REFERENCE:
            return f"[{text}][{module}]"
        page_of = PAGES.get(file) or (file.removeprefix("docs/") if file.startswith("docs/") else "")
        return f"{image}[{text}]({page_of}{anchor})" if page_of else text

    pieces = FENCE.split(markdown)  # code, whose brackets are no links, at the odd places
    pieces[::2] = [FUNCTIONS.sub(_linked, LINK.sub(turned, piece)) for piece in pieces[::2]]
    markdown = "".join(pieces)
    return EXAMPLE.sub(_beside_code, markdown) if page.file.src_uri == "examples.md" else markdown


def _beside_code(match: re.Match[str]) -> str:
    """A picture of the gallery beside the example that draws it."""
    code = (ROOT / "examples" / f"{match[1]}.py").read_text(encoding="utf-8")
    return f'<div class="gallery" markdown="1">\n\n{match[0]}\n\n```python\n{code}```\n\n</div>'


def _linked(match: re.Match[str]) -> str:
    """Functions beside the link to their module, as links to the reference."""
    names = re.sub(r"`((?!_)\w+(?:\.(?!_)\w+)*)`", rf"[`\1`][{match[2]}.\1]", match[3])
    return match[1] + names


def on_page_content(html: str, page: Page, **_: Any) -> str:
    """Mark the page of rows for docs/styles/wide.css; give the tables of the reference their units."""
    if page.file.src_uri.startswith("python_"):
        return TABLE.sub(_with_units, html)
    return f'<div class="rows">{html}</div>' if page.file.src_uri == "reproduction.md" else html


def _with_units(table: re.Match[str]) -> str:
    """A table of arguments with a column of units, where one of them has any."""
    rows = [(row[2], row[3]) for row in ROW.finditer(table[0])]
    units = [_unit(name, says) for name, says in rows]
    if not any(units):
        return table[0]
    left = iter(units)
    text = ROW.sub(lambda row: f"{row[1]}{row[3]}</td><td>{next(left)}</td>", table[0])
    return text.replace("<th>Description</th>", "<th>Description</th><th>Unit</th>", 1)


def _unit(name: str, says: str) -> str:
    """The unit that a name ends with, or the only one in brackets in what is said of it."""
    found = list(dict.fromkeys(UNIT.findall(says)))
    return unit_of(name) or (found[0] if len(found) == 1 else "")


def command_reference() -> str:
    """Every command with its help and its options."""
    head = "# Commands\n\n`fasbody` prints this list; every command has `--help`.\n"
    groups = groupby(commands(), lambda command: command.group)
    return "\n".join([head, *("\n".join([f"## {title}\n", *map(_section, group)]) for title, group in groups)])


def _section(command: Command) -> str:
    click = typer.main.get_command(importlib.import_module(command.home).app)
    found = getattr(click, "commands", {}).get(command.name, click)
    text, _, examples = (found.help or command.does).strip().partition("Examples:\n")
    rows = [_row(parameter) for parameter in found.params if not getattr(parameter, "hidden", False)]
    rows = [row for row in rows if "`--help`" not in row]
    table = "\n".join(["| option | what | default |", "|---|---|---|", *rows]) if rows else ""
    lines = [line.strip() for line in examples.splitlines() if line.strip()]
    shell = ["```shell\n" + "\n".join(lines) + "\n```"] if lines else []
    return "\n\n".join([f"### {command.call}", text.strip(), *shell, table]) + "\n"


def _row(parameter: Any) -> str:
    names = parameter.opts + parameter.secondary_opts if parameter.param_type_name == "option" else [parameter.name]
    default = parameter.default
    nothing = default is None or default is False or callable(default) or default in ((), [], "")
    shown = "" if nothing else f"`{default}`"
    text = re.sub(r"\\(?=\[)", "", getattr(parameter, "help", "") or "").replace("|", "\\|")
    return f"| {', '.join(f'`{name}`' for name in names)} | {text} | {'required' if parameter.required else shown} |"
