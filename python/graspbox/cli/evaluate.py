"""``graspbox evaluate``: the success of a policy on seeded trials."""

from pathlib import Path
from typing import Annotated, Any

import typer

from graspbox.cli.common import Json, PolicyName, Scale, Seed, Split, Threads, find, print_json, print_table, progress
from graspbox.cli.serve import TokenFile, token_in
from graspbox.envs import IDS
from graspbox.errors import ConfigError
from graspbox.evaluation import MAX_ENVS, MAX_TRIALS, Evaluation
from graspbox.evaluation import evaluate as run
from graspbox.files import check_output, dumps, write_text
from graspbox.policies import Policy
from graspbox.remote.remote_policy import RemotePolicy

Remote = Annotated[
    list[str] | None,
    typer.Option("--remote", help="Server that steps the environments: ws://HOST:PORT; repeatable."),
]
Obs = Annotated[
    list[str] | None,
    typer.Option("--obs", help="Observation for a policy on a server; repeatable; by default those that it names."),
]
Keys = Annotated[
    list[str] | None,
    typer.Option("--key", metavar="OURS=THEIRS", help="Name under which that server expects an observation."),
]
Chunk = Annotated[
    int, typer.Option("--chunk", min=1, max=1000, help="Actions of its answer that are executed before the next.")
]


def _print(result: Evaluation) -> None:
    rows = [(o.name, str(o.trials), str(o.succeeded), str(o.secure)) for o in result.objects]
    sums = ("total", str(len(result.trials)), str(result.succeeded), str(result.secure))
    print_table(f"{result.policy} in {result.env_id}", ("object", "trials", "succeeded", "secure"), [*rows, sums])
    secure, (low, high) = result.secure / len(result.trials), result.secure_ci95
    typer.echo(
        f"success {result.rate:.1%} (95 % interval {result.ci95[0]:.1%} to {result.ci95[1]:.1%}); "
        f"secure {secure:.1%} ({low:.1%} to {high:.1%}); {result.ms_per_decision:.2f} ms per decision"
    )
    if result.objects_left_out:
        typer.echo(
            f"left out: {result.objects_left_out} of {result.objects_given} objects, from which the policy learned "
            "(--include-learned keeps them)"
        )
    if result.failures:
        typer.echo("failures: " + ", ".join(f"{count} {kind}" for kind, count in result.failures.items()))


def _is_url(policy: str) -> bool:
    return policy.startswith(("ws://", "wss://"))


def _remote_policy(
    url: str, obs: list[str] | None, keys: list[str] | None, chunk: int, token_file: Path | None
) -> Policy:
    pairs = dict(pair.partition("=")[::2] for pair in keys or ())
    if not all(pairs.values()):
        raise ConfigError(f"--key is {keys}; write it as OURS=THEIRS, such as depth=observation/depth")
    return RemotePolicy(url, obs=tuple(obs) if obs else None, keys=pairs, chunk=chunk, token=token_in(token_file))


def evaluate(
    policy: PolicyName,
    env: Annotated[
        str | None,
        typer.Option("--env", help=f"Environment: {' or '.join(IDS)}; by default the policy's own, else {IDS[0]}."),
    ] = None,
    objects: Annotated[
        list[str] | None, typer.Option("--objects", help="Object set, 'procedural' by default; may be repeated.")
    ] = None,
    trials: Annotated[int, typer.Option("--trials", min=1, max=MAX_TRIALS, help="Number of trials.")] = 200,
    split: Split = None,
    scale: Scale = 1.0,
    include_learned: Annotated[
        bool, typer.Option("--include-learned", help="Sample from objects from which the policy learned, too.")
    ] = False,
    seed: Seed = 0,
    num_envs: Annotated[
        int,
        typer.Option(
            "--num-envs",
            min=1,
            max=MAX_ENVS,
            help="Number of environments stepped together; results do not depend on it.",
        ),
    ] = 16,
    threads: Threads = None,
    remote: Remote = None,
    obs: Obs = None,
    keys: Keys = None,
    chunk: Chunk = 1,
    token_file: TokenFile = None,
    out: Annotated[Path | None, typer.Option("--out", help="Write the JSON, with every trial, into this file.")] = None,
    as_json: Json = False,
) -> None:
    """Evaluate a policy on seeded trials: success, secure grasps, 95 % intervals (Wilson).

    The policy may be on a server: ws://HOST:PORT of any server that speaks openpi's protocol.
    """
    found = find(objects or ["procedural"], split, scale)
    if out is not None:
        check_output(out)
    chosen = _remote_policy(policy, obs, keys, chunk, token_file) if _is_url(policy) else policy
    settings: dict[str, Any] = {"remote": remote} if remote else {}
    with progress() as bar:
        task = bar.add_task(policy, total=trials)
        result = run(
            chosen,
            env,
            found,
            trials,
            seed,
            include_learned=include_learned,
            num_envs=num_envs,
            num_threads=threads,
            **settings,
            progress=lambda done: bar.update(task, completed=done),
        )
    _report(result, out, as_json)


def _report(result: Evaluation, out: Path | None, as_json: bool) -> None:
    """Print a result, and write it with every trial."""
    if as_json:
        print_json(result.to_json())
    else:
        _print(result)
    if out is not None:
        rows = [vars(trial) for trial in result.trials]
        write_text(out, dumps({**result.to_json(), "rows": rows}) + "\n")
