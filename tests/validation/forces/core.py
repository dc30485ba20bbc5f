"""The protocol in the core: one call for all grasps of a scene."""

from __future__ import annotations

from graspbox._common.arguments import config_dict, floats
from graspbox.simulation import Scene
from validation.forces.config import Array, Contact, ForceConfig, Verdict

__all__ = ["judge_in_core"]


def judge_in_core(
    scene: Scene, poses: Array, preshape: Array, config: ForceConfig | None = None, threads: int | None = None
) -> list[Verdict]:
    """Judge grasps of the scene's object with the scene's engine.

    Parameters
    ----------
    scene : Scene
        The object at rest, the hand and the engine.
    poses : (n, 4, 4) float64
        ``object_from_hand``, metres.
    preshape : (n,) float64
        See `graspbox.Hand.preshape_limits`.
    config : ForceConfig
        The protocol.
    threads : int, optional
        Number of threads; the verdicts do not depend on it.

    Raises
    ------
    ConfigError
        If an array has the wrong shape, a pose is not a rigid motion, or a setting is out of range.
    """
    fields = config_dict(config or ForceConfig(), ForceConfig)
    result = scene._core.forces(floats(poses, "poses"), floats(preshape, "preshape"), fields, threads)
    contacts: list[list[Contact]] = [[] for _ in range(len(poses))]
    for owner, row in zip(result["contact_of"], result["contacts"], strict=True):
        # The core's normal is into the link.
        contacts[owner].append(Contact(int(row[0]), row[1:4], -row[4:7], float(row[8])))
    verdicts = []
    for i, (motion, kept) in enumerate(zip(result["motions"], result["verdicts"], strict=True)):
        verdicts.append(
            Verdict(
                passes=bool(kept[:-1, 0].all()),
                holds=bool(kept[:-1, 1].all()),
                lifts=bool(kept[-1, 0]),
                keeps=bool(kept[-1, 1]),
                shift=motion[:, 1, 0],
                turn=motion[:, 1, 1],
                start_depth=float(result["start_depth"][i]),
                closed_depth=float(result["closed_depth"][i]),
                contacts=contacts[i],
            )
        )
    return verdicts
