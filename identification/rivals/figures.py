"""The printed figures of a comparison: predictions over frequency, and stiffness of the springs."""

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from fasbody.presentation import COLOURS, LINES, MARKS, panels, printed

if TYPE_CHECKING:
    from identification.rivals.naming import Naming
    from identification.rivals.result import Rivals

#: Colours that the colour-blind can distinguish (Okabe and Ito), each with a mark.
_COLOURS = (*COLOURS, "#8c6d31", "#7f7f7f", "#000000")
_MARKS = ("o", "s", "^", "v", "D", "P", "X", "<", ">")
#: An interval is drawn whole up to this factor from its value; beyond it an arrow says that it goes on.
_CUT = 30.0
#: The likelier branch and the other one: how far below its line an estimate is, colours, label.
_BRANCHES = (
    (0.0, "#0072B2", "#0072B2", "likelier branch"),
    (0.24, "#D55E00", "white", "other branch, if undecided"),
)
#: Rivals drawn over frequency: more would hide each other.
_DRAWN = 4


def _colours(result: "Rivals") -> dict[str, tuple[str, str]]:
    """One colour and mark a rival, by its name, the same in every figure."""
    names = sorted(r.name for r in result.rivals)
    return {name: (_COLOURS[i % len(_COLOURS)], _MARKS[i % len(_MARKS)]) for i, name in enumerate(names)}


