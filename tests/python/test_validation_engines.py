"""Labels of the engines `implicit` and `rapier` compared."""

import json

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the poses come from the comparison with MuJoCo, from the extra 'dev'")

import graspbox
from graspbox.configs import PhysicsConfig
from validate import main
from validation import engines
from validation.agreement import kappa
from validation.mujoco import sample_trials

OBJECTS = ("can", "box", "mug", "bottle", "ball", "hammer")


def test_both_engines_give_most_grasps_the_same_label() -> None:
    """60 poses, chosen at random among the planner's of six objects: at least 85 % equal, kappa at least 0.6."""
    labels: dict[str, list[bool]] = {"implicit": [], "rapier": []}
    for number, family in enumerate(OBJECTS):
        rest = graspbox.Scene(graspbox.object_sets.load(f"procedural:{family}:1")[0].load())
        sampled = sample_trials(rest, 10, np.random.default_rng([0, number]), "planner-any")
        assert sampled is not None
        for engine, found in labels.items():
            physics = PhysicsConfig(engine=engine)  # type: ignore[arg-type]
            scene = graspbox.Scene(rest.mesh, world_from_object=rest.world_from_object, physics=physics)
            found += scene.simulate(*sampled).success.tolist()
    ours, rapier = (np.array(found) for found in labels.values())
    assert 0 < ours.sum() < len(ours)
    equal = float(np.mean(ours == rapier))
    assert equal >= 0.85
    assert kappa(ours, rapier) >= 0.6


LAYOUT = (
    "engines",
    "--layout",
    "packed",
    "--hand",
    "panda_gripper",
    "--poses",
    "1",
    "--scenes",
    "1",
    "--count",
    "3",
    "--seed",
    "1",
)


def test_scenes_of_several_objects_are_compared_at_half_the_time_step(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each object is the target of one trial, in a scene with the others, at both time steps."""
    tried: list[tuple[int, int | None, float]] = []

    class Spy(graspbox.Scene):
        @classmethod
        def of(cls, scene, *, target=None, **others):  # type: ignore[no-untyped-def]
            tried.append((len(scene.world_from_objects), target, others["physics"].dt))
            return super().of(scene, target=target, **others)

    monkeypatch.setattr(graspbox, "Scene", Spy)
    assert main([*LAYOUT, "--engines", "implicit", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    whole = PhysicsConfig().dt
    of_a_scene = tried[0][0]
    assert of_a_scene > 1
    assert {dt for _, _, dt in tried} == {whole, whole / 2}
    assert [(count, target) for count, target, dt in tried if dt == whole] == [
        (of_a_scene, i) for i in range(of_a_scene)
    ]
    assert {row["name"]: row["trials"] for row in found["engines"]} == {
        "implicit": of_a_scene,
        "implicit, half dt": of_a_scene,
    }
    pairs = [(pair["first"], pair["second"]) for pair in found["agreements"]]
    assert pairs == [("implicit", "implicit, half dt")]


def test_what_cannot_be_compared_is_refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The hand's mimicking fingers are beyond `rapier`; counts begin at 1; scenes without a pose compare nothing."""
    assert main([*LAYOUT, "--engines", "rapier"]) == 2
    assert "rapier" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*LAYOUT, "--scenes", "0"])
    assert "--scenes is 0; give 1 or more" in capsys.readouterr().err
    monkeypatch.setattr(engines, "targets", lambda *_: iter(()))
    assert main([*LAYOUT, "--engines", "implicit"]) == 2
    assert "no object has a feasible pose" in capsys.readouterr().err
