"""The viewer from Python: a page beside a notebook or a script, and the same as a file."""

import asyncio
import os
import re
import sys
import threading
from html import escape
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from fasbody.exceptions import MissingPackageError, SettingError
from fasbody.foot.parameters import Fitted
from fasbody.recording.recording import Recording
from identification.result import FitResult
from viz.excitation import Excitation
from viz.exported import export_to
from viz.feet import Show
from viz.fitted import fitted
from viz.load import load_foot, name_and_values
from viz.settings import Settings

if TYPE_CHECKING:
    from fasbody.foot.model import Foot
    from viz.server import Server


#: Height of the page in a cell [px].
_HEIGHT = 640
#: Scheme, name and port of an address.
_ORIGIN = re.compile(r"(https?://[a-z0-9.-]+(?::\d+)?)(?:/.*)?$", re.IGNORECASE)


class Viewer:
    """A page that is served until `close`, or until Python ends.

    Args:
        show: what it shows.
        port: of this machine, 0 takes a free one.
        frames: origins of the notebook that shows it in a cell.
    """

    def __init__(self, show: Show, port: int = 0, frames: tuple[str, ...] = ()) -> None:
        self.show, self._frames = show, frames
        self._server: Server | None = None
        self._ready = threading.Event()
        self._problem: Exception | None = None
        self._thread = threading.Thread(target=self._run, args=(port,), name="viewer", daemon=True)
        self._thread.start()
        self._ready.wait()
        if self._problem is not None:
            raise self._problem

    def _run(self, port: int) -> None:
        try:
            asyncio.run(self._serve(port))
        finally:
            self._ready.set()

    async def _serve(self, port: int) -> None:
        try:
            from viz.bench import Bench
            from viz.server import Server

            self._server = Server(self.show, port, Bench(self.show), self._frames)
        except ImportError:
            self._problem = MissingPackageError("tornado", "view")
            return
        except Exception as problem:  # raised again in the calling thread
            self._problem = problem
            return
        self._loop = asyncio.get_running_loop()
        self._ready.set()
        await self._server.run()

    @property
    def url(self) -> str:
        """The page's address with its token, of this machine only."""
        assert self._server is not None
        return self._server.url

    def address_once(self) -> str:
        """An address that opens the page once, for a browser's command line."""
        assert self._server is not None
        return self._server.address_once()

    def wait(self) -> None:
        """Until Ctrl-C, as a script needs it, which would otherwise end and the page with it."""
        try:
            while self._thread.is_alive():
                self._thread.join(0.5)
        except KeyboardInterrupt:
            self.close()

    def close(self) -> None:
        """End the page."""
        if self._server is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._server.stop)
            self._thread.join()  # the server closes its connections within its time limit

    def __repr__(self) -> str:
        return f"{', '.join(self.show.models_called)} at {self.url}" + ("" if self._thread.is_alive() else " (closed)")

    def _repr_html_(self) -> str:
        """The live page, and below it a link for notebooks that allow no frame, as those of VS Code and Colab."""
        assert self._server is not None
        if not self._thread.is_alive():
            return f"<p>{escape(repr(self))}</p>"
        address, port = self.url, self._server.port
        if (base := _proxied()) is not None:
            address = f"{base}proxy/{port}/?token={self._server.key}"
        address, called = escape(address), escape(", ".join(self.show.models_called))
        return (
            f'<iframe src="{address}" title="{called}" style="width: 100%; height: {_HEIGHT}px; border: 0" '
            f'allow="fullscreen; clipboard-read; clipboard-write"></iframe><p><a href="{address}" target="_blank">'
            f"{called} in a page of its own</a></p>"
        )


def _proxied() -> str | None:
    """Where the notebook's server has its addresses, if jupyter-server-proxy brings those of other ports there."""
    if base := os.environ.get("JUPYTERHUB_SERVICE_PREFIX"):
        return base
    parent = os.environ.get("JPY_PARENT_PID")  # as VS Code starts a kernel, there is none
    if parent is None or find_spec("jupyter_server_proxy") is None:
        return None
    running = import_module("jupyter_server.serverapp").list_running_servers()
    servers = {str(server["pid"]): str(server["base_url"]) for server in running}
    return servers.get(parent, "/")


