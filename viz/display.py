"""The interface of what is displayed, for server and export, and the page's files: `page/*.html` extend `page.html`."""

import json
import re
from pathlib import Path
from typing import Any, Protocol

import jinja2

from viz import scene
from viz.scene import Hub
from viz.settings import Settings

PAGE = Path(__file__).parent / "page"
#: A page names its scripts and styles; server and export take them from there.
SCRIPT = re.compile(r'<script src="([^"]+)"></script>')
STYLE = re.compile(r'<link rel="stylesheet" href="([^"]+)">')


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


def with_token(html: str, key: str) -> str:
    """A page whose scripts and styles are asked for with the key."""
    for pattern in (SCRIPT, STYLE):
        html = pattern.sub(lambda tag: tag[0].replace(tag[1], f"{tag[1]}?token={key}"), html)
    return html


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
    """Names of a page's scripts and styles, in order."""
    text = markup(page, "any")
    return [*SCRIPT.findall(text), *STYLE.findall(text)]
