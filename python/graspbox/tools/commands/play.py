"""``graspbox play``: episodes of a policy in a window, or in a video."""

from pathlib import Path
from typing import Annotated

import typer

from graspbox.cli import common
from graspbox.envs import IDS
from graspbox.evaluation import trial_seeds
from graspbox.hands.loading import hand_like
from graspbox.pictures import check_video, playback
from graspbox.policies import load


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
        check_video(video)
    actor = load(policy)
    if not objects:
        objects, split = actor.default_objects(split)
    chosen = common.find(objects, split, 1.0)
    shown = None if hand is None else hand_like(hand)
    made = playback.make_rendered(actor, chosen, env_id=env, hand=shown, as_video=video is not None)
    frames = None if video is None else playback.Frames.of(made)
    report = (lambda _: None) if as_json else typer.echo
    try:
        rows = list(playback.play(actor, made, trial_seeds(seed, episodes), frames, report))
    finally:
        made.close()
    if frames is not None and video is not None:
        frames.save(video)
    succeeded = sum(row["success"] for row in rows)
    if as_json:
        file = None if video is None else str(video)
        facts = {"policy": actor.name, "env_id": made.spec.id, "video": file, "succeeded": succeeded}
        common.print_json({**facts, "episodes": rows})
        return
    typer.echo(f"{succeeded} of {len(rows)} episodes succeed")
    if frames is not None:
        full = f"; it ends after {playback.MOST_PICTURES} pictures" if frames.is_full else ""
        typer.echo(f"video: {video}, {len(frames.pictures)} pictures{full}")
