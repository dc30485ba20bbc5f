"""The core's environments in Python: arrays, buffers, errors, states, forks.

``tests/rust`` tests their behaviour.
"""

import os
import signal
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from acting import ACTING, EACH
from graspbox import _core, errors

NUM_ENVS = 3
FLAGS = ("terminated", "truncated", "reset")


@pytest.fixture(scope="module")
def objects() -> _core.Objects:
    names = ("box", "can", "ball")
    sources = [{"name": name, "family": name, "seed": 0} for name in names]
    return _core.Objects(sources, _core.Hand.named("reflex"), {}, None)


def make(objects: _core.Objects, num_envs: int = NUM_ENVS, **config: Any) -> _core.EnvPool:
    return _core.EnvPool(objects, {**EACH, **config}, num_envs, None)


def actions(seed: int, num_envs: int = NUM_ENVS, size: int = 10) -> Iterator[np.ndarray[Any, Any]]:
    rng = np.random.default_rng(seed)
    while True:
        yield rng.uniform(-1, 1, (num_envs, size)).astype(np.float32)


def flat(arrays: Any) -> dict[str, np.ndarray[Any, Any]]:
    """All arrays in one dictionary, the info's among them."""
    return {**{name: array for name, array in arrays.items() if name != "info"}, **arrays["info"]}


def tables() -> Any:
    return _core.env_tables(_core.Hand.named("reflex"))


@pytest.mark.parametrize(("control", "fingers"), ACTING)
def test_arrays_are_as_the_tables_say(objects: _core.Objects, control: str, fingers: str) -> None:
    table = tables()
    assert objects.names == ["box", "can", "ball"]
    assert len(objects) == 3
    size = sum(row["size"] for row in table["actions"][control][fingers])
    assert size == {"target_pose": 9, "top_down": 4}.get(control, 6) + (2 if fingers == "synergy" else 4)
    pool = make(objects, control=control, fingers=fingers)
    first = pool.reset([1, 2, 3])
    assert first["reset"].all()
    assert not first["terms"].any()
    stepped, last = pool.step(np.zeros((NUM_ENVS, size), np.float32))
    assert last is None
    for arrays in (first, stepped):
        for name, rows in table["observations"][control][fingers].items():
            low, high = (np.concatenate([np.full(row["size"], row[end]) for row in rows]) for end in ("low", "high"))
            values: np.ndarray[Any, Any] = arrays[name]  # type: ignore[literal-required]
            assert values.dtype == np.float32
            assert values.shape == (NUM_ENVS, len(low))
            assert (values >= low.astype(np.float32)).all()
            assert (values <= high.astype(np.float32)).all()
        assert arrays["terms"].shape == (NUM_ENVS, len(table["terms"]))
        assert all(arrays[name].dtype == bool and arrays[name].shape == (NUM_ENVS,) for name in FLAGS)  # type: ignore[literal-required]
        assert arrays["env"].tolist() == [0, 1, 2]
        entries = {row["name"]: row for row in table["info"]}
        assert list(arrays["info"]) == list(entries)
        for name, values in arrays["info"].items():
            dtype = "int64" if entries[name]["names"] else entries[name]["dtype"]
            assert (values.dtype.name, values.shape) == (dtype, (NUM_ENVS,)), name
        kind = "" if arrays["reset"].all() else "no_contact"
        assert all(table["failures"][code] == kind for code in arrays["info"]["failure"])
    assert table["privileged"] == ["state"]
    make(objects, randomization=table["randomization"]["standard"])
    object_from, hand, believed = pool.poses()
    assert object_from.shape == hand.shape == (NUM_ENVS, 4, 4)
    np.testing.assert_allclose(hand, believed, atol=1e-12)


def test_arrays_are_fresh_or_the_callers_own(objects: _core.Objects) -> None:
    pool = make(objects, observations=["proprio", "state"])
    sampled = actions(0)
    first = pool.reset([0, 1, 2])
    assert "tactile" not in first
    kept = {name: array.copy() for name, array in flat(first).items()}
    pool.step(next(sampled))
    for name, array in kept.items():
        np.testing.assert_array_equal(array, flat(first)[name])
    out = {"state": np.zeros_like(first["state"])}
    stepped, _ = pool.step(next(sampled), out)
    assert stepped["state"] is out["state"]
    assert stepped["proprio"] is not first["proprio"]
    np.testing.assert_array_equal(out["state"], pool.now()["state"])
    for wrong in (np.zeros((NUM_ENVS, 3), np.float32), np.asfortranarray(out["state"])):
        with pytest.raises(errors.ConfigError, match="state"):
            pool.step(next(sampled), {"state": wrong})


