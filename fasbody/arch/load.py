"""The arch under load: the pose at rest, sag and shares against measurements, the resonance under added mass.

Static means after the dashpot of the aponeurosis has yielded: only k_11 holds. A load on the apex leaves z_F = -W / k_F
and z_T = -W / k_T apart from the angles, so that the arch itself is three equations, solved by Newton's method.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol

import numpy as np

from fasbody.arch.bones import SPRINGS, Arch
from fasbody.arch.kinematics import Array, X, arms, deformations, gradients, rest
from fasbody.arch.lagrange import right_hand_side
from fasbody.arch.linear import Linear, linearise, response, state_space
from fasbody.constants import MODEL_GRAVITY
from fasbody.exceptions import SettingError, SimulationError
from fasbody.presentation import Presented, Sheet

#: Arangio 1998, computed by a model: load on the arch [N]; arch height [m] -> sag [m] with and without fascia.
ARANGIO_LOAD = 683.0
ARANGIO_SAG = {0.020: (11.8e-3, 13.5e-3), 0.060: (5.5e-3, 7.5e-3)}
#: The same, fascia cut at 60 mm: increase of sag and of elongation.
ARANGIO_CUT = (0.36, 0.40)
#: Kim & Voloshin, in the thesis: part of the compression that the calcaneus carries.
HEEL = 0.63
#: Chapter 2: added mass [kg] -> range of the resonance [Hz] at the malleolus (section 2.3.1).
MEASURED_HZ = {0.0: (15.0, 25.0), 2.3: (30.0, 35.0), 4.5: (35.0, 40.0)}

_STEP = 1e-30


class Springs(Protocol):
    """What holds an arch up: one tension and three moments."""

    def tension(self, e: Array) -> Array:
        """Of the aponeurosis [N] at its elongation e [m], any shape, real or complex."""

    def moment(self, joint: int, d: Array) -> Array:
        """Of the ligaments [N m] at the turn d [rad] of joint 2, 3 or 4, any shape, real or complex."""


@dataclass(frozen=True)
class Equilibrium:
    """The relaxed arch under a vertical load on its apex.

    Attributes:
        q: the pose, shape (6,), with x yielded.
        sag: fall of the apex towards the floor of the arch [m].
        elongation: of the aponeurosis [m].
        stiffness: of the arch, d load / d sag [N/m].
        share: part of the load that the aponeurosis carries, tension x d elongation / d sag / load; without a load the
            part of a very small one.
        heel: part of the load that presses on the heel, the rest on the metatarsal heads.
    """

    q: Array
    sag: float
    elongation: float
    stiffness: float
    share: float
    heel: float


def equilibrium(arch: Arch, load: float, steps: int = 20, springs: Springs | None = None) -> Equilibrium:
    """Static equilibrium of the arch under a load on its apex.

    Args:
        arch: the constants.
        load: downward [N], zero or more.
        steps: in which the load is raised.
        springs: aponeurosis and ligaments; None for the linear ones of the arch.

    Raises:
        SettingError: the load is below zero or no number.
        SimulationError: the arch collapses under the load.
    """
    if not 0 <= load < np.inf:
        raise SettingError(f"the load on the arch is {load:g} N, but must be zero or more.", "load")
    q, springs = rest(arch), springs or arch
    for force in np.linspace(load / steps, load, steps):
        q = _newton(arch, q, force, load, springs)
    a, e = arms(arch, q), deformations(arch, q).e
    fall = np.array([a.l_2, a.l_3, a.l_4])  # d sag / d theta
    give = np.linalg.solve(-tangent(arch, q, load, springs), fall)  # d theta / d load
    lengthening = gradients(arch, q).e[2:5] @ give / (fall @ give)
    q[0], q[1], q[X] = -load / arch.k_F, -load / arch.k_T, e
    pull = (
        springs.tension(e) / load if load else springs.tension(e + 1j * _STEP).imag / _STEP * lengthening * fall @ give
    )
    front = a.l_2 + a.l_3 + a.l_4  # moments of both contact points about the apex
    heel = front / (front + np.sqrt(a.E_1))
    values = (arch.height_0 - a.E_2, e, 1 / (fall @ give), pull * lengthening, heel)
    return Equilibrium(q, *map(float, values))


def _newton(arch: Arch, q: Array, force: float, load: float, springs: Springs) -> Array:
    """Newton's method for one of the forces on the way to `load` [N]; flat or unstable counts as collapsed."""
    for _ in range(50):
        step = np.linalg.solve(tangent(arch, q, force, springs), moments(arch, q, force, springs))
        q = q.copy()
        q[2:5] -= step
        if not np.abs(step).max() < 1 or not abs(apex_height(arch, q)) < arch.L_1:
            break
        if np.abs(step).max() < 1e-13:
            slope = tangent(arch, q, force, springs)
            if apex_height(arch, q) > 0 and np.linalg.eigvalsh(-(slope + slope.T) / 2)[0] > 0:
                return q
            break
    raise SimulationError(
        f"the arch of {arch.height_0 * 1e3:.0f} mm collapses under {load:.0f} N (at {force:.0f} N on the way); "
        "lower the load or stiffen k_2, k_3, k_4 or k_11."
    )


