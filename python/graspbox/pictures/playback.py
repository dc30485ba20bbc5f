"""Episodes of a policy in one environment, in a window or a video."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox.configs import VIEWER, PictureConfig
from graspbox.envs import GOAL_IDS, IDS
from graspbox.envs.settings import HandArgument, ObjectsArgument
from graspbox.errors import ConfigError
from graspbox.evaluation import trial_seeds
from graspbox.pictures.videos import save_video
from graspbox.policies import Policy, Task

__all__ = ["MOST_PICTURES", "Frames", "make_rendered", "play", "record_video"]

#: Pictures of a video: a hand that an agent lifts fast and far stays in sight.
_PICTURE = PictureConfig((360, 480), camera=replace(VIEWER, eye=(-0.85, -1.13, 0.95), target=(0.0, 0.0, 0.33)))
#: Pictures per second at most.
_RATE = 10.0
#: Most pictures of a video, which are in memory.
MOST_PICTURES = 2000
#: How long a decision and the end of an episode are shown, seconds.
_STILL = 1.0


@dataclass
class Frames:
    """Pictures with captions, each for the same time."""

    seconds: float
    every: int = 1
    pictures: list[NDArray[np.uint8]] = field(default_factory=list)
    captions: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, env: Any) -> "Frames":
        """Choose the rate: that of the environment, or every n-th step of it."""
        if not Task.of(env).closed_loop:
            return cls(_STILL)
        every = max(1, round(env.metadata["render_fps"] / _RATE))
        return cls(every / env.metadata["render_fps"], every)

    @property
    def is_full(self) -> bool:
        """Whether it holds as many pictures as it can."""
        return len(self.pictures) >= MOST_PICTURES - self.every

    def add(self, env: Any, caption: str, seconds: float = 0.0) -> None:
        """Add what the environment shows, for at least one picture; nothing once there are as many as it holds."""
        count = max(1, round(seconds / self.seconds))
        if len(self.pictures) + count <= MOST_PICTURES:
            self.pictures += [env.render()] * count
            self.captions += [caption] * count

    def save(self, path: Path) -> None:
        """Write it; raises as `graspbox.pictures.save_video`."""
        save_video(path, self.pictures, self.captions, seconds=self.seconds)


def make_rendered(
    policy: Policy,
    objects: ObjectsArgument,
    *,
    env_id: str | None = None,
    hand: HandArgument | None = None,
    as_video: bool,
) -> Any:
    """Make the environment in which a policy acts, with a window or for a video, and bind the policy.

    Raises
    ------
    ConfigError
        For an unknown id, or if the policy does not suit the environment.
    """
    env_id = (env_id or policy.env_id or IDS[0]).removeprefix("graspbox:")
    if env_id not in (*IDS, *GOAL_IDS):
        raise ConfigError(f"there is no environment {env_id!r}; choose from {', '.join((*IDS, *GOAL_IDS))}")
    settings = policy.settings_in(env_id)
    if (obs := policy.needed_obs(target=False)) is not None:
        settings["obs"] = obs
    if hand is not None:
        settings["hand"] = hand
    shown: dict[str, Any] = {"render_mode": "human"}
    if as_video:
        shown = {"render_mode": "rgb_array", "picture": _PICTURE}
    made = gymnasium.make(env_id, objects=objects, **settings, **shown)
    policy.bind(Task.of(made))
    return made


def play(
    policy: Policy,
    env: Any,
    seeds: Sequence[int],
    frames: Frames | None = None,
    report: Callable[[str], None] = lambda _: None,
) -> Iterator[dict[str, Any]]:
    """Run an episode per seed; yields its outcome, and reports it.

    Parameters
    ----------
    policy : Policy
        Bound to the environment.
    env : Env
        From `make_rendered`.
    seeds : sequence of int
        Seeds of the episodes.
    frames : Frames, optional
        Gets the pictures.
    report : callable
        Called with a line for each episode.
    """
    for number, seed in enumerate(seeds, 1):
        row = _episode(policy, env, seed, frames, f"{number}/{len(seeds)}")
        outcome = ("secure success" if row["secure"] else "success") if row["success"] else row["failure"]
        after = f" after {row['steps']} steps ({row['seconds']:.1f} s)" if row["seconds"] else ""
        report(f"{number}: {row['object']}, {outcome}{after}, reward {row['reward']:.2f}")
        yield row


def record_video(policy: Policy, path: Path, *, episodes: int, seed: int) -> None:
    """Write a video of the first trials of an evaluation of a policy on its held-out objects.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        As `make_rendered` and `graspbox.pictures.check_video`.
    """
    objects, split = policy.default_objects(None)
    env = make_rendered(policy, object_sets.load(objects, split=split), as_video=True)
    try:
        frames = Frames.of(env)
        for _ in play(policy, env, trial_seeds(seed, episodes), frames):
            pass
    finally:
        env.close()
    frames.save(path)


def _episode(policy: Policy, env: Any, seed: int, frames: Frames | None, number: str) -> dict[str, Any]:
    """Run one episode and return its outcome."""
    observation, info = _shown(env.reset, seed=seed)
    policy.reset(seed, info=info)
    name, steps, reward, done = str(info["object"]), 0, 0.0, False
    period = 1.0 / env.metadata["render_fps"] if policy.task.closed_loop else 0.0
    title = f"{number} {name}"
    if frames is not None:
        frames.add(env, title)
    while not done:
        observation, gained, terminated, truncated, info = env.step(policy.act(_rows(observation))[0])
        steps, reward, done = steps + 1, reward + float(gained), terminated or truncated
        if frames is not None and not done and steps % frames.every == 0:
            frames.add(env, _caption(title, steps * period))
    success = bool(info["is_success"])
    failure = "" if success else str(info.get("failure", "goal_missed")) or "time_limit"
    if frames is not None:
        frames.add(env, f"{_caption(title, steps * period)}: {failure or 'success'}", _STILL)
    ended = {"success": success, "secure": bool(info.get("is_secure", False)), "failure": failure}
    return {"seed": seed, "object": name, **ended, "steps": steps, "seconds": steps * period, "reward": reward}


def _caption(title: str, seconds: float) -> str:
    return f"{title}, {seconds:.1f} s" if seconds else title


def _rows(observation: Any) -> Any:
    """Return an observation as that of one of several environments."""
    if isinstance(observation, dict):
        return {name: np.asarray(value)[None] for name, value in observation.items()}
    return np.asarray(observation)[None]


def _shown(call: Any, **arguments: Any) -> Any:
    """Call what opens the window; where there is no display, an error names the alternative."""
    try:
        return call(**arguments)
    except Exception as error:
        if not type(error).__module__.startswith("pygame"):
            raise
        raise ConfigError(f"no window can be opened here ({error}); write a video: --video FILE.webp") from None
