"""Policies with a part left out, added or replaced by ground truth, to measure the contribution of each part.

| name | policy |
|---|---|
| ``completed_planner=FOLDER`` | the planner on the output of the completion in a policy's folder |
| ``nearest=DATA`` | a grasp that held in the most similar scene of a data set |
| ``filtered=FOLDER``, ``unfiltered=FOLDER`` | a head with or without its collision filter |
| ``refined=FOLDER``, ``unrefined=FOLDER`` | a policy of one depth image with two refinements, with none |
| ``geometric=FOLDER``, ``plain=FOLDER`` | the same without its head, without head and refinement |
| ``rehearsed=FOLDER`` | the same, with 8 grasps tried on the completed shape |
| ``tolerant=FOLDER`` | the same, expecting hand errors of up to 10 mm and 10 degrees |
| ``true_completion=FOLDER``, ``true_scorer=FOLDER``, ``true_both=FOLDER`` | the same with ground truth for a part |
"""

from dataclasses import replace
from math import radians, sqrt
from pathlib import Path
from typing import Any

from graspbox import policies
from graspbox.artifacts.folders import read_depth_policy
from graspbox.dataset.learned import of_datasets
from graspbox.errors import ConfigError
from graspbox.evaluation.oracles import DepthOracle, Oracle
from graspbox.models.nearest_finder import remember
from graspbox.perception.perturbations import PoseNoise

__all__ = ["ORACLES", "SETTINGS", "load_variant"]

#: Settings of the finder by which a variant of a policy differs from its folder.
SETTINGS: dict[str, dict[str, Any]] = {
    "refined": {"refinements": 2},
    "unrefined": {"refinements": 0},
    "geometric": {"predicted": 0},
    "plain": {"refinements": 0, "predicted": 0},
}
#: Components replaced by ground truth.
ORACLES: dict[str, tuple[Oracle, ...]] = {
    "true_completion": ("completion",),
    "true_scorer": ("scorer",),
    "true_both": ("completion", "scorer"),
}
#: Standard deviations of the errors of the condition ``hand_10``.
_HAND_10 = PoseNoise(0.01 / sqrt(3), radians(10) / sqrt(3))
_OTHERS = ("completed_planner", "filtered", "unfiltered", "nearest", "rehearsed", "tolerant")
#: Grasps that a variant rehearses.
_REHEARSED = 8


def load_variant(name: str) -> policies.Policy:
    """Make a policy: a name of the table, or an argument of `graspbox.policies.load`.

    Raises
    ------
    ConfigError
        If there is no such kind; otherwise as `graspbox.policies.load`.
    """
    kind, _, location = name.partition("=")
    if not location:
        return policies.load(name)
    path = Path(location)
    if kind == "completed_planner":
        return policies.PartialViewPlanner(path)
    if kind in ("filtered", "unfiltered"):
        return policies.HeadGrasp(path, filtered=kind == "filtered")
    if kind == "nearest":
        return policies.NearestGrasp(replace(remember(path), learned_from=tuple(of_datasets([path]))))
    if kind == "rehearsed":
        return policies.load(path, rehearsed=_REHEARSED)
    if kind == "tolerant":
        return policies.DepthGrasp(path, hand_error=_HAND_10)
    if kind in SETTINGS:
        return policies.DepthGrasp(path, config=replace(read_depth_policy(path).finder, **SETTINGS[kind]))
    if kind in ORACLES:
        return DepthOracle(path, ORACLES[kind])
    known = ", ".join((*_OTHERS, *SETTINGS, *ORACLES))
    raise ConfigError(f"there is no policy {name!r}; choose the prefix before = from {known}")
