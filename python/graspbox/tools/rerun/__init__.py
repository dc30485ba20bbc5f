"""Recordings for the viewer of rerun (extra ``rerun``): hand, objects, images, forces and probabilities over time.

>>> import graspbox, graspbox.tools.rerun
>>> scene = graspbox.Scene(graspbox.object_sets.load("procedural:can:0")[0].load())
>>> grasp = graspbox.plan(scene.mesh, world_from_object=scene.world_from_object).best()[0]
>>> path = graspbox.tools.rerun.log((scene, grasp), "can.rrd")  # doctest: +SKIP

`log` writes trials, episodes and grasps of images into a file, which ``rerun can.rrd`` shows; ``--rerun FILE.rrd`` of
``graspbox grasp``, ``evaluate``, ``record`` and ``grasp-image`` does the same. Episodes follow one another on the
timeline ``time``; the timeline ``episode`` counts them.

| entity | contents |
|---|---|
| ``world/object`` | mesh and pose of the object |
| ``world/others/INDEX``, ``world/walls`` | the other objects of the scene with their poses, and walls |
| ``world/hand``, ``world/hand/LINK`` | pose of the hand; mesh and pose of each link |
| ``world/contacts`` | forces on the object, 5 mm per N: of contacts in a trial, of tactile sensors in an episode |
| ``world/net_force`` | sum of all contact forces on the object, from its motion |
| ``world/cameras/NAME`` | images with the poses and intrinsics of their cameras |
| ``plots/...`` | force of the hand, lift, tension of each tendon, load of each actuator, predicted probability |
| ``log`` | object, seed and outcome of each episode |
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from graspbox.errors import ConfigError
from graspbox.evaluation.replays import Replay
from graspbox.planning import Grasp
from graspbox.policies.grasp_image import ImageGrasps
from graspbox.simulation import Scene
from graspbox.tools.rerun.episodes import of_demonstrations
from graspbox.tools.rerun.motions import RecordedMotion, Shot, of_replay, of_trial
from graspbox.tools.rerun.recording import RecordingWriter, check_file, record_all, recording, sdk

__all__ = [
    "RecordedMotion",
    "RecordingWriter",
    "Shot",
    "check_file",
    "log",
    "of_demonstrations",
    "of_replay",
    "of_trial",
    "recording",
]


def log(items: Any, to: str | os.PathLike[str] | Any = None, *, root: str = "") -> Path | None:
    """Log trials, episodes and grasps of images for rerun.

    Parameters
    ----------
    items : (Scene, Grasp), RecordedMotion, Replay, ImageGrasps, or a sequence of these
        A grasp of a plan, simulated in its scene; a motion of `of_trial` or `of_replay`; an episode of an evaluation;
        the result of `graspbox.policies.grasp_image.grasp_image`.
    to : str, PathLike or rerun.RecordingStream, optional
        A file ``.rrd``, which is replaced; or a stream of rerun, by default the one that ``rerun.init`` made.
    root : str
        Path above all entities.

    Returns
    -------
    Path or None
        The file; None for a stream.

    Raises
    ------
    ConfigError
        If `items` has another type, or `to` is neither an ``.rrd`` file nor a stream.
    FileError
        If the file cannot be written.
    MissingExtraError
        Without rerun-sdk.
    """
    rr = sdk()
    single = isinstance(items, RecordedMotion | Replay | ImageGrasps) or (isinstance(items, tuple) and len(items) == 2)
    things = [_motion(one) for one in ([items] if single or not isinstance(items, Sequence) else items)]
    if isinstance(to, str | os.PathLike):
        path = Path(to)
        with recording(path, root) as recorder:
            record_all(recorder, things)
        return path
    stream = rr.get_global_data_recording() if to is None else to
    if not isinstance(stream, rr.RecordingStream):
        raise ConfigError(f"to is {to!r}; name a file that ends in .rrd, or call rerun.init first")
    record_all(RecordingWriter(stream, root), things)
    return None


def _motion(item: Any) -> RecordedMotion | ImageGrasps:
    if isinstance(item, RecordedMotion | ImageGrasps):
        return item
    if isinstance(item, Replay):
        return of_replay(item)
    if isinstance(item, tuple) and len(item) == 2 and isinstance(item[0], Scene) and isinstance(item[1], Grasp):
        return of_trial(item[0], item[1].pose, float(item[1].preshape))
    raise ConfigError(
        f"items has a {type(item).__name__}; pass (scene, grasp), a RecordedMotion, a Replay or ImageGrasps"
    )
