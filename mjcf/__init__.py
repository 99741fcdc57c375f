"""The models as data: MJCF files, found by name from a checkout or an installed wheel.

A folder a model: `two_dof/two_dof.xml` is the model `two_dof`, `two_dof/scene.xml` the same with ground and light.
All include `shaker.xml`; `text("two_dof")` is a whole model, to be edited elsewhere.
"""

import re
from importlib.resources import files
from pathlib import Path

_FOLDER = Path(str(files(__package__)))
#: What moves the table, which every model includes.
SHAKER = _FOLDER / "shaker.xml"
_SHAKER = re.compile(r"""^ *<include file="[^"]*shaker\.xml"\s*/>\n""", re.MULTILINE)
_CONTENT = re.compile(r"<mujoco>\n(.*)</mujoco>", re.DOTALL)
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_INCLUDE = re.compile(r"""<(?:include|model)\s[^>]*?\bfile\s*=\s*["']([^"']+)["']""")


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


def text(name: str) -> str:
    """The shipped model `name` as one text that includes nothing: what a copy begins with.

    Raises:
        KeyError: no such model.
    """
    return whole(path(name).read_text())


def whole(model: str) -> str:
    """A model's MJCF with the shaker in place of its include."""
    content = _CONTENT.search(SHAKER.read_text())
    return _SHAKER.sub(lambda _: content[1] if content else "", model)


def included(model: str) -> list[str]:
    """Files that MJCF includes or attaches models of, as it names them."""
    return _INCLUDE.findall(without_comments(model))


def without_comments(model: str) -> str:
    """MJCF in the same lines."""
    return _COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), model)


def parts(file: Path) -> list[Path]:
    """An MJCF file and those that it includes or attaches and that exist, absolute, the file first.

    MuJoCo looks beside the main file, then beside the one that includes.
    """
    found, read = [file.resolve()], 0
    while read < len(found):
        includer, read = found[read], read + 1
        try:
            names = included(includer.read_text(errors="replace"))
        except OSError:
            continue  # an editor is replacing it
        for name in names:
            places = (folder / name for folder in (found[0].parent, includer.parent))
            part = next((place.resolve() for place in places if place.is_file()), None)
            if part is not None and part not in found:
                found.append(part)
    return found


def asset(name: str) -> Path:
    """A file of the display-only assets (meshes made by `fasbody anatomy`)."""
    return _FOLDER / "assets" / name


def scene(name: str) -> Path:
    """The shipped model dressed with the assets, for MuJoCo's own viewer."""
    model = path(name)
    return model.with_name(f"scene{name.removeprefix(model.parent.name)}.xml")


def _files() -> dict[str, Path]:
    """Models by name: the XML files that are called as their folder, or begin so."""
    return {file.stem: file for file in _FOLDER.glob("*/*.xml") if file.stem.startswith(file.parent.name)}
