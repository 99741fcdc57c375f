"""The steps of a session on real hardware, or on the virtual bench: acquire's board, generator, level and guard."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import typer

from fasbody.acquire.board import Stalled
from fasbody.acquire.devices import Equipment
from fasbody.acquire.display import Display
from fasbody.acquire.folder import RECORDINGS
from fasbody.acquire.level import Safety
from fasbody.acquire.plan import Plan
from fasbody.acquire.session import Session
from fasbody.console import console
from fasbody.exceptions import AcquisitionError, SettingError
from fasbody.recording.recording import Recording
from fasbody.recording.study import Study
from identification.plan.candidates import Step
from identification.plan.prior import Person
from identification.plan.session import Offering
from identification.plan.shaker import SINE


class Laboratory:
    """Records steps into a study, one after the other, the output off between them.

    Args:
        study: folder.
        person: on the shaker.
        safety: what guard and level keep to.
        equipment: board and generator; None for the virtual bench. On hardware a person at the
            terminal lays the loads, and says so.
    """

    def __init__(self, study: Path, person: Person, safety: Safety, equipment: Equipment | None) -> None:
        self._study, self._person, self._safety, self._equipment = study, person, safety, equipment
        self._stack = ExitStack()
        self._load: float | None = None
        self._session: Session | None = None
        self._stalled = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def record(self, step: Step) -> Recording:
        """Bring the base to its level and record.

        Raises:
            Stalled: the board gave no samples, also when it was repeated. AcquisitionError: it did not succeed. The
                output is off.
        """
        if step.kind != SINE:
            raise SettingError(f"a generator makes sines only, no {step.kind}.")
        plan = self._plan(step)
        plan.check(True)
        session = self._at(step.added_mass_kg, plan)
        session.plan = plan
        before = len(session.made)
        try:
            if self._stalled:
                session.board.revive()
                self._stalled = False
            session.run()
        except Stalled:
            self._stalled = True
            raise
        good = [one for one in session.made[before:] if not one.problems]
        if not good:
            why = "; ".join(problem for one in session.made[before:] for problem in one.problems) or "nothing was made"
            raise AcquisitionError(f"no attempt was usable: {why}.")
        name = f"{RECORDINGS}/{good[-1].file.name}"  # as every fit reads it: with the calibration of study.toml
        return next(r for r in Study.read(self._study).recordings if r.file.endswith(name))

    def _plan(self, step: Step) -> Plan:
        condition = replace(self._person.condition(step), frequency_hz=None)
        truth: dict[str, Any] | None = None
        if self._equipment is None:
            from fasbody.laboratory.foot import TRUTH

            truth = {"origin": "synthetic", "parameters": TRUTH, "instrument": {"delay_s": 0.0}}
        return Plan(
            self._study, (step.frequency_hz,), condition, step.seconds, 2 * step.amplitude_m_s2, safety=self._safety,
            origin="measured" if truth is None else "synthetic", truth=truth,
        )  # fmt: skip

    def _at(self, load_kg: float, plan: Plan) -> Session:
        """The session under a load: on the bench a new one, as the virtual foot has its masses from the start."""
        if self._session is not None and load_kg == self._load:
            return self._session
        equipment = self._equipment
        if equipment is None:
            self._stack.close()
            equipment = Equipment.simulated(self._stack, added_mass=load_kg)
        elif (self._load is not None or load_kg) and not _agreed(f"{load_kg:g} kg are on the knee"):
            raise AcquisitionError(f"{load_kg:g} kg are not on the knee.")
        if self._session is None or self._equipment is None:
            board, generator = equipment.open(self._stack)
            self._stack.enter_context(Display(board))
            self._session, self._stalled = Session(plan, board, generator), False
        self._load = load_kg
        return self._session


class Offer(Offering):
    """Tells on the terminal; asks before each step unless it is taken by itself."""

    def __init__(self, auto: bool) -> None:
        self._auto = auto

    def step(self, proposed: Step, why: str) -> Step | None:
        """See `Offering`."""
        console.print(f"next: {proposed} ({why})", soft_wrap=True, markup=False)
        if self._auto:
            return proposed
        return proposed if _agreed("take it") else None

    def report(self, sentence: str) -> None:
        """See `Offering`."""
        console.print(sentence, soft_wrap=True, markup=False)


def _agreed(question: str) -> bool:
    """What a person at the terminal says; Ctrl-C at the question is Ctrl-C."""
    try:
        return typer.confirm(question, default=True, err=True)
    except typer.Abort:
        raise KeyboardInterrupt from None
