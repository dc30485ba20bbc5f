"""``graspbox view``: views of an object, a hand, an environment, a depth image, a data set or a plan in a browser."""

import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from graspbox.cli.common import HandName, PerScene, Scale, Seed, console, find_hand

Source = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE",
        help="An object or mesh file, an object set, a hand (name or hand.urdf,hand.toml), an environment id, a depth "
        "image (.npy, .png), a plan or table of grasps (.json), the folder of a data set or of a run.",
    ),
]
PolicyOption = Annotated[
    str | None, typer.Option("--policy", help="Policy of an environment or a depth image: a name or a folder.")
]
Objects = Annotated[str | None, typer.Option("--objects", help="Objects of an environment, or the object of a plan.")]
LayoutName = Annotated[
    str | None,
    typer.Option("--layout", help="How the objects of an environment lie: single, packed, pile or bin."),
]
Intrinsics = Annotated[
    tuple[float, float, float, float] | None,
    typer.Option("--intrinsics", metavar="FX FY CX CY", help="Intrinsics of a depth image, pixels."),
]
DepthScale = Annotated[
    float | None,
    typer.Option("--depth-scale", help="Metres per unit of a depth image; by default 1 for floats, else 0.001."),
]
CameraPose = Annotated[
    Path | None,
    typer.Option("--camera-pose", help="File of table_from_camera (4x4); by default the table is searched for."),
]
Poses = Annotated[int, typer.Option("--poses", min=0, help="Poses to simulate at once, best first.")]
Host = Annotated[str, typer.Option("--host", help="Address to listen at.")]
Port = Annotated[
    int | None,
    typer.Option("--port", min=0, max=65535, help="Port; 0: any free one. By default 8080 or the next free one."),
]
Insecure = Annotated[
    bool, typer.Option("--insecure", help="Listen beyond this machine: anybody on that network may use the page.")
]
OpensBrowser = Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")]


def view(
    source: Source,
    hand: HandName = "reflex",
    policy: PolicyOption = None,
    objects: Objects = None,
    layout: LayoutName = None,
    objects_per_scene: PerScene = None,
    intrinsics: Intrinsics = None,
    depth_scale: DepthScale = None,
    camera_pose: CameraPose = None,
    poses: Poses = 200,
    host: Host = "127.0.0.1",
    port: Port = None,
    insecure: Insecure = False,
    browser: OpensBrowser = True,
    scale: Scale = 1.0,
    seed: Seed = 0,
) -> None:
    """Open an interactive view in a browser; Ctrl-C ends it."""
    from graspbox.viewer import show

    with console.status("preparing"):
        viewer = show(
            source,
            hand=find_hand(hand),
            objects=objects,
            layout=layout,
            objects_per_scene=objects_per_scene,
            scale=scale,
            seed=seed,
            poses=poses,
            policy=policy,
            intrinsics=intrinsics,
            depth_scale=depth_scale,
            camera_pose=camera_pose,
            host=host,
            port=port,
            insecure=insecure,
            open_browser=browser,
        )
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    typer.echo(f"{viewer.page.title} at {viewer.url} (Ctrl-C ends)")
    sys.stdout.flush()
    with viewer:
        viewer.wait()
