"""Which of the 13 constants matter: relative sensitivities of one arch and of many random ones, section 4.4.

The relative sensitivity of output i to constant j is alpha_j ||dx_i/d alpha_j|| / ||x_i||, norms over whole periods.
The thesis divides sample by sample, by states that cross zero, and its mean falls with the number of samples
(docs/errata.md). The linear model's are exact, frequency by frequency; the nonlinear model's come from the direct
differential method along a trajectory from rest.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from fasbody.arch.bones import PARAMETERS, SPRINGS, Arch
from fasbody.arch.kinematics import Array, X, arms, rest
from fasbody.arch.lagrange import force_per_parameter, mass_matrix, strains
from fasbody.arch.linear import linearise
from fasbody.arch.ode import STATES, initial_state, jacobian, malleolus_acceleration, solve, split
from fasbody.presentation import Presented, Sheet

#: Eq. (4.15): the outputs whose sensitivity to `PARAMETERS` is computed: 11 states, acceleration of the malleolus.
OUTPUTS = (*STATES, "malleolus")
#: The constants that the thesis keeps, section 4.4.
CLAIMED = frozenset({"k_T", "c_T", "k_F", "c_F"})

#: Section 2.2.2: table frequencies [Hz] and half of the 17.9 m/s^2 peak to peak.
FREQUENCIES_HZ = np.arange(10.0, 51.0, 5.0)
AMPLITUDE = 8.95

#: Radau IIA, three stages, fifth order: weights of the stages and their instants.
_ROOT = np.sqrt(6)
_STAGES = np.array([
    [(88 - 7 * _ROOT) / 360, (296 - 169 * _ROOT) / 1800, (-2 + 3 * _ROOT) / 225],
    [(296 + 169 * _ROOT) / 1800, (88 + 7 * _ROOT) / 360, (-2 - 3 * _ROOT) / 225],
    [(16 - _ROOT) / 36, (16 + _ROOT) / 36, 1 / 9],
])  # fmt: skip
_INSTANTS = _STAGES.sum(axis=1)


@dataclass(frozen=True, repr=False)
class Study(Presented):
    """Relative sensitivities of one arch, or of many random ones.

    Attributes:
        lever_arm_m: arm of the rotational constants [m]; None reads Table 4.2 literally.
        values: shape (draws, 12 outputs, 13 constants).
        method: "linear" (root mean square over the frequencies) or "trajectory".
        arch_name: whose constants these are; empty for random draws.
    """

    lever_arm_m: float | None
    values: Array
    method: str
    arch_name: str = ""

    figures: ClassVar[str] = "fasbody.arch.figures"
    plots: ClassVar[tuple[str, ...]] = ("sensitivity",)

    def records(self) -> list[dict[str, Any]]:
        """One row a draw, output and constant."""
        return [
            {"draw": i, "output": output, "constant": name, "relative_sensitivity": float(self.values[i, j, k])}
            for i in range(len(self.values))
            for j, output in enumerate(OUTPUTS)
            for k, name in enumerate(PARAMETERS)
        ]

    def sheet(self) -> Sheet:
        """Medians of all outputs but the rates, which repeat their coordinates almost exactly."""
        outputs = [i for i, output in enumerate(OUTPUTS) if not output.endswith("_dot")]
        median = np.median(self.values, axis=0)
        rows = [
            (f"{name} *" if name in CLAIMED else name, *(f"{median[i, j]:.2g}" for i in outputs))
            for j, name in enumerate(PARAMETERS)
        ]
        hits = (self.holds(OUTPUTS[i]).sum() for i in outputs)
        rows.append(("claim holds", *(f"{count}/{len(self.values)}" for count in hits)))
        many = "" if self.arch_name else f"median over {len(self.values)} draws, "
        title = f"Relative sensitivity, {many}{self.reading}, {self.method}"
        notes = ("* The four that the thesis keeps; its claim is that they are the largest.",)
        return Sheet(title, ("constant", *(OUTPUTS[i] for i in outputs)), rows, notes)

    @property
    def reading(self) -> str:
        """Whose constants these are: the arch's own, or how the range of the rotational ones was read."""
        if self.arch_name:
            return f"own constants of {self.arch_name}"
        return "literal" if self.lever_arm_m is None else f"lever arm {self.lever_arm_m * 1e3:g} mm"

    def holds(self, output: str) -> Array:
        """For each draw: are the four largest sensitivities of `output` the four that the thesis keeps?"""
        largest = np.argsort(self.values[:, OUTPUTS.index(output)], axis=-1)[:, -len(CLAIMED) :]
        return np.array([{PARAMETERS[j] for j in draw} == CLAIMED for draw in largest])

    def document(self) -> dict[str, object]:
        """The study as plain data for --json."""
        return {
            "method": self.method,
            "lever_arm_m": self.lever_arm_m,
            "draws": len(self.values),
            "parameters": PARAMETERS,
            "claim_holds": {output: int(self.holds(output).sum()) for output in OUTPUTS},
            "median": {
                output: dict(zip(PARAMETERS, np.median(self.values[:, i], axis=0), strict=True))
                for i, output in enumerate(OUTPUTS)
            },
            "malleolus_by_draw": self.values[:, -1],
        }


