"""``graspbox export-scene``: a scene of one object or several, or the objects of a set, as MJCF, USD or URDF."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import graspbox
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
from graspbox.hands import Hand
from graspbox.object_sets import Split as SplitName
from graspbox.planning import Grasp, Plan
from graspbox.simulation import Scene, layouts
from graspbox.tools import scene_export
from graspbox.tools.scene_export.folders import check_folder

_POSE = "x,y,z,qw,qx,qy,qz"

_ObjectName = Annotated[
    str | None,
    typer.Argument(
        metavar="OBJECT", help="A mesh file, or an object set that names one object; with --layout, any object set."
    ),
]
_ObjectsAlone = Annotated[
    list[str] | None, typer.Option(help="Export the objects of this set, a folder each; may be repeated.")
]
_HandName = Annotated[
    str | None, typer.Option(help="A hand by its name, or its two files: hand.urdf,hand.toml. [reflex]")
]
_PoseText = Annotated[str | None, typer.Option(help=f"Pose of the hand in the object's frame: {_POSE}.")]
_PlanFile = Annotated[Path | None, typer.Option(help="Take the grasp from this file of graspbox plan --out.")]
_Rank = Annotated[int | None, typer.Option(min=1, help="Rank of the plan's grasp, 1 for the best. [1]")]
_LayoutName = Annotated[str | None, typer.Option(help="Draw several objects from OBJECT: packed, pile or bin.")]
_PerScene = Annotated[int | None, typer.Option(min=1, max=64, help="Number of objects of a layout. [5]")]


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
        matrix = read_pose(pose)
        low, high = scene.hand.preshape_limits
        if preshape is None and low != high:
            raise ConfigError(f"--preshape is missing; give the preshape of --pose, {low:g} to {high:g}")
        return matrix, low if preshape is None else preshape
    if plan is not None:
        path, saved = plan
        scene.check_plan(saved)
        return _rank(saved, rank, f"the plan {str(path)!r}"), None
    with console.status("planning"):
        made = graspbox.plan(scene.mesh, hand=scene.hand, world_from_object=scene.world_from_object, seed=seed)
    return _rank(made, rank, f"the plan of {scene.name!r} for {scene.hand.name!r} with seed {seed}"), None


def _heap(
    objects: str, split: SplitName | None, scale: float, layout: str, count: int, seed: int, hand: Hand
) -> layouts.Arrangement:
    """Make the scene of several objects that ``graspbox scenes`` makes with the same seed."""
    object_set, named = find([objects], split, scale), layouts.layout_named(layout)
    meshes = [spec.load() for spec in layouts.draw_objects(object_set, count, named, seed)]
    return layouts.arrange(meshes, named, most=count, seed=seed, hand=hand)


def _grasp_among(heap: layouts.Arrangement, hand: Hand, rank: int | None, seed: int) -> tuple[int, Grasp] | None:
    """Plan for every object among the others; return the grasp of a rank, of all, and the index of its object.

    None, with a message, if there is no feasible grasp and no option names the rank.
    """
    ranked: list[tuple[float, int, Grasp]] = []
    for index, (mesh, rest) in enumerate(zip(heap.meshes, heap.world_from_objects, strict=True)):
        around = heap.without(index)
        plan = graspbox.plan(mesh, hand=hand, world_from_object=rest, seed=seed, neighbours=around).best()
        ranked += [(float(plan.score[i]), index, plan[i]) for i in range(len(plan))]
    ranked.sort(key=lambda row: -row[0])
    if len(ranked) < (rank or 1):
        if rank is None:
            console.print(f"the planner finds no feasible grasp of these objects for {hand.name!r}")
            return None
        raise PlanError(f"--grasp is {rank}; the {len(heap)} objects have {len(ranked)} feasible grasps")
    return ranked[(rank or 1) - 1][1:]


def _export_heap(
    heap: layouts.Arrangement, hand: Hand, out: Path, to: str, grasp: tuple[int, Grasp] | None, as_json: bool
) -> None:
    """Export a scene of several objects, with the hand at a grasp of one of them if there is one."""
    scene = Scene.of(heap, hand=hand)
    where: tuple[Any, float | None] = (None, None)
    if grasp is not None:
        index, one = grasp
        world_from_hand = heap.world_from_objects[index] @ one.pose
        where = np.linalg.inv(scene.world_from_object) @ world_from_hand, one.preshape
    done = scene_export.export_scene(scene, out, to, *where)  # type: ignore[arg-type]
    names = [mesh.name for mesh in heap.meshes]
    grasped = None if grasp is None else names[grasp[0]]
    held = "without a hand" if grasp is None else f"{hand.name} at a grasp of {grasped}"
    facts = {"objects": names, "grasp_of": grasped, "hand": None if grasp is None else hand.name}
    _print(done, f"{', '.join(names)}; {held}", facts, as_json)


def _print(done: scene_export.Export, title: str, facts: dict[str, Any], as_json: bool) -> None:
    files, limits = [str(path) for path in done.files], list(done.not_expressed)
    if as_json:
        print_json({"to": done.to, **facts, "folder": str(done.folder), "files": files, "not_expressed": limits})
        return
    typer.echo(f"{title}: {files[0]}")
    console.print(f"{len(files)} files; scene.json lists the limits of {done.to} ({len(limits)} points)")


def _check_options(
    one: str | None, objects: list[str] | None, heaped: Mapping[str, object], scene_only: Mapping[str, object]
) -> None:
    """Refuse options that contradict each other."""
    if (one is None) == (objects is None):
        raise typer.BadParameter("name one OBJECT, or an object set with --objects", param_hint="OBJECT")
    used = [name for name, value in scene_only.items() if value is not None]
    if objects is not None and used:
        raise typer.BadParameter("a set of objects has no hand; leave it out", param_hint=used[0])
    if objects is not None and heaped["--layout"] is not None:
        raise typer.BadParameter(
            "--objects exports every object by itself; name the set as OBJECT", param_hint="--layout"
        )
    if heaped["--layout"] is None and heaped["--objects-per-scene"] is not None:
        raise typer.BadParameter("it belongs to --layout", param_hint="--objects-per-scene")
    if heaped["--layout"] is not None and (single := [n for n in ("--pose", "--preshape", "--plan") if n in used]):
        raise typer.BadParameter("it applies to a single object; leave it out, or --layout", param_hint=single[0])
    if "--without-hand" in used and len(used) > 1:
        other = next(name for name in used if name != "--without-hand")
        raise typer.BadParameter("it applies to the hand; leave it out, or --without-hand", param_hint=other)
    if {"--pose", "--plan"} <= set(used):
        raise typer.BadParameter("it names another pose than --plan; give one of them", param_hint="--pose")
    if "--preshape" in used and "--pose" not in used:
        raise typer.BadParameter("it belongs to --pose; a grasp of a plan has its own", param_hint="--preshape")
    if "--grasp" in used and "--pose" in used:
        raise typer.BadParameter("it counts the grasps of a plan; leave it out with --pose", param_hint="--grasp")


def export_scene(
    one: _ObjectName = None,
    to: Annotated[str, typer.Option(help="Format: mjcf, usd or urdf.")] = ...,  # type: ignore[assignment]
    out: Annotated[Path, typer.Option(help="Folder to make; it may exist if it is empty.")] = ...,  # type: ignore[assignment]
    objects: _ObjectsAlone = None,
    hand: _HandName = None,
    pose: _PoseText = None,
    preshape: Annotated[float | None, typer.Option(help="Preshape of the hand, with --pose.")] = None,
    plan: _PlanFile = None,
    grasp: _Rank = None,
    without_hand: Annotated[bool, typer.Option("--without-hand", help="Leave out the hand.")] = False,
    layout: _LayoutName = None,
    objects_per_scene: _PerScene = None,
    split: Split = None,
    scale: Scale = 1.0,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Write objects at rest, a hand about to grasp one of them and the table as MJCF, USD or URDF.

    The hand is at --pose, at a grasp of --plan, or at a grasp that is planned with --seed. With --layout, several
    objects lie as graspbox scenes makes them with --seed; the hand is at the planner's first-ranked grasp of all of
    them, and is left out where there is none. With --objects, every object of a set is written by itself, without a
    hand. scene.json or object.json in the folder lists the limits of the format.
    """
    heaped = {"--layout": layout, "--objects-per-scene": objects_per_scene}
    scene_only = {"--hand": hand, "--pose": pose, "--preshape": preshape, "--plan": plan, "--grasp": grasp}
    _check_options(one, objects, heaped, {**scene_only, "--without-hand": without_hand or None})
    if to not in scene_export.FORMATS:
        raise ConfigError(f"--to is {to!r}; choose from {', '.join(scene_export.FORMATS)}")
    check_folder(out)
    if objects is not None:
        _export_set(objects, split, scale, out, to, as_json)
        return
    assert one is not None
    with_hand = find_hand(hand or "reflex")
    if layout is not None:
        with console.status("preparing"):
            heap = _heap(one, split, scale, layout, objects_per_scene or 5, seed, with_hand)
            chosen = None if without_hand else _grasp_among(heap, with_hand, grasp, seed)
        _export_heap(heap, with_hand, out, to, chosen, as_json)
        return
    if split is not None:
        raise typer.BadParameter("it belongs to --objects and --layout", param_hint="--split")
    spec = find_one(one, scale)
    with console.status("preparing"):
        saved = None if plan is None else (plan, Plan.load(plan))
        rest = None if saved is None else saved[1].world_from_object
        scene = Scene(spec.load(), hand=with_hand, world_from_object=rest)
    where = (None, None) if without_hand else _grasp(scene, pose, preshape, saved, grasp or 1, seed)
    done = scene_export.export_scene(scene, out, to, *where)
    name = None if without_hand else scene.hand.name
    title = scene.name if name is None else f"{scene.name} and {name}"
    _print(done, title, {"object": scene.name, "hand": name}, as_json)


def _export_set(objects: list[str], split: SplitName | None, scale: float, out: Path, to: str, as_json: bool) -> None:
    """Export the objects of a set, with a progress bar."""
    object_set = find(objects, split, scale)
    with progress() as bar:
        task = bar.add_task("exporting", total=len(object_set))
        done = scene_export.export_objects(object_set, out, to, done=lambda _: bar.advance(task))  # type: ignore[arg-type]
    if as_json:
        files = {name: str(path) for name, path in done.files.items()}
        print_json({"to": done.to, "folder": str(done.folder), "files": files, "refused": done.refused})
    else:
        typer.echo(f"{len(done.files)} of {len(object_set)} objects: {done.folder}")
    end_with(done.refused)
