"""The vibrating foot in a browser.

    import fasbody as fb
    import viz

    viz.show(fb.load("foot_arch"))
    viz.export(fb.load("foot_arch"), "foot.html")

A name is imported on first use, so that `import viz` costs nothing.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from viz.excitation import Excitation
    from viz.feet import Show
    from viz.modes import ModeShow
    from viz.notebook import Viewer, export, show
    from viz.settings import Settings
else:
    _HOMES = {
        "Excitation": "viz.excitation",
        "ModeShow": "viz.modes",
        "Settings": "viz.settings",
        "Show": "viz.feet",
        "Viewer": "viz.notebook",
        "export": "viz.notebook",
        "show": "viz.notebook",
    }

    def __getattr__(name: str) -> object:
        from fasbody.lazy import attribute

        return attribute(__name__, _HOMES, name)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})


__all__ = ["Excitation", "ModeShow", "Settings", "Show", "Viewer", "export", "show"]
