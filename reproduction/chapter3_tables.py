"""What sections 3.3 and 3.4 state of the fits and orders, held against the thesis' own Tables 3.2 and A.1 to A.9."""

import numpy as np

from identification.blackbox.polynomial import STRUCTURES
from reproduction import published
from reproduction.chapter3_findings import ALL, PUBLISHED
from reproduction.check import at_least, at_most, exactly
from reproduction.row import Outcome, Rows

ROWS = Rows()


@ROWS(
    "Finding 3.3, 1",
    "fits of 60 to 98 % for all structures",
    PUBLISHED,
)
def range_of_fits() -> Outcome:
    fits = published.table()[[f"{name}_fit" for name in ALL]].to_numpy()
    return Outcome(
        printed=[
            at_least("least fit in Tables 3.2 and A.1-A.9", fits.min(), 60, "%"),
            at_most("largest", fits.max(), 98, "%"),
        ],
        instead=[at_least("share of the printed fits below 60 %", float(np.mean(fits < 60)), 1e-4)],
        note=f"{np.sum(fits < 60)} of {fits.size} printed fits lie below 60 %.",
    )


@ROWS(
    "Finding 3.3, 2",
    "output error fits best",
    "python -c 'from reproduction import published; print(published.plausibility())'",
)
def output_error_fits_best() -> Outcome:
    share = published.plausibility().best_share
    others = max(value for name, value in share.items() if name != "oe")
    return Outcome(
        printed=[
            at_least("share of printed rows with OE first, less that of the next structure", share["oe"] - others, 0)
        ]
    )


@ROWS(
    "Finding 3.3, 3",
    "orders 9-15, 1-12, 1-12 of n_a, n_b, n_k; 3 or 5 of n_c, n_d, n_f; 2-8 of the state space",
    PUBLISHED,
)
def range_of_orders() -> Outcome:
    data = published.table()
    limits = {"arx_na": (9, 15), "arx_nb": (1, 12), "arx_nk": (1, 12), "ss_order": (2, 8)}
    outside = {name: float(np.mean(~data[name].between(*each))) for name, each in limits.items()}
    small = [f"{name}_{n}" for name, orders in STRUCTURES.items() for n in orders if n in ("nc", "nd", "nf")]
    other = int((~data[small].isin((3, 5))).to_numpy().sum())
    return Outcome(
        printed=[
            *(at_most(f"share of {name} outside of the stated range", share, 0.1) for name, share in outside.items()),
            exactly(f"orders {', '.join(small)} that are neither 3 nor 5, of {data[small].size}", other, 0),
        ]
    )


@ROWS(
    "Finding 3.3, 5",
    "linear models fit worst at 10 and 15 Hz and best above",
    PUBLISHED,
)
def fits_by_frequency() -> Outcome:
    data = published.table()
    mean = data.assign(fit=data[[f"{name}_fit" for name in ALL]].mean(axis=1)).groupby("frequency_hz")["fit"].mean()
    return Outcome(
        printed=[
            at_least(
                "mean printed fit at 20-50 Hz less that at 10 and 15 Hz",
                mean[mean.index >= 20].mean() - mean[mean.index < 20].mean(),
                0,
                "points",
            )
        ]
    )


@ROWS("Finding 3.3, 10", "at 10 and 15 Hz the fit is lower under load (3.4, too)", PUBLISHED)
def fits_by_load() -> Outcome:
    data = published.table()
    data = data.assign(fit=data[[f"{name}_fit" for name in ALL]].mean(axis=1))
    low = data[data.frequency_hz < 20].groupby("added_mass_kg")["fit"].mean()
    everywhere = data.groupby("added_mass_kg")["fit"].mean()
    return Outcome(
        printed=[
            at_least("fall of the mean printed fit from 0 to 2.3 kg, 10 and 15 Hz", -low.diff().iloc[1], 0, "points"),
            at_least("from 2.3 to 4.5 kg", -low.diff().iloc[2], 0, "points"),
        ],
        note=f"{', '.join(f'{fit:.1f}' for fit in low)} % at 10 and 15 Hz under the three loads; over all frequencies "
        f"{', '.join(f'{fit:.1f}' for fit in everywhere)} %, without such a fall.",
    )


def mean_order(where: str) -> float:
    """Mean printed order of the state-space models of some rows of Tables 3.2 and A.1 to A.9."""
    return float(published.table().query(where)["ss_order"].mean())


@ROWS("Finding 3.3, 8", "the order of the state-space model is higher at 10-25 Hz", PUBLISHED)
def order_by_frequency() -> Outcome:
    low, high = (mean_order(f"frequency_hz {side} 25") for side in ("<=", ">"))
    return Outcome(printed=[at_least(f"mean printed order at 10-25 Hz less that above ({high:.2f})", low - high, 0.05)])


@ROWS("Finding 3.3, 9", "the order of the state-space model at 10-25 Hz is higher with load", PUBLISHED)
def order_by_load() -> Outcome:
    bare, loaded = (mean_order(f"frequency_hz <= 25 and added_mass_kg {side} 0") for side in ("==", ">"))
    everywhere = mean_order("added_mass_kg > 0") - mean_order("added_mass_kg == 0")
    name = "mean printed order with load less that without"
    return Outcome(
        printed=[at_least(f"{name} ({bare:.2f}), 10-25 Hz", loaded - bare, 0.05)],
        note=f"At all frequencies the difference is {everywhere:.2f}.",
    )
