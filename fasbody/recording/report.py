"""What `check` understood, as one HTML file: each recording with its columns, findings and a second of its traces."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fasbody.console import write_whole
from fasbody.page import Section, html
from fasbody.presentation import COLOURS, Sheet
from fasbody.recording.checks import Checked, reasons, verdict
from fasbody.recording.recording import Recording

if TYPE_CHECKING:
    from markupsafe import Markup

#: Length of a thumbnail [s], its most samples, and its size [pixels].
_LENGTH_S, _SAMPLES, _WIDTH, _HEIGHT = 1.0, 500, 560, 120


def excerpt(recording: Recording) -> dict[str, list[float]]:
    """A second from the middle of a recording: times [s] and each channel [m/s^2], by name; empty where there is none.

    Args:
        recording: as read, sound or not.
    """
    t = recording.time_s
    middle = t.size // 2
    inside = np.flatnonzero(np.abs(t - t[middle]) <= 0.5 * _LENGTH_S)
    if not np.isfinite(t).all() or inside.size < 2:
        return {}
    kept = inside[:: max(1, inside.size // _SAMPLES)]
    good = {
        name: x[kept] for name, x in recording.channels.items() if x.shape == t.shape and np.isfinite(x[kept]).all()
    }
    return {name.removesuffix("_m_s2"): [float(f"{value:.5g}") for value in x] for name, x in good.items()}


def write(file: Path, title: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write the page.

    Args:
        file: to write.
        title: of the page.
        rows: of `checks.understood`, with an `excerpt` each where there is one.
    """
    verdicts = [verdict(row) for row in rows]
    counts = (f"{verdicts.count(word)} {word.partition(',')[0]}" for word in dict.fromkeys(verdicts))
    sheet = replace(Checked("", tuple(rows)).sheet(), title=title, notes=reasons(rows))
    sections = [Section(sheet, f"{len(rows)} recordings: {', '.join(counts)}", ())]
    for row, word in zip(rows, verdicts, strict=True):
        notes = [row["problem"], *row.get("warnings", ())] if row["problem"] else [*row.get("warnings", ())]
        if row.get("used"):
            left = "; ".join(row["unused"]) or "nothing"
            notes.append(f"{'; '.join(row['used'])}. Not used: {left}.")
        one = Sheet(f"{row['file']}: {word}", (), (), notes)
        sections.append(Section(one, _numbers(row), _drawn(row.get("excerpt") or {})))
    write_whole(file, html(sections))


def _numbers(row: Mapping[str, Any]) -> str:
    parts = [f"{row['samples']} samples"] if "samples" in row else []
    parts += [f"{row['rate_hz']:.6g} Hz"] if "rate_hz" in row else []
    if "transmissibility" in row:
        ratio, phase = row["transmissibility"], row["phase_deg"]
        parts.append(f"excitation {row['frequency_hz']:.5g} Hz: T = {ratio:.4g}, phase {phase:.4g} degrees")
    elif not row["problem"]:
        parts.append("broadband")
    levels = ", ".join(f"{name} {value:.3g}" for name, value in row.get("rms_m_s2", {}).items())
    return ", ".join([*parts, *([f"rms in m/s²: {levels}"] if levels else [])])


def _drawn(second: Mapping[str, list[float]]) -> list[tuple["Markup", str]]:
    """A thumbnail of the channels, all on one scale, and what that is; none without channels."""
    from markupsafe import Markup

    channels = {name: np.array(x) for name, x in second.items() if name != "time_s"}
    if "time_s" not in second or not channels:
        return []
    t, top = np.array(second["time_s"]), max(float(np.abs(x).max()) for x in channels.values()) or 1.0
    across = _WIDTH * (t - t[0]) / max(1e-12, t[-1] - t[0])
    drawn = Markup()
    for place, (name, x, colour) in enumerate(zip(channels, channels.values(), COLOURS, strict=False)):
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, 68 - 48 * x / top, strict=True))
        line = '<polyline fill="none" stroke="{0}" points="{1}"/><text x="{2}" y="12" fill="{0}">{3}</text>'
        drawn += Markup(line).format(colour, points, 4 + 90 * place, name)
    frame = Markup('<svg viewBox="0 0 {0} {1}" width="{0}" font-size="11">{2}</svg>')
    scale = f"{t[0]:.4g} to {t[-1]:.4g} s, within ±{top:.3g} m/s²"
    return [(frame.format(_WIDTH, _HEIGHT, drawn), scale)]
