"""A viscoelastic cell (thesis, Chapter 6), or any body: complex frequencies, damping, response.

A standard linear solid is a spring E beside a spring g E in series with a dashpot:

    E(s) = E (1 + g s tau / (1 + s tau)),

E at rest, (1 + g) E when shaken fast. With an internal displacement q_r for the dashpots of each
region the modes are the eigenvalues of a linear problem. It is solved in a small basis (modes, and
how each region bends them) and the residual of the full equations is reported with every result;
with one and the same solid in all regions the basis is exact. Membrane and cytoskeleton stay
elastic.

Relative to the base, [M]{x''} + [C]{x'} + [K]{x} = {F(t)}, Eq. (5.1), has F = -M r a for a base
acceleration a along r; C is the loss of the standard linear solids, so that K(i omega) carries
both. A free body is driven by a force at its highest point. Everything is linear: responses are
per unit of base motion or of force.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from fasbody.cell.mesh import NUCLEUS
from fasbody.cell.modal import CellModel, Modes, direct, inverse, orthonormal, solve
from fasbody.exceptions import SettingError
from fasbody.presentation import Tabled

#: How far above the reach of the basis, relative, relaxation may lift the rest stiffness of its
#: last mode.
WITHIN = 0.1
#: A complex mode whose residual is larger is a vector of the basis, not a mode of the cell. Modes
#: whose frequencies are right to 2e-3 have 0.01 to 0.15 (tests/test_cell_viscoelastic.py), such
#: vectors 0.3 to 1.
CONVERGED = 0.2
#: Share of the reach below which a motion of a free body is a rigid one.
RIGID = 1e-5
#: Frequencies of a response, besides those of the modes.
POINTS = 500


@dataclass(frozen=True)
class StandardLinearSolid(Tabled):
    """Relaxation of one region.

    Args:
        g: instantaneous stiffness over stiffness at rest, minus 1.
        tau: relaxation time at constant strain [s].

    Raises:
        SettingError: g is negative or tau not positive.

    Example:
        >>> StandardLinearSolid(0.5, 2e-5)(2j * math.pi * 1000)
    """

    g: float
    tau: float

    def __post_init__(self) -> None:
        if not 0 <= self.g < math.inf:
            text = f"the relaxing share of stiffness must be 0 or more, not {self.g}."
            raise SettingError(text, "g")
        if not 0 < self.tau < math.inf:
            text = f"the relaxation time must be a positive number of s, not {self.tau}."
            raise SettingError(text, "tau")

    def __call__(self, s: Any) -> Any:
        """E(s) / E at complex frequency `s` [rad/s]."""
        return 1 + self.g * s * self.tau / (1 + s * self.tau)


Solids = Sequence[StandardLinearSolid]


@dataclass(frozen=True)
class ReducedCell:
    """A cell, or any other body, in a small M-orthonormal basis.

    Args:
        model: the full body.
        basis: vectors (dof, m); of a free body, its rigid motions, too.
        stiffness: stiffness of each region in the basis, (m, m) each.
        rest: stiffness (m, m) of what does not relax.
        loads: basis^T M times unit translations (m, 3).
        reach_hz: highest mode in the basis; above it the other vectors stand in for modes that
            are missing [Hz].
    """

    model: CellModel
    basis: NDArray[np.float64]
    stiffness: tuple[NDArray[np.float64], ...]
    rest: NDArray[np.float64]
    loads: NDArray[np.float64]
    reach_hz: float

    @classmethod
    def of(cls, model: CellModel, count: int, modes: Modes | None = None) -> "ReducedCell":
        """Basis of `count` modes, their correction by each region, and a steady deflection."""
        # tens of modes, and a factor that is needed anyway
        modes = modes or solve(model, count, way=direct())
        regions = [model.stiffness(region) for region in range(len(model.materials))]
        columns = [part @ modes.vectors for part in regions[1:]]  # the first follows from these
        columns += [point_load(model) if model.assembly.flies else model.M @ model.rigid]
        apply = inverse(model.K + model.lift * model.M, direct())
        corrections = [apply(column) for column in np.column_stack(columns).T]
        vectors = np.column_stack([model.flight, modes.vectors, *corrections])
        basis = orthonormal(vectors, model.M)
        parts = tuple(basis.T @ (part @ basis) for part in regions)
        rest, loads = basis.T @ (model.additions @ basis), basis.T @ (model.M @ model.rigid)
        return cls(model, basis, parts, rest, loads, float(modes.frequencies_hz[-1]))

    def motion(self, frequency_hz: float, solids: Solids, load: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Motion (m, c) under loads (m, c) at one frequency."""
        w = 2 * np.pi * frequency_hz
        relaxing = zip(solids, self.stiffness, strict=True)
        K = sum((solid(1j * w) * part for solid, part in relaxing), self.rest.astype(complex))
        return np.asarray(np.linalg.solve(K - w**2 * np.eye(len(K)), load))


