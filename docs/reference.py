"""The Python reference: which module stands on which page, by task; what no task names is listed with the internals."""

import ast
import importlib
import inspect
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
#: Task -> title of a page -> modules of a folder, in the order of the page. Without names: all of the folder.
TASKS: dict[str, dict[str, tuple[str, ...]]] = {
    "Record and read": {
        "Recordings": ("fasbody/recording recording condition known harmonics quality checks channels clock",),
        "Studies": ("fasbody/recording study trials files merge proposal sources",),
        "Acquisition": ("fasbody/acquire session plan board generator level folder capture",),
        "Virtual bench": ("fasbody/acquire/bench",),
        "Virtual laboratory": ("fasbody/laboratory",),
    },
    "Simulate": {
        "Models": ("mjcf", "fasbody/foot model parameters"),
        "Motion": ("fasbody/foot shaker simulate two_dof damper figures",),
        "The five-body arch": (
            "fasbody/arch bones kinematics lagrange linear ode sensitivity reduction load motion",
        ),
        "The leg": ("fasbody/leg chain peaks statements crosscheck figures",),
    },
    "Fit": {
        "Fit a foot": ("identification fitting setup estimates result",),
        "Rival models": ("identification/rivals compare result ladder edited naming mechanisms figures",),
        "Many recordings": ("identification/study plan summary population profile validation loops report figures",),
        "Black-box models": (
            "identification/blackbox identify data polynomial state_space frequency mimo nonlinear narx pem subspace",
            "identification/blackbox selection validation criteria excitation condition keep report figures",
        ),
        "Heel strikes": ("fasbody/heel strike plate laws study pad estimate population analysis figures",),
    },
    "Transmissibility": {
        "Transmissibility": (
            "fasbody/transmissibility table estimate response sines periodic broadband local resonance sdof",
            "fasbody/transmissibility spectra statistics comparisons findings steps figures",
        ),
    },
    "Plan": {
        "The experiment director": ("identification/plan director session candidates shaker prior result figures",)
    },
    "View": {"Viewer": ("viz notebook feet motion settings excitation exported bench modes",)},
    "The cell": {
        "Cell": ("fasbody/cell analysis dome materials mesh meshfile modal modeshape viscoelastic body figures",)
    },
    "Errors": {"Exceptions": ("fasbody exceptions",)},
}
#: Pages that the search finds before others of the same word.
BOOSTED = ("Fit a foot", "Models", "Motion", "Recordings", "Studies")
#: Folders whose other modules are the internals, with their titles.
INTERNALS: dict[str, str] = {
    "Internals: what all commands share": "fasbody",
    "Internals: models": "fasbody/foot",
    "Internals: arch": "fasbody/arch",
    "Internals: leg": "fasbody/leg",
    "Internals: recordings": "fasbody/recording",
    "Internals: file formats": "fasbody/recording/formats",
    "Internals: heel strikes": "fasbody/heel",
    "Internals: transmissibility": "fasbody/transmissibility",
    "Internals: acquisition": "fasbody/acquire",
    "Internals: identification": "identification",
    "Internals: engines": "identification/engines",
    "Internals: rival models": "identification/rivals",
    "Internals: director": "identification/plan",
    "Internals: black-box models": "identification/blackbox",
    "Internals: many recordings": "identification/study",
    "Internals: cell": "fasbody/cell",
    "Internals: viewer": "viz",
    "Internals: anatomy": "viz/anatomy",
}


def listed() -> dict[str, list[str]]:
    """Title of each page -> its modules, tasks first."""
    pages = {
        title: [m for each in names for m in _named(each)] for pages in TASKS.values() for title, names in pages.items()
    }
    taken = {module for modules in pages.values() for module in modules}
    rest = {title: [m for m in _all(folder) if m not in taken] for title, folder in INTERNALS.items()}
    return {title: modules for title, modules in (pages | rest).items() if modules}


def page_of(title: str) -> str:
    """Name of the page with a title."""
    return f"python_{re.sub(r'[^a-z]+', '_', title.lower())}.md"


def navigation() -> list[dict[str, object]]:
    """The reference as mkdocs' nav has it: the overview, a group a task, the internals."""
    there = listed()
    tasks = [{task: [{t: page_of(t)} for t in pages if t in there]} for task, pages in TASKS.items()]
    single = [dict(group) if len(pages) > 1 else pages[0] for group in tasks for pages in group.values()]
    inner = [{title.removeprefix("Internals: ").capitalize(): page_of(title)} for title in INTERNALS if title in there]
    return [{"Names by task": "python.md"}, *single, {"Internals": inner}]


def pages() -> dict[str, str]:
    """Page -> its text, from which mkdocstrings makes the reference."""
    texts = {"python.md": _overview()}
    for title, modules in listed().items():
        boost = 0.2 if title in INTERNALS else 2 if title in BOOSTED else 1
        head = f"---\nsearch:\n  boost: {boost}\n---\n\n# {title}\n\n"
        texts[page_of(title)] = head + "\n".join(f"::: {module}\n" for module in modules)
    return texts


def _named(entry: str) -> list[str]:
    folder, *names = entry.split()
    package = folder.replace("/", ".")
    return [f"{package}.{name}" for name in names if (ROOT / folder / f"{name}.py").is_file()] or _all(folder)


def _all(folder: str) -> list[str]:
    files = [file for file in (ROOT / folder).glob("*.py") if file.stem not in ("__init__", "__main__")]
    return [".".join(file.relative_to(ROOT).with_suffix("").parts) for file in sorted(files)] or (
        [folder.replace("/", ".")] if (ROOT / folder / "__init__.py").is_file() else []
    )


def _overview() -> str:
    """What `fasbody` and `identification` export, a table a task, each name with its first sentence."""
    place = {module: title for title, modules in listed().items() for module in modules}
    rows: dict[str, list[str]] = {}
    for package, short in (("fasbody", "fb"), ("identification", "idn")):
        top = importlib.import_module(package)
        for name in top.__all__:
            thing = getattr(top, name)
            if inspect.isclass(thing) or inspect.isfunction(thing):
                path = f"{thing.__module__}.{thing.__qualname__}"
                says = (inspect.getdoc(thing) or "").split("\n")[0].replace("|", "\\|")
                rows.setdefault(place[thing.__module__], []).append(f"| [`{short}.{name}`][{path}] | {says} |")
    text = [
        "# Python",
        "What a script needs, by task. `import fasbody as fb` and `import identification as idn` have these names;"
        " everything else is imported from its module. The pages of this section show every public class with its"
        " constructor. The internals stand last.",
    ]
    for title in listed():
        if title in rows:
            text += [f"## {title}", "\n".join(["| name | what |", "|---|---|", *rows[title]])]
    return "\n\n".join(text) + "\n"


def functions_of(file: str) -> set[str]:
    """Names that a module defines, methods with their class: `TwoDof.rates`."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    found = {node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    inside = [
        (n.name, m.name)
        for n in tree.body
        if isinstance(n, ast.ClassDef)
        for m in n.body
        if isinstance(m, ast.FunctionDef)
    ]
    return found | {f"{outer}.{inner}" for outer, inner in inside}
