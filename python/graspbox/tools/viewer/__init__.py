"""Interactive 3D views of objects, grasps, hands and environments in a browser (extra ``view``).

    graspbox view procedural:mug:0

`show` opens a view from Python and notebooks; ``graspbox view`` from the command line. Sources:

| source | page |
|---|---|
| an object, a mesh file or a mesh | boxes, the best grasp, all poses by outcome, the trace of any trial |
| a `graspbox.Scene`, a `graspbox.Arrangement` | the same for an object among others, which trials move |
| (mesh, plan), a plan, its JSON file | the same, with the poses of the plan |
| an object set | a gallery; each object opens |
| a hand, its name, or its two files | joints and preshape as sliders, shapes, tendons, sensors, swept volume; re-read |
| the id of an environment | stepped live by ``policy``, by sliders or by keys, with its images and all of its objects |
| the folder of a policy, or of a run of ``graspbox train sb3`` | the same, in its environment and with its objects |
| `graspbox.simulation.path_motion.PathMotion` | an arm on its path, on a time slider |
| a depth image, cloud or recording (`graspbox.captures`), `ImageGrasps`, `SceneGrasps` | points, crop, completed object, grasps by score |

``graspbox report`` shows tables of grasps, data sets and runs.
"""  # noqa: E501 (a table)

import webbrowser
from typing import Any

from graspbox.tools.viewer.page import Page, ViewerOptions
from graspbox.tools.viewer.server import Viewer

__all__ = ["Page", "Viewer", "ViewerOptions", "show"]


def show(
    source: Any,
    *,
    host: str = "127.0.0.1",
    port: int | None = None,
    insecure: bool = False,
    open_browser: bool = False,
    **options: Any,
) -> Viewer:
    """Open a view in a browser.

    In a notebook, the returned `Viewer` as the last value of a cell shows the page. Elsewhere open its ``url``,
    and keep the program running with `Viewer.wait`.

    Parameters
    ----------
    source : object
        A name, a path or a value of one of the kinds in the table of `graspbox.tools.viewer`.
    host : str
        Address to listen at.
    port : int, optional
        Port; 0 for any that is free; by default 8080 or the next free one.
    insecure : bool
        Allow an address beyond this machine: anybody who reaches it may use the page.
    open_browser : bool
        Open the page in the user's browser.
    **options
        ``hand``, ``seed`` and the other fields of `ViewerOptions`.

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
    viewer = Viewer(source, ViewerOptions(**options), host=host, port=port, insecure=insecure)
    if open_browser:
        webbrowser.open(viewer.url)
    return viewer