def test_one_environment_is_like_one_of_many(objects: _core.Objects) -> None:
    config: dict[str, Any] = {"max_episode_steps": 12, "autoreset": "same_step"}
    many = make(objects, **config)
    single = [make(objects, 1, **config) for _ in range(NUM_ENVS)]
    many.reset([7, 8, 9])
    for i, pool in enumerate(single):
        pool.reset([7 + i])
    ended = 0
    for action, _ in zip(actions(1), range(30), strict=False):
        together, last = many.step(action)
        ended += 0 if last is None else len(last["env"])
        for i, pool in enumerate(single):
            alone, own = pool.step(action[i : i + 1])
            assert (own is None) == (last is None or i not in last["env"])
            for name, array in flat(alone).items():
                if name != "env":
                    np.testing.assert_array_equal(array[0], flat(together)[name][i], name)
    assert ended >= 2 * NUM_ENVS


def test_environments_come_back_as_they_arrive(objects: _core.Objects) -> None:
    whole, apart = make(objects), make(objects)
    whole.reset([0, 1, 2])
    apart.reset([0, 1, 2])
    for action, _ in zip(actions(2), range(8), strict=False):
        expected, _ = whole.step(action)
        apart.send(action, [0, 1, 2])
        with pytest.raises(errors.ConfigError, match="still stepping"):
            apart.step(action)
        seen = []
        for count in (2, 1):
            rows, _ = apart.recv(count)
            for row, env in enumerate(rows["env"]):
                np.testing.assert_array_equal(rows["state"][row], expected["state"][env])
                seen.append(int(env))
        assert sorted(seen) == [0, 1, 2]
    with pytest.raises(errors.ConfigError, match="0 steps are pending"):
        apart.recv(1)


def test_an_interrupt_calls_back_what_was_sent(objects: _core.Objects) -> None:
    """Once, `recv` looked for signals only while nothing arrived, and everything that was sent was stepped."""
    count = 4000
    pool, other = (_core.EnvPool(objects, {"fingers": "each"}, count, 1) for _ in range(2))
    pool.reset(list(range(count)))
    first = pool.now()["state"].copy()
    still = np.zeros((count, 10), np.float32)
    pool.send(still, list(range(count)))

    def receive() -> None:
        threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
        pool.recv(count)

    with pytest.raises(KeyboardInterrupt):
        receive()
    # One environment may still be stepping; the others are here, or can be received. All of them would be far more.
    stepped = []
    while True:
        try:
            stepped += pool.recv(1)[0]["env"].tolist()
        except errors.ConfigError:
            break
    assert 0 < len(stepped) < count / 2
    rest = np.setdiff1d(np.arange(count), stepped)
    np.testing.assert_array_equal(pool.now()["state"][rest], first[rest])
    # The environments that stayed step as if they had never been sent.
    chosen = rest[-2:].tolist()
    other.reset(list(range(count)))
    for each in (pool, other):
        each.send(still[:2], chosen)
    ours, theirs = ({int(env): row for env, row in zip(a["env"], a["state"], strict=True)} for a in (
        pool.recv(2)[0], other.recv(2)[0]))  # fmt: skip
    assert ours.keys() == theirs.keys() == set(chosen)
    for env in chosen:
        np.testing.assert_array_equal(ours[env], theirs[env])


def test_the_number_of_environments_is_bounded(objects: _core.Objects) -> None:
    """Once, a billion environments aborted the process."""
    for count in (0, 65_537, 10**9):
        with pytest.raises(errors.ConfigError, match=r"num_envs.*between 1 and 65536"):
            make(objects, count)


def half_broken() -> _core.Objects:
    """Return a box, and an object whose file does not exist."""
    sources: list[dict[str, Any]] = [
        {"name": "box", "family": "box", "seed": 0},
        {"name": "gone", "path": "/no/such/file.stl"},
    ]
    return _core.Objects(sources, _core.Hand.named("reflex"), {}, None)


def seeds_of(objects: _core.Objects, count: int, *, breaks: bool) -> list[int]:
    """Find seeds whose first episode has the box, and whose second has it too, or the object that cannot be read."""
    found = []
    for seed in range(1000):
        pool = make(objects, 1)
        try:
            pool.reset([seed])
        except errors.FileError:
            continue
        try:
            pool.reset()
        except errors.FileError:
            found += [seed] if breaks else []
        else:
            found += [] if breaks else [seed]
        if len(found) == count:
            break
    return found


