"""The models as data: MJCF files, found by name from a checkout or an installed wheel."""

from importlib.resources import files
from pathlib import Path

_FOLDER = Path(str(files(__package__)))


def names() -> list[str]:
    """Names of the models that ship with the package, without the ending."""
    return sorted(file.stem for file in _FOLDER.glob("*.xml"))


def path(name: str) -> Path:
    """File of the shipped model `name`, e.g. ``path("two_dof")``.

    Raises:
        KeyError: no such model; the message lists those that exist.
    """
    if name not in names():
        raise KeyError(f"no model {name!r}; shipped models: {', '.join(names())}")
    return _FOLDER / f"{name}.xml"


def asset(name: str) -> Path:
    """A file of the display-only assets (meshes made by `python -m viz.anatomy`)."""
    return _FOLDER / "assets" / name


def scene(name: str) -> Path:
    """The shipped model dressed with the assets, for MuJoCo's own viewer."""
    return _FOLDER / "scene" / path(name).name
