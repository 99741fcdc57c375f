"""The recursion of a polynomial NARX model and its derivatives, compiled."""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _value(variables, row):  # type: ignore[no-untyped-def]
    product = 1.0
    for k in row:
        product *= variables[k]
    return product


@njit(cache=True, nogil=True)
def _fill(variables, y, u, t, lags, step, nk):  # type: ignore[no-untyped-def]
    for k in range(lags):
        variables[k] = y[t - (k + 1) * step]
    for k in range(lags + 1):
        variables[lags + k] = u[t - nk - k * step]
    variables[2 * lags + 1] = 1.0


@njit(cache=True, nogil=True)
def simulate(y, u, table, theta, lags, step, nk, first, limit, columns):  # type: ignore[no-untyped-def]
    """Fill `y` (N,) from sample `first` on, and d y / d theta in `columns` (N, d) unless they are none.

    Returns the sample at which it leaves `limit`, N if it does not.
    """
    variables, slope, count = np.empty(2 * lags + 2), np.empty(lags), columns.shape[1]
    for t in range(first, len(y)):
        _fill(variables, y, u, t, lags, step, nk)
        total = 0.0
        slope[:] = 0.0
        for j in range(len(theta)):
            row = table[j]
            product = _value(variables, row)
            total += theta[j] * product
            if count == 0:
                continue
            columns[t, j] = product
            for place in range(len(row)) if theta[j] != 0.0 else range(0):
                if row[place] < lags:
                    others = theta[j]
                    for k in range(len(row)):
                        if k != place:
                            others *= variables[row[k]]
                    slope[row[place]] += others
        if not abs(total) < limit:
            return t
        y[t] = total
        for k in range(lags):
            for j in range(count):
                columns[t, j] += slope[k] * columns[t - (k + 1) * step, j]
    return len(y)
