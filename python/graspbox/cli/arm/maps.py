"""``graspbox arm map``: where an arm reaches things around its base."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox.arms import load_arm, reach_map
from graspbox.cli.common import (
    HandName,
    Json,
    Seed,
    Threads,
    check_files,
    console,
    find_hand,
    print_json,
    print_table,
)
from graspbox.hands.loading import hand_like
from graspbox.planning import typical_grasps

__all__ = ["map_command"]

#: Most things whose grasps are typical, and rings around the base, metres.
_MOST_THINGS = 20
_RINGS = ((0.0, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.0))


def map_command(
    arm: Annotated[str, typer.Argument(help="A name such as fr3, or URDF,TOML.")],
    hand: HandName,
    workspace: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(
            metavar="X Y X Y",
            help="Lower and upper corner of a rectangle on the table, metres, in which the base shall reach the most.",
        ),
    ] = None,
    height: Annotated[float, typer.Option(help="Height of the upright base over the table, metres.")] = 0.0,
    spacing: Annotated[float, typer.Option(help="Distance between positions, metres.")] = 0.05,
    turns: Annotated[int, typer.Option(help="Angles about the vertical by which each grasp is turned.")] = 4,
    objects: Annotated[
        list[str] | None,
        typer.Option(help="Object set whose grasps are typical, at most 20; by default two boxes and two cylinders."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Write a picture into this file.")] = None,
    seed: Seed = 0,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Map which share of typical grasps an arm reaches, by where the thing stands, and where its base stands best.

    Grasps come from above and from the side; what stands around is not in the way. Positions are in the frame of the
    arm's base, those of the workspace and of the best base in the frame of the workspace.
    """
    check_files(None, out)
    loaded, held = load_arm(hand_like(arm)), find_hand(hand)
    things = None if objects is None else [spec.load() for spec in object_sets.load(objects)[:_MOST_THINGS]]
    with console.status("planning, and testing what is reached"):
        grasps = typical_grasps(held, objects=things, seed=seed, num_threads=threads)
        found = reach_map(
            loaded,
            held,
            grasps.poses,
            grasps.preshape,
            spacing=spacing,
            turns=turns,
            height=height,
            seed=seed,
            num_threads=threads,
        )
        place = None if workspace is None else found.best_base(workspace[:2], workspace[2:])
    if out is not None:
        from graspbox.pictures import save_reach_map

        save_reach_map(out, found, place=place, workspace=workspace)
        console.print(f"wrote {out}")
    if as_json:
        base = None if place is None else {**place._asdict(), "table_from_base": place.pose.tolist()}
        print_json({**found.to_json(), "best_base": base})
        return
    shares = {"all grasps": found.share, "from above": found.above, "from the side": found.side}
    rows = [(name, *_bands(found.x, found.y, share)) for name, share in shares.items() if not np.isnan(share).any()]
    columns = ("distance from the base / m", *(f"{low:g} to {high:g}" for low, high in _RINGS))
    print_table(f"{found.arm} with {found.hand}: share of {found.grasps} grasps that is reached", columns, rows)
    if place is not None:
        typer.echo(
            f"best base: x {place.x:.2f} m, y {place.y:.2f} m, turned by {np.degrees(place.yaw):.0f} degrees "
            f"(--base {place.x:.2f} {place.y:.2f} {height:g} {np.degrees(place.yaw):.0f}): it reaches "
            f"{place.share:.0%} of the grasps in the workspace, {place.least:.0%} at the worst position"
        )


def _bands(x: NDArray[np.float64], y: NDArray[np.float64], share: NDArray[np.float64]) -> list[str]:
    """Return the mean share in each ring around the base."""
    away = np.hypot(x[None], y[:, None])
    inside = [(away >= low) & (away < high) for low, high in _RINGS]
    return [f"{share[ring].mean():.0%}" if ring.any() else "" for ring in inside]
