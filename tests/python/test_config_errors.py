"""Configs: numpy's numbers are accepted in every field, and messages name the field, its value and the accepted ones.

The cases of numpy are made from the dataclasses, so that a new config or field is covered by itself; those of bad
values of every field are in ``tests/rust/configs.rs``.
"""

import types
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import gymnasium as gym
import numpy as np
import pytest

import graspbox
from graspbox import configs, errors
from graspbox._common.arguments import config_dict, floats

BOX = "procedural:box:0"
CONFIGS: list[Any] = [kind for name in configs.__all__ if isinstance(kind := getattr(configs, name), type)]
NUMPY: dict[type, tuple[Callable[[Any], Any], ...]] = {
    int: (np.int64, np.int32, np.uint8, np.asarray),
    float: (np.float64, np.float32, np.float16, np.longdouble, np.asarray),
    bool: (np.bool_, np.asarray),
    str: (np.str_,),
}


def read(config: Any) -> Any:
    """Return the fields of a config as they cross."""
    return config_dict(config)


def use(config: Any) -> None:
    """Call a function of the core that takes a config."""
    mesh = graspbox.object_sets.load(BOX)[0].load()
    match config:
        case configs.PlanConfig():
            graspbox.plan(mesh, config=config)
        case configs.TrialConfig():
            graspbox.Scene(mesh).simulate(np.eye(4)[None], 0.0, config=config)
        case configs.PhysicsConfig():
            graspbox.Scene(mesh, physics=config)
        case configs.CamerasConfig():
            gym.make("graspbox/Grasp-v0", objects=BOX, obs="depth", cameras=config)
        case _:
            raise AssertionError(config)


def kinds(hint: Any) -> tuple[Any, ...]:
    """Name the alternatives of a type: those of a union, else itself."""
    return get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)


def numpy_cases() -> Iterator[Any]:
    for config in CONFIGS:
        hints = get_type_hints(config)
        for field in fields(config):
            value = getattr(config(), field.name)
            makers: list[Callable[[Any], Any]] = []
            for kind in kinds(hints[field.name]):
                makers += NUMPY.get(kind, NUMPY[str] if get_origin(kind) is Literal else ())
                if get_origin(kind) is tuple and value and not is_dataclass(value[0]):
                    makers += [np.asarray, lambda v: tuple(np.asarray(v)), list]
            if value is None:  # of the text alone, the layout
                value = "packed" if str in kinds(hints[field.name]) else 1.0 if float in kinds(hints[field.name]) else 1
            for i, maker in enumerate(makers):
                yield pytest.param(config, field.name, maker, value, id=f"{config.__name__}.{field.name}-{i}")


@pytest.mark.parametrize(("config", "name", "maker", "value"), list(numpy_cases()))
def test_numpy_values_cross(config: Any, name: str, maker: Callable[[Any], Any], value: Any) -> None:
    if isinstance(value, int) and not isinstance(value, bool):
        value = min(value, 100)
    if isinstance(value, float):
        value = min(value, 6e4)  # half precision ends at 65,504
    given = read(replace(config(), **{name: maker(value)}))[name]
    plain = read(replace(config(), **{name: value}))[name]
    # Half precision rounds 5e-7 to 4.8e-7.
    assert type(given) is type(plain)
    assert given == (pytest.approx(plain, rel=0.1) if isinstance(plain, float) else plain)


def test_there_are_cases_for_every_field() -> None:
    count = sum(len(fields(config)) for config in CONFIGS)
    assert len(list(numpy_cases())) > 2 * count


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (configs.TrialConfig(standoff="x"), "TrialConfig.standoff is 'x' (str); give a number"),  # type: ignore[arg-type]
        (
            configs.PlanConfig(decompose=configs.DecomposeConfig(area_gain=None)),  # type: ignore[arg-type]
            "PlanConfig.decompose.area_gain is None; give a number",
        ),
        (
            configs.PlanConfig(poses=configs.PoseConfig(standoffs=(0.01, "far"))),  # type: ignore[arg-type]
            "PlanConfig.poses.standoffs[1] is 'far' (str); give a number",
        ),
        (
            configs.CamerasConfig(cameras=(configs.CameraConfig(mount="wall"),)),  # type: ignore[arg-type]
            "mount is 'wall' (str); give 'world' or 'hand'",
        ),
        (
            configs.PhysicsConfig(engine="mujoco"),  # type: ignore[arg-type]
            "PhysicsConfig.engine is 'mujoco' (str); give 'implicit' or 'rapier'",
        ),
        (
            configs.PhysicsConfig(engine="graspbox"),  # type: ignore[arg-type]
            "PhysicsConfig.engine is 'graspbox' (str); give 'implicit' or 'rapier'",
        ),
        (
            configs.CamerasConfig(cameras=(configs.CameraConfig(eye=(0.0, 1.0)),)),  # type: ignore[arg-type]
            "eye is [0.0,1.0] (list); give a list of 3 values",
        ),
        (
            configs.PlanConfig(decompose=configs.PoseConfig()),  # type: ignore[arg-type]
            "give a DecomposeConfig",
        ),
        (
            configs.CamerasConfig(cameras=(configs.PoseConfig(),)),  # type: ignore[arg-type]
            "CamerasConfig.cameras[0] is PoseConfig(",
        ),
        (configs.PlanConfig(seed=1.5), "PlanConfig.seed is 1.5 (float); give an integer that is not negative"),  # type: ignore[arg-type]
        (
            configs.CamerasConfig(cameras=(configs.CameraConfig(name="\udcff"),)),
            "name is '\\udcff' (str); give valid Unicode text",
        ),
    ],
)
def test_messages(config: Any, message: str) -> None:
    with pytest.raises(errors.ConfigError) as caught:
        use(config)
    assert message in str(caught.value)


