"""summary.csv, the figures and report.html of a study, from its fits alone."""

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, PackageLoader, select_autoescape
from markupsafe import Markup

from fasbody import console
from fasbody.presentation import counted, inline
from identification.estimates import RULE
from identification.recommendations import LEAST_FIT, follows
from identification.study import summary, tables
from identification.study.findings import Findings, gather
from identification.study.population import Population
from identification.study.truth import LIMITS, Truth, recovery

#: The subject whose motion and loops are shown where there is one of that name, as in the thesis.
_EXAMPLE = "16"
_LISTED = 20
_NONE_FOLLOWS = (
    f" No fit of any subject here follows its recordings to {LEAST_FIT:g} %, so what the model does between foot and "
    "ground is not shown."
)
#: Names of the figures that `pictures` gives, or gave before.
_OURS = re.compile(r"(verdicts|waterfall|(curves|boxes|traces|transmissibility|loops|energies|persons)_.+)\.(svg|png)")
_MODES = {
    "per-recording": "each recording alone, as in the thesis",
    "pooled": "each load of a subject over all frequencies, with constants that do not depend on frequency",
}
#: Modes whose loops mean most first: one frequency may have ankle and pad changed.
_TRUSTED = ("per-recording", "pooled")


def write(
    out: Path, documents: Sequence[Mapping[str, Any]], title: str, origin: str, truth: Truth | None = None,
    findings: Findings | None = None,
) -> list[Path]:  # fmt: skip
    """Write summary.csv, energy.csv, recovery.csv (with a truth), figures/ and report.html, each whole or not at all.

    Args:
        out: folder.
        documents: the fits.
        title: of the study.
        origin: "synthetic", "measured" or what is known of it.
        truth: of a synthetic study.
        findings: tracked branches and checks; None tracks the branches here.

    Returns:
        The files written, the report first.
    """
    findings = findings or gather(documents)
    table = summary.tidy(documents, truth, findings.tracked, findings.profiles)
    energy = summary.cycle_table(documents, findings.tracked)
    recovered = recovery(table) if truth else pd.DataFrame()
    drawn = pictures(documents, table, energy, origin, findings.tracked, findings.populations)
    from identification.study import figures  # late: matplotlib takes a second

    files, page_pictures = {}, {}
    for name, (draw, caption) in drawn.items():
        figure = draw()
        for ending in ("svg", "png"):
            files[f"figures/{name}.{ending}"] = figures.save(figure, ending)
        page_pictures[name] = {"svg": Markup(inline(files[f"figures/{name}.svg"])), "caption": caption}
    csv = {"summary.csv": table, "energy.csv": energy} | ({"recovery.csv": recovered} if len(recovered) else {})
    files |= {name: summary.csv(frame).encode() for name, frame in csv.items()}
    page = _page(documents, table, energy, recovered, page_pictures, findings, title=title, origin=origin)
    clear(out, files)
    written = [console.write_whole(out / name, content) for name, content in files.items()]
    return [console.write_whole(out / "report.html", page), *written]


def clear(out: Path, files: Collection[str]) -> None:
    """Remove what an earlier report of this program left in the folder and this one does not have."""
    stale = [f"figures/{file.name}" for file in (out / "figures").glob("*") if _OURS.fullmatch(file.name)]
    for name in ("recovery.csv", *stale):
        if name not in files:
            (out / name).unlink(missing_ok=True)


def pictures(
    documents: Sequence[Mapping[str, Any]], table: pd.DataFrame, energy: pd.DataFrame, origin: str,
    tracked: Mapping[str, str], populations: Sequence[Population] = (),
) -> dict[str, tuple[Callable[[], Any], str]]:  # fmt: skip
    """Name -> (function that draws it, caption) of every figure that these fits can fill."""
    from identification.study import figures

    out: dict[str, tuple[Callable[[], Any], str]] = {}
    if table.empty:
        return out
    for posture in dict.fromkeys(p.posture for p in populations):
        people = [p for p in populations if p.posture == posture]
        text = f"Each person's constants and the mean of all, pooled fits, {posture}. {tables.left_out(people)}"
        out[f"persons_{posture}"] = (partial(figures.persons, people, origin), text)
    over = table[table["frequency_hz"].notna()]
    for (mode, posture), rows in over.groupby(["mode", "posture"], sort=False):
        name = f"curves_{mode}_{posture}"
        text = f"Estimates over frequency, {mode}, {posture} (in the manner of Figures 4.18 to 4.25). "
        text += f"{tables.drawn(rows)}{_failed(documents, mode, posture)}"
        out[name] = (partial(figures.curves, rows, origin), text)
    for place, mode in enumerate(m for m in _TRUSTED if m in set(energy["mode"])):
        posture = energy.loc[energy["mode"] == mode, "posture"].iloc[0]
        subject, cycles = example(documents, mode, posture, tracked)
        others, follow = cycles[0]["subjects"] - 1 if cycles else 0, any(c["follows"] for c in cycles)
        more = f", whose recordings stand for those of {others} more" if others else ""
        whose, failed = f"subject {subject}{more}, {mode}, {posture}", _failed(documents, mode, posture, subject)
        text = f"Malleolus over base, data and model: {whose} (what Figures 4.6 to 4.14 show as traces).{failed}"
        text += "" if follow else _NONE_FOLLOWS
        out[f"transmissibility_{mode}"] = (partial(figures.transmissibility, cycles, origin), text)
        if place == 0:
            if follow:
                text = f"Force against relative displacement: {whose} (in the manner of Figures 4.15 to 4.17).{failed}"
                out[f"loops_{mode}"] = (partial(figures.loops, cycles, origin), text)
            rows = energy[(energy["mode"] == mode) & (energy["posture"] == posture)]
            text = f"Energy dissipated in one cycle, and the fat pad's share: {mode}, {posture}. {tables.drawn(rows)}"
            if follows(rows.loc[rows["shown"], "fit_percent"]).any():
                out[f"energies_{mode}"] = (partial(figures.energies, rows, origin), text)
    return out