@dataclass(frozen=True)
class DampedModes(Tabled):
    """Oscillating modes of a viscoelastic cell, by rising frequency.

    Args:
        s: complex eigenvalues (c,) with positive imaginary part [rad/s].
        residuals: |s^2 M x + K(s) x| / |K(s) x| in the full unknowns (c,).
        elastic_hz: frequencies of the same shapes at rest stiffness (c,), by Rayleigh's quotient.
    """

    s: NDArray[np.complex128]
    residuals: NDArray[np.float64]
    elastic_hz: NDArray[np.float64]

    @property
    def frequencies_hz(self) -> NDArray[np.float64]:
        """Damped frequencies (c,) [Hz]."""
        return self.s.imag / (2 * np.pi)

    @property
    def damping(self) -> NDArray[np.float64]:
        """Damping ratios (c,)."""
        return np.asarray(-self.s.real / np.abs(self.s))

    def grid(self, low_hz: float, high_hz: float) -> NDArray[np.float64]:
        """Frequencies (n,) of a response [Hz], with those of the modes: no narrow peak is missed."""
        f = self.frequencies_hz
        inside = f[(low_hz < f) & (f < high_hz)]
        return np.union1d(np.geomspace(low_hz, high_hz, POINTS), inside)

    def document(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "frequencies_hz": self.frequencies_hz,
            "damping_ratio": self.damping,
            "elastic_hz": self.elastic_hz,
            "residuals": self.residuals,
        }

    def __str__(self) -> str:
        rows = zip(self.frequencies_hz, self.damping, self.elastic_hz, self.residuals, strict=True)
        return "\n".join(  # adding 0.0 turns the -0.0 of rounding into 0.0
            f"  mode {i:2d}  {f:10.4g} Hz, damping {round(z, 5) + 0.0:.3%} (elastic {e:.4g} Hz, residual {r:.0e})"
            for i, (f, z, e, r) in enumerate(rows, start=1)
        )