def apex_height(arch: Arch, q: Array) -> float:
    """Height of the apex [m], which needs no closed arch."""
    return float(np.cos(q[2:5]) @ [arch.L_2, arch.L_3, arch.L_4])


def moments(arch: Arch, q: Array, load: Array | float, springs: Springs) -> Array:
    """About theta_2, theta_3, theta_4 [N m] at poses (..., 6) with the dashpot yielded, shape (..., 3).

    Args:
        arch: the bones.
        q: coordinates, shape (..., 6).
        load: on the apex [N], shape (...).
        springs: aponeurosis and ligaments.
    """
    d, g, a = deformations(arch, q), gradients(arch, q), arms(arch, q)
    Q = -springs.tension(d.e)[..., None] * g.e
    for joint, turn, slope in ((2, d.d_2, g.d_2), (3, d.d_3, g.d_3), (4, d.d_4, g.d_4)):
        Q = Q - springs.moment(joint, turn)[..., None] * slope
    return Q[..., 2:5] + np.asarray(load)[..., None] * np.stack([a.l_2, a.l_3, a.l_4], axis=-1)


def tangent(arch: Arch, q: Array, load: Array | float, springs: Springs) -> Array:
    """Slope of `moments` over theta_2, theta_3, theta_4 [N m/rad] at poses (..., 6), shape (..., 3, 3)."""
    columns = [moments(arch, q + 1j * _STEP * e, load, springs).imag / _STEP for e in np.eye(6)[2:5]]
    return np.stack(columns, axis=-1)


def loaded(arch: Arch, gravity: float = MODEL_GRAVITY) -> Linear:
    """M, C, K and output row about the pose in which the arch carries its own weight and the tibia's.

    Args:
        arch: the constants.
        gravity: downward acceleration [m/s^2].

    Raises:
        SimulationError: the arch collapses under that weight.
    """
    start = equilibrium(arch, (arch.m_T + arch.m_1 / 2) * gravity).q
    q = under_weight(arch, start, gravity)
    return linearise(arch, q, gravity)


def under_weight(arch: Arch, q: Array, gravity: float) -> Array:
    """The pose, shape (6,), at which all six right-hand sides vanish under gravity: springs, dashpot and every mass.

    Args:
        arch: the constants.
        q: where to start, shape (6,).
        gravity: downward acceleration [m/s^2].

    Raises:
        SimulationError: there is no such pose.
    """

    def residual(pose: Array) -> Array:
        return right_hand_side(arch, pose, np.zeros(6), gravity)

    for _ in range(50):
        tangent = (residual(q + 1j * _STEP * np.eye(6)).imag / _STEP).T
        step = np.linalg.solve(tangent, residual(q))
        q = q - step
        if np.abs(step).max() < 1e-13 and apex_height(arch, q) > 0:
            return q
    raise SimulationError("the arch collapses under its own weight; stiffen k_2, k_3, k_4 or k_11.")


