"""The interface of what is displayed, for server and export, and the page's files.

`page/*.html` extend `page.html`. A page names meshcat's script, its first modules and its styles; the modules import
the others, each on a line of its own: `import { name, other } from "./file.js";`.
"""

import json
import re
from pathlib import Path
from typing import Any, Protocol

import jinja2

from viz import scene
from viz.scene import Hub
from viz.settings import Settings

PAGE = Path(__file__).parent / "page"
#: Server and export take the names of scripts, modules and styles from the page, and of other modules from a module.
SCRIPT = re.compile(r'<script src="([^"]+)"></script>')
MODULE = re.compile(r'<script type="module" src="([^"]+)"></script>')
STYLE = re.compile(r'<link rel="stylesheet" href="([^"]+)">')
IMPORT = re.compile(r'^import (?:\{ [^}\n]+ \} from )?"\./([^"\n]+)";$', re.MULTILINE)
#: What makes a module of a script, beside imports: the word before a declaration, and a vendored file's last line.
EXPORT = re.compile(r"^export (?:\{ \w+ \};$)?", re.MULTILINE)


class Display(Protocol):
    """The foot (`viz.feet.Show`) or the cell (`viz.modes.ModeShow`)."""

    #: Name of the page in the folder `page`.
    page: str
    hub: Hub
    #: Why the file could not be loaded again; empty if it could.
    error: str

    def description(self) -> dict[str, Any]:
        """What a page needs to know before anything else."""

    def answer(self, settings: Settings) -> dict[str, Any]:
        """The motion or scene for a page's settings."""

    def exported(self, live: bool) -> dict[str, Any]:
        """The documents that an exported page carries, by name; `live` with what moves its sliders."""

    def files(self) -> list[Path]:
        """The files to watch, absolute."""

    def reload(self) -> None:
        """Read the file again after it has changed; a broken one leaves the last good one in place."""


def markup(page: str, key: str = "") -> str:
    """A page's HTML, from its template; `key` is the session's, without which nothing on the server is changed."""
    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(PAGE), autoescape=True, undefined=jinja2.StrictUndefined
    )
    return templates.get_template(page).render(key=key)


def with_token(text: str, key: str) -> str:
    """A page or module whose scripts, modules and styles are asked for with the key."""
    for pattern in (SCRIPT, MODULE, STYLE, IMPORT):
        text = pattern.sub(lambda tag: tag[0].replace(f'{tag[1]}"', f'{tag[1]}?token={key}"'), text)
    return text


def page_json(document: Any) -> str:
    """A document as a page reads it: JSON, which has no NaN and no infinity; null stands for them."""
    try:
        return json.dumps(document, allow_nan=False)
    except ValueError:
        return json.dumps(json.loads(json.dumps(document), parse_constant=lambda _: None))


def file_of(name: str) -> Path:
    """The file behind a name in a page."""
    return scene.SCRIPT if name == "meshcat.js" else PAGE / name


def files(page: str) -> list[str]:
    """Names of a page's scripts, modules and styles."""
    text = markup(page, "any")
    return [*SCRIPT.findall(text), *modules(text), *STYLE.findall(text)]


def modules(html: str) -> list[str]:
    """Names of a page's modules, each after those that it imports: the order in which a browser runs them."""
    names: dict[str, None] = {}

    def visit(name: str) -> None:
        if name not in names:
            for imported in IMPORT.findall(file_of(name).read_text()):
                visit(imported)
            names.setdefault(name)

    for name in MODULE.findall(html):
        visit(name)
    return list(names)


def joined(names: list[str]) -> str:
    """Modules as one, for a page that is a single file; no two of them declare the same name."""
    return "\n".join(EXPORT.sub("", IMPORT.sub("", file_of(name).read_text())) for name in names)