@printed
def predictions(result: "Rivals") -> Figure:
    """Measured transmissibility and phase lag, with the curves of the best models. One column per load.

    The lowest panels show how far each model's fundamental is from the measured one. The standard error of the
    measurement is grey.
    """
    loads = sorted({p.load_kg for p in result.points})
    figure, axes = panels(3, len(loads), 3.0 * len(loads) + 0.6, 6.4, sharex=True, sharey="row")
    drawn = list(result.rivals[:_DRAWN])
    drawn += [r for r in result.rivals[_DRAWN:] if r.name == "model"]
    look = _colours(result)
    for column, load in enumerate(loads):
        places = [i for i, p in enumerate(result.points) if p.load_kg == load]
        places.sort(key=lambda i: result.points[i].frequency_hz)
        points = [result.points[i] for i in places]
        f = np.array([p.frequency_hz for p in points])
        U, Y = np.array([p.base[0] for p in points]), np.array([p.malleolus[0] for p in points])
        noise = np.array([np.sqrt(2) * p.std[0] / abs(p.malleolus[0]) for p in points])
        size, lag, gap = axes[:, column]
        size.plot(f, np.abs(Y / U), "o", ms=5, mfc="white", mec="#2b2b2b", label="measured", zorder=3)
        lag.plot(f, _lag(Y / U), "o", ms=5, mfc="white", mec="#2b2b2b", zorder=3)
        gap.fill_between(f, 1e-7, 100 * noise, color="#d9d9d9", lw=0, label="standard error")
        for number, r in enumerate(drawn):
            colour, mark = look[r.name]
            y = np.array([r.predicted[i][0] for i in places])
            # the first is wide, so that it is seen behind the others
            line: Any = {"color": colour, "lw": 1.2 if number else 3.5, "ls": LINES[number % len(LINES)]}
            size.plot(f, np.abs(y / U), alpha=1 if number else 0.4, label=r.title, **line)
            lag.plot(f, _lag(y / U), alpha=1 if number else 0.4, **line)
            gap.semilogy(f, 100 * np.abs(y - Y) / np.abs(Y), color=colour, marker=mark, ms=3.5, lw=0.9)
        size.set_title(f"{load:g} kg on the knee")
        gap.set_xlabel("frequency [Hz]")
    worst = [100 * abs(r.predicted[i][0] / p.malleolus[0] - 1) for r in drawn for i, p in enumerate(result.points)]
    axes[2, 0].set_ylim(min(1e-3, 0.5 * float(np.quantile(worst, 0.02))), 2 * max(worst))
    axes[0, 0].set_ylabel("transmissibility")
    axes[1, 0].set_ylabel("phase lag [deg]")
    axes[2, 0].set_ylabel("difference [%]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    more, more_labels = axes[2, 0].get_legend_handles_labels()
    figure.legend(
        [*handles, *more], [*labels, *more_labels], loc="outside lower center", ncols=min(3, 1 + len(loads)),
    )  # fmt: skip
    return figure


def _lag(H: np.ndarray) -> np.ndarray:
    return np.asarray(-np.degrees(np.unwrap(np.angle(H))))


@printed
def constants(result: "Rivals") -> Figure:
    """k_T and k_F with 95 % intervals for each model, the best at the top. Models that are not adequate are pale.

    The right panel shows BIC and the held-out prediction error, minus those of the best model.
    """
    rivals = [r for r in result.rivals if r.k_T and r.k_F][::-1]
    figure, axes = panels(1, 3, 7.6, 0.34 * len(rivals) + 1.6, sharey=True)
    adequate, marks = result.adequate, {}
    for axis, name in zip(axes[0], ("k_T", "k_F"), strict=False):
        values = []
        for place, r in enumerate(rivals):
            alpha = 1.0 if r in adequate else 0.45
            for e, (lower, colour, face, label) in zip(r.estimates(name), _BRANCHES, strict=False):
                low, high = max(e.lower, e.value / _CUT), min(e.upper, e.value * _CUT)
                values += [low / 1e3, e.value / 1e3, high / 1e3]
                for end, whole, arrow in ((low, e.lower, "<"), (high, e.upper, ">")):
                    if end != whole:  # cut
                        axis.plot([end / 1e3], [place - lower], arrow, ms=5, color=colour, alpha=alpha)
                marks[label] = axis.errorbar(
                    [e.value / 1e3], [place - lower], fmt="o", ms=4, color=colour, mfc=face, capsize=2.5, alpha=alpha,
                    xerr=[[max(0, e.value - low) / 1e3], [max(0, high - e.value) / 1e3]], lw=1.1,
                )  # fmt: skip
        axis.set_xscale("log")
        axis.set_xlim(min(values) / 1.2, max(values) * 1.2)
        axis.set_xlabel(f"${name[0]}_{name[2]}$ [kN/m]")
        axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
        axis.xaxis.set_minor_locator(NullLocator())
    axes[0, 0].set_yticks(range(len(rivals)), [r.title for r in rivals])
    axes[0, 0].set_ylim(-0.6, len(rivals) - 0.6)
    score, y = axes[0, 2], np.arange(len(rivals))
    least, held = min(r.bic for r in rivals), min(r.surprise for r in rivals)
    marks["BIC"] = score.plot([r.bic - least for r in rivals], y, "o", ms=4, color="#2b2b2b")[0]
    if any(r.held_out for r in rivals):
        heights = [r.surprise - held for r in rivals]
        marks["held-out prediction"] = score.plot(heights, y, "s", ms=5.5, mfc="none", mec="#2b2b2b")[0]
    marks["odds of 1000 to 1"] = score.axvline(13.8, color="#009E73", lw=0.9, ls="--")
    score.set_xscale("symlog", linthresh=10)
    most = max(max(r.bic - least, r.surprise - held) for r in rivals)
    score.set_xlim(-3, 3 * max(most, 13.8))
    score.set_xticks([0, *(10.0**n for n in (1, 3, 5, 7, 9) if 10**n < 3 * most)])
    score.xaxis.set_minor_locator(NullLocator())
    score.set_xlabel("above the best")
    figure.legend(
        list(marks.values()), list(marks), loc="outside lower center", ncols=3
    )  # fmt: skip
    return figure


@printed
def naming(result: "Naming") -> Figure:
    """|MB| and |TB| as recorded (marks, hollow at a smaller amplitude) and of the best fit (lines)."""
    seen, best = result.seen, result.fits[0]
    kept = seen.recordings.repeats
    plan = seen.plan.only(kept)
    pairs = ("MB", "TB") if plan.tuberosity else ("MB",)
    figure, axes = panels(1, len(pairs), 3.35 * len(pairs) + 0.4, 2.8)
    smaller = plan.partner >= 0
    for ax, pair in zip(axes[0], pairs, strict=True):
        read, fitted = np.abs(getattr(seen.recordings, pair)[kept]), np.abs(getattr(best, pair))
        groups = product(np.unique(plan.added_kg), (False, True))
        for number, (added, hollow) in enumerate(groups):
            colour, mark = (some[number // 2 % len(some)] for some in (COLOURS, MARKS))
            some = (plan.added_kg == added) & (smaller == hollow)
            if not some.any():
                continue
            at = np.flatnonzero(some)[np.argsort(plan.frequency_hz[some])]
            label = f"{added:g} kg added" + (", smaller amplitude" if hollow else "")
            face, f = "none" if hollow else colour, plan.frequency_hz[at]
            ax.plot(f, read[at], mark, color=colour, mfc=face, ms=4.5, label=label)
            ax.plot(f, fitted[at], color=colour, lw=1, ls=":" if hollow else "-")
        ax.set_title(f"{pair}: recorded (marks), {best.rival} (lines)", loc="left")
        ax.set_xlabel("frequency [Hz]")
        ax.set_ylim(0, 1.1 * max(1.0, read.max(), fitted.max()))
        ax.axhline(1, color="0.6", lw=0.8, zorder=0)
    axes[0, 0].set_ylabel("transmissibility")
    handles, labels = axes[0, -1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(3, len(labels)))
    return figure
