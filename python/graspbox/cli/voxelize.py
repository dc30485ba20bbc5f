"""``graspbox voxelize``: voxels of an object, as a binvox file."""

import time
from pathlib import Path
from typing import Annotated

import typer

import graspbox
from graspbox._common.files import check_output, replacing
from graspbox.cli.common import Json, Scale, console, find_one, print_json, print_table
from graspbox.meshes.voxels import Mode


def voxelize(
    mesh: Annotated[str, typer.Argument(help="A mesh file, or an object set that names one object.")],
    resolution: Annotated[int, typer.Option("-d", "--resolution", min=1, help="Voxels along the longest side.")] = 32,
    mode: Annotated[
        Mode, typer.Option(help="Voxels with their centre inside ('solid') or touched by a triangle ('surface').")
    ] = "solid",
    down: Annotated[int, typer.Option(min=0, help="Halve the resolution this often.")] = 0,
    remove_internal: Annotated[
        bool, typer.Option("--ri", "--remove-internal", help="Clear voxels whose six neighbours are set.")
    ] = False,
    exact: Annotated[bool, typer.Option("-e", "--exact", help="Set every voxel that a triangle touches, too.")] = False,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Write this .binvox file.")] = None,
    scale: Scale = 1.0,
    as_json: Json = False,
) -> None:
    """Cut an object into voxels.

    The options are those of binvox, except -e, which is --mode surface there. Nothing is random here, so there is no
    --seed.
    """
    if out is not None:
        check_output(out)
    loaded = find_one(mesh, scale).load()
    started = time.perf_counter()
    voxels = graspbox.voxelize(loaded, resolution, mode, down=down, remove_internal=remove_internal, exact=exact)
    seconds = time.perf_counter() - started
    if out is not None:
        with replacing(out) as temporary:
            voxels.save(temporary)
        console.print(f"wrote {out}")
    facts = {
        "resolution": voxels.resolution,
        "set": int(voxels.occupancy.sum()),
        "volume": voxels.volume,
        "voxel_size": voxels.voxel_size,
        "origin": voxels.origin.tolist(),
        "fill": voxels.fill,
        "seconds": seconds,
    }
    if as_json:
        print_json(facts)
        return
    rows: list[tuple[str, ...]] = [
        ("voxels per side", str(voxels.resolution)),
        ("side of a voxel / mm", f"{1e3 * voxels.voxel_size:.3f}"),
        ("voxels set", f"{facts['set']:,}"),
        ("volume / cm3", f"{1e6 * voxels.volume:.2f}"),
        ("fill rule", voxels.fill or "-"),
        ("time / ms", f"{1e3 * seconds:.1f}"),
    ]
    print_table(loaded.name, ("", ""), rows)