def study(
    draws: int = 30,
    seed: int = 0,
    lever_arm_m: float | None = None,
    frequency_hz: float | None = None,
    bones: Arch | None = None,
) -> Iterator[Study]:
    """Draw arches from Table 4.2; yields after each draw the study so far.

    Args:
        draws: number of random arches.
        seed: of the random numbers.
        lever_arm_m: see `Arch.draw`.
        frequency_hz: None for the linear model over `FREQUENCIES_HZ`, else the nonlinear one at this frequency.
        bones: geometry and masses of every draw; None is Table 4.1.
    """
    bones = bones or Arch.thesis()
    rng, values = np.random.default_rng(seed), []
    for _ in range(draws):
        values.append(_of(bones.drawn(rng, lever_arm_m), frequency_hz))
        yield Study(lever_arm_m, np.array(values), _method(frequency_hz))


def of_arch(arch: Arch, name: str, frequency_hz: float | None = None) -> Study:
    """Sensitivities about the constants of one arch.

    Args:
        arch: the constants.
        name: what to call it.
        frequency_hz: see `study`.
    """
    return Study(None, _of(arch, frequency_hz)[None], _method(frequency_hz), name)


def _method(frequency_hz: float | None) -> str:
    return "linear" if frequency_hz is None else "trajectory"


def _of(arch: Arch, frequency_hz: float | None) -> Array:
    if frequency_hz is None:
        return np.sqrt(np.mean(linear_sensitivity(arch) ** 2, axis=0))
    return trajectory_sensitivity(arch, frequency_hz)


def linear_sensitivity(arch: Arch, frequency_hz: Array = FREQUENCIES_HZ) -> Array:
    """Relative sensitivities of the linear arch in steady vibration, exact.

    Args:
        arch: the constants.
        frequency_hz: table frequencies [Hz], shape (n,).

    Returns:
        Shape (n, 12, 13), outputs in the order of `OUTPUTS`, constants in that of `PARAMETERS`.
    """
    model, g = linearise(arch), np.array([slope for _, slope in strains(arch, rest(arch)).values()])
    s = 2j * np.pi * np.asarray(frequency_hz)[:, None, None]
    inverse = np.linalg.inv(s**2 * model.M + s * model.C + model.K)
    q = -inverse @ model.M[:, 0]
    # d/d alpha of (s^2 M + s C + K) q = -M[:, 0]: each constant adds its own g g^T
    unit = np.where([name in SPRINGS for name in PARAMETERS], 1, s[:, 0])
    dq = -inverse @ g.T * (unit * (q @ g.T))[:, None, :]
    states, d_states = _states(q[..., None], dq, s)
    output, d_output = 1 + s[:, 0, 0] ** 2 * (q @ model.out), s[:, 0] ** 2 * np.einsum("i,nij->nj", model.out, dq)
    x = np.concatenate([states[..., 0], output[:, None]], axis=1)
    dx = np.concatenate([d_states, d_output[:, None]], axis=1)
    return np.abs(dx) * [getattr(arch, name) for name in PARAMETERS] / np.abs(x)[..., None]


def _states(q: Array, dq: Array, s: Array) -> tuple[Array, Array]:
    return tuple(np.concatenate([v[:, :5], s * v[:, :5], v[:, 5:]], axis=1) for v in (q, dq))  # type: ignore[return-value]


