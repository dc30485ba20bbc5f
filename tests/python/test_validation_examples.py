"""The example grasps of a checkout of DexGraspBench, here a small one: a gripper of two boxes, and a cube."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the protocol needs mujoco, from the extra 'dev'")
pytest.importorskip("scipy", reason="force closure needs scipy, from the extra 'dev'")
pytest.importorskip("yaml", reason="the settings of the benchmark are YAML")

from graspbox.errors import ConfigError, FileError
from validate import main
from validation.forces.checkout import EXAMPLES, Checkout, judge_examples

#: Two pads 11 cm apart that slide towards each other; stiffness 200 N/m.
HAND = """
<mujoco model="hand">
  <compiler angle="radian" meshdir="../meshes" autolimits="true"/>
  <default>
    <joint type="slide" range="0 0.06" damping="5" armature="0.1"/><position kp="200" forcerange="-9 9"/>
  </default>
  <asset><mesh name="palm" file="palm.obj"/></asset>
  <worldbody>
    <body name="palm">
      <inertial mass="0.3" pos="0 0 0" diaginertia="0.001 0.001 0.001"/>
      <geom type="mesh" mesh="palm" contype="0" conaffinity="0"/>
      <body name="left" pos="-0.06 0 0.1">
        <joint name="left" axis="1 0 0"/><geom type="box" size="0.005 0.02 0.02" mass="0.05"/>
      </body>
      <body name="right" pos="0.06 0 0.1">
        <joint name="right" axis="-1 0 0"/><geom type="box" size="0.005 0.02 0.02" mass="0.05"/>
      </body>
    </body>
  </worldbody>
  <actuator><position joint="left"/><position joint="right"/></actuator>
</mujoco>
"""
SETTINGS = """
obj_mass: 0.1
miu_coef: [0.6, 0.02]
simulation_metrics: {max_pene: 0.01, trans_thre: 0.05, angle_thre: 15}
"""


def cube(half: float) -> str:
    """Write an .obj file."""
    corners = [(x, y, z) for x in (-half, half) for y in (-half, half) for z in (-half, half)]
    faces = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += [f"f {a} {b} {c}\nf {a} {c} {d}" for a, b, c, d in faces]
    return "\n".join(lines) + "\n"


def grasp(root: Path, name: str, squeeze: float, **changes: Any) -> None:
    """Write a grasp at which the pads go to 35 mm, where the cube is, and are commanded to `squeeze`, metres."""
    base, stages = [0, 0, -0.1, 1, 0, 0, 0], {"pregrasp": 0.0, "grasp": 0.035, "squeeze": squeeze}
    fields: dict[str, Any] = {f"{stage}_qpos": np.array([*base, way, way], np.float32) for stage, way in stages.items()}
    fields |= {"obj_pose": np.array([0, 0, 0, 1, 0, 0, 0.0]), "obj_scale": np.float64(0.04), "obj_path": "assets/cube"}
    file = root / EXAMPLES / "graspdata" / name
    file.parent.mkdir(parents=True, exist_ok=True)
    np.save(file, np.array({**fields, **changes}, dtype=object), allow_pickle=True)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    files = {
        "assets/hand/shadow/right_hand.xml": HAND,
        "assets/hand/meshes/palm.obj": cube(0.02),
        "assets/cube/urdf/meshes/convex_piece_000.obj": cube(0.5),
        "assets/cube/info/simplified.json": json.dumps({"mass": 1.0, "density": 1.0, "scale": 1.0}),
        "config/task/eval.yaml": SETTINGS,
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def test_a_pinch_passes_where_friction_carries_the_force(root: Path) -> None:
    """Pads that press with N each carry 1.2 N across them; the pull is 1 N, so that 200 N/m need 4.2 mm."""
    for name, squeeze in (("a/0.npy", 0.045), ("a/1.npy", 0.037), ("b/0.npy", 0.0)):
        grasp(root, name, squeeze)
    # Pads inside the cube from the beginning.
    grasp(root, "b/1.npy", 0.045, pregrasp_qpos=np.array([0, 0, -0.1, 1, 0, 0, 0, 0.055, 0.055]))
    report = judge_examples(Checkout(root), threads=2)
    assert [row.file for row in report.rows] == ["a/0.npy", "a/1.npy", "b/0.npy", "b/1.npy"]
    assert [row.passes for row in report.rows] == [True, False, False, False]
    held, slipped, missed, deep = report.rows
    assert held.shift < 0.005
    assert held.turn < 2.0
    # Looked at every 0.2 s, at 10 m/s2.
    assert missed.shift == pytest.approx(0.2, rel=0.05)
    assert slipped.shift >= 0.05
    assert np.isnan(deep.shift)
    assert deep.depth < 0.001
    assert report.passed == 1


def test_the_object_has_the_mass_of_the_settings(root: Path) -> None:
    grasp(root, "0.npy", 0.045)
    checkout = Checkout(root)
    model = checkout.model(checkout.fields(checkout.grasps[0]))
    assert model.body("object").mass == pytest.approx(0.1)
    np.testing.assert_allclose(model.geom_friction[:, :2], [[0.6, 0.02]] * model.ngeom)


def test_stored_verdicts_are_compared(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grasp(root, "0.npy", 0.045)
    command = ["forces", "--dexgraspbench", str(root)]
    assert main(command) == 0
    assert "pass six forces: 1 of 1" in (out := capsys.readouterr().out)
    assert "has no evaluation to compare with" in out
    for stored, status in ((True, 0), (False, 1)):
        file = root / EXAMPLES / "evaluation/0.npy"
        file.parent.mkdir(exist_ok=True)
        np.save(file, np.array({"succ_flag": np.bool_(stored)}, dtype=object), allow_pickle=True)
        assert main([*command, "--json"]) == status
        facts = json.loads(capsys.readouterr().out)
        assert (facts["passed"], facts["compared"], facts["equal"]) == (1, 1, int(stored))
        assert facts["rows"][0]["stored"] is stored


def test_missing_files_are_named(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(FileError, match=r"graspdata holds no \.npy file; give a checkout of DexGraspBench"):
        Checkout(root)
    grasp(root, "0.npy", 0.045, obj_path="assets/missing")
    checkout = Checkout(root)
    with pytest.raises(FileError, match="assets/missing does not exist; its README, section Object Preparation"):
        checkout.fields(checkout.grasps[0])
    (root / "assets/hand/meshes/palm.obj").unlink()
    assert main(["forces", "--dexgraspbench", str(root)]) == 2
    assert "palm.obj does not exist; its README gets third_party/mujoco_menagerie" in capsys.readouterr().err
    assert main(["forces", "--dexgraspbench", str(root / "nowhere")]) == 2
    assert "config/task/eval.yaml does not exist; give a checkout of" in capsys.readouterr().err


def test_damaged_settings_and_grasps_are_refused(root: Path) -> None:
    grasp(root, "0.npy", 0.045, squeeze_qpos=np.zeros(5))
    with pytest.raises(ConfigError, match="squeeze_qpos has 5 numbers; the hand needs 9"):
        judge_examples(Checkout(root))
    for damaged in ("[", "obj_mass: heavy", "- 1"):
        (root / "config/task/eval.yaml").write_text(damaged)
        with pytest.raises(FileError, match=r"eval\.yaml"):
            Checkout(root)