def damped_modes(cell: ReducedCell, solids: Solids, count: int = 10) -> DampedModes:
    """The lowest oscillating modes, at most `count`: shapes within the reach that converged.

    The basis also holds vectors that are no modes; their values lie above its reach and do not
    converge. State (u, v, q_1, q_2, ...):

        s u = v,  s v = -(K + sum g_r K_r) u + sum g_r K_r q_r,  s q_r = (u - q_r) / tau_r.

    Args:
        cell: in its basis.
        solids: by region number.
        count: of modes.

    Raises:
        SettingError: no mode of the basis oscillates and converges.
    """
    m, n = cell.basis.shape[1], len(solids)
    one, zero = np.eye(m), np.zeros((m, m))
    g, rates = np.array([solid.g for solid in solids]), [1 / solid.tau for solid in solids]
    rest, fast = (cell.rest + np.tensordot(weights, cell.stiffness, 1) for weights in (np.ones(n), 1 + g))
    dashpots = [solid.g * part for solid, part in zip(solids, cell.stiffness, strict=True)]
    relaxing = np.kron(np.array(rates)[:, None], one)
    state = np.block([
        [zero, one, *[zero] * n],
        [-fast, zero, *dashpots],
        [relaxing, np.zeros((n * m, m)), -np.kron(np.diag(rates), one)],
    ])  # fmt: skip
    values, vectors = scipy.linalg.eig(state)
    swinging = np.flatnonzero(values.imag > 1e-6 * np.abs(values))
    s, shapes = values[swinging], vectors[:m, swinging]
    squares = (shapes.conj() * (rest @ shapes)).sum(axis=0).real / (np.abs(shapes) ** 2).sum(axis=0)
    elastic_hz = np.sqrt(np.abs(squares)) / (2 * np.pi)
    most, least = cell.reach_hz * (1 + WITHIN), RIGID * cell.reach_hz
    within = np.flatnonzero((elastic_hz <= most) & (elastic_hz > least))
    within = within[np.argsort(s[within].imag)][:count]
    s, x, model = s[within], cell.basis @ shapes[:, within], cell.model
    restoring = model.additions @ x
    for region, solid in enumerate(solids):
        restoring = restoring + solid(s) * (model.stiffness(region) @ x)
    residuals = np.linalg.norm(s**2 * (model.M @ x) + restoring, axis=0)
    residuals /= np.linalg.norm(restoring, axis=0)
    good = residuals < CONVERGED
    if not good.any():
        raise SettingError(
            f"none of the damped modes below {cell.reach_hz:.4g} Hz oscillates and converges "
            f"(residual below {CONVERGED:g}) in this basis: take more modes, less relaxing "
            "stiffness or another relaxation time.",
            "modes",
        )
    return DampedModes(s[good], residuals[good], elastic_hz[within][good])


