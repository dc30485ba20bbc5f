"""MJCF hands: converted to URDFs whose links move as MuJoCo's bodies do."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox.errors import HandError
from graspbox.hand_tools import check_hand, guess_hand
from graspbox.hands import Hand, load_hand, urdf_of_mjcf

mujoco = pytest.importorskip("mujoco", reason="MJCF is read by mujoco, from the extra 'mjcf'")

#: Two fingers on a palm: one slides and leads the other; a bent fingertip is a body without a joint, and an eyelet has
#: no mass. The second finger also has a hinge, whose anchor is not at the origin of its body.
GRIPPER = """
<mujoco model="gripper">
  <compiler angle="radian"/>
  <asset>
    <mesh name="tip" vertex="-.01 -.004 0 .01 -.004 0 -.01 .004 0 .01 .004 0
      -.01 -.004 .02 .01 -.004 .02 -.01 .004 .02 .01 .004 .02"/>
  </asset>
  <worldbody>
    <body name="palm" pos="0.3 0.1 0.2" euler="0.2 0.1 -0.4">
      <geom name="palm_box" type="box" size="0.05 0.03 0.02" mass="0.5"/>
      <geom name="decoration" type="sphere" size="0.1" contype="0" conaffinity="0" mass="0"/>
      <body name="eyelet" pos="0 0 0.1"><site name="grip"/></body>
      <body name="left" pos="0.04 0 0.02" euler="0 0 0.3">
        <joint name="left_slide" type="slide" axis="-1 0 0" range="0 0.035"/>
        <geom name="left_bar" type="capsule" size="0.005 0.02" pos="0 0 0.02" mass="0.05"/>
        <body name="left_tip" pos="0 0 0.04" euler="0.1 0 0">
          <geom name="left_pad" type="mesh" mesh="tip" mass="0.02"/>
        </body>
      </body>
      <body name="right" pos="-0.04 0 0.02" euler="0 0 3.3">
        <joint name="right_slide" type="slide" axis="-1 0 0" range="0 0.035"/>
        <geom name="right_bar" type="cylinder" size="0.005 0.02" pos="0 0 0.02" mass="0.05"/>
        <body name="right_tip" pos="0 0 0.04">
          <joint name="right_bend" type="hinge" axis="0 1 0" pos="0.002 0 -0.003" range="-0.5 0.5"/>
          <geom name="right_pad" type="box" size="0.01 0.004 0.01" pos="0 0 0.01" mass="0.02"/>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="right_slide" joint2="left_slide" polycoef="0 1 0 0 0"/></equality>
  <actuator><position joint="left_slide" kp="1000" forcerange="-40 40"/></actuator>
