"""Native callbacks: equal to their Python twin, restored, and refused where the engine's layout differs."""

import mujoco
import numpy as np
import pytest

from fasbody.exceptions import EngineError
from fasbody.foot import engine
from fasbody.foot import engine as layout
from fasbody.foot.engine import Callbacks, callbacks, native, python_twin, self_test
from fasbody.foot.model import Foot
from fasbody.foot.shaker import sine


def installed() -> list[object]:
    return [
        mujoco.get_mjcb_passive(), mujoco.get_mjcb_act_dyn(), mujoco.get_mjcb_act_bias(), mujoco.get_mju_user_warning(),
    ]  # fmt: skip


def steps(model: mujoco.MjModel, pair: Callbacks | None, count: int = 200) -> np.ndarray:
    """Accelerations of every step under a 30 Hz sine of the base (the first joint)."""
    data, rows = mujoco.MjData(model), []
    controls = sine(30.0, 1.0).controls(model.opt.timestep, count)
    with callbacks(pair):
        data.qvel[1:] = 0.05
        for row in controls:
            data.ctrl[:5] = row
            mujoco.mj_step(model, data)
            rows.append(np.concatenate([data.qacc, data.act, data.qpos]))
    return np.array(rows)


def test_native_foot_equals_the_python_twin(foot: Foot) -> None:
    have, want = steps(foot.model, None), steps(foot.model, python_twin())
    assert np.abs(have - want).max() < 1e-12 * np.abs(want).max()
    assert np.ptp(want[:, 1]) > 1  # it does move


@pytest.mark.parametrize(("joints", "tendons"), [(0, 0), (3, 2)])
def test_native_laws_equal_the_python_twin(joints: int, tendons: int) -> None:
    """The probe holds every law, a tendon with a law, and the hereditary pad with its activations."""
    model = layout.probe_model(joints, tendons)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT  # a touch would make much of a rounding
    have, want = steps(model, None, 50), steps(model, python_twin(), 50)
    assert (np.abs(have - want) <= 1e-11 * (1e-3 + np.abs(want).max(axis=0))).all()


def test_callbacks_matter(foot: Foot) -> None:
    """Without them the foot is undamped and not shaken."""
    nothing = Callbacks(None, None, None, None)
    assert np.abs(steps(foot.model, nothing)[:, 0]).max() < 1e-3
    assert np.abs(steps(foot.model, None)[:, 0]).max() > 8


def test_callbacks_are_restored_also_after_an_error() -> None:
    before = installed()
    with callbacks():
        assert installed() != before
    assert installed() == before
    with pytest.raises(RuntimeError), callbacks():
        raise RuntimeError
    assert installed() == before


def test_callbacks_nest() -> None:
    def passive(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Do nothing."""

    mujoco.set_mjcb_passive(passive)
    try:
        with callbacks():
            assert mujoco.get_mjcb_passive() is not passive
        assert mujoco.get_mjcb_passive() is passive
    finally:
        mujoco.set_mjcb_passive(None)


def test_self_test_sees_no_difference() -> None:
    assert self_test(native()) < 1e-12


@pytest.mark.parametrize(
    ("one", "other"), [("qpos", "qvel"), ("ten_length", "ten_velocity"), ("dof_damping", "qpos_spring")]
)
def test_a_broken_layout_is_refused(monkeypatch: pytest.MonkeyPatch, one: str, other: str) -> None:
    """Two arrays of one size exchanged: nothing crashes, and the self-test must see it."""
    right = layout.find_offsets()
    wrong = {**right, one: right[other], other: right[one]}
    monkeypatch.setattr(engine, "find_offsets", lambda: wrong)
    with pytest.raises(EngineError, match=r"differ from their Python twin.*mujoco==4\.0"):
        native.__wrapped__()


def test_a_missing_field_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(layout, "MODEL_WORDS", 20)
    with pytest.raises(EngineError, match=r"does not have the field .* where version 4\.0 has it"):
        layout.find_offsets()


def test_offsets_read_the_values_of_another_model(foot: Foot) -> None:
    """Counts at the found words are those of a model that the search has not seen."""
    offsets = layout.find_offsets()
    words = layout._words(foot.model, layout.MODEL_WORDS)
    assert [int(words[offsets[n]]) for n in ("njnt", "ntendon", "nuser_jnt", "nuser_tendon")] == [
        foot.model.njnt, foot.model.ntendon, foot.model.nuser_jnt, foot.model.nuser_tendon,
    ]  # fmt: skip
    data = mujoco.MjData(foot.model)
    data.time = 0.125
    assert layout._words(data, layout.DATA_WORDS).view(float)[offsets["time"]] == 0.125
    assert int(words[offsets["jnt_user"]]) == foot.model.jnt_user.ctypes.data