def _frames(origin: str | None) -> tuple[str, ...]:
    """Origins of the notebook: the one that was given, else those of this machine, and the one of JupyterHub.

    Raises:
        SettingError: what was given is no origin.
    """
    from viz.server import LOCAL

    public = os.environ.get("JUPYTERHUB_PUBLIC_URL") if origin is None else origin
    if public is None:
        return LOCAL
    match = _ORIGIN.match(public)
    if match is None:
        valid = 'as in "https://hub.example.org"'
        raise SettingError(setting="origin", quantity="the origin of the notebook", value=public, valid=valid)
    return (match[1].lower(),)


def show(
    foot: "Foot | Recording | str",
    result: Fitted | None = None,
    *,
    compare: "Foot | str | None" = None,
    excitation: Excitation | None = None,
    frequency: float = 20.0,
    added_mass: float = 0.0,
    browser: bool | None = None,
    port: int = 0,
    wait: bool | None = None,
    origin: str | None = None,
) -> Viewer:
    """Watch a foot in the browser, or in the cell of a notebook.

    Args:
        foot: a model, by name or file, or loaded; or a recording, which shakes the two masses.
        result: a fit whose parameters it gets.
        compare: a second model, shown as a ghost.
        excitation: of the base, a sine unless given.
        frequency: of the sine [Hz].
        added_mass: on the knee [kg].
        browser: open it; unless given, only where no notebook shows it.
        port: of this machine, 0 takes a free one.
        wait: until Ctrl-C; unless given, only where Python would end otherwise, which is in no
            notebook and no prompt.
        origin: of a notebook on another machine, "https://hub.example.org"; the page comes through its
            jupyter-server-proxy.

    Raises:
        SettingError: a parameter is unknown or outside the bounds that the model declares.
    """
    in_notebook = "ipykernel" in sys.modules
    frames = _frames(origin) if in_notebook or origin is not None else ()
    viewer = Viewer(_display(foot, result, compare, excitation, frequency, added_mass), port, frames)
    if not in_notebook if browser is None else browser:
        import webbrowser

        webbrowser.open(viewer.address_once())
    interactive = hasattr(sys, "ps1") or bool(sys.flags.interactive) or in_notebook
    if not interactive if wait is None else wait:
        viewer.wait()
    return viewer


def export(
    foot: "Foot | Recording | str",
    file: Path | str,
    result: Fitted | None = None,
    *,
    compare: "Foot | str | None" = None,
    excitation: Excitation | None = None,
    frequency: float = 20.0,
    added_mass: float = 0.0,
) -> Path:
    """Write what `show` shows as a page that needs no server, a picture or a film, as the file's ending says.

    Args:
        foot, result, compare, excitation, frequency, added_mass: as in `show`.
        file: .html, .png, .gif or .mp4.

    Raises:
        SettingError: another ending, or a parameter that cannot be. MissingPackageError: a tool that is missing.
    """
    export_to(_display(foot, result, compare, excitation, frequency, added_mass), Path(file))
    return Path(file)


def _display(
    foot: "Foot | Recording | str",
    result: Fitted | None,
    compare: "Foot | str | None",
    excitation: Excitation | None,
    frequency: float,
    added_mass: float,
) -> Show:
    if isinstance(foot, Recording):
        excitation, foot = Excitation.recorded(foot), "two_dof"
    loaded = load_foot(foot) if isinstance(foot, str) else foot
    recording = excitation.recording if excitation else None
    if recording is not None and recording.condition.body_mass_kg and not added_mass:
        added_mass = recording.condition.added_mass_kg
    estimates = {} if result is None else result.values()
    values = {loaded.parameters[key].name: value for key, value in estimates.items() if key in loaded.parameters}
    if estimates and not values:
        raise SettingError(f"the result holds no parameter of {loaded.name}; give the model that was fitted.")
    fit = fitted(result.document(), loaded.parameters, result.sentence()) if isinstance(result, FitResult) else {}
    delay = fit["branches"][0]["delay_s"] if fit else 0.0
    # by name, so that the page can fit it, and save a session
    model, changed = (foot, {}) if isinstance(foot, str) else name_and_values(foot) or (foot, {})
    values = changed | values
    models = [model, *([] if compare is None else [compare])]
    settings = Settings(frequency=frequency, added_mass=added_mass, values=values, delay_s=delay)
    return Show(models, excitation, settings, fit=fit)
