"""What `check` understood, as one HTML file: each recording with its columns, findings and a second of its traces."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.console import write_whole
from fasbody.presentation import COLOURS
from fasbody.recording.checks import reasons, verdict
from fasbody.recording.recording import Recording

#: Length of a thumbnail [s], its most samples, and its size [pixels].
_LENGTH_S, _SAMPLES, _WIDTH, _HEIGHT = 1.0, 500, 560, 120

_PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>{{ title }}</title>
<style>
body {font: 15px/1.4 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222}
section {border-top: 1px solid #bbb; padding: .6em 0} h2 {font-size: 1.05em; margin: .2em 0}
p, ul {margin: .3em 0} svg {max-width: 100%} .unusable {color: #a40000} .note {color: #8a5a00}
</style>
<h1>{{ title }}</h1>
<p>{{ rows | length }} recordings: {{ counts }}.</p>
{% if why %}<ul class="unusable">{% for text in why %}<li>{{ text }}</li>{% endfor %}</ul>{% endif %}
{% for row in rows %}<section>
<h2>{{ row.file }}: <span class="{{ row.verdict }}">{{ row.verdict }}</span></h2>
{% if row.problem %}<p class="unusable">{{ row.problem }}</p>{% endif %}
<p>{{ row.numbers }}</p>
{% if row.used %}<p>{{ row.used | join("; ") }}.<br>Not used: {{ row.unused | join("; ") or "nothing" }}.</p>{% endif %}
{% for text in row.warnings %}<p class="note">{{ text }}</p>{% endfor %}
{% if row.lines %}<svg viewBox="0 0 {{ width }} {{ height }}" width="{{ width }}" role="img"
 aria-label="One second of base and malleolus">
{% for name, colour, points in row.lines %}<polyline fill="none" stroke="{{ colour }}" points="{{ points }}"/>
<text x="{{ 4 + 90 * loop.index0 }}" y="12" font-size="11" fill="{{ colour }}">{{ name }}</text>
{% endfor %}<text x="{{ width - 4 }}" y="12" font-size="11" text-anchor="end">{{ row.range }}</text></svg>{% endif %}
</section>{% endfor %}</html>
"""


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
    from jinja2 import Environment, select_autoescape

    verdicts = [verdict(row) for row in rows]
    counts = ", ".join(f"{verdicts.count(name)} {name.partition(',')[0]}" for name in dict.fromkeys(verdicts))
    entries = [dict(row) | {"verdict": name, "numbers": _numbers(row)} | _drawn(row.get("excerpt") or {})
             for row, name in zip(rows, verdicts, strict=True)]  # fmt: skip
    page = Environment(autoescape=select_autoescape(default_for_string=True)).from_string(_PAGE)
    text = page.render(title=title, rows=entries, counts=counts, why=reasons(rows), width=_WIDTH, height=_HEIGHT)
    write_whole(file, text)


def _numbers(row: Mapping[str, Any]) -> str:
    """Length, rate, excitation, ratio and phase in a line."""
    parts = [f"{row['samples']} samples"] if "samples" in row else []
    parts += [f"{row['rate_hz']:.6g} Hz"] if "rate_hz" in row else []
    if "transmissibility" in row:
        ratio, phase = row["transmissibility"], row["phase_deg"]
        parts.append(f"excitation {row['frequency_hz']:.5g} Hz: T = {ratio:.4g}, phase {phase:.4g} degrees")
    elif not row["problem"]:
        parts.append("broadband")
    levels = (f"{name} {value:.3g}" for name, value in row.get("rms_m_s2", {}).items())
    return ", ".join([*parts, *([f"rms in m/s²: {', '.join(levels)}"] if row.get("rms_m_s2") else [])])


def _drawn(second: Mapping[str, list[float]]) -> dict[str, Any]:
    """Points of a thumbnail's lines, all on one scale, and what that is."""
    channels = {name: np.array(x) for name, x in second.items() if name != "time_s"}
    if "time_s" not in second or not channels:
        return {}
    t, top = np.array(second["time_s"]), max(float(np.abs(x).max()) for x in channels.values()) or 1.0
    across = _WIDTH * (t - t[0]) / max(1e-12, t[-1] - t[0])
    lines = [
        (name, colour, " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, 68 - 48 * x / top, strict=True)))
        for (name, x), colour in zip(channels.items(), COLOURS, strict=False)
    ]
    return {"lines": lines, "range": f"{t[0]:.4g} to {t[-1]:.4g} s, within ±{top:.3g} m/s²"}