def trajectory_sensitivity(
    arch: Arch, frequency_hz: float = 30.0, amplitude: float = AMPLITUDE, periods: int = 12, steps_per_period: int = 40
) -> Array:
    """Relative sensitivities of the nonlinear arch along a sine from rest, shape (12, 13).

    Args:
        arch: the constants.
        frequency_hz: of the table [Hz].
        amplitude: of its acceleration [m/s^2].
        periods: length of the run; its second half counts.
        steps_per_period: of the sensitivity equations.
    """
    omega = 2 * np.pi * frequency_hz
    X, S, y, dy = sensitivity_along(
        arch, lambda t: amplitude * np.sin(omega * t), periods / frequency_hz, periods * steps_per_period
    )
    half = periods // 2 * steps_per_period
    x = np.column_stack([X, y])[half:]
    dx = np.concatenate([S, dy[:, None, :]], axis=1)[half:]
    # Eq. (4.20) and Eq. (4.21) with norms in place of the quotient of samples
    alpha = np.array([getattr(arch, name) for name in PARAMETERS])
    return np.linalg.norm(dx, axis=0) * alpha / np.linalg.norm(x, axis=0)[:, None]


def sensitivity_along(
    arch: Arch, base_acceleration: Callable[[float], float], duration: float, steps: int
) -> tuple[Array, Array, Array, Array]:
    """The direct differential method along a trajectory of the nonlinear arch, from rest and S(0) = 0.

    S holds the first-order terms of Eq. (4.17).

    Args:
        arch: the constants.
        base_acceleration: acceleration of the table [m/s^2] at a time [s].
        duration: length of the trajectory [s].
        steps: equal steps of the sensitivity equations (three stages each).

    Returns:
        Deviation of the states from rest (steps, 11) and S = dX/d alpha (steps, 11, 13), then the malleolus'
        acceleration (steps,) and its derivatives (steps, 13), all at the ends of the steps.
    """
    h = duration / steps
    time = np.concatenate([[0.0], (h * (np.arange(steps)[:, None] + _INSTANTS)).ravel()])
    # Eq. (4.16): X' = f(X, alpha, u, t)
    motion = solve(arch, base_acceleration, time, tolerance=1e-7)
    states, table = motion.states[1:], np.array([base_acceleration(t) for t in time[1:]])
    J, F = jacobian(arch, states, table), parameter_jacobian(arch, states)
    J, F = J.reshape(steps, 3, 11, 11), F.reshape(steps, 3, 11, 13)
    # Eq. (4.19): dS_j/dt = J S_j + F_j is linear in S, so each implicit step is one linear system
    system = np.eye(33) - h * np.einsum("ab,naij->naibj", _STAGES, J).reshape(steps, 33, 33)
    from_start = np.linalg.solve(system, J.reshape(steps, 33, 11))
    from_force = np.linalg.solve(system, F.reshape(steps, 33, 13))
    S = np.zeros((steps + 1, 11, 13))  # Eq. (4.18)
    weights = h * _STAGES[-1]
    for n in range(steps):
        slopes = (from_start[n] @ S[n] + from_force[n]).reshape(3, 11, 13)
        S[n + 1] = S[n] + np.einsum("a,aij->ij", weights, slopes)
    ends = slice(2, None, 3)
    X_end, S_end = states[ends], S[1:]
    d_output = _output_gradient(arch, X_end, table[ends]) @ S_end
    d_output = d_output[:, 0] + np.einsum("ni,nij->nj", _output_row(arch, X_end), F[:, 2, 5:10])
    return X_end - initial_state(arch), S_end, motion.malleolus[1:][ends], d_output


def parameter_jacobian(arch: Arch, states: Array) -> Array:
    """F = df/d alpha, shape (..., 11, 13): what one unit more of each constant does to the accelerations and to x'."""
    q, q_dot, _ = split(arch, states)
    force = np.stack(list(force_per_parameter(arch, q, q_dot).values()), axis=-1)
    acceleration = np.linalg.solve(mass_matrix(arch, q)[..., :5, :5], force[..., :5, :])
    return np.concatenate([np.zeros_like(acceleration), acceleration, force[..., X:, :] / arch.c_1], axis=-2)


def _output_row(arch: Arch, states: Array) -> Array:
    """Row that turns the five accelerations into that of the malleolus, shape (n, 5)."""
    a = arms(arch, states[..., [0, 1, 2, 3, 4, 10]])
    one = np.ones_like(a.l_2)
    return np.stack([one, one, -a.l_2, -a.l_3, -a.l_4], axis=-1)


def _output_gradient(arch: Arch, states: Array, table: Array) -> Array:
    """d(malleolus' acceleration)/dX by complex steps, shape (n, 1, 11)."""
    stepped = states[:, None, :] + 1e-30j * np.eye(11)
    return malleolus_acceleration(arch, stepped, table[:, None]).imag[:, None, :] / 1e-30
