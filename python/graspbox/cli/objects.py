"""``graspbox objects``, ``prepare`` and ``scenes``: a set's contents, its cache filled in advance, layouts of it."""

from pathlib import Path
from typing import Annotated

import typer

from graspbox._common.refusals import reason
from graspbox.cli.common import (
    HandName,
    Json,
    Mass,
    Objects,
    Scale,
    Seed,
    Split,
    Spread,
    Threads,
    check_files,
    end_with,
    find,
    print_json,
    print_table,
    progress,
)
from graspbox.configs import PhysicsConfig
from graspbox.envs._pools.preparation import load_objects, prepare_objects
from graspbox.hands.loading import hand_like
from graspbox.simulation import layouts


def objects(
    sets: Annotated[list[str] | None, typer.Argument(help="Object sets; 'procedural' by default.")] = None,
    split: Split = None,
    scale: Scale = 1.0,
    as_json: Json = False,
) -> None:
    """List the objects of a set, with their masses and splits.

    Nothing is random here, so there is no --seed.
    """
    object_set = find(sets, split, scale)
    if as_json:
        keys = ("name", "split", "mass", "mass_known")
        print_json([{key: getattr(spec, key) for key in keys} for spec in object_set])
        return
    rows: list[tuple[str, ...]] = [
        (s.name, s.split, "" if s.mass is None else f"{s.mass:.4f}", s.mass_known) for s in object_set
    ]
    print_table(f"{object_set.name}: {len(object_set)} objects", ("name", "split", "mass / kg", "mass known"), rows)


def prepare(
    sets: Annotated[list[str] | None, typer.Argument(help="Object sets; 'procedural' by default.")] = None,
    split: Split = None,
    scale: Scale = 1.0,
    mass: Mass = None,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Prepare the objects of a set: other processes then find them in the cache (GRASPBOX_CACHE).

    Nothing is random here, so there is no --seed. The exit status is 1 if some objects cannot be used.
    """
    object_set = find(sets, split, scale, mass)
    handle, _ = load_objects(object_set, "reflex", PhysicsConfig())
    with progress() as bar:
        task = bar.add_task(object_set.name, total=len(object_set))
        errors = prepare_objects(
            handle, False, threads, lambda done: bar.update(task, completed=done), skip_errors=True
        )
    refused = {object_set[index].name: reason(error, object_set[index].path) for index, error in errors.items()}
    prepared = [name for name in object_set.names if name not in refused]
    if as_json:
        print_json({"set": object_set.name, "prepared": prepared, "refused": refused})
    else:
        typer.echo(f"{len(prepared)} of {len(object_set)} objects of {object_set.name} are prepared")
    end_with(refused)


def scenes(
    objects: Objects = None,
    layout: Annotated[str, typer.Option(help="packed, pile or bin.")] = "pile",
    each: Annotated[int, typer.Option("--objects-per-scene", min=1, max=64, help="Wanted objects of a scene.")] = 5,
    count: Annotated[int, typer.Option("--scenes", min=1, max=10_000, help="Number of scenes.")] = 6,
    inside: Annotated[tuple[float, float, float], typer.Option(help="Length, width and height of the bin, metres.")] = (
        0.3,
        0.25,
        0.12,
    ),
    spread: Spread = 1.0,
    picture: Annotated[Path | None, typer.Option(help="Write a picture of the first 12 scenes into this file.")] = None,
    split: Split = None,
    scale: Scale = 1.0,
    hand: HandName = "reflex",
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Make scenes of several objects, packed, in piles or in bins, and draw them.

    Objects and their sizes are drawn at random, as in VGN: 0.7 to 0.9 of their size when packed, 0.8 to 1.0 in piles.
    A scene has fewer objects than wanted where some leave the workspace, or find no place within 12 attempts.
    """
    object_set, named = find(objects, split, scale), layouts.layout_named(layout)
    check_files(None, picture)
    made: list[layouts.Arrangement] = []
    with progress() as bar:
        task = bar.add_task("scenes", total=count)
        for number in range(seed, seed + count):
            meshes = [spec.load() for spec in layouts.draw_objects(object_set, each, named, number)]
            at_rest = layouts.arrange(
                meshes, named, most=each, spread=spread, seed=number, inside=inside, hand=hand_like(hand)
            )
            made.append(at_rest)
            bar.update(task, completed=len(made))
    if as_json:
        print_json([_scene_row(scene, each, seed + n) for n, scene in enumerate(made)])
    else:
        rows: list[tuple[str, ...]] = [
            (str(seed + n), ", ".join(mesh.name for mesh in scene.meshes), str(each - len(scene)))
            for n, scene in enumerate(made)
        ]
        print_table(f"{layout}: {count} scenes", ("seed", "objects", "missing"), rows)
    if picture is not None:
        from graspbox.pictures.arrangements import save_arrangements

        save_arrangements(picture, made[:12])


def _scene_row(scene: layouts.Arrangement, wanted: int, seed: int) -> dict[str, object]:
    return {
        "layout": scene.layout,
        "seed": seed,
        "objects": [
            {"name": mesh.name, "mass": mesh.mass, "world_from_object": pose.tolist()}
            for mesh, pose in zip(scene.meshes, scene.world_from_objects, strict=True)
        ],
        "missing": wanted - len(scene),
        "walls": [
            {"world_from_wall": pose.tolist(), "half_extents": half.tolist()}
            for pose, half in zip(scene.world_from_walls, scene.wall_half_extents, strict=True)
        ],
    }