def test_configs_of_another_class_are_refused() -> None:
    mesh = graspbox.object_sets.load("procedural:box:0")[0].load()
    wrong: Any = {"seed": 1}
    with pytest.raises(errors.ConfigError, match=r"config is \{'seed': 1\} \(dict\); give a PlanConfig"):
        graspbox.plan(mesh, config=wrong)
    with pytest.raises(errors.ConfigError, match="give a DecomposeConfig"):
        graspbox.decompose(mesh, wrong)
    with pytest.raises(errors.ConfigError, match=r"physics is None \(NoneType\); give a PhysicsConfig"):
        graspbox.Scene(mesh, physics=None)  # type: ignore[arg-type]
    with pytest.raises(errors.ConfigError, match="give a TrialConfig"):
        graspbox.Scene(mesh).simulate(np.eye(4)[None], 0.0, config=wrong)


def test_numpy_arguments() -> None:
    mesh = graspbox.object_sets.load("procedural:box:0")[0].load()
    plan = graspbox.plan(mesh, seed=np.int64(3), num_threads=np.int64(1))  # type: ignore[arg-type]
    np.testing.assert_array_equal(plan.poses, graspbox.plan(mesh, seed=3).poses)
    with pytest.raises(errors.ConfigError, match=r"PlanConfig\.seed is 3\.0 \(float\)"):
        graspbox.plan(mesh, seed=3.0)  # type: ignore[arg-type]


def test_numpy_arguments_of_views() -> None:
    mesh = graspbox.object_sets.load("procedural:box:0")[0].load()
    given: dict[str, Any] = {
        "count": np.int64(2),
        "seed": np.uint8(4),
        "image_size": np.array([8, 12]),
        "fov": np.float32(0.5),
        "near": np.float64(0.02),
        "far": np.asarray(5.0),
        "table": np.bool_(True),
        "images": "rgb",
    }
    seen = graspbox.views(mesh, **given)
    assert seen.rgb is not None
    assert seen.rgb.shape == (2, 8, 12, 3)
    assert graspbox.views(mesh, count=1, image_size=np.int32(8)).depth.shape == (1, 8, 8)  # type: ignore[arg-type]
    for name, value in {"fov": "x", "near": None, "count": 1.5, "image_size": [8], "far": float("nan")}.items():
        with pytest.raises(errors.ConfigError, match=rf"views\.{name} is "):
            graspbox.views(mesh, **{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", [1.5, "1", -1, 2**64])
def test_bad_seeds_of_resets_are_named(seed: Any) -> None:
    env = gym.make("graspbox/GraspPose-v0", objects=BOX).unwrapped

    with pytest.raises(errors.ConfigError, match="seed is "):
        env.reset(seed=seed)
    env.reset(seed=np.int64(3))  # type: ignore[arg-type]
    with pytest.raises(errors.ConfigError, match=r"reset options\.place\[0\] is nan"):
        env.reset(options={"place": [float("nan"), 0.0, 0.0]})


@pytest.mark.parametrize("value", [-1, 0, 1025, 10**30, 2.5, "x", [1]])
def test_bad_num_threads_is_named(value: Any) -> None:
    mesh = graspbox.object_sets.load("procedural:box:0")[0].load()
    scene = graspbox.Scene(mesh)
    calls: list[Callable[[], Any]] = [
        lambda: graspbox.plan(mesh, num_threads=value),
        lambda: scene.simulate(np.eye(4)[None], 0.0, num_threads=value),
        lambda: graspbox.views(mesh, count=1, image_size=(8, 8), num_threads=value),
    ]
    for call in calls:
        with pytest.raises(errors.ConfigError, match="num_threads is"):
            call()


@pytest.mark.parametrize("value", ["x", [["x"]], [[1.0], [1.0, 2.0]], None, {"a": 1}, 1j])
def test_arrays_that_are_no_numbers_are_named(value: Any) -> None:
    with pytest.raises(errors.ConfigError, match=r"poses is .*; give an array of numbers"):
        floats(value, "poses")
