"""Measure policies by protocols of the field.

``graspbox benchmark clutter`` clears scenes of several objects, after VGN's protocol; ``captures`` judges grasps in
real depth images by what the camera saw.
"""

from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer

from graspbox._common.files import check_output, dumps, write_text
from graspbox._common.progress import ProgressBar
from graspbox.cli.common import (
    HandOfPolicy,
    Json,
    Seed,
    Split,
    Spread,
    check_files,
    console,
    print_json,
    print_table,
)
from graspbox.cli.policy_servers import CaFile, Chunk, Keys, Obs, PolicyServers, ServerToken
from graspbox.configs import OVERHEAD, CamerasConfig
from graspbox.errors import ConfigError
from graspbox.evaluation.rounds import Film, Rounds, clear_rounds
from graspbox.hands.loading import hand_like
from graspbox.policies import Policy, names
from graspbox.simulation.layouts import Layout, layout_named

if TYPE_CHECKING:
    from graspbox.evaluation.captures import Given
    from graspbox.policies.grasp_image import ImageGrasper

benchmark_app = typer.Typer(no_args_is_help=True, help="Measure policies by protocols of the field.")

#: Distance between the first seeds of two repetitions: more than the rounds of one.
_APART = 1_000_000

Policies = Annotated[
    list[str],
    typer.Argument(
        metavar="POLICY...",
        help=f"Policies: {', '.join(names())}, installed ones such as panda, folders, or ws://HOST:PORT of a server.",
    ),
]
Layouts = Annotated[
    list[str] | None,
    typer.Option(help=f"Layout: {', '.join(get_args(Layout))}; repeatable; by default packed and pile."),
]
Camera = Annotated[
    Literal["front", "overhead"], typer.Option(help="Where the camera is; it looks down at 40 or 75 degrees.")
]
MaxFailures = Annotated[
    int,
    typer.Option(
        min=1,
        help="Failed attempts in a row after which a round ends; with more than 2, looks that find no grasp count too.",
    ),
]
AllObjects = Annotated[bool, typer.Option("--all-objects", help="Use also objects that the hand cannot span.")]
Video = Annotated[
    Path | None, typer.Option(help="File for a video of the first round of every policy and layout: .gif, .webp, .mp4.")
]


@benchmark_app.callback()
def _benchmark() -> None:
    """Measure policies by protocols of the field."""


