"""Periodic motion of the two-mass foot by harmonic balance: Eqs. (4.27) to (4.33), many feet at once.

The stretches are z_j = Re sum_h Z_jh exp(i h w t), z_1 across the talocrural joint and z_2 across the fat pad. A damper
c(z) z' of Eq. (4.25) is the derivative of G(z(t)) with G' = c, so its harmonics are i h w times those of G and its mean
is zero. A spring is any complex stiffness: here k (1 + r s tau / (1 + s tau)), a Zener spring, whose share r relaxes
within tau. Newton's method solves for all feet together, and one solution more with the same matrices gives the
derivatives with respect to every parameter.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

#: Order of a foot's parameters: N/m, N s/m, 1/m, kg, shares that relax, and their time [s].
PARAMETERS = (
    "k_T", "k_F", "c_11", "c_12", "c_13", "c_21", "c_22", "c_23", "m_S", "m_F", "r_T", "r_F", "tau",
)  # fmt: skip
_AT = {name: i for i, name in enumerate(PARAMETERS)}
#: Where k, c1, c2, c3 and r of the ankle and of the pad stand.
_JOINT = np.array([[_AT[n] for n in ("k_T", "c_11", "c_12", "c_13", "r_T")],
                   [_AT[n] for n in ("k_F", "c_21", "c_22", "c_23", "r_F")]])  # fmt: skip
#: Passes of Newton's method, and halvings of the amplitude where it fails from the linear motion.
_PASSES = 30
_HALVINGS = 6
#: Stretch [m] beyond which a trial step is shortened: no joint of a foot moves so far.
_FAR = 0.1
#: Harmonics at most, and the share of the largest that the last ones may have.
_MOST_HARMONICS = 48
_LAST = 1e-10


@dataclass(frozen=True, eq=False)
class Orbits:
    """Periodic motions of B feet.

    Attributes:
        omega: (B,) angular frequency [rad/s].
        theta: (B, 13) parameters in the order of `PARAMETERS`.
        stretch: (B, 2, H) harmonics of z_1 and z_2 [m].
        shank: (B, H) harmonics of the shank's acceleration [m/s^2].
        foot: (B, H) harmonics of the foot's acceleration [m/s^2].
        converged: (B,) whether there is such a motion. Where there is none, the motion that grows with the base ends
            at a fold below the full one: a damper that bends takes no more power than it takes there.
        stretch_slopes: (B, 2, H, 13) derivatives of the stretches to the parameters; None where not requested.
        force_by_stretch: (B, 2, 2 H, 2 H) of the joint forces.
    """

    omega: np.ndarray
    theta: np.ndarray
    stretch: np.ndarray
    shank: np.ndarray
    foot: np.ndarray
    converged: np.ndarray
    stretch_slopes: np.ndarray | None
    force_by_stretch: np.ndarray

    @property
    def _s2(self) -> np.ndarray:
        """(B, H) -(h w)^2."""
        return -((self.omega[:, None] * np.arange(1, self.shank.shape[1] + 1)) ** 2)

    @property
    def slopes(self) -> np.ndarray | None:
        """(B, 2, H, 13) derivatives of shank and foot to the parameters; None where not requested."""
        if self.stretch_slopes is None:
            return None
        foot = self._s2[..., None] * self.stretch_slopes[:, 1]
        return np.stack([foot + self._s2[..., None] * self.stretch_slopes[:, 0], foot], 1)

    def by_base(self) -> np.ndarray:
        """Derivatives (B, 2, 2 H, 2 H) of shank and foot, real parts before imaginary ones, to the base's harmonics."""
        B, H = self.shank.shape
        unit = np.zeros((4 * H, 2 * H))
        unit[2 * H :] = np.eye(2 * H)
        system = _System(self.theta, self.omega, np.zeros_like(self.shank), slopes=False)
        moved = -system.solved(self.force_by_stretch, np.broadcast_to(unit, (B, 4 * H, 2 * H)))
        s2 = np.tile(self._s2, 2)[..., None]
        foot = np.eye(2 * H) + s2 * moved[:, 2 * H :]
        return np.stack([foot + s2 * moved[:, : 2 * H], foot], 1)

    def states(self) -> np.ndarray:
        """(B, 4) z_1, z_2 [m] and their rates [m/s] at the beginning of a period."""
        ihw = 1j * self.omega[:, None] * np.arange(1, self.shank.shape[1] + 1)
        return np.concatenate([self.stretch.sum(-1).real, (ihw[:, None] * self.stretch).sum(-1).real], 1)

    def memories(self) -> np.ndarray:
        """(B, 2) forces [N] in the Maxwell elements of ankle and pad at the beginning of a period."""
        x = 1j * self.omega[:, None] * np.arange(1, self.shank.shape[1] + 1) * self.theta[:, -1:]
        k, r = (self.theta[:, _JOINT[:, i]] for i in (0, 4))
        return (k * r) * ((x / (1 + x))[:, None] * self.stretch).sum(-1).real

    def multipliers(self) -> np.ndarray:
        """(B,) largest modulus of the Floquet multipliers; above 1 the motion does not last.

        The linearised equations are integrated over one period by the matrix exponential at each of many instants.
        """
        steps = 8 * self.shank.shape[1] + 32
        E = _samples(self.shank.shape[1], steps)
        period = 2 * np.pi / self.omega
        ihw = 1j * self.omega[:, None] * np.arange(1, self.shank.shape[1] + 1)
        z, v = (self.stretch @ E).real, ((ihw[:, None] * self.stretch) @ E).real
        k, c1, c2, c3, r = (self.theta[:, _JOINT[:, i]][..., None] for i in range(5))
        with np.errstate(over="ignore"):  # where no motion was found
            e = np.exp(-c2 * z)
        c = c1 * e * np.cos(c3 * z)  # Eq. (4.32)
        slope = k - c1 * e * (c2 * np.cos(c3 * z) + c3 * np.sin(c3 * z)) * v
        m_S, m_F, tau = (self.theta[:, _AT[n], None] for n in ("m_S", "m_F", "tau"))
        by_force = np.stack([np.stack([-(1 / m_F + 1 / m_S), 1 / m_F]), np.stack([1 / m_F, -1 / m_F])])
        A = np.zeros((len(self.omega), steps, 6, 6))
        for joint in range(2):
            A[..., joint, 2 + joint] = 1.0
            A[..., 4 + joint, 2 + joint] = (k * r)[:, joint]
            A[..., 4 + joint, 4 + joint] = -1 / tau
            for row in range(2):
                A[..., 2 + row, joint] = by_force[row, joint] * slope[:, joint]
                A[..., 2 + row, 2 + joint] = by_force[row, joint] * c[:, joint]
                A[..., 2 + row, 4 + joint] = by_force[row, joint]
        return _largest_multiplier(A, period / steps)


