"""Earlier answers in requests for grasps (``previous``): what is read of them, and its checks.

Clients send back what they were answered, so that servers remember nothing.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import floats, natural, shown
from graspbox.errors import ConfigError
from graspbox.hands import Hand
from graspbox.perception.captured import MOST_THINGS
from graspbox.policies.grasp_image import EARLIER_ENTRIES, EarlierGrasp, EarlierScene
from graspbox.tools.remote.sent_arrays import sent_array

__all__ = ["earlier_grasp", "earlier_scene"]

#: Farthest hand, metres.
_FARTHEST = 100.0
_ADVICE = "give an earlier answer, or its entries"


def earlier_grasp(value: Any, hand: Hand) -> EarlierGrasp | None:
    """Return the best grasp of an earlier answer; None without one.

    Raises
    ------
    ConfigError
        If it is no answer with grasps of one thing, or one of another hand.
    """
    if not isinstance(value, Mapping) or any(name not in value for name in EARLIER_ENTRIES):
        raise ConfigError(f"previous is {shown(value)}; {_ADVICE} {', '.join(EARLIER_ENTRIES)}")
    named = value["hand"]
    if not isinstance(named, str):
        raise ConfigError(f"previous.hand is {shown(named)}; {_ADVICE}")
    preshapes = floats(value["preshape"], "previous.preshape")
    if preshapes.ndim != 1:
        raise ConfigError(f"previous.preshape has shape {preshapes.shape}; give (n,)")
    if not len(preshapes):
        return None
    poses = [_pose(value[name], f"previous.{name}") for name in ("camera_from_hand", "table_from_hand")]
    preshape = float(preshapes[0])
    least, most = hand.preshape_limits
    # Another hand is refused by its name.
    if named == hand.name and not least - 1e-9 <= preshape <= most + 1e-9:
        raise ConfigError(f"previous.preshape begins with {preshape:g}; those of {named} are {least:g} to {most:g}")
    return EarlierGrasp(named, poses[0], poses[1], preshape)


def _pose(value: Any, name: str) -> NDArray[np.float64]:
    """Return the first pose (4, 4) of some (n, 4, 4)."""
    poses = floats(value, name)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or not len(poses):
        raise ConfigError(f"{name} has shape {poses.shape}; give poses (n, 4, 4), as many as preshapes")
    pose: NDArray[np.float64] = poses[0]
    turn = pose[:3, :3]
    rigid = np.isfinite(pose).all() and np.allclose(pose[3], (0, 0, 0, 1))
    if not rigid or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) or np.linalg.det(turn) < 0:
        raise ConfigError(f"{name} begins with no rigid motion; {_ADVICE}, in metres")
    if np.abs(pose[:3, 3]).max() > _FARTHEST:
        raise ConfigError(f"{name} begins {np.abs(pose[:3, 3]).max():.3g} m away; {_ADVICE}, in metres")
    return pose


def earlier_scene(value: Any, hand: Hand) -> EarlierScene:
    """Return the best grasps of an earlier answer of all things; errors as of `earlier_grasp`."""
    things = value.get("things") if isinstance(value, Mapping) else None
    if not isinstance(things, list | tuple) or len(things) > MOST_THINGS or "labels" not in value:
        raise ConfigError(f"previous is {shown(value)}; {_ADVICE} things, at most {MOST_THINGS}, and labels")
    labels = sent_array(value["labels"], "previous.labels", f"{_ADVICE}, with numbers (h, w)")
    if labels.ndim != 2 or labels.dtype.kind not in "iu" or (labels.size and int(labels.max()) >= 2**62):
        raise ConfigError(f"previous.labels is {labels.dtype} of shape {labels.shape}; {_ADVICE}, with numbers (h, w)")
    best: dict[int, EarlierGrasp] = {}
    for one in things:
        if not isinstance(one, Mapping) or "thing" not in one:
            raise ConfigError(f"previous.things holds {shown(one)}; {_ADVICE}")
        number = natural(one["thing"], "previous.things.thing", bits=62)
        if "refused" not in one and (found := earlier_grasp(one, hand)) is not None:
            best[number] = found
    return EarlierScene(labels.astype(np.int64), best)