@benchmark_app.command()
def clutter(
    policies: Policies,
    hand: HandOfPolicy = None,
    layout: Layouts = None,
    objects: Annotated[str, typer.Option(help="Object set.")] = "procedural:unseen:0-19",
    split: Split = None,
    objects_per_scene: Annotated[int, typer.Option(min=1, max=40, help="Number of objects.")] = 5,
    spread: Spread = 1.0,
    rounds: Annotated[int, typer.Option(min=1, max=100_000, help="Rounds of each seed.")] = 40,
    seed: Annotated[list[int] | None, typer.Option(help="Seed; repeatable; by default 0, 1 and 2.")] = None,
    max_attempts: Annotated[int, typer.Option(min=1, help="Attempts after which a round ends.")] = 30,
    max_failures: MaxFailures = 2,
    camera: Camera = "front",
    all_objects: AllObjects = False,
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
    graspbox/Clear-v0; there the position of a bin is unknown.

        graspbox benchmark clutter panda scene_planner --hand panda_gripper --layout pile --rounds 40
        graspbox benchmark clutter panda_clutter --layout bin --objects-per-scene 15 --max-failures 30 --camera overhead
    """
    check_files(out)
    servers = PolicyServers(obs, keys, chunk, token_file, ca_file)
    servers.check(policies)
    frames: list[tuple[Any, str]] = []
    if video is not None:
        from graspbox import pictures  # imports matplotlib

        pictures.check_video(video)
    layouts = [layout_named(name) for name in layout or ("packed", "pile")]
    seeds, named = seed or [0, 1, 2], None if hand is None else hand_like(hand)
    settings: dict[str, Any] = {
        "objects": objects,
        "split": split,
        "objects_per_scene": objects_per_scene,
        "spread": spread,
        "rounds": rounds,
        "hand": named,
        "max_attempts": max_attempts,
        "max_failures": max_failures,
        "fitting": not all_objects,
        **({} if camera == "front" else {"cameras": CamerasConfig(cameras=(OVERHEAD,))}),
    }
    results = []
    for name, one in product(policies, layouts):
        policy, title = servers.load(name), f"{Path(name).name}, {one}"
        film = None if video is None else partial(_film, frames, title)
        with ProgressBar(f"{name}, {one}", rounds * len(seeds), not json) as bar:
            outcome = _joined(policy, seeds, film, bar, {**settings, "layout": one})
        results.append(outcome.to_json())
    if out is not None:
        write_text(out, dumps(results))
    if video is not None:
        pictures.save_video(video, [picture for picture, _ in frames], [caption for _, caption in frames])
    (print_json if json else _print)(results)


def _film(frames: list[tuple[Any, str]], title: str, picture: Any, shown: str) -> None:
    frames.append((picture, f"{title}, {shown}"))


def _joined(policy: Policy, seeds: list[int], film: Film | None, bar: ProgressBar, settings: dict[str, Any]) -> Rounds:
    """Run the rounds of every seed; `film` records the first one."""
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


@benchmark_app.command()
def captures(
    folder: Annotated[Path, typer.Argument(help="Folder of captures: NAME/depth.npy, capture.json, labels.png.")],
    policy: Annotated[str, typer.Option(help="An installed policy such as depth, or the folder of one.")],
    given: Annotated[
        Literal["depth", "pose", "mask", "alone"],
        typer.Option(
            help="What the policy is given: the image, from which it chooses a thing; also the camera's pose; or the "
            "mask of each thing; or each thing alone, with nothing measured around it, and the camera's pose."
        ),
    ] = "depth",
    disturb: Annotated[
        bool,
        typer.Option(
            "--disturb",
            help="Instead count the images that pass without a warning with wrong intrinsics, units and kinds of depth "
            "(graspbox.evaluation.disturbances).",
        ),
    ] = False,
    seed: Seed = 0,
    out: Annotated[Path | None, typer.Option(help="File for the result of every image, JSON.")] = None,
    pictures: Annotated[Path | None, typer.Option(help="Folder for a picture of every answer.")] = None,
    as_json: Json = False,
) -> None:
    """Judge grasps in real depth images by what the camera saw; no robot executes them.

    Counts, for each kind of camera: images, or things; answered; best grasps that close within 2 cm and 4 cm of seen
    points of the thing; open hands with seen points more than 3 mm inside; answers with warnings; tables that can be
    judged, and right ones; wrong grasps that state a success of more than 0.7; and the mean stated success of the
    others. The files are documented in graspbox.evaluation.captures.
    """
    from graspbox.evaluation.captures import captures_in
    from graspbox.policies.grasp_image import ImageGrasper

    if disturb and (seed or pictures is not None):
        raise ConfigError("--disturb finds no grasps, so it takes no --seed and no --pictures; leave them out")
    check_files(out)
    folders, grasper = captures_in(folder), ImageGrasper(policy)
    if disturb:
        _disturbed(grasper, folders, given, out, as_json)
    else:
        _judged(grasper, folders, given, seed, _drawer(pictures), out, as_json)


def _judged(
    grasper: "ImageGrasper",
    folders: tuple[Path, ...],
    given: "Given",
    seed: int,
    draw: Callable[[str, Any], None],
    out: Path | None,
    as_json: bool,
) -> None:
    """Judge the grasps in captures; write and print the counts."""
    from graspbox.evaluation.captures import judge_captures, summary

    name = grasper.config.name
    with ProgressBar(name, len(folders), not as_json) as bar:
        rows = list(judge_captures(grasper, folders, given=given, seed=seed, progress=bar.update, draw=draw))
    cameras = sorted({row.camera for row in rows})
    counts = {camera: summary([row for row in rows if row.camera == camera]) for camera in cameras}
    result: dict[str, Any] = {"policy": name, "given": given, "cameras": counts, "all": summary(rows)}
    if out is not None:
        write_text(out, dumps({**result, "rows": [row.to_json() for row in rows]}))
    if as_json:
        print_json(result)
        return
    shown = [
        (camera, *("" if v is None else f"{v:.2f}" if isinstance(v, float) else str(v) for v in row.values()))
        for camera, row in {**counts, "all": result["all"]}.items()
    ]
    print_table(f"captures, {name}", ("camera", *(one.replace("_", " ") for one in result["all"])), shown)
    for row in rows:
        if row.refused is not None:
            console.print(f"{row.capture}{'' if row.thing is None else f', thing {row.thing}'}: {row.refused}")


def _disturbed(
    grasper: "ImageGrasper", folders: tuple[Path, ...], given: "Given", out: Path | None, as_json: bool
) -> None:
    """Write and print what is said of disturbed captures."""
    from graspbox.evaluation.disturbances import disturb_captures, silence

    name = grasper.config.name
    with ProgressBar(f"{name}, disturbed", len(folders), not as_json) as bar:
        rows = list(disturb_captures(grasper, folders, given=given, progress=bar.update))
    counts = silence(rows)
    result = {"policy": name, "given": given, "disturbances": counts}
    if out is not None:
        write_text(out, dumps({**result, "rows": [asdict(row) for row in rows]}))
    if as_json:
        print_json(result)
        return
    shown = [(kind, *map(str, row.values())) for kind, row in counts.items()]
    print_table(f"captures, {name}, {given}, disturbed", ("disturbance", "of", "refused", "told", "silent"), shown)


def _drawer(folder: Path | None) -> Callable[[str, Any], None]:
    """Return what saves the picture of an answer, by name, in a folder."""
    if folder is None:
        return lambda name, grasps: None
    from graspbox import pictures

    check_output(folder / "picture.png")
    return lambda name, grasps: pictures.save_grasp_image(folder / f"{name}.png", grasps)