def _largest_multiplier(A: np.ndarray, step: np.ndarray) -> np.ndarray:
    """(B,) largest modulus of the multipliers of linear systems A (B, n, s, s) constant over steps (B,) [s]."""
    from scipy.linalg import expm  # slow to import, and needed for stability only

    with np.errstate(over="ignore", invalid="ignore"):
        parts = expm(A * step[:, None, None, None])
        whole = np.broadcast_to(np.eye(A.shape[-1]), (len(A), *A.shape[-2:]))
        for part in np.moveaxis(parts, 1, 0):
            whole = part @ whole
    finite = np.asarray(np.isfinite(whole).all((1, 2)))
    values = np.linalg.eigvals(np.where(finite[:, None, None], whole, 0.0))
    return np.where(finite, np.abs(values).max(-1), np.inf)


def parameters(values: Mapping[str, float]) -> np.ndarray:
    """(13,) parameters of a foot by name; springs relax only where `r_T` or `r_F` says so."""
    rest = {"r_T": 0.0, "r_F": 0.0, "tau": 5e-3}
    return np.array([values.get(name, rest.get(name, np.nan)) for name in PARAMETERS], float)


def orbits(
    theta: np.ndarray,
    omega: np.ndarray,
    base: np.ndarray,
    start: np.ndarray | None = None,
    *,
    slopes: bool = True,
    tolerance: float = 1e-10,
    passes: int = _PASSES,
) -> Orbits:
    """Periodic motions of feet, each on a base of its own, with the harmonics that `base` has.

    Newton starts from `start` or from the linear motion; where that fails, the amplitude is raised from a small
    one step by step.

    Example:
        ``orbits(parameters(foot.values())[None], np.array([w]), 9.0 * np.eye(1, 6))``

    Args:
        theta: (B, 13) parameters.
        omega: (B,) angular frequencies [rad/s].
        base: (B, H) complex harmonics of the base acceleration [m/s^2].
        start: (B, 2, H) stretches to start from [m].
        slopes: compute derivatives to the parameters.
        tolerance: of the last step, as a share of the stretch; slopes are as exact, and what is left is its square.
        passes: of Newton's method at most.
    """
    system = _System(theta, omega, base, slopes)
    Z = system.linear() if start is None else start
    result = _newton(system, Z, tolerance, passes)
    if result.converged.all() or passes < _PASSES:
        return result
    failed = np.flatnonzero(~result.converged)
    again = _grown(_System(theta[failed], omega[failed], base[failed], slopes), tolerance)
    return _merged(result, again, failed)


