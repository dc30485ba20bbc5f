"""A grasp whose outcome is known: two pads press a cube with a given force, in the core and in MuJoCo."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the comparison needs mujoco, from the extra 'dev'")

import graspbox
from graspbox.configs import TrialConfig
from validation import mujoco as judge

#: Pulling force of both fingers together (N), hence half of it on each side, and how long the lift takes (s).
FORCE, LIFT_TIME = 20.0, 4.0
SIDE = 0.05
CONFIG = TrialConfig(lift_time=LIFT_TIME, early_stop=False)
#: Greatest acceleration of a minimum-jerk lift: 10 / sqrt(3) of height / time^2.
ACCELERATION = 10.0 / np.sqrt(3.0) * CONFIG.lift_height / LIFT_TIME**2


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> graspbox.Hand:
    """Give a parallel jaw that closes with `FORCE`; its pads have a friction factor of 1."""
    urdf, toml = graspbox.load_hand("panda_gripper").files
    weak = toml.replace("load_limit = { value = 140.0", f"load_limit = {{ value = {FORCE}")
    assert weak != toml
    folder: Path = tmp_path_factory.mktemp("weak")
    (folder / "hand.urdf").write_text(urdf)
    (folder / "hand.toml").write_text(weak)
    return graspbox.load_hand((folder / "hand.urdf", folder / "hand.toml"))


@pytest.mark.parametrize("load", [0.97, 1.03])
def test_a_squeezed_cube_is_held_if_friction_carries_it(hand: graspbox.Hand, load: float) -> None:
    """Friction carries 2 mu F: a cube of 0.97 of that is held without creeping, one of 1.03 is not lifted."""
    carried = 2.0 * 1.0 * (FORCE / 2.0)
    held = load < 1.0
    mass = load * carried / (9.81 + (ACCELERATION if held else 0.0))
    half = 0.5 * SIDE
    corners = np.array([[x, y, z] for x in (-half, half) for y in (-half, half) for z in (-half, half)])
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    scene = graspbox.Scene(graspbox.mesh_from_arrays(corners, np.array(faces), mass=mass, name="cube"), hand=hand)
    world = np.diag([1.0, -1.0, -1.0, 1.0])
    world[2, 3] = half + 0.0374
    outcome, trace = scene.trace(np.linalg.inv(scene.world_from_object) @ world, 0.0, config=CONFIG)
    times = judge.TrialTimes(lift_time=LIFT_TIME)
    theirs = judge.replay(judge.build(judge.describe(hand), judge.object_data(scene)), world, 0.0, times)
    assert (bool(outcome.success[0]), theirs.success) == (held, held)
    if held:
        height = (np.linalg.inv(trace.world_from_hand) @ trace.world_from_object)[:, 2, 3]
        assert abs(height[-1] - height[-51]) / 0.5 < 5e-5
        assert theirs.speed < 5e-5
        assert trace.loads[-1, 0] == pytest.approx(FORCE)
    else:
        assert outcome.failure[0] == theirs.failure == "slipped"