def _failed(documents: Sequence[Mapping[str, Any]], mode: str, posture: str, subject: str | None = None) -> str:
    """How many fits of a mode and posture failed, of one subject or of all, in a sentence; empty where none did."""
    failed = _of(documents, mode, posture, "failed")
    count = sum(subject in (None, str(d["subject"])) for d in failed)
    return f" {counted(count, 'failed fit is', 'failed fits are')} not drawn." if count else ""


def _of(documents: Sequence[Mapping[str, Any]], mode: str, posture: str, status: str) -> list[Mapping[str, Any]]:
    return [d for d in documents if (d["mode"], d["posture"], d["status"]) == (mode, posture, status)]


def example(
    documents: Sequence[Mapping[str, Any]], mode: str, posture: str, tracked: Mapping[str, str]
) -> tuple[str, list[Mapping[str, Any]]]:
    """One subject's cycles of the branch shown: of whom the model follows most, subject 16 before others, the fullest.

    Each entry says whether its branch is decided, whether it follows its recordings, of how many subjects this is one,
    and how many of its fits failed.
    """
    fits = _of(documents, mode, posture, "done")
    good = {d["key"]: bool(follows(summary.displayed_fit(d, tracked))) for d in fits}
    counts, followed = Counter[Any](), Counter[Any]()
    for d in fits:
        files = len({c["file"] for c in d["cycles"]})
        counts[d["subject"]] += files
        followed[d["subject"]] += files * good[d["key"]]
    share = {s: followed[s] / max(1, count) for s, count in counts.items()}
    subject = max(counts, key=lambda s: (counts[s] > 0, share[s], s == _EXAMPLE, counts[s]))
    failed = sum(d["subject"] == subject for d in _of(documents, mode, posture, "failed"))
    whose = {"subject": subject, "subjects": len(counts), "failed": failed, "mode": mode}
    cycles: list[Mapping[str, Any]] = []
    for d in (d for d in fits if d["subject"] == subject):
        name, by = summary.displayed_branch(d, tracked)
        marks = whose | {"decided": by not in summary.OPEN, "follows": good[d["key"]]}
        cycles += [{**c, **marks} for c in d["cycles"] if c["branch"] == name]
    return str(subject), cycles


def _page(
    documents: Sequence[Mapping[str, Any]], table: pd.DataFrame, energy: pd.DataFrame, recovered: pd.DataFrame,
    pictures: Mapping[str, Any], findings: Findings, **more: str,
) -> str:  # fmt: skip
    environment = Environment(
        loader=PackageLoader("identification"), autoescape=select_autoescape(default=True),
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    modes = list(dict.fromkeys(d["mode"] for d in documents))
    trusted = next((m for m in _TRUSTED if m in set(energy["mode"])), "")
    failed = [f"Failed ({d['mode']}): {d['error']}" for d in documents if d["status"] == "failed"]
    failed += [f"Failed ({d['mode']}, {d['kind']}): {d['error']}" for d in findings.checks if d["status"] == "failed"]
    failed += [f"Left out ({d['mode']}): {text}" for d in documents for text in d.get("left_out", ())]
    return environment.get_template("study.html").render(
        sections=tables.sections(findings), odds=tables.odds(findings.populations), findings=findings,
        listed=tables.LISTED, rule=RULE,
        pictures=pictures, limits=LIMITS, day=date.today().isoformat(),
        subjects=len({d["subject"] for d in documents}),
        recordings=len({file for d in documents for file in d["files"]}),
        short=tables.short(documents, table, energy, recovered, findings.tracked),
        modes_text=" ".join(f"Mode {m}: {_MODES[m]}." for m in modes if m in _MODES),
        counts=tables.counts(documents, findings.tracked),
        failures=failed[:_LISTED], more_failures=max(0, len(failed) - _LISTED),
        verdicts=tables.verdicts(table), branches=tables.branches(documents, table), outliers=tables.outliers(table),
        recovery=tables.recovery(recovered) if len(recovered) else None,
        energies=tables.energies(energy[energy["mode"] == trusted]),
        balance=tables.balance(energy),
        named=lambda start: [name for name in pictures if name.startswith(start)], **more,
    )  # fmt: skip