def resolved(theta: np.ndarray, omega: np.ndarray, base: np.ndarray, slopes: bool = False) -> Orbits:
    """`orbits` with as many harmonics as it takes: doubled until the last two are below 1e-10 of the largest.

    Args:
        theta, omega: as `orbits`.
        base: (B, K) harmonics of the base; those of the motion are K or more.
        slopes: as `orbits`.
    """
    H = max(6, base.shape[1])
    start = None
    while True:
        full = np.zeros((len(base), H), complex)
        full[:, : base.shape[1]] = base
        result = orbits(theta, omega, full, start, slopes=slopes)
        size = np.abs(result.stretch)
        last = size[..., -2:].max((1, 2)) / np.maximum(size.max((1, 2)), 1e-300)
        if (last[result.converged] < _LAST).all() or 2 * H > _MOST_HARMONICS:
            return result
        start = np.zeros((len(base), 2, 2 * H), complex)
        start[..., :H] = result.stretch
        H *= 2


class _System:
    """The equations of B feet at given parameters."""

    def __init__(self, theta: np.ndarray, omega: np.ndarray, base: np.ndarray, slopes: bool) -> None:
        self.theta, self.omega, self.base, self.slopes = theta, omega, base, slopes
        self.H = base.shape[1]
        self.N = 4 * self.H + 8 if self.H < 24 else 4 * self.H
        self.samples = _samples(self.H, self.N)
        self.s = 1j * omega[:, None] * np.arange(1, self.H + 1)
        x = self.s * theta[:, -1:]
        self.relaxing = (x / (1 + x))[:, None]
        k, self.c1, c2, c3, r = (theta[:, _JOINT[:, i]][..., None] for i in range(5))
        self.k, self.r = k, r
        self.kappa = k * (1 + r * self.relaxing)
        bend = c2 - 1j * c3
        self.bend = np.where(np.abs(bend) < 1e-9, 1e-9, bend)
        self.aS, self.aF = 1 / theta[:, _AT["m_S"], None], 1 / theta[:, _AT["m_F"], None]

    def rows(self, which: np.ndarray) -> "_System":
        """Of some of the feet."""
        return _System(self.theta[which], self.omega[which], self.base[which], self.slopes)

    def linear(self) -> np.ndarray:
        """Stretches (B, 2, H) of the foot with dampers as they are at rest."""
        s2 = self.s**2
        f_T, f_F = np.moveaxis(self.kappa + self.s[:, None] * self.c1, 1, 0)
        a, b = s2 + (self.aS + self.aF) * f_T, -self.aF * f_F
        c, d = -self.aF * f_T, s2 + self.aF * f_F
        det = a * d - b * c
        return np.stack([b * self.base / det, -a * self.base / det], 1)

    def forces(self, Z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """At Z (B, 2, H): joint forces (B, 2, H) [N], samples (B, 2, N) of z and G, and exp(-s z) - 1 (B, 2, N)."""
        z = (Z @ self.samples).real
        e = np.expm1(-self.bend * z)
        G = -self.c1 * (e / self.bend).real
        damper = self.s[:, None] * self._harmonics(G)
        return self.kappa * Z + damper, z, G, e

    def _harmonics(self, x: np.ndarray) -> np.ndarray:
        """(..., H) of samples (..., N)."""
        return np.fft.rfft(x, axis=-1)[..., 1 : self.H + 1] * (2 / self.N)

    def by_stretch(self, e: np.ndarray) -> np.ndarray:
        """(B, 2, 2 H, 2 H) derivatives of the joint forces to the stretches, real parts before imaginary ones."""
        C = np.fft.rfft(self.c1 * (1 + e.real), axis=-1) / self.N  # Eq. (4.32)
        H = self.H
        j, l = np.meshgrid(np.arange(H), np.arange(H), indexing="ij")  # noqa: E741
        less = C.take(np.abs(j - l), -1)
        less.imag *= np.where(j >= l, 1.0, -1.0)
        P = self.s[:, None, :, None] * less
        Q = self.s[:, None, :, None] * C.take(j + l + 2, -1)
        P[..., np.arange(H), np.arange(H)] += self.kappa
        up = np.concatenate([(P + Q).real, (Q - P).imag], -1)
        return np.concatenate([up, np.concatenate([(P + Q).imag, (P - Q).real], -1)], -2)

    def balance(self, Z: np.ndarray, F: np.ndarray) -> np.ndarray:
        """What is left (B, 2, H) of Eq. (4.29) at stretches Z under joint forces F (B, 2, H)."""
        s2 = self.s**2
        first = s2 * Z[:, 0] + (self.aS + self.aF) * F[:, 0] - self.aF * F[:, 1]
        return np.stack([first, s2 * Z[:, 1] + self.aF * (F[:, 1] - F[:, 0]) + self.base], 1)

    def solved(self, K: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Changes (B, 4 H, k) of the stretches that change the balance by `right` (B, 4 H, k).

        Both rows of the balance add up to the shank's, s^2 (z_1 + z_2) + F_T / m_S, which gives the change of z_2 by
        that of z_1 and leaves equations of half the size.

        Args:
            K: (B, 2, 2 H, 2 H) of `by_stretch`.
            right: real parts before imaginary ones, of the first row and of the second.
        """
        n = 2 * self.H
        s2 = np.tile((self.s**2).real, 2)[..., None]
        by_T, by_F = self.aS[..., None] * K[:, 0] / s2, self.aF[..., None] * K[:, 1]
        at = np.arange(n)
        by_T[:, at, at] += 1.0
        by_F[:, at, at] += s2[..., 0]
        shank = (right[:, :n] + right[:, n:]) / s2
        first = _solve(self.aF[..., None] * K[:, 0] + by_F @ by_T, by_F @ shank - right[:, n:])
        return np.concatenate([first, shank - by_T @ first], 1)

    def by_parameter(self, Z: np.ndarray, F: np.ndarray, z: np.ndarray, G: np.ndarray, e: np.ndarray) -> np.ndarray:
        """(B, 2, H, 13) derivatives of the joint forces at fixed stretches."""
        D = np.zeros((*F.shape, len(PARAMETERS)), complex)
        grown = self.relaxing
        b = self.bend
        # dG/db of G = -c_1 expm1(-b z) / b; the sum is a small difference where b z is small
        far = np.abs(b * z) > 1e-3
        dG = np.where(far, (z * (1 + e) + e / b) / b, z * z * (-0.5 + b * z / 3 - (b * z) ** 2 / 8))
        dG = self.c1 * dG
        harmonics = self.s[:, None] * self._harmonics(np.stack([G / self.c1, dG.real, dG.imag]))
        for joint in range(2):
            k, c1, c2, c3, r = _JOINT[joint]
            D[:, joint, :, k] = (self.kappa / self.k)[:, joint] * Z[:, joint]
            D[:, joint, :, c1], D[:, joint, :, c2], D[:, joint, :, c3] = harmonics[:, :, joint]
            D[:, joint, :, r] = (self.k * grown)[:, joint] * Z[:, joint]
        x = self.s * self.theta[:, -1:]
        D[..., -1] = self.k * self.r * (self.s / (1 + x) ** 2)[:, None] * Z
        return D

    def by_parameter_of_balance(self, F: np.ndarray, D: np.ndarray) -> np.ndarray:
        """(B, 2, H, 13) derivatives of the balance at fixed stretches, from those of the forces."""
        aS, aF = self.aS[..., None], self.aF[..., None]
        R = np.stack([(aS + aF) * D[:, 0] - aF * D[:, 1], aF * (D[:, 1] - D[:, 0])], 1)
        between = (F[:, 0] - F[:, 1]) * self.aF**2
        R[:, 0, :, _AT["m_S"]] = -F[:, 0] * self.aS**2
        R[:, 0, :, _AT["m_F"]], R[:, 1, :, _AT["m_F"]] = -between, between
        return R


def _samples(H: int, N: int) -> np.ndarray:
    """(H, N) exp(i h w t) over a period."""
    return np.exp(2j * np.pi * np.outer(np.arange(1, H + 1), np.arange(N)) / N)


def _real(x: np.ndarray) -> np.ndarray:
    """(B, 2, H, ...) complex -> (B, 4 H, ...): of each joint the real parts, then the imaginary ones."""
    B, _, H = x.shape[:3]
    return np.concatenate([x.real, x.imag], 2).reshape(B, 4 * H, *x.shape[3:])


def _complex(x: np.ndarray) -> np.ndarray:
    """The inverse of `_real`."""
    B, n = x.shape[:2]
    parts = x.reshape(B, 2, n // 2, *x.shape[2:])
    return parts[:, :, : n // 4] + 1j * parts[:, :, n // 4 :]


def _newton(system: _System, Z: np.ndarray, tolerance: float, passes: int) -> Orbits:
    """Newton's method for all feet at once; the last step is taken, to first order, in all results."""
    Z, done, going = Z.copy(), np.zeros(len(Z), bool), np.arange(len(Z))
    state: list[np.ndarray] = []
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for number in range(passes):
            part = system if going.size == len(Z) else system.rows(going)
            F, z, G, e = part.forces(Z[going])
            K = part.by_stretch(e)
            X = -part.solved(K, _real(part.balance(Z[going], F))[..., None])
            for whole, new in zip(state, (F, z, G, e, K, X), strict=False):
                whole[going] = new
            state = state or [F, z, G, e, K, X]
            step = _complex(X[..., 0])
            length = np.abs(step).max((1, 2))
            moving = np.isfinite(length)
            done[going] = moving & (length <= tolerance * np.abs(Z[going]).max((1, 2)))
            if done.all() or number == passes - 1 or not moving.any():
                break
            share = np.minimum(1.0, _FAR / np.maximum(length, 1e-300))
            ahead = np.where(moving[:, None, None], share[:, None, None] * step, 0.0)
            left = ~done[going]
            going = going[left]
            Z[going] += ahead[left]
        F, z, G, e, K, X = state
        dZ = None
        if system.slopes:
            D = system.by_parameter(Z, F, z, G, e)
            dZ = _complex(-system.solved(K, _real(system.by_parameter_of_balance(F, D))))
        return _orbits_of(system, Z + _complex(X[..., 0]), K, dZ, done)


def _solve(J: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions (B, n, k), NaN where a matrix is singular or not finite."""
    try:
        return np.linalg.solve(J, right)
    except np.linalg.LinAlgError:
        if len(J) == 1:
            return np.full_like(right, np.nan)
        return np.concatenate([_solve(j[None], r[None]) for j, r in zip(J, right, strict=True)])


def _orbits_of(system: _System, Z: np.ndarray, K: np.ndarray, dZ: np.ndarray | None, done: np.ndarray) -> Orbits:
    """Motions of stretches Z: the foot moves with the base and by the pad's stretch, the shank by the ankle's, too."""
    foot = system.base + system.s**2 * Z[:, 1]
    return Orbits(system.omega, system.theta, Z, foot + system.s**2 * Z[:, 0], foot, done, dZ, K)


def _grown(system: _System, tolerance: float) -> Orbits:
    """The motions by continuation in amplitude, from a small one to the full one."""
    B = len(system.theta)
    level, stride = np.zeros(B), np.full(B, 0.25)
    at = np.zeros((B, 2, system.H), complex)
    result = None
    for _ in range(4 * 2**_HALVINGS):
        trial = np.minimum(1.0, level + stride)
        part = _System(system.theta, system.omega, trial[:, None] * system.base, system.slopes)
        start = np.where(
            (level > 0)[:, None, None], at * (trial / np.maximum(level, 1e-9))[:, None, None], part.linear()
        )
        result = _newton(part, start, tolerance, 12)
        level = np.where(result.converged, trial, level)
        at = np.where(result.converged[:, None, None], result.stretch, at)
        stride = np.where(result.converged, 1.5 * stride, 0.5 * stride)
        if ((level >= 1.0) | (stride < 0.25 / 2**_HALVINGS)).all():
            break
    last = _newton(system, at, tolerance, 12)
    return replace(last, converged=last.converged & (level >= 1.0))


def _merged(all_feet: Orbits, some: Orbits, where: np.ndarray) -> Orbits:
    """All feet with those at `where` replaced by others."""
    kept = {}
    for name in Orbits.__dataclass_fields__:
        whole, part = getattr(all_feet, name), getattr(some, name)
        if whole is not None:
            whole = whole.copy()
            whole[where] = part
        kept[name] = whole
    return Orbits(**kept)