@dataclass(frozen=True, repr=False)
class SagStudy(Presented):
    """Sag against arch height under one load; arrays of shape (n,), SI units."""

    load: float
    height: Array
    sag: Array
    sag_cut: Array
    elongation: Array
    elongation_cut: Array
    share: Array
    heel: Array

    figures: ClassVar[str] = "fasbody.arch.figures"
    plots: ClassVar[tuple[str, ...]] = ("arch_sag",)

    def records(self) -> list[dict[str, Any]]:
        """One row a height."""
        names = ("height", "sag", "sag_cut", "elongation", "elongation_cut")
        lengths = [{f"{name}_m": float(getattr(self, name)[i]) for name in names} for i in range(len(self.height))]
        shares = zip(lengths, self.share, self.heel, strict=True)
        return [row | {"fascia_share": float(fascia), "heel_share": float(heel)} for row, fascia, heel in shares]

    def sheet(self) -> Sheet:
        """Sag with and without fascia by height, in brackets what was computed elsewhere."""
        rows = []
        for i, height in enumerate(self.height):
            elsewhere = ARANGIO_SAG.get(round(float(height), 3), ()) if self.load == ARANGIO_LOAD else ()
            cut = ARANGIO_CUT if elsewhere and height > 0.05 else ()
            sag = self.sag[i], self.sag_cut[i]
            more = sag[1] / sag[0] - 1, self.elongation_cut[i] / self.elongation[i] - 1
            cells = [f"{1e3 * height:.0f}"]
            for form, scale, values, others in (
                (".1f", 1e3, sag, elsewhere), ("+.0f", 100, more, cut),
                (".0f", 100, (self.share[i],), ()), (".0f", 100, (self.heel[i],), (HEEL,)),
            ):  # fmt: skip
                beside = [f" ({scale * other:{form}})" for other in others] or [""] * len(values)
                cells += [f"{scale * v:{form}}{b}" for v, b in zip(values, beside, strict=True)]
            rows.append(cells)
        columns = (
            "height [mm]", "sag [mm]", "fascia cut [mm]", "more sag [%]", "more elongation [%]", "fascia's share [%]",
            "heel's share [%]",
        )  # fmt: skip
        title = f"Sag under {self.load:g} N; computed elsewhere in brackets (Arangio; heel: Kim & Voloshin)"
        return Sheet(title, columns, rows)


def sag_study(arch: Arch, height: Array, load: float = ARANGIO_LOAD) -> SagStudy:
    """The same bones spread to each rest height, with their aponeurosis and with it cut.

    Args:
        arch: the constants.
        height: rest heights of the apex [m], shape (n,).
        load: on the apex [N].

    Raises:
        ModelError: the bones cannot reach one of the heights.
        SimulationError: the arch collapses under the load.
    """
    whole = [equilibrium(arch.with_height(h), load) for h in height]
    cut = [equilibrium(replace(arch.with_height(h), k_11=0.0, k_12=0.0), load) for h in height]
    return SagStudy(
        load, np.asarray(height), *(np.array(values) for values in (
            [e.sag for e in whole], [e.sag for e in cut],
            [e.elongation for e in whole], [e.elongation for e in cut], [e.share for e in whole],
            [e.heel for e in whole],
        ))
    )  # fmt: skip


