"""``graspbox evaluate``: the success of a policy on seeded trials."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from graspbox._common.files import dumps, write_text
from graspbox._common.options import flattened
from graspbox.cli import common
from graspbox.cli.arm.path_options import told_assumptions
from graspbox.cli.policy_servers import CaFile, Chunk, Keys, Obs, PolicyServers, ServerToken
from graspbox.cli.recorders import CommandRecorder, Rerun, RerunEpisodes, rerun_recorder
from graspbox.envs import EVALUATED_IDS
from graspbox.envs.remote_config import RemoteConfig
from graspbox.errors import ConfigError
from graspbox.evaluation import MAX_ENVS, MAX_TRIALS, Evaluation
from graspbox.evaluation import evaluate as run
from graspbox.evaluation.conditions import CONDITIONS
from graspbox.evaluation.replays import ActionLog, failed, shown
from graspbox.hands.loading import hand_like
from graspbox.object_sets import ObjectSet
from graspbox.object_sets.mesh_folders import MASSES
from graspbox.simulation.layouts import SceneLayout

NumEnvs = Annotated[
    int, typer.Option(min=1, max=MAX_ENVS, help="Number of environments stepped together; results do not depend on it.")
]
EnvId = Annotated[
    str | None,
    typer.Option(help=f"Environment: {' or '.join(EVALUATED_IDS)}; by default the policy's own, else the first."),
]
IncludeLearned = Annotated[
    bool, typer.Option("--include-learned", help="Sample from objects from which the policy learned, too.")
]
Condition = Annotated[str, typer.Option(help=f"Condition of the trials: {', '.join(CONDITIONS)}.")]
Lies = Annotated[
    str,
    typer.Option(
        help=f"How objects lie: {', '.join(get_args(SceneLayout))}; except in the first, a target lies among others."
    ),
]
Remote = Annotated[
    list[str] | None, typer.Option(help="Server that steps the environments: ws://HOST:PORT; repeatable.")
]


@dataclass(frozen=True)
class Carrier:
    """What carries the hand."""

    hand: common.HandOfPolicy = None
    arm: Annotated[
        str | None,
        typer.Option(
            help="The arm that carries the hand: a name such as fr3, or URDF,TOML. A depth policy then decides for "
            "grasps to which it has a path."
        ),
    ] = None
    base: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(
            metavar="X Y Z YAW",
            help="Where the arm's base stands upright: metres, and degrees about z; by default behind the objects.",
        ),
    ] = None

    def keywords(self) -> dict[str, Any]:
        """Return the keywords of environments that are given."""
        keywords = {} if self.hand is None else {"hand": hand_like(self.hand)}
        keywords |= {} if self.arm is None else {"arm": hand_like(self.arm)}
        if self.base is None:
            return keywords
        return {**keywords, "base": common.standing(self.base).tolist()}


def _print(result: Evaluation, as_json: bool, carrier: Carrier) -> None:
    if as_json:
        common.print_json({**result.to_json(), "env_id": result.env_id, **vars(carrier)})
        return
    if not result.trials:
        typer.echo(
            f"no trial: {len(result.refused)} of {result.objects_given} objects were tried, and none can be used"
        )
        return
    rows = [(o.name, str(o.trials), str(o.succeeded), str(o.secure)) for o in result.objects]
    sums = ("total", str(len(result.trials)), str(result.succeeded), str(result.secure))
    where = result.env_id if result.condition == "nominal" else f"{result.env_id}, {result.condition}"
    where += f" on {carrier.arm}" if carrier.arm else ""
    common.print_table(f"{result.policy} in {where}", ("object", "trials", "succeeded", "secure"), [*rows, sums])
    secure, (low, high) = result.secure / len(result.trials), result.secure_ci95
    typer.echo(
        f"success {result.rate:.1%} (95 % interval {result.ci95[0]:.1%} to {result.ci95[1]:.1%}); "
        f"secure {secure:.1%} ({low:.1%} to {high:.1%}); {result.ms_per_decision:.2f} ms per decision"
    )
    if result.mean_confidence is not None:
        typer.echo(
            f"predicted probability of success: {result.mean_confidence:.1%} on average, expected calibration error "
            f"{result.calibration_error:.3f}"
        )
    fitting = result.fitting
    if 0 < len(fitting.trials) < len(result.trials):
        low, high = fitting.ci95
        typer.echo(
            f"objects that fit the hand: {len(fitting.trials)} of {len(result.trials)} trials, success "
            f"{fitting.rate:.1%} ({low:.1%} to {high:.1%}); secure {fitting.secure / len(fitting.trials):.1%}"
        )
    if result.objects_left_out:
        typer.echo(
            f"left out: {result.objects_left_out} of {result.objects_given} objects, from which the policy learned "
            "(--include-learned keeps them)"
        )
    if result.refused:
        typer.echo(f"left out: {len(result.refused)} objects that cannot be used: {', '.join(result.refused)}")
    if result.failures:
        typer.echo("failures: " + ", ".join(f"{count} {kind}" for kind, count in result.failures.items()))


def _servers(
    remote: list[str] | None, mass: float | None, token_file: str | None, ca_file: str | None
) -> RemoteConfig | None:
    if not remote:
        return None
    if mass is not None:
        raise ConfigError(
            f"--mass is for meshes of this machine; write masses into a table {MASSES} in the server's folder"
        )
    return RemoteConfig(tuple(remote), token_file, ca_file)


@flattened
def evaluate(
    policy: common.PolicyName,
    carrier: Carrier,
    env: EnvId = None,
    objects: common.ObjectsOfPolicy = None,
    trials: Annotated[int, typer.Option(min=1, max=MAX_TRIALS, help="Number of trials.")] = 200,
    split: common.Split = None,
    scale: common.Scale = 1.0,
    mass: common.Mass = None,
    include_learned: IncludeLearned = False,
    condition: Condition = "nominal",
    rehearse: common.Rehearse = None,
    layout: Lies = "single",
    objects_per_scene: common.PerScene = None,
    seed: common.Seed = 0,
    num_envs: NumEnvs = 16,
    threads: common.Threads = None,
    remote: Remote = None,
    obs: Obs = None,
    keys: Keys = None,
    chunk: Chunk = 1,
    token_file: ServerToken = None,
    ca_file: CaFile = None,
    out: Annotated[Path | None, typer.Option(help="Write the JSON, with every trial, into this file.")] = None,
    rerun: Rerun = None,
    rerun_episodes: RerunEpisodes = 10,
    as_json: common.Json = False,
) -> None:
    """Evaluate a policy on seeded trials: success, secure grasps, 95 % intervals (Wilson).

    The policy may be on a server: ws://HOST:PORT of any server that speaks openpi's protocol. The exit status is 1 if
    some objects cannot be used; other trials replace theirs.
    """
    common.check_files(out)
    recorder = _recorder(rerun, remote, layout)
    servers = PolicyServers(obs, keys, chunk, token_file, ca_file)
    servers.check([policy], bool(remote))
    log = ActionLog(servers.load(policy, rehearse))
    objects, split = (objects, split) if objects else log.default_objects(split)
    object_set = None if remote else common.find(objects, split, scale, mass)  # a server uses its own names
    with common.progress() as bar, told_assumptions():
        task = bar.add_task(policy, total=trials)
        result = run(
            log,
            env,
            objects if object_set is None else object_set,
            trials,
            seed,
            scale=scale if remote else 1.0,
            split=split if remote else None,
            include_learned=include_learned,
            condition=condition,
            num_envs=num_envs,
            num_threads=threads,
            remote=_servers(remote, mass, token_file, ca_file),
            progress=lambda done: bar.update(task, completed=done),
            **carrier.keywords(),
            **_keywords(layout, objects_per_scene),
        )
    _print(result, as_json, carrier)
    if out is not None:
        _write(out, result, seed, log, object_set)
    if object_set is not None and recorder is not None:
        recorder.write_replays(shown(result, log, object_set, rerun_episodes))
    common.end_with(result.refused)


def _recorder(rerun: Path | None, remote: list[str] | None, layout: str) -> CommandRecorder | None:
    if rerun is not None and remote:
        raise ConfigError("--rerun records environments of this machine; leave out --remote")
    if rerun is not None and layout != "single":
        raise ConfigError(f"--rerun records single objects; leave it out, or --layout {layout}")
    return rerun_recorder(rerun)


def _keywords(layout: str, objects_per_scene: int | None) -> dict[str, Any]:
    """Collect the keywords of the environment that are not its defaults."""
    keywords: dict[str, Any] = {} if layout == "single" else {"layout": layout}
    return keywords | ({} if objects_per_scene is None else {"objects_per_scene": objects_per_scene})


def _write(out: Path, result: Evaluation, seed: int, log: ActionLog, object_set: ObjectSet | None) -> None:
    """Write a result with every trial, its origin (`common.made`), and failures that can be replayed."""
    objects = object_set or ()
    names = {trial.object for trial in result.trials}
    content = {
        **result.to_json(),
        "rows": [vars(trial) for trial in result.trials],
        "made": common.made(env_id=result.env_id, seed=seed, settings=result.settings),
        "sources": {
            spec.name: {"source": spec.source, "scale": spec.scale, "mass": spec.mass}
            for spec in objects
            if spec.name in names
        },
        "replays": [] if object_set is None else [replay.to_json() for replay in failed(result, log, object_set)],
    }
    write_text(out, dumps(content) + "\n")
