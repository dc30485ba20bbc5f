"""``graspbox export-scene``: a scene, or the objects of a set, as MJCF, USD or URDF."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import graspbox
from graspbox import scene_export
from graspbox._common.rotations import poses_from, rotation_from_quaternion
from graspbox.cli.common import (
    Json,
    Scale,
    Seed,
    Split,
    console,
    end_with,
    find,
    find_hand,
    find_one,
    print_json,
    progress,
)
from graspbox.errors import ConfigError, PlanError
from graspbox.planning import Grasp, Plan
from graspbox.scene_export.folders import check_folder
from graspbox.simulation import Scene

_POSE = "x,y,z,qw,qx,qy,qz"


def read_pose(text: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Read a pose (4, 4) from seven numbers with commas between: position (m) and quaternion."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 7 or not np.isfinite(numbers).all():
        raise ConfigError(f"--pose is {text[:80]!r}; give seven numbers {_POSE}: metres, and a quaternion")
    if not 0.999 < float(np.linalg.norm(numbers[3:])) < 1.001:
        raise ConfigError(f"--pose is {text[:80]!r}; its quaternion qw,qx,qy,qz must have length 1")
    rotation = rotation_from_quaternion([numbers[3:]])
    return np.asarray(poses_from([numbers[:3]], rotation)[0])


def _rank(plan: Plan, rank: int, source: str) -> Grasp:
    """Return the feasible grasp of a rank, 1 for the best."""
    best = plan.best()
    if rank > len(best):
        raise PlanError(f"--grasp is {rank}; {source} has {len(best)} feasible grasps")
    return best[rank - 1]


def _grasp(
    scene: Scene, pose: str | None, preshape: float | None, plan: tuple[Path, Plan] | None, rank: int, seed: int
) -> tuple[Any, float | None]:
    """Return the pose and the preshape that the options name, of a saved plan, or of a new one."""
    if pose is not None:
        found = read_pose(pose)
        low, high = scene.hand.preshape_limits
        if preshape is None and low != high:
            raise ConfigError(f"--preshape is missing; give the preshape of --pose, {low:g} to {high:g}")
        return found, low if preshape is None else preshape
    if plan is not None:
        path, saved = plan
        scene.check_plan(saved)
        return _rank(saved, rank, f"the plan {str(path)!r}"), None
    with console.status("planning"):
        made = graspbox.plan(scene.mesh, hand=scene.hand, world_from_object=scene.world_from_object, seed=seed)
    return _rank(made, rank, f"the plan of {scene.name!r} for {scene.hand.name!r} with seed {seed}"), None


def _check_options(one: str | None, objects: list[str] | None, scene_only: Mapping[str, object]) -> None:
    """Refuse options that contradict each other."""
    if (one is None) == (objects is None):
        raise typer.BadParameter("name one OBJECT, or an object set with --objects", param_hint="OBJECT")
    if objects is not None:
        for name, value in scene_only.items():
            if value is not None:
                raise typer.BadParameter("a set of objects has no hand; leave it out", param_hint=name)
    used = [name for name in ("--pose", "--plan") if scene_only[name] is not None]
    if len(used) == 2:
        raise typer.BadParameter("it names another pose than --plan; give one of them", param_hint="--pose")
    if scene_only["--preshape"] is not None and scene_only["--pose"] is None:
        raise typer.BadParameter("it belongs to --pose; a grasp of a plan has its own", param_hint="--preshape")
    if scene_only["--grasp"] is not None and scene_only["--pose"] is not None:
        raise typer.BadParameter("it counts the grasps of a plan; leave it out with --pose", param_hint="--grasp")


def export_scene(
    one: Annotated[
        str | None, typer.Argument(metavar="OBJECT", help="A mesh file, or an object set that names one object.")
    ] = None,
    to: Annotated[str, typer.Option("--to", help="Format: mjcf, usd or urdf.")] = ...,  # type: ignore[assignment]
    out: Annotated[Path, typer.Option("--out", help="Folder to make; it may exist if it is empty.")] = ...,  # type: ignore[assignment]
    objects: Annotated[
        list[str] | None,
        typer.Option("--objects", help="Export the objects of this set alone, a folder each; may be repeated."),
    ] = None,
    hand: Annotated[
        str | None, typer.Option("--hand", help="A hand by its name, or its two files: hand.urdf,hand.toml. [reflex]")
    ] = None,
    pose: Annotated[
        str | None, typer.Option("--pose", help=f"Pose of the hand in the object's frame: {_POSE}.")
    ] = None,
    preshape: Annotated[float | None, typer.Option("--preshape", help="Preshape of the hand, with --pose.")] = None,
    plan: Annotated[
        Path | None, typer.Option("--plan", help="Take the grasp from this file of graspbox plan --out.")
    ] = None,
    grasp: Annotated[
        int | None, typer.Option("--grasp", min=1, help="Rank of the plan's grasp, 1 for the best. [1]")
    ] = None,
    split: Split = None,
    scale: Scale = 1.0,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Write an object at rest, a hand about to grasp it and the table as MJCF, USD or URDF.

    The hand is at --pose, at a grasp of --plan, or at a grasp that is planned with --seed. With --objects, every object
    of a set is written alone, without a hand. scene.json or object.json in the folder lists the limits of the format.
    """
    scene_only = {"--hand": hand, "--pose": pose, "--preshape": preshape, "--plan": plan, "--grasp": grasp}
    _check_options(one, objects, scene_only)
    if to not in scene_export.FORMATS:
        raise ConfigError(f"--to is {to!r}; choose from {', '.join(scene_export.FORMATS)}")
    check_folder(out)
    if objects is not None:
        _export_set(objects, split, scale, out, to, as_json)
        return
    assert one is not None
    if split is not None:
        raise typer.BadParameter("it belongs to --objects", param_hint="--split")
    spec, with_hand = find_one(one, scale), find_hand(hand or "reflex")
    with console.status("preparing"):
        saved = None if plan is None else (plan, Plan.load(plan))
        rest = None if saved is None else saved[1].world_from_object
        scene = Scene(spec.load(), hand=with_hand, world_from_object=rest)
    where, value = _grasp(scene, pose, preshape, saved, grasp or 1, seed)
    done = scene_export.export_scene(scene, out, to, where, value)
    if as_json:
        files = [str(path) for path in done.files]
        facts = {"to": done.to, "object": scene.name, "hand": scene.hand.name, "folder": str(done.folder)}
        print_json({**facts, "files": files, "not_expressed": list(done.not_expressed)})
        return
    typer.echo(f"{scene.name} and {scene.hand.name}: {done.files[0]}")
    console.print(f"{len(done.files)} files; scene.json lists the limits of {to} ({len(done.not_expressed)} points)")


def _export_set(objects: list[str], split: str | None, scale: float, out: Path, to: str, as_json: bool) -> None:
    """Export the objects of a set, with a progress bar."""
    found = find(objects, split, scale)
    with progress() as bar:
        task = bar.add_task("exporting", total=len(found))
        done = scene_export.export_objects(found, out, to, done=lambda _: bar.advance(task))  # type: ignore[arg-type]
    if as_json:
        files = {name: str(path) for name, path in done.files.items()}
        print_json({"to": done.to, "folder": str(done.folder), "files": files, "refused": done.refused})
    else:
        typer.echo(f"{len(done.files)} of {len(found)} objects: {done.folder}")
    end_with(done.refused)
