"""``graspbox view``: views of an object, a hand, an environment, a depth image or a plan in a browser."""

import signal
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from graspbox._common.options import flattened
from graspbox.cli.camera.options import CameraPose, ReadingOptions
from graspbox.cli.common import HandOfPolicy, PerScene, Scale, Seed, console, find_hand
from graspbox.cli.grasp_image import TimeOption

Source = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE",
        help="An object or mesh file, an object set, a hand (name or hand.urdf,hand.toml), an environment id, the "
        "folder of a policy or of a run, a depth image, cloud or recording as of grasp-image, or a plan (.json).",
    ),
]
Objects = Annotated[str | None, typer.Option(help="Objects of an environment, or the object of a plan.")]
Mask = Annotated[
    Path | None,
    typer.Option(help="Image of the objects' numbers in a depth image, 0 for none, .npy or .png: each has its grasps."),
]
Poses = Annotated[int, typer.Option(min=0, help="Poses to simulate at once, best first.")]
Port = Annotated[
    int | None, typer.Option(min=0, max=65535, help="Port; 0: any free one. By default 8080 or the next free one.")
]
PolicyName = Annotated[str | None, typer.Option(help="Policy of an environment or a depth image: a name or a folder.")]
Layout = Annotated[str | None, typer.Option(help="How the objects of an environment lie: single, packed, pile or bin.")]


@flattened
def view(
    source: Source,
    reading: ReadingOptions,
    hand: HandOfPolicy = None,
    policy: PolicyName = None,
    objects: Objects = None,
    layout: Layout = None,
    objects_per_scene: PerScene = None,
    mask: Mask = None,
    time: TimeOption = None,
    camera_pose: CameraPose = None,
    poses: Poses = 200,
    host: Annotated[str, typer.Option(help="Address to listen at.")] = "127.0.0.1",
    port: Port = None,
    insecure: Annotated[
        bool, typer.Option("--insecure", help="Listen beyond this machine: anyone on that network may use the page.")
    ] = False,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")] = True,
    scale: Scale = 1.0,
    seed: Seed = 0,
) -> None:
    """Open an interactive view in a browser; Ctrl-C ends it."""
    open_view(
        source,
        hand=None if hand is None else find_hand(hand),
        objects=objects,
        layout=layout,
        objects_per_scene=objects_per_scene,
        scale=scale,
        seed=seed,
        poses=poses,
        policy=policy,
        mask=mask,
        time=time,
        camera_pose=camera_pose,
        **vars(reading),
        host=host,
        port=port,
        insecure=insecure,
        open_browser=browser,
    )


def open_view(source: Any, *, open_browser: bool = True, **options: Any) -> None:
    """Open a view and wait until Ctrl-C; arguments as of `graspbox.tools.viewer.show`."""
    from graspbox.tools.viewer import show

    with console.status("preparing"):
        viewer = show(source, open_browser=open_browser, **options)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    typer.echo(f"{viewer.page.title} at {viewer.url} (Ctrl-C ends)")
    sys.stdout.flush()
    with viewer:
        viewer.wait()
