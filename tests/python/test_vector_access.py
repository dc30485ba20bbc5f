"""The native vector environment takes seeds, options, attributes and methods per environment."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

from acting import CAMERAS, EACH, OBJECTS
from graspbox import errors
from test_vector_env import ID, make, make_sync


def test_options_of_each_environment() -> None:
    """They replace those for all; a mask leaves the others alone; each start is that of a single environment."""
    env = make(3)
    _, info = env.reset(
        seed=4, options={"friction": 0.5, "each": [{"object": 1}, None, {"object": 4, "friction": 2.0}]}
    )
    given: list[dict[str, Any]] = [{"object": 1, "friction": 0.5}, {"friction": 0.5}, {"object": 4, "friction": 2.0}]
    shown = [env.get_state(i) for i in range(3)]
    single: Any = gymnasium.make(ID, objects=OBJECTS, reward="dense", cameras=CAMERAS, **EACH).unwrapped
    for i, options in enumerate(given):
        _, theirs = single.reset(seed=4 + i, options=options)
        assert info["object"][i] == theirs["object"]
        assert single.get_state() == shown[i]
    mask = np.array([False, True, False])
    options = {"each": [{"object": 0}, {"object": 2}, {"object": 0}], "reset_mask": mask}
    _, info = env.reset(seed=9, options=options)
    assert "each" in options
    assert info["object"].tolist() == [None, env.objects.names[2], None]
    assert [env.get_state(i) == shown[i] for i in range(3)] == [True, False, True]
    wrong_ones: list[Any] = [[{}], {"object": 0}, "abc", 3]
    for wrong in wrong_ones:
        with pytest.raises(errors.ConfigError, match="sequence of 3"):
            env.reset(options={"each": wrong})
    with pytest.raises(errors.ConfigError, match="no object"):
        env.reset(options={"each": [{}, {"object": "moon"}, {}]})


def test_options_of_the_wrong_type_are_named() -> None:
    """A list of options, one for each environment, was once a ValueError of Python's ``dict``."""
    env: Any = gymnasium.make_vec(ID, num_envs=2, objects=OBJECTS)
    with pytest.raises(errors.ConfigError, match=r"options is \[.*\] \(list\); give a dictionary .*options\['each'\]"):
        env.reset(options=[{"object": 0}, {"object": 1}])
    with pytest.raises(errors.ConfigError, match=r"options\['each'\]\[1\] is 3 \(int\); give a dictionary"):
        env.reset(options={"each": [None, 3]})
    single = gymnasium.make(ID, objects=OBJECTS).unwrapped
    with pytest.raises(errors.ConfigError, match=r"options is 'mug' \(str\); give a dictionary"):
        single.reset(options="mug")  # type: ignore[arg-type]


def test_attributes_and_methods_as_sync_has_them() -> None:
    native, sync = make(2, render_mode="rgb_array", obs="state"), make_sync(AutoresetMode.NEXT_STEP, 2, obs="state")
    native.reset(seed=1)
    sync.reset(seed=1)
    for name in ("render_mode", "observation_space", "action_space", "np_random_seed"):
        expected = ("rgb_array",) * 2 if name == "render_mode" else sync.get_attr(name)
        assert native.get_attr(name) == expected
    assert native.get_attr("objects")[0].names == sync.get_attr("objects")[0].names
    states = native.call("get_state")
    assert [len(state) for state in states] == [len(state) for state in sync.call("get_state")]
    assert data_equivalence(native.call("cameras"), sync.call("cameras"), exact=True)
    np.testing.assert_array_equal(np.stack(native.call("render")), np.stack(native.render()))
    native.call("set_state", states[0])
    assert native.call("get_state") == (states[0], states[0])
    for env in (native, sync):
        env.set_attr("level", [3, 4])
        assert env.get_attr("level") == (3, 4)
        env.set_attr("level", 5)
        assert env.get_attr("level") == env.call("level") == (5, 5)
        with pytest.raises(ValueError, match="2"):
            env.set_attr("level", [1, 2, 3])
        with pytest.raises(AttributeError):
            env.get_attr("moon")
    with pytest.raises(errors.ConfigError, match="'render_mode' is shared"):
        native.set_attr("render_mode", None)


@pytest.mark.parametrize("seed", [1.5, "1", [0, 1.5, 2], [0, None, "2"], -1, [0, -1, 2], 2**64])
def test_what_is_no_seed_is_refused(seed: Any) -> None:
    env = make()
    env.reset(seed=0)
    before = env.get_state(0)
    with pytest.raises(errors.ConfigError, match="seed is"):
        env.reset(seed=seed)
    assert env.get_state(0) == before


def test_seeds_of_numpy_are_seeds() -> None:
    env = make()
    first = env.reset(seed=3)
    for seed in (np.int64(3), np.uint32(3), np.array([3, 4, 5]), [np.int32(3), 4, np.uint8(5)]):
        assert data_equivalence(env.reset(seed=seed), first, exact=True)
        assert env.np_random_seed == (3, 4, 5)