@dataclass(frozen=True)
class LoadCase:
    """One added mass.

    Attributes:
        added_mass: on the knee [kg].
        transmissibility: |T| at the malleolus about the loaded pose, shape (n,).
        peak_hz: frequency of its largest value [Hz].
        arch_stiffness: tangent stiffness of the relaxed arch under the weight [N/m].
        factor: by which all springs must be multiplied for the peak to lie in the middle of the measured range; NaN
            for a mass without a measurement.
    """

    added_mass: float
    transmissibility: Array
    peak_hz: float
    arch_stiffness: float
    factor: float


@dataclass(frozen=True, repr=False)
class LoadStudy(Presented):
    """The arch under the added masses of Chapter 2, its constants unchanged."""

    frequency_hz: Array
    cases: list[LoadCase]

    figures: ClassVar[str] = "fasbody.arch.figures"
    plots: ClassVar[tuple[str, ...]] = ("load_resonance",)

    def records(self) -> list[dict[str, Any]]:
        """One row an added mass."""
        return [
            {
                "added_mass_kg": c.added_mass, "peak_hz": c.peak_hz, "arch_stiffness_n_per_m": c.arch_stiffness,
                "factor": c.factor,
            }
            for c in self.cases
        ]  # fmt: skip

    def sheet(self) -> Sheet:
        """Resonance and stiffness under each added mass, beside the measured range."""
        rows = []
        for c in self.cases:
            measured = "{:g} to {:g}".format(*MEASURED_HZ[c.added_mass]) if c.added_mass in MEASURED_HZ else ""
            rows.append(
                (
                    f"{c.added_mass:g}", f"{c.peak_hz:.4g}", measured, f"{c.transmissibility.max():.2f}",
                    f"{c.arch_stiffness / 1e3:.1f}", f"{c.factor:.3g}" if measured else "",
                )
            )  # fmt: skip
        columns = (
            "added mass [kg]", "resonance [Hz]", "measured [Hz]", "|T| there", "arch [kN/m]", "factor on springs",
        )  # fmt: skip
        return Sheet("Resonance at the malleolus under added mass, constants unchanged", columns, rows)


def load_study(arch: Arch, added_kg: Sequence[float] = tuple(MEASURED_HZ)) -> LoadStudy:
    """Resonance and stiffness of `arch` with masses on the knee.

    Args:
        arch: the constants.
        added_kg: the masses [kg]; those of Chapter 2 unless given.
    """
    frequency = np.arange(2.0, 80.0, 0.05)
    cases = []
    for added_mass in added_kg:
        heavy = replace(arch, m_T=arch.m_T + added_mass)
        T = np.abs(response(loaded(heavy), frequency))
        stiffness = equilibrium(heavy, heavy.m_T * MODEL_GRAVITY).stiffness
        peak = float(frequency[T.argmax()])
        measured = MEASURED_HZ.get(added_mass)
        factor = _factor(heavy, float(np.mean(measured))) if measured else np.nan
        cases.append(LoadCase(added_mass, T, peak, stiffness, factor))
    return LoadStudy(frequency, cases)


def _factor(arch: Arch, target_hz: float) -> float:
    """Bisect for the common factor of all springs that puts the peak at `target_hz`, about the rest pose."""
    frequency, low, high = np.arange(2.0, 120.0, 0.05), 0.1, 100.0
    for _ in range(40):
        factor = float(np.sqrt(low * high))
        stiff = replace(arch, **{name: factor * getattr(arch, name) for name in SPRINGS})
        peak = frequency[np.abs(_by_poles(stiff, frequency)).argmax()]
        low, high = (factor, high) if peak < target_hz else (low, factor)
    return factor


def _by_poles(arch: Arch, frequency_hz: Array) -> Array:
    """`transmissibility` from poles and residues: one decomposition for all frequencies, shape (n,)."""
    A, b, c, d = state_space(arch)
    poles, V = np.linalg.eig(A)
    residues = (c @ V) * np.linalg.solve(V, b)
    return d + (residues / (2j * np.pi * frequency_hz[:, None] - poles)).sum(axis=-1)
