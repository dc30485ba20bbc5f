"""``graspbox benchmark clutter``: clear scenes of several objects, after VGN's protocol."""

from contextlib import nullcontext
from itertools import product
from pathlib import Path
from typing import Annotated, Any, cast, get_args

import typer

from graspbox._common.files import check_output, dumps, write_text
from graspbox._common.progress import ProgressBar
from graspbox.cli.common import Json, Spread, hand_like, print_json, print_table
from graspbox.cli.serving.clients import CaFile, Chunk, Keys, Obs, PolicyServers, ServerToken
from graspbox.configs import FRONT, OVERHEAD, CamerasConfig
from graspbox.envs.settings import HandArgument
from graspbox.errors import ConfigError
from graspbox.evaluation.rounds import Film, Rounds, clear_rounds
from graspbox.layouts import Layout, layout_named
from graspbox.object_sets import Split
from graspbox.policies import Policy, names

benchmark_app = typer.Typer(no_args_is_help=True, help="Protocols of the field, for any policy.")

#: Distance between the first seeds of two repetitions: more rounds than anybody makes.
_APART = 1_000_000
#: Cameras by name.
_CAMERAS = {"front": FRONT, "overhead": OVERHEAD}

Policies = Annotated[
    list[str],
    typer.Argument(
        metavar="POLICY...",
        help=f"Policies: {', '.join(names())}, installed ones such as panda, folders, or ws://HOST:PORT of a server.",
    ),
]
Hand = Annotated[
    str | None, typer.Option(help="The hand, by its name or as hand.urdf,hand.toml; by default that of the policy.")
]
Layouts = Annotated[
    list[str] | None,
    typer.Option(help=f"Layout: {', '.join(get_args(Layout))}; repeatable; by default packed and pile."),
]
Camera = Annotated[
    str, typer.Option(help=f"Where the camera is: {', '.join(_CAMERAS)} (looks down at 40 or 75 degrees).")
]
MaxFailures = Annotated[
    int,
    typer.Option(
        min=1,
        help="Failed attempts in a row after which a round ends; with more than 2, looks that find no grasp count too.",
    ),
]
AllObjects = Annotated[bool, typer.Option("--all-objects", help="Use also objects that the hand cannot span.")]
Judge = Annotated[
    str | None, typer.Option(help="A second judge, which tries the same attempts in the same scenes: mujoco.")
]
Patch = Annotated[float, typer.Option(min=0, max=20, help="Mean radius of contact areas in MuJoCo, mm; 0: points.")]
Video = Annotated[
    Path | None,
    typer.Option(help="File for a video of the first round of every policy and layout: .gif, .webp, .mp4."),
]


@benchmark_app.callback()
def _benchmark() -> None:
    """Protocols of the field, for any policy."""


@benchmark_app.command()
def clutter(
    policies: Policies,
    hand: Hand = None,
    layout: Layouts = None,
    objects: Annotated[str, typer.Option(help="Object set.")] = "procedural:unseen:0-19",
    split: Annotated[str | None, typer.Option(help="Use only this split: train, validation or test.")] = None,
    objects_per_scene: Annotated[int, typer.Option(min=1, max=40, help="Number of objects.")] = 5,
    spread: Spread = 1.0,
    rounds: Annotated[int, typer.Option(min=1, max=100_000, help="Rounds of each seed.")] = 40,
    seed: Annotated[list[int] | None, typer.Option(help="Seed; repeatable; by default 0, 1 and 2.")] = None,
    max_attempts: Annotated[int, typer.Option(min=1, help="Attempts after which a round ends.")] = 30,
    max_failures: MaxFailures = 2,
    camera: Camera = "front",
    all_objects: AllObjects = False,
    judge: Judge = None,
    patch: Patch = 0.0,
    obs: Obs = None,
    keys: Keys = None,
    chunk: Chunk = 1,
    token_file: ServerToken = None,
    ca_file: CaFile = None,
    out: Annotated[Path | None, typer.Option(help="File for all results, JSON.")] = None,
    video: Video = None,
    json: Json = False,
) -> None:
    """Clear scenes of several objects with policies, after the protocol of VGN.

    A round ends when nothing is left, when the policy finds no grasp, which is no attempt, or after two failed attempts
    in a row. The success rate is that of attempts, successful ones over all; an object is cleared if the hand holds it
    high and still at the end of an attempt. Wilson 95 % intervals. Objects from which a policy learned are left out,
    and those whose least width in plan view is more than the hand opens: the sets of VGN fit its gripper. A video shows
    a picture at first, and one after every attempt. A policy may be on a server, which is started with --env
    graspbox/Clear-v0; there it does not know where a bin stands.

        graspbox benchmark clutter panda scene_planner --hand panda_gripper --layout pile --rounds 40
        graspbox benchmark clutter panda_clutter --layout bin --objects-per-scene 15 --max-failures 30 --camera overhead
    """
    if out is not None:
        check_output(out)
    servers = PolicyServers(obs, keys, chunk, token_file, ca_file)
    servers.check(policies)
    filmed = None if video is None else _Video(video)
    layouts = [layout_named(name) for name in layout or ("packed", "pile")]
    seeds, named = seed or [0, 1, 2], None if hand is None else hand_like(hand)
    settings: dict[str, Any] = {
        "objects": objects,
        "split": _split(split),
        "objects_per_scene": objects_per_scene,
        "spread": spread,
        "rounds": rounds,
        "hand": named,
        "max_attempts": max_attempts,
        "max_failures": max_failures,
        "fitting": not all_objects,
        **_cameras(camera),
    }
    results = []
    for name, one in product(policies, layouts):
        # A server may close a connection while a second judge ends its work on another layout.
        policy, film = servers.load(name), None if filmed is None else filmed.film(name, one)
        with (
            ProgressBar(f"{name}, {one}", rounds * len(seeds), not json) as bar,
            _judge(judge, policy, named, patch) as second,
        ):
            settings |= {"layout": one, "witness": second}
            found = _joined(policy, seeds, film, bar, settings).to_json()
            results.append(found if second is None else {**found, "mujoco": second.to_json()})
    if out is not None:
        write_text(out, dumps(results))
    if filmed is not None:
        filmed.save()
    (print_json if json else _print)(results)


