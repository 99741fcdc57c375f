"""What the model's motion asks of the table, and what a foot that lifts would add to it: see contact.py."""

from collections.abc import Mapping, Sequence

import numpy as np

from fasbody.constants import GRAVITY
from fasbody.recording.recording import Recording
from identification.contact import Contact
from identification.intervals import Solution


def contacts(solution: Solution, recordings: Sequence[Recording]) -> tuple[Contact, ...]:
    """The contact in each recording at the end of a steady fit.

    Args:
        solution: the branch.
        recordings: as fitted.
    """
    problem, variables = solution.problem, solution.problem.variables
    theta = variables.theta(solution.q)
    forces, predicted = problem.motion.table_force(theta), problem.predicted(solution.q)
    rows = []
    for r, (recording, line, force) in enumerate(zip(recordings, problem.measured.lines, forces, strict=True)):
        values = solution.foot(r)
        weight = GRAVITY * problem.motion.weight_kg(theta[r])
        static = recording.known.static_force_n(recording.condition.added_mass_kg)
        held = weight if static is None else static
        added, beyond = None, None
        if line.count > 1 and variables.two_mass:
            lifted = lifting(values, line.base.frequency_hz, np.maximum(force + held, 0.0) - force - held, line.count)
            first = abs(line.malleolus.amplitudes[0])
            added = float(np.linalg.norm(lifted[1:]) / first)
            beyond = float(np.linalg.norm((line.malleolus.amplitudes - predicted[r, 0, : line.count])[1:]) / first)
        time = np.arange(force.size) / (force.size * line.base.frequency_hz)
        condition = recording.condition
        about = (recording.file, line.base.frequency_hz, condition.added_mass_kg, problem.motion.carrier)
        rows.append(Contact(*about, held, static is not None, time, force + held, added, beyond))
    return tuple(rows)


def lifting(values: Mapping[str, float], frequency_hz: float, missing: np.ndarray, count: int) -> np.ndarray:
    """Harmonics (count,) of the malleolus [m/s^2] under a force on the foot's mass over a period (n,) [N], linearly.

    Args:
        values: of the two-mass model.
        frequency_hz: fundamental.
        missing: the force.
        count: how many harmonics.
    """
    h = np.arange(1, count + 1)
    F = 2 / missing.size * np.fft.rfft(missing)[h]
    s = 2j * np.pi * frequency_hz * h
    p_T, p_F = values["k_T"] + s * values["c_11"], values["k_F"] + s * values["c_21"]
    shank, foot_side = values["m_S"] * s**2 + p_T, values["m_F"] * s**2 + p_T + p_F
    response: np.ndarray = s**2 * p_T * F / (shank * foot_side - p_T**2)
    return response
