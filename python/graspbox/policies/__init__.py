"""Policies: what chooses the actions of many environments at once; torch-free.

| name | environments | what it does |
|---|---|---|
| ``random``  | all | actions sampled uniformly from the action space |
| ``zero``    | all | zero actions |
| ``planner`` | all | grasps at the planner's first-ranked pose; in ``Grasp-v0`` the scripted expert executes it |
| ``expert``  | ``Grasp-v0`` | as ``planner``, at the one of its 40 best poses that takes the least motion |
| ``seen_planner``  | all | as ``planner``, on the surface that one depth camera sees |
| ``robust_oracle`` | ``GraspPose-v0`` | of the planner's poses, the one that simulation finds most robust |
| a folder    | all | `DepthGrasp` or `HeadGrasp` with the networks that it holds: grasps what one depth camera sees |
| a folder    | the one that it names | `NetworkPolicy`: one network from observations to actions, such as a clone |
| a folder    | ``GraspPose-v0`` | a network of the study (`graspbox.learning.regressor`); also with ``model.json`` |
| a folder with ``feel.json`` | ``Grasp-v0`` | `FeelThenLift`: feels its grasp, and chooses once more if it is bad |

``planner``, ``expert`` and ``robust_oracle`` are **privileged**: they observe ``state`` and know the object's mesh.
`load` makes a policy by its name; `graspbox.evaluation.evaluate` measures one; a policy of your own is a subclass of
`Policy`.

| module | what it holds |
|---|---|
| `base`    | `Policy`, the interface, and `Task`, the environments that a policy acts in |
| `simple`  | ``random`` and ``zero`` |
| `planner` | ``planner`` and ``expert`` |
| `depth`   | `DepthGrasp` |
| `feel`    | `FeelThenLift` |
| `head`    | `HeadGrasp`: one network |
| `network` | `NetworkPolicy` |
| `network_folders` | what its folder holds |
| `goals` | where another policy would grasp, as an observation of ``Grasp-v0`` |
| `residual` | `ResidualGrasp`: bounded corrections of the grasps of another policy |
| `depth_oracles` | the truth in place of its parts, to measure what each loses, and ``robust_oracle`` |
| `seen_baselines` | `SeenPlanner` and `NearestGrasp`, which see one depth image and have no scorer |

A policy is bound to its environments once, told of every episode that begins, and then acts:

>>> import gymnasium, graspbox
>>> envs = gymnasium.make_vec(
...     "graspbox/GraspPose-v0", num_envs=2, objects="procedural:can:0-9", autoreset_mode="SameStep"
... )
>>> policy = graspbox.policies.load("planner")
>>> policy.bind(graspbox.policies.Task.of(envs))
>>> observation, info = envs.reset(seed=0)
>>> policy.reset(seed=0, info=info)
>>> for _ in range(3):
...     observation, reward, terminated, truncated, info = envs.step(policy.act(observation))
...     if (done := terminated | truncated).any():
...         policy.reset(mask=done, info=info)
>>> float(info["final_info"]["is_success"].mean())
1.0
"""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import cast

from graspbox.errors import ConfigError
from graspbox.perception.feel_folders import FEEL
from graspbox.perception.head_folders import HEAD_KIND
from graspbox.perception.policy_folders import CONFIG, KIND, POSE_KIND, policy_hash, read_kind
from graspbox.policies.base import Actions, Policy, Task
from graspbox.policies.depth import DepthGrasp
from graspbox.policies.depth_oracles import RobustOracle
from graspbox.policies.feel import Attempt, FeelThenLift
from graspbox.policies.head import HEAD, HeadGrasp
from graspbox.policies.network import NetworkPolicy
from graspbox.policies.network_folders import NETWORK_KIND, read_network_policy
from graspbox.policies.planner import Expert, Planner
from graspbox.policies.seen_baselines import NearestGrasp, SeenPlanner
from graspbox.policies.simple import Random, Zero

__all__ = [
    "Actions",
    "Attempt",
    "DepthGrasp",
    "Expert",
    "FeelThenLift",
    "HeadGrasp",
    "NearestGrasp",
    "NetworkPolicy",
    "Planner",
    "Policy",
    "Random",
    "RobustOracle",
    "SeenPlanner",
    "Task",
    "Zero",
    "load",
    "names",
]


def _regressor(folder: Path) -> Policy:
    """Make a policy of a network of the study; its module imports this one."""
    return cast(Policy, import_module("graspbox.learning.regressor").PoseRegressor(folder))


def _network(folder: Path) -> Policy:
    """Make a network that acts, and load the policy that looks for it, if one does."""
    config = read_network_policy(folder)
    if not config.goal_from:
        return NetworkPolicy(folder)
    other = folder / config.goal_from
    if not (other / CONFIG).is_file() or policy_hash(other) != config.goal_hash:
        raise ConfigError(
            f"the policy {config.name!r} needs, in {str(other)!r}, the policy with which it was published; that folder "
            "holds another one or none; restore it"
        )
    return NetworkPolicy(folder, base=load(str(other)))


#: Policies of a folder, by the kind that its ``config.json`` names.
_KINDS: dict[str, Callable[[Path], Policy]] = {
    KIND: DepthGrasp,
    HEAD_KIND: HeadGrasp,
    NETWORK_KIND: _network,
    POSE_KIND: _regressor,
}
#: File of a folder in which a network of the study was trained (`graspbox.learning`).
_STUDY = "model.json"
_BASELINES: dict[str, Callable[[], Policy]] = {
    kind.name: kind for kind in (Random, Zero, Planner, Expert, SeenPlanner, RobustOracle)
}


def names() -> tuple[str, ...]:
    """Names that `load` takes."""
    return tuple(_BASELINES)


def load(name: str) -> Policy:
    """Make a policy by its name.

    Parameters
    ----------
    name : str
        One of `names`, or a folder of a published policy: the table of the module says what each does.

    Raises
    ------
    ConfigError
        If there is no policy of that name, or the folder's ``config.json`` is wrong.
    FileError
        If the folder lacks a file.
    """
    if name in _BASELINES:
        return _BASELINES[name]()
    folder, known = Path(name), ", ".join(_BASELINES)
    if not folder.is_dir():
        raise ConfigError(f"there is no policy {name!r}; choose from {known}, or name a folder with config.json")
    if (folder / HEAD).is_file():
        return HeadGrasp(folder)
    if (folder / _STUDY).is_file():
        return _regressor(folder)
    if (folder / FEEL).is_file():
        return FeelThenLift(folder)
    kind = read_kind(folder)
    if kind not in _KINDS:
        raise ConfigError(f"{name} holds a policy of the kind {kind!r}; this version knows {', '.join(_KINDS)}")
    return _KINDS[kind](folder)
