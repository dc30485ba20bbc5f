"""``graspbox play``: episodes of a policy in a window, or in a video."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import typer
from numpy.typing import NDArray

from graspbox.cli import common
from graspbox.configs import PictureConfig
from graspbox.envs import IDS, SINGLE_OBJECT_IDS
from graspbox.errors import ConfigError
from graspbox.evaluation import trial_seeds
from graspbox.policies import Policy, Task, load

#: Rows and columns of a picture of a video.
_SIZE = (360, 480)
#: Pictures per second at most, and those of a video, which are in memory.
_RATE, _MOST = 10.0, 2000
#: How long a decision and the end of an episode are shown, seconds.
_STILL = 1.0


@dataclass
class Film:
    """Pictures with captions, each for the same time."""

    seconds: float
    every: int = 1
    pictures: list[NDArray[np.uint8]] = field(default_factory=list)
    captions: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, env: Any, closed_loop: bool) -> "Film":
        """Choose the rate: that of the environment, or every n-th step of it."""
        if not closed_loop:
            return cls(_STILL)
        every = max(1, round(env.metadata["render_fps"] / _RATE))
        return cls(every / env.metadata["render_fps"], every)

    def add(self, env: Any, caption: str, seconds: float = 0.0) -> None:
        """Add what the environment shows, for at least one picture; nothing once the film is full."""
        count = max(1, round(seconds / self.seconds))
        if len(self.pictures) + count <= _MOST:
            self.pictures += [env.render()] * count
            self.captions += [caption] * count


def play(
    policy: common.PolicyName,
    env: Annotated[
        str | None,
        typer.Option(help=f"Environment: {' or '.join(IDS)}; by default the policy's own, else the first."),
    ] = None,
    objects: common.ObjectsOfPolicy = None,
    split: common.Split = None,
    hand: common.HandOfPolicy = None,
    episodes: Annotated[int, typer.Option(min=1, max=1000, help="Number of episodes.")] = 5,
    seed: common.Seed = 0,
    video: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a video (.mp4, .gif, .webp) instead of opening a window.")
    ] = None,
    as_json: common.Json = False,
) -> None:
    """Show episodes of a policy in a window, or write a video of them; prints the outcome of each.

    The episodes are the first trials of `graspbox evaluate` with the same options, except that no objects are left out.
    A window needs the extra human, a video as .mp4 the extra video. Ctrl-C ends.

        graspbox play out/ppo --video out/ppo.webp
        graspbox play planner --env graspbox/Grasp-v0 --objects procedural:mug
    """
    if video is not None:
        from graspbox.pictures import check_video  # imports matplotlib

        check_video(video)
    actor = load(policy)
    if not objects:
        objects, split = actor.default_objects(split)
    chosen = common.find(objects, split, 1.0)
    made = _make(actor, env, chosen, hand, video is not None)
    film = None if video is None else Film.of(made, Task.of(made).closed_loop)
    try:
        rows = [dict(row) for row in _episodes(actor, made, trial_seeds(seed, episodes), film, not as_json)]
    finally:
        made.close()
    if film is not None and video is not None:
        from graspbox.pictures import save_video

        save_video(video, film.pictures, film.captions, seconds=film.seconds)
    succeeded = sum(row["success"] for row in rows)
    if as_json:
        shown = None if video is None else str(video)
        facts = {"policy": actor.name, "env_id": made.spec.id, "video": shown, "succeeded": succeeded}
        common.print_json({**facts, "episodes": rows})
        return
    typer.echo(f"{succeeded} of {len(rows)} episodes succeed")
    if film is not None:
        full = f"; it ends after {_MOST} pictures" if len(film.pictures) >= _MOST - film.every else ""
        typer.echo(f"video: {video}, {len(film.pictures)} pictures{full}")


def _make(policy: Policy, env: str | None, objects: Any, hand: str | None, filmed: bool) -> Any:
    """Make the environment that a policy acts in."""
    env_id = (env or policy.env_id or SINGLE_OBJECT_IDS[0]).removeprefix("graspbox:")
    if env_id not in IDS:
        raise ConfigError(f"there is no environment {env_id!r}; choose from {', '.join(IDS)}")
    settings = policy.settings_in(env_id)
    if (obs := policy.needed_obs(target=False)) is not None:
        settings["obs"] = obs
    if hand is not None:
        settings["hand"] = common.hand_like(hand)
    shown: dict[str, Any] = {"render_mode": "human"}
    if filmed:
        shown = {"render_mode": "rgb_array", "picture": PictureConfig(_SIZE)}
    made = gymnasium.make(env_id, objects=objects, **settings, **shown)
    policy.bind(Task.of(made))
    return made


def _episodes(policy: Policy, env: Any, seeds: list[int], film: Film | None, told: bool) -> Iterator[dict[str, Any]]:
    """Run an episode per seed; yields its outcome, and prints it if `told`."""
    for number, seed in enumerate(seeds, 1):
        row = _episode(policy, env, seed, film, f"{number}/{len(seeds)}")
        if told:
            outcome = ("secure success" if row["secure"] else "success") if row["success"] else row["failure"]
            after = f" after {row['steps']} steps ({row['seconds']:.1f} s)" if row["seconds"] else ""
            typer.echo(f"{number}: {row['object']}, {outcome}{after}, reward {row['reward']:.2f}")
        yield row


def _episode(policy: Policy, env: Any, seed: int, film: Film | None, number: str) -> dict[str, Any]:
    """Run an episode."""
    observation, info = _shown(env.reset, seed=seed)
    policy.reset(seed, info=info)
    name, steps, reward, done = str(info["object"]), 0, 0.0, False
    period = 1.0 / env.metadata["render_fps"] if policy.task.closed_loop else 0.0
    title = f"{number} {name}"
    if film is not None:
        film.add(env, title)
    while not done:
        observation, gained, terminated, truncated, info = env.step(policy.act(_rows(observation))[0])
        steps, reward, done = steps + 1, reward + float(gained), terminated or truncated
        if film is not None and not done and steps % film.every == 0:
            film.add(env, _caption(title, steps * period))
    success = bool(info["is_success"])
    failure = "" if success else str(info["failure"]) or "time_limit"
    if film is not None:
        film.add(env, f"{_caption(title, steps * period)}: {failure or 'success'}", _STILL)
    ended = {"success": success, "secure": bool(info["is_secure"]), "failure": failure}
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