@pytest.mark.parametrize("mode", ["same_step", "next_step"])
def test_an_episode_that_cannot_begin_is_tried_again(mode: str) -> None:
    """The call that draws it raises; the next one begins an episode, and does not go on with the old one."""
    objects = half_broken()
    pool = make(objects, 1, autoreset=mode, max_episode_steps=2)
    pool.reset(seeds_of(objects, 1, breaks=True))
    still = np.zeros((1, 10), np.float32)
    pool.step(still)
    if mode == "next_step":
        assert pool.step(still)[0]["truncated"].all()
    with pytest.raises(errors.FileError, match=r"file\.stl"):
        pool.step(still)
    for _ in range(20):
        try:
            now, _ = pool.step(still)
        except errors.FileError:
            continue
        break
    assert now["reset"].all()
    assert not now["terms"].any()
    assert not pool.step(still)[0]["reset"].any()


def test_an_error_on_the_way_leaves_the_others_to_the_next_call() -> None:
    objects = half_broken()
    pool = make(objects, 3, autoreset="same_step", max_episode_steps=1)
    good, bad = seeds_of(objects, 2, breaks=False), seeds_of(objects, 1, breaks=True)
    pool.reset([good[0], bad[0], good[1]])
    pool.send(np.zeros((3, 10), np.float32), [0, 1, 2])
    arrived: list[int] = []
    failed = 0
    while len(arrived) < 2:
        try:
            now, _ = pool.recv(2 if not failed else 2 - len(arrived))
        except errors.FileError:
            failed += 1
        else:
            arrived += now["env"].tolist()
            if not failed:
                # It arrives last, and alone.
                with pytest.raises(errors.FileError):
                    pool.recv(1)
                failed += 1
    assert failed == 1
    assert sorted(arrived) == [0, 2]
    with pytest.raises(errors.ConfigError, match="0 steps are pending"):
        pool.recv(1)


def test_a_state_crosses_as_bytes(objects: _core.Objects) -> None:
    pool, other = make(objects), make(objects)
    pool.reset([4, 5, 6])
    sampled = actions(3)
    for _ in range(5):
        pool.step(next(sampled))
    for env in range(NUM_ENVS):
        other.set_state(env, pool.get_state(env))
    for _ in range(5):
        action = next(sampled)
        np.testing.assert_array_equal(pool.step(action)[0]["state"], other.step(action)[0]["state"])
    with pytest.raises(errors.ConfigError, match="state"):
        pool.set_state(0, b"nonsense")


def test_errors_name_what_is_wrong(objects: _core.Objects) -> None:
    hand = _core.Hand.named("reflex")
    for source, match in (
        ({"name": "x"}, "path, or a family"),
        ({"name": "x", "family": "box", "seed": 0, "scale": -1}, "scale"),
        ({"name": "x", "colour": 1}, "colour"),
    ):
        with pytest.raises(errors.ConfigError, match=match):
            _core.Objects([source], hand, {}, None)
    with pytest.raises(errors.ConfigError, match="empty"):
        _core.Objects([], hand, {}, None)
    missing = _core.Objects([{"name": "gone", "path": "/no/such/file.stl"}], hand, {}, None)
    with pytest.raises(errors.FileError):
        make(missing, 1).reset([0])
    for config, match in (({"control": "thought"}, "thought"), ({"max_episode_steps": 0}, "max_episode_steps")):
        with pytest.raises(errors.ConfigError, match=match):
            make(objects, **config)
    pool = make(objects)
    zeros = np.zeros((NUM_ENVS, 10), np.float32)
    with pytest.raises(errors.ConfigError, match="reset"):
        pool.step(zeros)
    with pytest.raises(errors.ConfigError, match="seed"):
        pool.reset()
    with pytest.raises(errors.ConfigError, match='"sphere"'):
        pool.reset([0, 0, 0], None, [{"object": "sphere"}])
    pool.reset([0, 0, 0])
    bad = zeros.copy()
    bad[1, 3] = np.nan
    with pytest.raises(errors.ConfigError, match="environment 1"):
        pool.step(bad)
    with pytest.raises(errors.ConfigError, match="shape"):
        pool.step(zeros[:, :9])
    with pytest.raises(errors.ConfigError, match="mask"):
        pool.reset(None, np.ones(5, bool))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_child_steps_on(objects: _core.Objects) -> None:
    """A child that was forked after a rollout has none of its parent's threads."""
    pool = make(objects)
    pool.reset([0, 1, 2])
    sampled = actions(4)
    pool.step(next(sampled))
    state = pool.get_state(0)
    action = next(sampled)
    expected = pool.step(action)[0]["state"][0]
    read, write = os.pipe()
    if (child := os.fork()) == 0:
        pool.set_state(0, state)
        os.write(write, pool.step(action)[0]["state"][0].tobytes())
        os._exit(0)
    os.waitpid(child, 0)
    assert os.read(read, 1 << 16) == expected.tobytes()
