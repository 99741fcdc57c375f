"""The population sampled by NUTS (nutpie) instead of found at its maximum: the same model, its covariances uncertain
too.

The likelihood of a person is the Gaussian of its estimate, so persons and speeds integrate out exactly, and what is
left to sample are the means and the Cholesky factors of two covariances, in parts of each parameter's own scatter.
Behind the extra `population`.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fasbody.exceptions import MissingPackageError
from identification.heel.population import Observed, of_documents

if TYPE_CHECKING:
    from identification.heel.analysis import Analysis

Array = np.ndarray
#: Draws of each chain after as many to adapt, chains, seed.
DRAWS, CHAINS, SEED = 1000, 4, 0
#: Beliefs: standard deviations of a mean logarithm about its start, of the logarithm of a scatter about a half, and of
#: a correlation's slope, all in parts of the parameter's scatter.
_MEAN, _SCATTER, _SLOPE = 3.0, 1.0, 0.5


class Unusable(ArithmeticError):
    """A point so far out that its covariance has no inverse; nutpie goes back from it."""

    is_recoverable = True


class Density:
    """Logarithm of the posterior density and its gradient, of means and the unknowns of two covariances (ndim,).

    Args:
        observed: estimates. speeds: in order.
    """

    def __init__(self, observed: Sequence[Observed], speeds: Sequence[str]) -> None:
        logs = np.array([item.log for item in observed])
        self.level, self.middle = logs.std(axis=0) + 1e-9, logs.mean(axis=0)
        self.p, self.speeds = logs.shape[1], len(speeds)
        self.lower = np.tril_indices(self.p, -1)
        self.count = self.p + self.lower[0].size
        self.ends = np.cumsum([0, self.speeds * self.p, self.count, self.count])
        groups: dict[tuple[int, ...], list[list[Observed]]] = {}
        for person in sorted({item.person for item in observed}):
            own = sorted(
                (item for item in observed if item.person == person), key=lambda item: speeds.index(item.speed)
            )
            groups.setdefault(tuple(speeds.index(item.speed) for item in own), []).append(own)
        self.blocks = []  # persons with the same speeds together: data (persons, n, p), speeds, and covariances
        for speed, persons in groups.items():
            y = np.array([[(item.log - self.middle) / self.level for item in own] for own in persons])
            V = np.zeros((len(persons), len(speed), self.p, len(speed), self.p))
            for i, own in enumerate(persons):
                for k, item in enumerate(own):
                    V[i, k, :, k] = item.covariance / np.outer(self.level, self.level)
            self.blocks.append((y, list(speed), V))

    @property
    def ndim(self) -> int:
        """How many unknowns there are."""
        return int(self.ends[-1])

    def root(self, q: Array) -> Array:
        """Cholesky factor (p, p) of the unknowns (count,) of a covariance."""
        out = np.diag(0.5 * np.exp(q[: self.p]))
        out[self.lower] = q[self.p :]
        return out

    def __call__(self, q: Array) -> tuple[float, Array]:
        """Log density and gradient (ndim,) at q (ndim,).

        Raises:
            Unusable: a covariance there is not finite or cannot be inverted.
        """
        try:
            with np.errstate(all="ignore"):
                value, gradient = self._density(q)
        except np.linalg.LinAlgError:
            raise Unusable("a covariance cannot be inverted") from None
        if not (np.isfinite(value) and np.isfinite(gradient).all()):
            raise Unusable("the density is not finite")
        return value, gradient

    def _density(self, q: Array) -> tuple[float, Array]:
        mu, b, c = (q[i:j] for i, j in zip(self.ends[:-1], self.ends[1:], strict=True))
        mu, p = mu.reshape(self.speeds, self.p), self.p
        roots = self.root(b), self.root(c)
        between, within = (root @ root.T for root in roots)
        value, g_mu = -0.5 * float((mu**2).sum()) / _MEAN**2, -mu / _MEAN**2
        g_between, g_within = np.zeros((p, p)), np.zeros((p, p))
        for y, speed, own in self.blocks:
            m, n = y.shape[:2]
            V = own + between[None, None, :, None, :]
            for k in range(n):
                V[:, k, :, k] += within
            inverse = np.linalg.inv(V.reshape(m, n * p, n * p))
            r = (y - mu[speed]).reshape(m, n * p)
            pull = np.einsum("mij,mj->mi", inverse, r)
            value += 0.5 * float(np.linalg.slogdet(inverse)[1].sum() - (r * pull).sum())
            np.add.at(g_mu, speed, pull.reshape(m, n, p).sum(axis=0))
            G = 0.5 * (pull.T @ pull - inverse.sum(axis=0)).reshape(n, p, n, p)
            g_between += G.sum(axis=(0, 2))
            g_within += np.einsum("kikj->ij", G)
        gradient = [g_mu.ravel()]
        for g, root, unknown in ((g_between, roots[0], b), (g_within, roots[1], c)):
            by_root = 2.0 * g @ root
            value -= 0.5 * float(((unknown[:p] / _SCATTER) ** 2).sum() + ((unknown[p:] / _SLOPE) ** 2).sum())
            gradient += [np.diag(by_root) * np.diag(root) - unknown[:p] / _SCATTER**2,
                         by_root[self.lower] - unknown[p:] / _SLOPE**2]  # fmt: skip
        return value, np.concatenate(gradient)


def sampled(found: "Analysis") -> dict[str, Any]:
    """The population's parameters by sampling, with diagnostics, as plain data.

    Raises:
        MissingPackageError: nutpie is not installed.
    """
    assert found.population is not None
    document = next(d for d in found.laws if d["law"] == found.law and d["window"] == found.window)
    observed, _ = of_documents(document)
    density = Density(observed, found.population.speeds)
    draws, divergences, gradients = sample(density)
    mu = (
        draws[..., : density.ends[1]].reshape(*draws.shape[:2], density.speeds, density.p) * density.level
        + density.middle
    )
    rows = []
    for s, speed in enumerate(found.population.speeds):
        for i, name in enumerate(found.population.names):
            low, middle, high = np.exp(np.percentile(mu[..., s, i], [2.5, 50, 97.5]))
            rows.append({"speed": speed, "parameter": name, "median": middle, "lower": low, "upper": high,
                         "r_hat": r_hat(mu[..., s, i])})  # fmt: skip
    return {
        "method": "NUTS (nutpie)", "chains": CHAINS, "draws": DRAWS, "divergences": divergences, "gradients": gradients,
        "parameters": rows,
    }  # fmt: skip


def sample(density: Density, draws: int = DRAWS, chains: int = CHAINS, seed: int = SEED) -> tuple[Array, int, int]:
    """Draws (chains, draws, ndim) of a density, divergences, and how many gradients that took.

    Raises:
        MissingPackageError: nutpie is not installed.
    """
    try:
        import nutpie
        from nutpie.compiled_pyfunc import from_pyfunc
    except ImportError as error:
        raise MissingPackageError("nutpie", "population", "" if error.name == "nutpie" else str(error)) from None

    def make_density() -> Callable[[Array], tuple[float, Array]]:
        return density

    def make_expand(*_: Any) -> Callable[[Array], dict[str, Array]]:
        return lambda q: {"q": np.asarray(q, dtype=float)}

    model = from_pyfunc(density.ndim, make_density, make_expand, [np.dtype("float64")], [(density.ndim,)], ["q"])
    trace = nutpie.sample(
        model, draws=draws, tune=draws, chains=chains, seed=seed, progress_bar=False, save_warmup=True,
    )  # fmt: skip
    steps = sum(int(group["n_steps"].sum()) for group in (trace.sample_stats, trace.warmup_sample_stats))
    return np.asarray(trace.posterior["q"]), int(trace.sample_stats["diverging"].sum()), steps


def r_hat(draws: Array) -> float:
    """Split potential scale reduction of draws (chains, draws): 1 where the chains agree."""
    half = draws.shape[1] // 2
    split = np.concatenate([draws[:, :half], draws[:, half : 2 * half]])
    within = split.var(axis=1, ddof=1).mean()
    between = split.mean(axis=1).var(ddof=1)
    return float(np.sqrt((half - 1) / half + between / within))