def _joined(policy: Policy, seeds: list[int], film: Film | None, bar: ProgressBar, settings: dict[str, Any]) -> Rounds:
    """Do the rounds of every seed; `film` sees the first one."""
    return Rounds.joined(
        [
            clear_rounds(
                policy,
                seed=_APART * seed,
                film=None if number else film,
                progress=lambda done, before=number * settings["rounds"]: bar.update(before + done),  # type: ignore[misc]
                **settings,
            )
            for number, seed in enumerate(seeds)
        ]
    )


def _cameras(name: str) -> dict[str, Any]:
    """Give the setting of the environment for a camera by its name; there is none for the default."""
    if name not in _CAMERAS:
        raise ConfigError(f"--camera is {name!r}; choose from {', '.join(_CAMERAS)}")
    return {} if name == "front" else {"cameras": CamerasConfig(cameras=(_CAMERAS[name],))}


def _judge(name: str | None, policy: Policy, hand: HandArgument | None, patch: float) -> Any:
    """Give a second judge of the attempts of a policy, or none, as a context."""
    if name is None:
        return nullcontext()
    if name != "mujoco":
        raise ConfigError(f"--judge is {name!r}; there is only mujoco")
    # Needs the extra 'dev'.
    from graspbox.validation.mujoco.heaps import HeapJudge

    return HeapJudge(hand or policy.settings.get("hand", "reflex"), patch=1e-3 * patch)


def _split(name: str | None) -> Split | None:
    """Check the name of a split."""
    if name not in (None, *get_args(Split)):
        raise ConfigError(f"--split is {name!r}; choose from {', '.join(get_args(Split))}")
    return cast("Split | None", name)


class _Video:
    """The video of the first rounds; the path is checked before any work."""

    def __init__(self, path: Path) -> None:
        # matplotlib takes long to import.
        from graspbox.pictures import check_video

        self._path, self._pictures, self._captions = check_video(path), list[Any](), list[str]()

    def film(self, policy: str, layout: str) -> Film:
        """Give what takes the pictures of one policy and layout."""

        def film(picture: Any, shown: str) -> None:
            self._pictures.append(picture)
            self._captions.append(f"{Path(policy).name}, {layout}, {shown}")

        return film

    def save(self) -> None:
        """Write the file."""
        from graspbox.pictures import save_video

        save_video(self._path, self._pictures, self._captions)


def _print(results: list[dict[str, Any]]) -> None:
    """Print a row for each policy and layout."""
    rows: list[tuple[str, ...]] = []
    for one in results:
        success, cleared = (
            f"{one[name]:.1%} ({low:.1%} to {high:.1%})"
            for name, (low, high) in (("success_rate", one["success_interval"]), ("cleared", one["cleared_interval"]))
        )
        rows.append(
            (one["policy"], one["hand"], one["layout"], str(one["rounds"]), str(one["no_grasp"]), success, cleared)
        )
    print_table("clutter", ("policy", "hand", "layout", "rounds", "no grasp", "success", "cleared"), rows)
    for one in results:
        failures = ", ".join(f"{count} {kind}" for kind, count in one["failures"].items())
        typer.echo(
            f"{one['policy']}, {one['layout']}: failures: {failures or 'none'}; {one['objects_left_out']} objects of "
            f"the set are left out as learned, {one['objects_too_wide']} as too wide"
        )
        if second := one.get("mujoco"):
            low, high = second["success_interval"]
            typer.echo(
                f"{one['policy']}, {one['layout']}: MuJoCo: {second['success_rate']:.1%} ({low:.1%} to {high:.1%}) of "
                f"the same attempts succeed; {second['equal']} of {second['attempts']} outcomes are equal, "
                f"{second['only_core']} succeed in graspbox alone, {second['only_mujoco']} in MuJoCo alone"
            )
