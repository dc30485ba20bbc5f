"""Specs of environments: pickled, copied, written as JSON, and made into environments again."""

import copy
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AsyncVectorEnv

import graspbox
from acting import CAMERAS, OBJECTS
from graspbox import errors
from graspbox.envs import IDS

FILES = graspbox.load_hand("reflex").files
SETTINGS: dict[str, Any] = {
    "objects": OBJECTS,
    "cameras": CAMERAS,
    "randomization": graspbox.Randomization.standard(),
    "success": graspbox.SuccessCriterion(hold_time=0.25),
    "physics": graspbox.PhysicsConfig(friction=graspbox.FrictionConfig(table=0.4)),
}


def pickled(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))


def cloudpickled(value: Any) -> Any:
    cloudpickle = pytest.importorskip("cloudpickle")
    return cloudpickle.loads(cloudpickle.dumps(value))


def through_json(spec: Any) -> EnvSpec:
    return EnvSpec.from_json(spec.to_json())


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """Write the two files of a hand."""
    folder: Path = tmp_path_factory.mktemp("hand")
    paths = (folder / "hand.urdf", folder / "hand.toml")
    for path, text in zip(paths, FILES, strict=True):
        path.write_text(text)
    return str(paths[0]), str(paths[1])


def same_start(first: Any, second: Any) -> None:
    assert data_equivalence(first.reset(seed=3), second.reset(seed=3), exact=True)


@pytest.mark.parametrize("id_", IDS)
@pytest.mark.parametrize("way", [pickled, copy.deepcopy, cloudpickled, through_json], ids=lambda way: way.__name__)
@pytest.mark.parametrize("kind", ["name", "object", "files"])
def test_a_spec_makes_the_environment_again(
    id_: str, way: Callable[[Any], Any], kind: str, hand: tuple[str, str]
) -> None:
    given = {"name": "reflex", "object": graspbox.load_hand(hand), "files": hand}[kind]
    env = gymnasium.make(id_, hand=given, obs=("state", "depth"), **SETTINGS)
    if way is through_json and kind == "object":
        # JSON cannot hold objects; the documentation says to give names or files.
        with pytest.raises(TypeError, match="Hand is not JSON serializable"):
            way(env.spec)
        return
    same_start(env, gymnasium.make(way(env.spec)))


def test_a_spec_of_a_vector_environment_makes_it_again(hand: tuple[str, str]) -> None:
    envs = gymnasium.make_vec(IDS[1], 2, hand=graspbox.load_hand(hand), **SETTINGS)
    same_start(envs, gymnasium.make_vec(pickled(envs.spec)))


@pytest.mark.parametrize("context", ["spawn", "forkserver"])
def test_async_environments_take_a_hand(context: str, hand: tuple[str, str]) -> None:
    """Gymnasium sends the functions to fresh processes by cloudpickle, the hand with them."""
    loaded = graspbox.load_hand(hand)
    makers = [lambda: gymnasium.make(f"graspbox:{IDS[1]}", objects=OBJECTS, hand=loaded)] * 2
    envs = AsyncVectorEnv(makers, context=context)
    try:
        observations, _ = envs.reset(seed=3)
    finally:
        envs.close()
    for i, observation in enumerate(observations):
        np.testing.assert_array_equal(observation, makers[0]().reset(seed=3 + i)[0])


@pytest.mark.parametrize("context", ["spawn", "forkserver"])
def test_workers_know_the_ids(context: str) -> None:
    """The functions name nothing of graspbox but the id; "Namespace graspbox not found" was the workers' answer."""
    id_, objects = IDS[1], OBJECTS
    envs = AsyncVectorEnv([lambda: gymnasium.make(id_, objects=objects)] * 2, context=context)
    try:
        observations, _ = envs.reset(seed=3)
    finally:
        envs.close()
    np.testing.assert_array_equal(observations[1], gymnasium.make(id_, objects=objects).reset(seed=4)[0])


def test_dictionaries_are_configs() -> None:
    cameras = {"image_size": [24, 32], "cameras": [{"name": "top", "eye": [0, 0, 0.8], "up": [1, 0, 0]}]}
    env = gymnasium.make(IDS[1], objects=OBJECTS, obs="depth_top", cameras=cameras)
    assert env.observation_space.shape == (24, 32, 1)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"cameras": {"image_sice": 3}}, "cameras has no field 'image_sice'; did you mean 'image_size'?"),
        ({"cameras": {"cameras": [{"shape": 3}]}}, r"cameras.cameras\[0\] has no field 'shape'"),
        ({"cameras": {"voxels": -1}}, "voxels"),
        (
            {"physics": {"friction": {"floor": 1}}},
            "physics.friction has no field .floor.; its fields are table",
        ),
        ({"cameras": "front"}, r"cameras is 'front' \(str\); give a CamerasConfig, or a dictionary"),
        ({"physics": None}, r"physics is None \(NoneType\); give a PhysicsConfig"),
        ({"success": 0.1}, r"success is 0.1 \(float\); give a SuccessCriterion"),
        ({"randomization": 3}, r"randomization is 3 \(int\); give a Randomization"),
        ({"randomization": "wild"}, "randomization is 'wild'; give None, 'standard' or a Randomization"),
    ],
)
def test_what_is_no_config_is_named(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(errors.ConfigError, match=message):
        gymnasium.make(IDS[1], objects=OBJECTS, **settings)
