"""summary.csv, the figures and report.html of a study, from its fits alone."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

from markupsafe import Markup

from fasbody import console
from fasbody.page import templates
from fasbody.presentation import counted, inline
from identification.estimates import RULE
from identification.recommendations import follows
from identification.study import summary, tables
from identification.study.findings import Findings

Document = Mapping[str, Any]
#: The subject whose motion and loops are shown where there is one of that name, as in the thesis.
_EXAMPLE = "16"
_LISTED = 20
_NONE_FOLLOWS = (
    " No fit follows its recordings, so the hysteresis of the model is not shown."
)
#: Names of the figures that `pictures` gives, or gave before.
_OURS = re.compile(r"(verdicts|waterfall|(curves|boxes|traces|transmissibility|loops|energies|persons)_.+)\.(svg|png)")
#: What a fit of each mode takes; loops mean most per recording, where ankle and pad may change places.
_MODES = {
    "per-recording": "each recording alone, as in the thesis",
    "pooled": "all frequencies of a subject and load together, with constants that do not depend on frequency",
}


def write(out: Path, findings: Findings, title: str, origin: str) -> list[Path]:
    """Write summary.csv, energy.csv, recovery.csv (with a truth), figures/ and report.html.

    Returns:
        The files written, the report first, each there whole or not at all.
    """
    drawn = pictures(findings, origin)
    from identification.figures import save  # late: matplotlib takes a second

    files, inlined = dict[str, bytes](), dict[str, Any]()
    for name, (draw, caption) in drawn.items():
        figure = draw()
        files |= {f"figures/{name}.{ending}": save(figure, ending) for ending in ("svg", "png")}
        inlined[name] = {"svg": Markup(inline(files[f"figures/{name}.svg"])), "caption": caption}
    frames = {"summary.csv": findings.table, "energy.csv": findings.energy, "recovery.csv": findings.recovered}
    files |= {name: summary.csv(frame).encode() for name, frame in frames.items() if len(frame.columns)}
    page = _page(findings, inlined, title, origin)
    clear(out, files)
    written = [console.write_whole(out / name, content) for name, content in files.items()]
    return [console.write_whole(out / "report.html", page), *written]


def clear(out: Path, files: Collection[str]) -> None:
    """Remove what an earlier report of this program left in the folder and this one does not have."""
    figures = (file.name for file in (out / "figures").glob("*") if _OURS.fullmatch(file.name))
    for name in {"recovery.csv", *(f"figures/{figure}" for figure in figures)} - set(files):
        (out / name).unlink(missing_ok=True)


def pictures(findings: Findings, origin: str) -> dict[str, tuple[Callable[[], Any], str]]:
    """Name -> (function that draws it, caption) of every figure that the fits can fill."""
    from identification.study import figures

    out: dict[str, tuple[Callable[[], Any], str]] = {}
    documents, energy, populations = findings.documents, findings.energy, findings.populations

    def add(name: str, draw: Callable[..., Any], data: Any, caption: str) -> None:
        out[name] = partial(draw, data, origin), caption

    for posture in dict.fromkeys(p.posture for p in populations):
        people = [p for p in populations if p.posture == posture]
        text = f"Each person's constants and the mean of all, pooled fits, {posture}."
        add(f"persons_{posture}", figures.persons, people, f"{text} {tables.left_out(people)}")
    over = findings.table[findings.table["frequency_hz"].notna()]
    for (mode, posture), rows in over.groupby(["mode", "posture"], sort=False):
        text = f"Estimates over frequency, {mode}, {posture} (in the manner of Figures 4.18 to 4.25). "
        text += f"{tables.drawn(rows)}{_failed(documents, mode, posture)}"
        add(f"curves_{mode}_{posture}", figures.curves, rows, text)
    postures = {d["mode"]: d["posture"] for d in reversed(documents) if d["status"] == "done" and d["cycles"]}
    modes = [mode for mode in _MODES if mode in postures]
    for mode in modes:
        posture = postures[mode]
        subject, cycles = example(findings, mode, posture)
        others = cycles[0]["subjects"] - 1 if cycles else 0
        follow = any(cycle["follows"] for cycle in cycles)
        more = f", whose recordings stand for those of {others} more" if others else ""
        whose, failed = f"subject {subject}{more}, {mode}, {posture}", _failed(documents, mode, posture, subject)
        text = f"Malleolus over base, data and model: {whose} (what Figures 4.6 to 4.14 show as traces).{failed}"
        text += "" if follow else _NONE_FOLLOWS
        add(f"transmissibility_{mode}", figures.transmissibility, cycles, text)
        if mode != modes[0]:
            continue
        if follow:
            text = f"Force against relative displacement: {whose} (in the manner of Figures 4.15 to 4.17).{failed}"
            add(f"loops_{mode}", figures.loops, cycles, text)
        rows = energy[(energy["mode"] == mode) & (energy["posture"] == posture)]
        text = f"Energy dissipated in one cycle, and the fat pad's share: {mode}, {posture}. {tables.drawn(rows)}"
        if follows(rows.loc[rows["shown"], "fit_percent"]).any():
            add(f"energies_{mode}", figures.energies, rows, text)
    return out


def _failed(documents: Sequence[Document], mode: str, posture: str, subject: str | None = None) -> str:
    """How many fits failed, of one subject or of all, in a sentence; empty where none did."""
    failed = _of(documents, mode, posture, "failed")
    count = sum(subject in (None, str(fit["subject"])) for fit in failed)
    return f" {counted(count, 'failed fit is', 'failed fits are')} not drawn." if count else ""


def _of(documents: Sequence[Document], mode: str, posture: str, status: str) -> list[Document]:
    which = (mode, posture, status)
    return [d for d in documents if (d["mode"], d["posture"], d["status"]) == which]


def example(findings: Findings, mode: str, posture: str) -> tuple[str, list[Document]]:
    """One subject's cycles of the branch shown.

    The one of whom the model follows most, subject 16 before others, then the fullest. Each entry
    says whether its branch is decided, whether it follows its recordings, of how many subjects this
    is one, and how many of its fits failed.
    """
    documents, tracked = findings.documents, findings.tracked
    fits: dict[str, list[tuple[Document, bool]]] = {}  # of each subject, and whether it follows
    for fit in _of(documents, mode, posture, "done"):
        follow = bool(follows(summary.displayed_fit(fit, tracked))) and not summary.misfit(fit)
        fits.setdefault(fit["subject"], []).append((fit, follow))

    def rank(subject: str) -> tuple[bool, float, bool, int]:
        files = [(len({c["file"] for c in fit["cycles"]}), follow) for fit, follow in fits[subject]]
        count, followed = sum(n for n, _ in files), sum(n for n, follow in files if follow)
        return count > 0, followed / max(1, count), subject == _EXAMPLE, count

    subject = max(fits, key=rank)
    failed = sum(fit["subject"] == subject for fit in _of(documents, mode, posture, "failed"))
    whose = {"subject": subject, "subjects": len(fits), "failed": failed, "mode": mode}
    cycles: list[Document] = []
    for fit, follow in fits[subject]:
        name, by = summary.displayed_branch(fit, tracked)
        marks = whose | {"decided": by not in summary.OPEN, "follows": follow}
        cycles += [{**cycle, **marks} for cycle in fit["cycles"] if cycle["branch"] == name]
    return str(subject), cycles


def _page(findings: Findings, pictures: Mapping[str, Any], title: str, origin: str) -> str:
    documents, table, energy = findings.documents, findings.table, findings.energy
    environment = templates("identification", trim_blocks=True, lstrip_blocks=True)
    modes = dict.fromkeys(d["mode"] for d in documents)
    trusted = next((mode for mode in _MODES if mode in set(energy["mode"])), "")
    failed = [f"Failed ({d['mode']}): {d['error']}" for d in documents if d["status"] == "failed"]
    checks = [d for d in findings.checks if d["status"] == "failed"]
    failed += [f"Failed ({d['mode']}, {d['kind']}): {d['error']}" for d in checks]
    failed += [f"Left out ({d['mode']}): {text}" for d in documents for text in d.get("left_out", ())]
    return environment.get_template("study.html").render(
        title=title,
        origin=origin,
        balance=tables.balance(energy),
        branches=tables.branches(documents, table),
        counts=tables.counts(documents, findings.tracked),
        day=date.today().isoformat(),
        energies=tables.energies(energy[energy["mode"] == trusted]),
        failures=failed[:_LISTED],
        findings=findings,
        listed=tables.LISTED,
        modes_text=" ".join(f"Mode {mode}: {_MODES[mode]}." for mode in modes if mode in _MODES),
        more_failures=max(0, len(failed) - _LISTED),
        named=lambda start: [name for name in pictures if name.startswith(start)],
        odds=tables.odds(findings.populations),
        outliers=tables.outliers(table),
        pictures=pictures,
        recordings=len({file for d in documents for file in d["files"]}),
        recovery=tables.recovery(findings.recovered) if len(findings.recovered) else None,
        rule=RULE,
        sections=tables.sections(findings),
        short=tables.short(findings),
        subjects=len({d["subject"] for d in documents}),
        verdicts=tables.verdicts(table),
    )
