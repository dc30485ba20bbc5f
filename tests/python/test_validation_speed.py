"""``python tests/validate.py speed``: rates of the engines on the same trials."""

import json

import pytest

pytest.importorskip("mujoco")

from validate import main
from validation import speed


def rates(capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, dict[str, float]]:
    assert main(["speed", *options, "--poses", "1", "--json"]) == 0
    return {row["engine"]: row for row in json.loads(capsys.readouterr().out)}


def test_all_engines_simulate_the_same_seconds(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each engine runs the pose of the can, MuJoCo for as long as `implicit` did."""
    monkeypatch.setitem(speed.WORK, "procedural mix", ("procedural:can:0",))
    found = rates(capsys, "--work", "procedural mix")
    assert set(found) == set(speed.ENGINES)
    assert all(row["trials"] == 1 and row["trials/s"] > 0 for row in found.values())
    assert found["mujoco"]["simulated"] == pytest.approx(found["implicit"]["simulated"], abs=0.01)


def test_hand_beyond_an_engine_has_no_rate(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The fingers of the Franka hand mimic each other, which rapier cannot simulate: a row without trials."""
    monkeypatch.setitem(speed.WORK, "procedural mix", ("procedural:can:0",))
    found = rates(capsys, "--work", "procedural mix", "--hand", "panda_gripper")
    assert found["implicit"]["trials"] == found["mujoco"]["trials"] == 1
    assert found["rapier"]["trials"] == 0
    timed = speed.SpeedRow("some", "implicit", 1, 2.0, 0.5), speed.SpeedRow("some", "mujoco, fast", 1, 2.0, 1.0)
    table = speed.markdown([*timed, speed.SpeedRow("some", "rapier")])
    assert "| some | rapier | 0 | - | - | - |" in table
    assert "| some | implicit | 1 | 2.0 | 4 | 2.00 |" in table


def test_scenes_of_several_objects_are_timed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each object of a packed scene is the target of one trial; MuJoCo has all of them, too."""
    monkeypatch.setattr(speed, "SCENES", 1)
    monkeypatch.setitem(speed.HEAPS, "5 packed", ("packed", 2))
    found = rates(capsys, "--work", "5 packed", "--hand", "panda_gripper")
    assert 1 <= found["implicit"]["trials"] <= 2
    assert found["mujoco"]["simulated"] == pytest.approx(found["implicit"]["simulated"], abs=0.02)
