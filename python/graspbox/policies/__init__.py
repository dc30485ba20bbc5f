"""Policies, which choose the actions of many environments at once; torch-free.

| name | environments | behaviour |
|---|---|---|
| ``random``  | all | actions sampled uniformly from the action space |
| ``zero``    | all | zero actions |
| ``top_down`` | ``GraspPose-v0``, ``Clear-v0`` | straight down at the highest point of a depth image |
| ``scene_planner`` | ``Clear-v0`` | the planner's first-ranked pose of all objects among their neighbours |
| ``planner`` | of one object | the planner's first-ranked pose; in ``Grasp-v0`` the scripted expert executes it |
| ``expert``  | ``Grasp-v0`` | as ``planner``, at the one of its 40 best poses that takes the least motion |
| ``partial_view_planner`` | all | as ``planner``, on the surface that one depth camera sees |
| ``best_proposal`` | all | of grasps proposed on that surface, all over the table, the one that geometry ranks first |
| ``robust_oracle`` | ``GraspPose-v0`` | of the planner's poses, the one that simulation ranks most robust |
| a folder    | all | `DepthGrasp` or `HeadGrasp` with its networks: grasps the object in one depth image |
| a folder    | its own | `NetworkPolicy`: one network from observations to actions, such as a clone |
| a folder    | ``GraspPose-v0`` | a network of the study (`graspbox.study.regressor`) |
| a folder    | ``Grasp-v0`` | `FeelThenLift`: predicts whether its grasp will hold, and retries once if not |
| a folder    | its own | a run of ``graspbox train sb3`` (extra ``train``): its best checkpoint, or another one |
| ``hf://owner/name`` | | such a folder, downloaded from the Hugging Face hub |
| ``depth``, ... | | such a folder of an installed package; ``graspbox-policies`` holds the published ones |

``planner``, ``expert``, ``robust_oracle`` (which use ``state`` and the object's mesh) and ``scene_planner`` (which uses
the scene) are **privileged**. `load` makes a policy by its name, and `available` lists names;
`graspbox.evaluation.evaluate` measures one; a policy of your own is a subclass of `Policy`. Others are in modules:
`grasp_image`, for your own depth image, and `baselines.oracles`, with partial ground truth.

A policy is bound to its environments once, is reset at the start of every episode, and then acts:

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

import os
from collections.abc import Callable
from typing import cast

from graspbox.errors import ConfigError
from graspbox.policies._executor import Executor, GraspExecutor, PoseExecutor
from graspbox.policies._observer import Observer
from graspbox.policies.base import Actions, Policy, Task
from graspbox.policies.baselines.oracles import RobustOracle
from graspbox.policies.baselines.partial_view import BestProposal, PartialViewPlanner
from graspbox.policies.baselines.planner import Expert, Planner
from graspbox.policies.baselines.simple import Random, Zero
from graspbox.policies.clutter import ScenePlanner, TopDown, TsdfPlan, TsdfPolicy
from graspbox.policies.depth import DepthGrasp, DepthPolicy
from graspbox.policies.feel import Attempt, FeelThenLift
from graspbox.policies.head import HeadGrasp
from graspbox.policies.network import NetworkPolicy
from graspbox.policies.published import installed
from graspbox.policies.published.downloads import folder_of
from graspbox.policies.published.folders import policy_of

__all__ = [
    "Actions",
    "Attempt",
    "BestProposal",
    "DepthGrasp",
    "DepthPolicy",
    "Executor",
    "Expert",
    "FeelThenLift",
    "GraspExecutor",
    "HeadGrasp",
    "NetworkPolicy",
    "Observer",
    "PartialViewPlanner",
    "Planner",
    "Policy",
    "PoseExecutor",
    "Random",
    "ScenePlanner",
    "Task",
    "TopDown",
    "TsdfPlan",
    "TsdfPolicy",
    "Zero",
    "available",
    "load",
    "names",
]


_BASELINES: dict[str, Callable[[], Policy]] = {
    kind.name: kind
    for kind in (Random, Zero, Planner, Expert, PartialViewPlanner, BestProposal, TopDown, ScenePlanner, RobustOracle)
}


def names() -> tuple[str, ...]:
    """Names of the baselines, which `load` accepts besides folders."""
    return tuple(_BASELINES)


def available() -> tuple[str, ...]:
    """Names that `load` takes on this machine: the baselines, then the policies of installed packages.

    Packages offer policies by entry points of the group ``graspbox.policies``, such as ``depth =
    "graspbox_policies.depth"``: the name of a policy, and its folder within an importable package. A baseline hides an
    installed policy of its name.
    """
    return (*_BASELINES, *(name for name in installed.names() if name not in _BASELINES))


def load(name: str | os.PathLike[str], *, rehearsed: int | None = None) -> Policy:
    """Make a policy by its name.

    Parameters
    ----------
    name : str or path
        One of `available`, the folder of a published policy or of a run, or ``hf://owner/name``, with ``@revision`` for
        a branch, a tag or a commit, of one on the Hugging Face hub. A folder hides an installed policy of its name.
    rehearsed : int, optional
        As of `DepthGrasp`.

    Raises
    ------
    ConfigError
        If there is no policy of that name, or its folder is incomplete: a field of ``config.json`` is missing or wrong,
        or a file is missing or changed. Also if it rehearses no grasps.
    ConnectionLostError
        If the hub cannot be reached.
    MissingExtraError
        If the extra ``onnx`` is not installed, ``hub`` for a policy of the hub, or ``graspbox-policies`` for the name
        of a published one.
    """
    if isinstance(name, str) and name in _BASELINES:
        if rehearsed is not None:
            raise ConfigError(f"the policy {name!r} rehearses no grasps; take one of a depth image, with networks")
        return _BASELINES[name]()
    folder = folder_of(name, _BASELINES)
    if not folder.is_dir():
        choices = ", ".join(available())
        raise ConfigError(f"there is no policy {str(name)!r}; choose from {choices}, or name a folder with config.json")
    return cast(Policy, policy_of(folder, **({} if rehearsed is None else {"rehearsed": rehearsed})))
