"""Policies with a part left out, added or replaced by ground truth, to measure the contribution of each part.

| name | policy |
|---|---|
| ``completed_planner=FOLDER`` | the planner on the output of the completion in a policy's folder |
| ``filtered=FOLDER``, ``unfiltered=FOLDER`` | a head with or without its collision filter |
| ``geometric=FOLDER`` | a policy of one depth image without its head |
| ``rehearsed=FOLDER`` | the same, with 8 grasps tried on the completed shape |
| ``tolerant=FOLDER`` | the same, expecting hand errors of up to 10 mm and 10 degrees |
| ``true_completion=FOLDER``, ``true_scorer=FOLDER``, ``true_both=FOLDER`` | the same with ground truth for a part |

Other packages add prefixes by entry points of the group ``graspbox.variants``; ``nearest=DATA`` of `graspbox.learn`
makes a policy that repeats a grasp which held in the most similar scene of a data set.
"""

from collections.abc import Callable
from dataclasses import replace
from math import radians, sqrt
from pathlib import Path

from graspbox import policies
from graspbox._common.entry_points import entry_points_of, load_entry_point
from graspbox.errors import ConfigError
from graspbox.perception.perturbations import PoseNoise
from graspbox.policies.baselines.oracles import DepthOracle
from graspbox.policies.published.folders import read_depth_policy

__all__ = ["VARIANTS", "load_variant"]

#: Standard deviations of the errors of the condition ``hand_10``.
_HAND_10 = PoseNoise(0.01 / sqrt(3), radians(10) / sqrt(3))
#: Grasps that a variant rehearses.
_REHEARSED = 8
#: Functions that make a policy of a folder, by prefix.
VARIANTS: dict[str, Callable[[Path], policies.Policy]] = {
    "completed_planner": lambda path: policies.PartialViewPlanner(path),
    "filtered": lambda path: policies.HeadGrasp(path, filtered=True),
    "unfiltered": lambda path: policies.HeadGrasp(path, filtered=False),
    "geometric": lambda path: policies.DepthGrasp(path, config=replace(read_depth_policy(path).finder, predicted=0)),
    "rehearsed": lambda path: policies.load(path, rehearsed=_REHEARSED),
    "tolerant": lambda path: policies.DepthGrasp(path, hand_error=_HAND_10),
    "true_completion": lambda path: DepthOracle(path, ("completion",)),
    "true_scorer": lambda path: DepthOracle(path, ("scorer",)),
    "true_both": lambda path: DepthOracle(path, ("completion", "scorer")),
}
#: Entry points of packages that add variants: a prefix, and a function that makes the policy of a path.
GROUP = "graspbox.variants"


def load_variant(name: str) -> policies.Policy:
    """Make a policy: a name of the table, or an argument of `graspbox.policies.load`, whose errors it raises."""
    kind, _, location = name.partition("=")
    if not location:
        return policies.load(name)
    others = entry_points_of(GROUP)
    if kind not in VARIANTS and kind not in others:
        known = ", ".join((*VARIANTS, *others))
        raise ConfigError(f"there is no policy {name!r}; choose the prefix before = from {known}")
    make = VARIANTS.get(kind) or load_entry_point(GROUP, kind, "variant", f"{__name__} lists all")
    return make(Path(location))
