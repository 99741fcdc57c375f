"""What n estimates tell of the population behind them, whose tails may be heavy: the posterior, on a grid.

y_i ~ t_nu(mu, tau^2 + s_i^2): persons need not be Gaussian, and whoever lies far out may have a standard error that is
too small. The prior of mu is flat, that of tau is 1 / (tau^2 + s^2)^(1/2) (flat below the errors, of a scale above),
and each nu of `TAILS` is as likely. Given mu, tau and nu all that is asked for has a closed form.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, ndtri, stdtr, stdtrit

Array = NDArray[np.float64]
#: Degrees of freedom: tails as heavy as data of people are, to Gaussian ones; shape (v, 1, 1).
TAILS = np.array([3.0, 5.0, 10.0, 60.0])[:, None, None]
#: Share of a Gaussian population within a standard deviation.
MIDDLE = 0.6827
#: Scales, least and largest of the estimates' scatter, and centres; where half of them lie within a hundredth.
SCALES = np.geomspace(0.01, 6.0, 48)
CENTRES = np.sinh(np.linspace(-7.0, 7.0, 71)) / np.sinh(7.0)
#: How far the likelihood of no spread may lie below the largest, in logarithms, and still hold it (95 %).
HOLDS = 1.92
#: Of the largest weight: smaller ones count for nothing in the interval of a person.
NEGLIGIBLE = 1e-3


@dataclass(frozen=True, eq=False)
class Posterior:
    """The posterior of one population.

    Attributes:
        values: estimates (n,).
        errors: their standard errors (n,).
        mu: centres, shape (m,).
        tau: scales, shape (t, 1).
        prior: its logarithm with the cell's size, shape (t, m).
        log_likelihood: of each estimate, shape (v, t, m, n).
    """

    values: Array
    errors: Array
    mu: Array
    tau: Array
    prior: Array
    log_likelihood: Array

    @classmethod
    def of(cls, values: Array, errors: Array) -> "Posterior":
        """The posterior of n estimates and their standard errors."""
        scatter = float(np.hypot(np.std(values, ddof=1), np.median(errors)))
        tau, mu = scatter * SCALES[:, None], np.median(values) + 3 * scatter * CENTRES
        known = 1 / np.sqrt(np.mean(1 / errors**2))
        prior = np.log(tau / np.hypot(tau, known)) + np.log(np.gradient(mu))
        variance = tau[:, :, None] ** 2 + errors**2
        nu = TAILS[..., None]
        size = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * np.log(nu * np.pi)
        far = (values - mu[:, None]) ** 2 / variance
        likely = size - (nu + 1) / 2 * np.log1p(far / nu) - 0.5 * np.log(variance)
        return cls(values, errors, mu, tau, prior, likely)

    def weights(self, without: int | None = None) -> Array:
        """Probability of each tail, scale and centre (v, t, m); of all estimates, or `without` one."""
        log = self.log_likelihood.sum(axis=-1) + self.prior
        if without is not None:
            log = log - self.log_likelihood[..., without]
        weight = np.exp(log - log.max())
        return np.asarray(weight / weight.sum())

    def spread(self, level: float) -> tuple[float, float, float]:
        """Half the width that holds the middle two thirds of persons: median and ends of the interval of a level.

        Of Gaussian persons that is the standard deviation; of heavy tails n persons do not tell one. The lower end is
        zero where no spread is hardly less likely than the likeliest.
        """
        weight = self.weights().sum(axis=2)
        half = self.tau[:, 0] * stdtrit(TAILS[..., 0], 0.5 + 0.5 * MIDDLE)
        median, low, high = quantiles(half, weight, (0.5, 0.5 - 0.5 * level, 0.5 + 0.5 * level))
        density = np.log(weight.sum(axis=0) / self.tau[:, 0])
        return median, 0.0 if density[0] > density.max() - HOLDS else low, high

    def persons(self, level: float) -> Array:
        """Each person's own value and the ends of its interval, shape (n, 3).

        Given the rest it has Student's t with nu + 1 degrees of freedom about mu + share (y - mu), and the more
        variance, the farther y lies off.
        """
        weight, rows = self.weights(), []
        for y, s in zip(self.values, self.errors, strict=True):
            share = self.tau**2 / (self.tau**2 + s**2)
            far = (y - self.mu) ** 2 / (self.tau**2 + s**2)
            middle = self.mu + share * (y - self.mu)
            scale = np.sqrt(share * s**2 * (TAILS + far) / (TAILS + 1))
            rows.append(mixed(weight, middle, scale, TAILS + 1, (0.5, 0.5 - 0.5 * level, 0.5 + 0.5 * level)))
        return np.array(rows)

    def chances(self) -> Array:
        """Chance (n,) that one of n persons lies as far off as each from what the others predict."""
        chance = []
        for i, (y, s) in enumerate(zip(self.values, self.errors, strict=True)):
            below = float(np.sum(self.weights(i) * stdtr(TAILS, (y - self.mu) / np.hypot(self.tau, s))))
            chance.append(2 * min(below, 1 - below))
        return np.minimum(1.0, len(chance) * np.array(chance))


def quantiles(values: Array, weight: Array, at: tuple[float, ...]) -> tuple[float, ...]:
    """Quantiles of values with weights, both of any one shape, between which it is linear."""
    order = np.argsort(values, axis=None)
    mass = weight.ravel()[order]
    return tuple(np.interp(at, np.cumsum(mass) - mass / 2, values.ravel()[order]).tolist())


def mixed(weight: Array, middle: Array, scale: Array, nu: Array, at: tuple[float, ...]) -> tuple[float, ...]:
    """Quantiles of a mixture of Student's t, whose weights, middles and scales have shapes like (v, t, m)."""
    heavy = weight > NEGLIGIBLE * weight.max()
    w, m, s, v = (np.broadcast_to(part, weight.shape)[heavy] for part in (weight, middle, scale, nu))
    mean = float(w @ m / w.sum())
    std = float(np.sqrt(w @ (s**2 + (m - mean) ** 2) / w.sum()))
    grid = mean + std * np.linspace(-4, 4, 21)
    below = ndtri([w @ stdtr(v, (x - m) / s) / w.sum() for x in grid])  # nearly straight, whatever the tails
    return tuple(np.interp(ndtri(at), below, grid).tolist())
