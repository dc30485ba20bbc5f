"""Interactive 3D views of objects, grasps, hands and runs in a browser (extra ``view``).

    graspbox view procedural:mug:0

`show` opens a view from Python and notebooks; ``graspbox view`` from the command line. Sources:

| source | page |
|---|---|
| an object, a mesh file or a mesh | boxes, poses by outcome, filters, and the trace of any trial |
| a `graspbox.Scene`, a `graspbox.Arrangement` | the same for an object among others, which trials move |
| (mesh, plan), a plan, its JSON file | the same, with the poses of the plan |
| the JSON file of ``graspbox grasp --out`` | counts; each object with its poses and outcomes |
| an object set | a gallery; each object opens |
| a hand, its name, or its two files | joints and preshape as sliders, shapes, tendons, sensors, swept volume; re-read |
| the id of an environment | stepped live by ``policy``, by sliders or by keys, with its images and all of its objects |
| a depth image (array, ``.npy``, ``.png``), `ImageGrasps` | points, crop, completed object, grasps by score |
| the folder of a data set | rows with filters, images, and the trial of a row replayed |
| the folder of a run | settings, log, results and curves, as they grow |

| module | contents |
|---|---|
| `server` | `Viewer`: a running view |
| `kinds` | the table of kinds: recogniser and page of each |
| `page`, `pages` | `Page`, the interface, and `Options`; one module per kind |
| `canvas` | a viser server as pages use it |
| `drawn_hand`, `player` | hands and poses in the scene; the trace of a trial on a time slider |
| `surroundings` | the other objects of a scene, those of an environment, and walls |
| `links`, `contacts`, `geometry` | frames of links, contacts of a trace, meshes and colours; without viser |
"""

import os
import webbrowser
from pathlib import Path
from typing import Any

from graspbox.hands import HandLike
from graspbox.viewer.page import Options, Page
from graspbox.viewer.server import Viewer

__all__ = ["Options", "Page", "Viewer", "show"]


def show(
    source: Any,
    *,
    hand: HandLike = "reflex",
    objects: str | None = None,
    layout: str | None = None,
    objects_per_scene: int | None = None,
    scale: float = 1.0,
    seed: int = 0,
    poses: int = 200,
    policy: str | os.PathLike[str] | None = None,
    intrinsics: tuple[float, float, float, float] | None = None,
    depth_scale: float | None = None,
    camera_pose: str | Path | None = None,
    host: str = "127.0.0.1",
    port: int | None = None,
    insecure: bool = False,
    open_browser: bool = False,
) -> Viewer:
    """Open a view in a browser.

    In a notebook, the returned `Viewer` as the last value of a cell shows the page. Elsewhere open its ``url``,
    and keep the program running with `Viewer.wait`.

    Parameters
    ----------
    source : object
        A name, a path or a value of one of the kinds in the table of `graspbox.viewer`.
    hand, objects, layout, objects_per_scene, scale, seed, poses, policy, intrinsics, depth_scale, camera_pose
        See `Options`.
    host : str
        Address to listen at.
    port : int, optional
        Port; 0 for any that is free; by default 8080 or the next free one.
    insecure : bool
        Allow an address beyond this machine: anybody who reaches it may use the page.
    open_browser : bool
        Open the page in the user's browser.

    Returns
    -------
    Viewer
        The running view; ``close`` ends it.

    Raises
    ------
    ConfigError, ObjectSetError
        If the source does not exist, an option is invalid, or the address cannot be used.
    MissingExtraError
        Without viser (extra ``view``).
    GraspboxError
        If the source cannot be read or simulated.
    """
    options = Options(
        hand=hand,
        objects=objects,
        layout=layout,
        objects_per_scene=objects_per_scene,
        scale=scale,
        seed=seed,
        poses=poses,
        policy=None if policy is None else os.fspath(policy),
        intrinsics=intrinsics,
        depth_scale=depth_scale,
        camera_pose=camera_pose,
    )
    viewer = Viewer(source, options, host=host, port=port, insecure=insecure)
    if open_browser:
        webbrowser.open(viewer.url)
    return viewer