@dataclass(frozen=True)
class BaseResponse(Tabled):
    """Frequency response to motion of the base along x, y and z in turn.

    Args:
        frequencies_hz: frequencies of the shaking (n,) [Hz].
        top: motion of the highest point over motion of the base, along the same axis,
            complex (3, n).
        nucleus: the same for the mean of the nucleus (3, n); NaN without one.
        relative_m: largest way of the top against the base (3, n) at a base acceleration of
            amplitude 1 m/s^2 [m].
    """

    frequencies_hz: NDArray[np.float64]
    top: NDArray[np.complex128]
    nucleus: NDArray[np.complex128]
    relative_m: NDArray[np.float64]

    @property
    def resonance_hz(self) -> NDArray[np.float64]:
        """Highest peak (3,) of the top's motion against the base per base displacement [Hz].

        NaN where the motion only rises towards an end of the range: an end is no resonance.
        """

        def peak(motion: NDArray[np.float64]) -> float:
            inside = motion[1:-1]
            peaks = 1 + np.flatnonzero((inside > motion[:-2]) & (inside >= motion[2:]))
            return self.frequencies_hz[peaks[motion[peaks].argmax()]] if len(peaks) else np.nan

        return np.array([peak(motion) for motion in np.abs(self.top - 1)])

    def at(self, frequency_hz: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Transmissibility of the top (3,) and its way against the base (3,) [m at 1 m/s^2]."""
        i = int(np.abs(self.frequencies_hz - frequency_hz).argmin())
        return np.abs(self.top[:, i]), self.relative_m[:, i]

    def document(self) -> dict[str, Any]:
        """Ready for JSON; transmissibilities as magnitudes."""
        return {
            "frequencies_hz": self.frequencies_hz,
            "top_transmissibility_xyz": np.abs(self.top),
            "nucleus_transmissibility_xyz": np.abs(self.nucleus),
            "relative_m_per_m_s2_xyz": self.relative_m,
            "resonance_hz_xyz": self.resonance_hz,
        }

    def __str__(self) -> str:
        none = f"none below {self.frequencies_hz[-1]:.4g} Hz"
        pairs = zip("xyz", self.resonance_hz, strict=True)
        peaks = ", ".join(f"{x} {none if np.isnan(f) else f'{f:.4g} Hz'}" for x, f in pairs)
        slow = max(20.0, float(self.frequencies_hz[0]))
        T, way = self.at(slow)
        return (
            f"resonance (largest motion of the top relative to the base, per base displacement): {peaks}\n"
            f"at {slow:.3g} Hz the top moves {T[0]:.9g} times as much as the base along x; relative to the base "
            f"{way[0]:.3g} m at 1 m/s^2"
        )


def base_response(
    cell: ReducedCell, solids: Solids, frequencies_hz: NDArray[np.float64],
    inner: int | None = NUCLEUS,
) -> BaseResponse:  # fmt: skip
    """Shake the base along x, y and z; valid up to `cell.reach_hz`.

    Args:
        cell: in its basis.
        solids: by region number.
        frequencies_hz: (n,).
        inner: the region whose mean motion is the nucleus', None for none.
    """
    assembly, f = cell.model.assembly, np.asarray(frequencies_hz, dtype=np.float64)
    top = cell.basis.T @ point_load(cell.model)
    inside = np.full(top.shape, np.nan)
    weight = np.zeros(1) if inner is None else assembly.regions[inner].m.diagonal()
    if weight.sum() > 0:
        inside = np.einsum("n,mnd->md", weight, assembly.expand(cell.basis)) / weight.sum()
    # per unit of base displacement the acceleration is -omega^2, so the load is omega^2 M r
    squares = (2 * np.pi * f) ** 2
    motions = [cell.motion(h, solids, w2 * cell.loads) for h, w2 in zip(f, squares, strict=True)]
    at_top, at_nucleus = (np.einsum("md,nmd->dn", place, motions) for place in (top, inside))
    return BaseResponse(f, 1 + at_top, 1 + at_nucleus, np.abs(at_top) / squares)


def point_load(model: CellModel) -> NDArray[np.float64]:
    """Unit forces (dof, 3) along x, y and z at the highest point."""
    assembly = model.assembly
    highest = int(assembly.nodes_um[assembly.free, assembly.mesh.up].argmax())
    load = np.zeros((assembly.dof, 3))
    load[3 * highest : 3 * highest + 3] = np.eye(3)
    return load


@dataclass(frozen=True)
class ForceResponse(Tabled):
    """Frequency response of a free body to a force at its highest point along x, y and z in turn.

    Args:
        frequencies_hz: frequencies of the force (n,) [Hz].
        accelerance: acceleration of that point along the force over it, complex (3, n) [1/kg].
    """

    frequencies_hz: NDArray[np.float64]
    accelerance: NDArray[np.complex128]

    def document(self) -> dict[str, Any]:
        """Ready for JSON; magnitudes."""
        size = np.abs(self.accelerance)
        return {"frequencies_hz": self.frequencies_hz, "accelerance_per_kg_xyz": size}

    def __str__(self) -> str:
        peaks = zip("xyz", np.abs(self.accelerance).argmax(axis=1), strict=True)
        where = ", ".join(f"{axis} {self.frequencies_hz[i]:.4g} Hz" for axis, i in peaks)
        return f"driven by a force at its highest point, that point accelerates most at: {where}"


def force_response(cell: ReducedCell, solids: Solids, frequencies_hz: NDArray[np.float64]) -> ForceResponse:
    """A force at the highest point at each frequency (n,) [Hz]; valid up to `cell.reach_hz`."""
    f = np.asarray(frequencies_hz, dtype=np.float64)
    load = cell.basis.T @ point_load(cell.model)
    moved = np.einsum("md,nmd->dn", load, [cell.motion(h, solids, load) for h in f])
    return ForceResponse(f, -((2 * np.pi * f) ** 2) * moved)