</mujoco>
"""


@pytest.fixture
def gripper(tmp_path: Path) -> Path:
    path = tmp_path / "gripper.xml"
    path.write_text(GRIPPER)
    return path


def converted(mjcf: Path, folder: Path) -> Hand:
    """Convert a hand and guess its other file."""
    (folder / "hand.urdf").write_text(urdf_of_mjcf(mjcf).text)
    (folder / "hand.toml").write_text(guess_hand(folder / "hand.urdf", "converted").text)
    return load_hand((folder / "hand.urdf", folder / "hand.toml"))


def test_links_joints_and_masses_are_those_of_the_file(gripper: Path, tmp_path: Path) -> None:
    fitted = urdf_of_mjcf(gripper)
    assert list(fitted.fits) == ["left_pad"]
    assert fitted.fits["left_pad"].mean < 1e-3
    hand = converted(gripper, tmp_path)
    assert hand.joints == ["left_slide", "right_bend"]
    np.testing.assert_allclose(hand.joint_limits, [[0.0, 0.035], [-0.5, 0.5]])
    text = fitted.text
    assert '<mimic joint="left_slide" multiplier="1" offset="0" />' in text
    assert 'effort="40"' in text
    assert text.count("<link") == 4
    masses = [float(part.split('"')[0]) for part in text.split('<mass value="')[1:]]
    assert masses == pytest.approx([0.5, 0.07, 0.05, 0.02])
    assert "decoration" not in text
    assert [f'name="left_bar.{n}"' in text for n in range(4)] == [True, True, True, False]


def test_shapes_move_as_in_mujoco(gripper: Path, tmp_path: Path) -> None:
    """Distances between the middles of all shapes agree for random positions of the joints."""
    hand = converted(gripper, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(gripper))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(5):
        low, high = hand.joint_limits.T
        positions: NDArray[np.float64] = rng.uniform(low, high)
        # left_slide, right_slide and right_bend, in the order of MuJoCo's joints.
        data.qpos[:] = [positions[0], positions[0], positions[1]]
        mujoco.mj_kinematics(model, data)
        seen = np.flatnonzero(model.geom_contype)
        there = data.geom_xpos[seen]
        # A capsule is a cylinder and two spheres around its middle.
        poses = hand.shapes(positions)[0][:, :3, 3]
        ours = np.stack([poses[0], poses[1:4].mean(axis=0), *poses[4:]])
        own, other = (np.linalg.norm(p[:, None] - p[None], axis=2) for p in (ours, there))
        np.testing.assert_allclose(own, other, atol=2e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('type="hinge" axis="0 1 0" pos="0.002 0 -0.003" range="-0.5 0.5"', 'type="ball"'), "'right_bend' is a ball"),
        (
            ("</worldbody>", '<body name="b"><geom size="1"/></body></worldbody>'),
            "has 2 bodies in the world; a hand is",
        ),
        (("<equality>", '<equality><connect body1="left" body2="right" anchor="0 0 0"/>'), "closes a loop"),
        (('polycoef="0 1 0 0 0"', 'polycoef="0 1 1 0 0"'), "is not linear"),
        (('type="box" size="0.05 0.03 0.02"', 'type="ellipsoid" size="0.05 0.03 0.02"'), "geom 'palm_box' is none of"),
        (('<joint name="right_bend"', '<joint name="x" axis="1 0 0"/><joint name="right_bend"'), "has several joints"),
        (('<geom name="palm_box"', '<joint name="turn"/><geom name="palm_box"'), "'palm' is the base and has a joint"),
        (("</mujoco>", ""), "gripper.xml: "),
    ],
)
def test_files_that_are_no_hand_are_refused(gripper: Path, change: tuple[str, str], message: str) -> None:
    assert change[0] in GRIPPER
    gripper.write_text(GRIPPER.replace(change[0], change[1], 1))
    with pytest.raises(HandError, match=message):
        urdf_of_mjcf(gripper)


def test_followers_of_followers_and_tendons_follow_the_leader(gripper: Path) -> None:
    """A tendon of constant length couples the hinge; it follows the slide that follows the other one."""
    text = GRIPPER.replace(
        "<equality>",
        '<tendon><fixed name="cord"><joint joint="right_slide" coef="10"/><joint joint="right_bend" coef="-1"/></fixed>'
        '</tendon><equality><tendon tendon1="cord"/>',
    )
    gripper.write_text(text.replace('polycoef="0 1 0 0 0"', 'polycoef="0.001 0.5 0 0 0"'))
    found = urdf_of_mjcf(gripper).text
    assert '<mimic joint="left_slide" multiplier="0.5" offset="0.001" />' in found
    assert '<mimic joint="left_slide" multiplier="5" offset="0.01" />' in found


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "graspbox", *words], capture_output=True, text=True, check=False)


def test_the_command_writes_both_files(gripper: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "hand"
    done = run("hand", "convert", str(gripper), "--out", str(out), "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["hand"] == "gripper"
    assert found["meshes"]["left_pad"]["shapes"] == ["box"]
    assert load_hand((out / "hand.urdf", out / "hand.toml")).name == "gripper"
    again = run("hand", "convert", str(gripper), "--out", str(out))
    assert (again.returncode, "--force" in again.stderr) == (2, True)
    missing = run("hand", "convert", str(tmp_path / "none.xml"), "--out", str(tmp_path / "other"))
    assert missing.returncode == 2
    assert "none.xml" in missing.stderr
    assert "Traceback" not in missing.stderr


@pytest.mark.slow
def test_hands_of_another_project_are_converted(tmp_path: Path) -> None:
    """Hands in the wheel of robosuite, which is downloaded: they load, and their checks find no error in them."""
    words = [
        sys.executable,
        "-m",
        "pip",
        "download",
        "--no-deps",
        "--quiet",
        "--dest",
        str(tmp_path),
        "robosuite>=1.5,<1.6",
    ]
    if subprocess.run(words, check=False).returncode:
        pytest.skip("the wheel of robosuite cannot be downloaded")
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path, [name for name in archive.namelist() if "/assets/grippers/" in name])
    grippers = tmp_path / "robosuite/models/assets/grippers"
    # Links of the Robotiq follow by equality constraints; the file of its 2F-85 is not valid MJCF by itself.
    expected = {"inspire_right_hand": 12, "fourier_right_hand": 11, "robotiq_gripper_140": 2, "panda_gripper": 2}
    for name, joints in expected.items():
        folder = tmp_path / name
        folder.mkdir()
        hand = converted(grippers / f"{name}.xml", folder)
        assert len(hand.joints) == joints
        report = check_hand(hand, trials=False)
        assert not report.has_errors, report.table()
    with pytest.raises(HandError, match="repeated name 'robotiq_arg2f_base_link' in mesh"):
        urdf_of_mjcf(grippers / "robotiq_gripper_85.xml")
