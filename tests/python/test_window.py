"""``render_mode="human"``: a window, here without a display."""

import copy
import subprocess
import sys
import warnings
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pygame
import pytest
from gymnasium.utils.env_checker import check_env

from acting import EACH, OBJECTS, over_the_highest, pressing
from graspbox import errors
from graspbox.configs import PictureConfig
from graspbox.envs import IDS

SMALL = PictureConfig(image_size=(48, 64), samples=1)
SETTINGS: dict[str, Any] = {"objects": OBJECTS, "picture": SMALL}


@pytest.fixture(autouse=True)
def ticks(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """SDL's driver without a display, and the rates for which the window would have waited."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    rates: list[float] = []

    class Clock:
        def tick(self, rate: float) -> None:
            rates.append(rate)

    monkeypatch.setattr(pygame.time, "Clock", Clock)
    yield rates
    pygame.quit()


def shown() -> np.ndarray:
    """Read the frame in the window, (H, W, 3)."""
    surface = pygame.display.get_surface()
    assert surface is not None, "no window is open"
    return np.asarray(pygame.surfarray.array3d(surface)).swapaxes(0, 1)


@pytest.mark.parametrize(("id_", "rate"), [(IDS[0], 1), (IDS[1], 20), (IDS[2], 1)])
def test_every_reset_and_step_is_shown(id_: str, rate: int, ticks: list[float]) -> None:
    """The frames are those of ``rgb_array``, and Gymnasium adds no window of its own."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        settings = {**SETTINGS, **(EACH if id_ == IDS[1] else {})}
        env, twin = (gymnasium.make(id_, render_mode=mode, **settings) for mode in ("human", "rgb_array"))
    assert not pygame.display.get_init()
    assert "human" in env.metadata["render_modes"]
    for each in (env, twin):
        each.reset(seed=0)
    frames = [shown()]
    np.testing.assert_array_equal(frames[0], twin.render())
    if id_ == IDS[1]:
        action = pressing(1, 1)[0, 0]
    else:
        native: Any = env.unwrapped
        action = over_the_highest(native.arrangement())
    for each in (env, twin):
        each.step(action)
    frames.append(shown())
    np.testing.assert_array_equal(frames[1], twin.render())
    assert (frames[0] != frames[1]).any()
    assert ticks == [rate, rate]
    assert env.render() is None
    env.close()
    assert not pygame.display.get_init()
    env.close()


@pytest.mark.parametrize("id_", IDS)
def test_a_vector_environment_shows_its_first_one(id_: str) -> None:
    envs, twins = (gymnasium.make_vec(id_, 2, render_mode=mode, **SETTINGS) for mode in ("human", "rgb_array"))
    assert "human" in envs.metadata["render_modes"]
    envs.reset(seed=3)
    twins.reset(seed=3)
    for _ in range(2):
        frames = twins.render()
        assert frames is not None
        np.testing.assert_array_equal(shown(), frames[0])
        actions = np.zeros(envs.action_space.shape or (), np.float32)
        for each in (envs, twins):
            each.step(actions)
    assert envs.render() is None
    envs.close()
    assert not pygame.display.get_init()


def test_two_environments_share_the_window() -> None:
    """Each shows its frames there, and continues after the other has closed it."""
    large = PictureConfig(image_size=(64, 96), samples=1)
    first: Any = gymnasium.make(IDS[1], render_mode="human", **SETTINGS, **EACH)
    second: Any = gymnasium.make(IDS[1], render_mode="human", **{**SETTINGS, **EACH, "picture": large})
    first.reset(seed=0)
    second.reset(seed=0)
    assert shown().shape == (64, 96, 3)
    other = copy.deepcopy(first)
    second.close()
    for each in (first, other):
        each.step(pressing(1, 1)[0, 0])
        assert shown().shape == (48, 64, 3)


@pytest.mark.parametrize("id_", IDS)
def test_gymnasium_finds_nothing_to_complain_about(id_: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # It makes the environment again from its spec in every render mode.
        check_env(gymnasium.make(id_, render_mode="human", **SETTINGS).unwrapped)


def test_without_pygame_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(errors.MissingExtraError, match=r"graspbox\[human\]"):
            make(IDS[1], render_mode="human", **SETTINGS)


def test_pygame_is_loaded_for_a_window_alone() -> None:
    code = "import gymnasium, graspbox, sys; gymnasium.make('graspbox/Grasp-v0'); print('pygame' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert result.stdout.strip() == "False"
