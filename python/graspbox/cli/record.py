"""``graspbox record``: demonstrations of a policy."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from graspbox.cli import common
from graspbox.cli.recorders import Rerun, RerunEpisodes, rerun_recorder
from graspbox.data import episodes as demonstrations
from graspbox.envs import IDS
from graspbox.errors import ConfigError
from graspbox.evaluation import MAX_ENVS
from graspbox.hands.loading import hand_like

Environments = Annotated[
    int,
    typer.Option(min=1, max=MAX_ENVS, help="Number of environments stepped together; episodes do not depend on it."),
]
Noise = Annotated[
    float, typer.Option(min=0, max=1, help="Noise that disturbs the actions, in shares; it is not recorded.")
]


def _keywords(settings: list[str] | None) -> dict[str, Any]:
    """Read ``name=value``; a value that is not valid JSON is text."""
    keywords: dict[str, Any] = {}
    for one in settings or []:
        name, equals, value = one.partition("=")
        if not equals or not name.isidentifier():
            raise ConfigError(f"--set {one!r} names no keyword; write, for example, control_freq=10")
        try:
            keywords[name] = json.loads(value)
        except ValueError:
            keywords[name] = value
    return keywords


def _counts(made: demonstrations.Demonstrations) -> dict[str, Any]:
    rows = made.episodes
    return {
        "folder": str(made.folder),
        "trials": made.trials,
        "episodes": len(rows),
        "steps": sum(row.steps for row in rows),
        "success": sum(row.success for row in rows),
        "secure": sum(row.secure for row in rows),
        "refused": made.refused,
    }


def _print(counts: dict[str, Any], as_json: bool) -> None:
    if as_json:
        common.print_json(counts)
        return
    typer.echo(
        f"{counts['folder']}: {counts['episodes']} episodes of {counts['trials']} trials, {counts['steps']} steps; "
        f"{counts['success']} successes, {counts['secure']} secure"
    )


def record(
    policy: common.PolicyName,
    out: Annotated[Path, typer.Option(help="Folder; an existing recording is continued.")],
    env: Annotated[str, typer.Option(help=f"Environment: {' or '.join(IDS)}.")] = "graspbox/Grasp-v0",
    objects: common.Objects = None,
    hand: common.HandOfPolicy = None,
    episodes: Annotated[int, typer.Option(min=1, help="Episodes to keep.")] = 500,
    obs: Annotated[
        list[str] | None, typer.Option(help="Observation to record, 'state' by default; may be repeated.")
    ] = None,
    keep: Annotated[
        str, typer.Option(help="Which episodes: secure successes, all successes ('success'), or 'all'.")
    ] = "secure",
    noise: Noise = 0.0,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Other keyword of the environment, such as control_freq=10; may be repeated."),
    ] = None,
    split: common.Split = None,
    scale: common.Scale = 1.0,
    mass: common.Mass = None,
    seed: common.Seed = 0,
    num_envs: Environments = 32,
    threads: common.Threads = None,
    rerun: Rerun = None,
    rerun_episodes: RerunEpisodes = 10,
    as_json: common.Json = False,
) -> None:
    """Record episodes of a policy as Parquet files, to learn from them.

    The exit status is 1 if some objects cannot be used.
    """
    recorder = rerun_recorder(rerun)
    common.find(objects, split, scale, mass)
    # Options that were left out are no settings of the environment.
    overrides: dict[str, Any] = {"scale": scale} if scale != 1.0 else {}
    overrides |= {"mass": mass} if mass is not None else {}
    overrides |= {"hand": hand_like(hand)} if hand is not None else {}
    with common.progress() as bar:
        task = bar.add_task(policy, total=episodes)
        made = demonstrations.record(
            policy,
            out,
            env,
            objects or ["procedural"],
            episodes,
            obs or ["state"],
            seed,
            keep=keep,
            noise=noise,
            split=split,
            num_envs=num_envs,
            progress=lambda kept, trials: bar.update(task, completed=kept, description=f"{policy}, {trials} trials"),
            **{"num_threads": threads, **overrides, **_keywords(settings)},
        )
    _print(_counts(made), as_json)
    if recorder is not None:
        recorder.write_demonstrations(made, rerun_episodes)
    common.end_with(made.refused)
