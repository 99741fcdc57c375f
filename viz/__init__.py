"""The vibrating foot in a browser.

    import fasbody as fb
    import viz

    viz.show(fb.load("foot_arch"))
    viz.export(fb.load("foot_arch"), "foot.html")

A name is imported on first use, so that `import viz` costs nothing.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from viz.excitation import Excitation as Excitation
    from viz.feet import Show as Show
    from viz.modes import ModeShow as ModeShow
    from viz.notebook import Viewer as Viewer
    from viz.notebook import export as export
    from viz.notebook import show as show
    from viz.settings import Settings as Settings
else:

    def __getattr__(name: str) -> object:
        from fasbody.lazy import attribute

        return attribute(__name__, name)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__getattr__("__all__")})
