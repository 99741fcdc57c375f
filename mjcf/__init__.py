"""The models as data: MJCF files, found by name from a checkout or an installed wheel.

A folder a model: `two_dof/two_dof.xml` is the model `two_dof`, `two_dof/scene.xml` the same with ground and light.
"""

from importlib.resources import files
from pathlib import Path

_FOLDER = Path(str(files(__package__)))


def names() -> list[str]:
    """Names of the models that ship with the package, without the ending."""
    return sorted(_files())


def path(name: str) -> Path:
    """File of the shipped model `name`, e.g. ``path("two_dof")``.

    Raises:
        KeyError: no such model; the message lists those that exist.
    """
    files = _files()
    if name not in files:
        raise KeyError(f"no model {name!r}; shipped models: {', '.join(sorted(files))}")
    return files[name]


def asset(name: str) -> Path:
    """A file of the display-only assets (meshes made by `python -m viz.anatomy`)."""
    return _FOLDER / "assets" / name


def scene(name: str) -> Path:
    """The shipped model dressed with the assets, for MuJoCo's own viewer."""
    model = path(name)
    return model.with_name(f"scene{name.removeprefix(model.parent.name)}.xml")


def _files() -> dict[str, Path]:
    """Models by name: the XML files that are called as their folder, or begin so."""
    return {file.stem: file for file in _FOLDER.glob("*/*.xml") if file.stem.startswith(file.parent.name)}
