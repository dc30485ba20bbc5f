"""Contents of ``config.json`` of a published policy: the fields of every policy, and those of each kind.

A class of this module holds both. In the file the fields of `PolicyConfig` are the envelope, and the others form an
object named after the kind. All of them are required in the file, except those whose default is None.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import gymnasium
import numpy as np

from graspbox import _core
from graspbox._common.arguments import check_range
from graspbox.envs import GOAL_IDS, GOAL_OBSERVATIONS, IDS
from graspbox.envs.settings import complete, kind_of
from graspbox.errors import ConfigError, GraspboxError
from graspbox.hands import Hand
from graspbox.perception.configs import CropConfig, FinderConfig, HandGridConfig, ProposalConfig
from graspbox.perception.crops import crop as crop_images
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.hand_settings import settings_of
from graspbox.perception.inputs.hand_numbers import HAND_NUMBERS
from graspbox.policies.published.calibration import Calibration, check_line
from graspbox.policies.published.head_configs import HeadConfig
from graspbox.policies.stability_inputs import check_times

__all__ = [
    "ACTING",
    "COMPLETION",
    "HAND_FILES",
    "SETTINGS",
    "DepthPolicyConfig",
    "Environment",
    "FeelPolicyConfig",
    "HeadPolicyConfig",
    "NetworkInput",
    "NetworkPolicyConfig",
    "PolicyConfig",
    "Use",
]

#: Files of a hand that is not shipped, in the folder of its policy.
HAND_FILES = ("hand.urdf", "hand.toml")
#: Role of the policy whose completion another one uses, and the name of its files.
COMPLETION = "completion"
#: Settings of an environment that determine the effect of an action; a published network lists all that its
#: environment has. The hand is a separate field.
ACTING = ("control", "fingers", "control_freq")
#: Settings of an environment that a published policy may contain.
SETTINGS = (*ACTING, "arm", "base", "max_episode_steps", "image_size", "cameras", "depth_limits", "trial")
#: Upper bounds of members, channels and actions of a network, with a wide margin.
_MOST_MEMBERS, _WIDEST, _MOST_ACTIONS = 64, 4096, 1024
#: Greatest length of a network's input along an axis.
_LONGEST = 1 << 16
#: An object set that is quick to prepare, for environments that check settings.
_ANY_OBJECT = "procedural:can:0"
_HASH = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Environment:
    """The environments in which a policy acts: registered id, keyword ``obs``, and other keywords (`SETTINGS`)."""

    id: str
    obs: str | tuple[str, ...]
    settings: Mapping[str, Any]

    def __post_init__(self) -> None:
        if self.id not in (*IDS, *GOAL_IDS):
            raise ConfigError(f"id is {self.id!r}; choose from {', '.join((*IDS, *GOAL_IDS))}")
        for name in self.settings:
            if name not in SETTINGS:
                raise ConfigError(f"settings has {name!r}; a policy names only {', '.join(SETTINGS)}")
        complete(kind_of(self.id, vector=True), self.settings)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the observations."""
        if self.id in GOAL_IDS:
            return GOAL_OBSERVATIONS
        return (self.obs,) if isinstance(self.obs, str) else self.obs


@dataclass(frozen=True)
class Use:
    """Another published policy that a policy needs.

    Attributes
    ----------
    policy : str
        Its folder, relative to the folder of the policy that needs it; the name of an installed policy; or
        ``hf://owner/name@revision``.
    sha256 : str
        SHA-256 of its ``config.json``, which lists its files with their hashes.
    """

    policy: str
    sha256: str

    def __post_init__(self) -> None:
        _check_hash("sha256", self.sha256)


@dataclass(frozen=True, kw_only=True)
class PolicyConfig:
    """The fields of every published policy.

    Attributes
    ----------
    name : str
        Name in results.
    version : str
        Version of graspbox that exported it.
    hand : str
        Name of the hand that it was trained with. Its folder holds the files of a hand that is not shipped.
    environment : Environment or None
        The environments in which it acts; None if the kind of policy determines them.
    learned_from : tuple of str
        Object sets that it was trained on, ``NAME`` or ``NAME/SPLIT``, without those of the policies that it uses.
    uses : mapping of str to Use
        Other policies that it needs, by their role.
    files : mapping of str to str
        SHA-256 of each file of its networks, and of the hand's own files (`HAND_FILES`).
    """

    kind: ClassVar[str]
    #: Whether its folder may hold the files of its hand.
    carries_hand: ClassVar[bool] = False

    name: str
    version: str = _core.__version__
    hand: str
    environment: Environment | None = None
    learned_from: tuple[str, ...] = ()
    uses: Mapping[str, Use] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if sorted(self.uses) != sorted(self.roles):
            used, needed = (", ".join(sorted(roles)) or "no policy" for roles in (self.uses, self.roles))
            raise ConfigError(f"uses has {used}; a policy like this uses {needed}")
        for name, digits in self.files.items():
            _check_hash(f"files.{name}", digits)

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles of the policies that it uses."""
        return ()

    @property
    def holds(self) -> tuple[str, ...]:
        """Names of the files of its networks."""
        raise NotImplementedError

    def check(self, hand: Hand) -> None:
        """Check values that need the core or the hand, shipped or of the folder; the constructor checks single fields.

        Raises ConfigError for an invalid field.
        """
        if hand.name != self.hand:
            raise ConfigError(f"hand is {self.hand!r}, but its files describe {hand.name!r}; export the policy again")


@dataclass(frozen=True, kw_only=True)
class DepthPolicyConfig(PolicyConfig):
    """Configuration of a policy that grasps from one depth image: completion, proposals, scorer, and optionally a head.

    With the role ``completion`` the completion is that of another policy, which need not know the same hand.

    Attributes
    ----------
    calibration : Calibration
        Of the scorer's logits; part of ``scorer.onnx``.
    members, width : int
        Of the scorer, `graspbox.learn.models.scorer.network.ScorerNet`.
    finalists : int
        Grasps that all members score, `graspbox.learn.export.graphs.ScorerGraph`.
    completion_width : int
        `graspbox.learn.models.completion.network.CompletionNet`.
    hand_numbers : tuple of str or None
        Names of `graspbox.perception.inputs.hand_numbers.HAND_NUMBERS` of a policy that grasps with any hand: `hand` is
        then the default, and lengths of `grid` and `finder` are fitted to each.
    """

    kind: ClassVar[str] = "depth"
    carries_hand: ClassVar[bool] = True

    environment: None = None
    calibration: Calibration
    members: int
    width: int
    finalists: int
    completion_width: int
    crop: CropConfig
    grid: HandGridConfig
    finder: FinderConfig
    head: HeadConfig | None
    hand_numbers: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range(self, "members", 1, _MOST_MEMBERS)
        if self.hand_numbers is not None:
            self._check_any_hand()
        for name in ("width", "finalists", "completion_width"):
            check_range(self, name, 1, _WIDEST)

    def _check_any_hand(self) -> None:
        if self.hand_numbers != tuple(HAND_NUMBERS):
            raise ConfigError(
                f"hand_numbers is {self.hand_numbers}; this version of graspbox computes {tuple(HAND_NUMBERS)}"
            )
        if self.members != 1 or self.head is not None or self.grid.shape is None:
            raise ConfigError("a policy for any hand has one scorer, no head, and a grid of a set shape")

    def settings_for(self, hand: Hand, finder: FinderConfig | None = None) -> tuple[HandGridConfig, FinderConfig]:
        """Return the settings of a hand's grid and of its search, by default those of the policy.

        Raises ConfigError if the policy does not know the hand.
        """
        chosen = finder or self.finder
        if chosen.rehearsal is not None and len(hand.chains) < (chosen.rehearsal.fingers or 0):
            chosen = chosen.rehearsing(0)
        if self.hand_numbers is not None:
            fitted = settings_of(hand, chosen.proposals, shape=self.grid.shape)
            return fitted.grid, replace(chosen, proposals=fitted.proposals)
        if hand.name != self.hand:
            raise ConfigError(f"the policy {self.name!r} was trained for the hand {self.hand!r}, not {hand.name!r}")
        return self.grid, chosen

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles of the policies that it uses."""
        return (COMPLETION,) if COMPLETION in self.uses else ()

    @property
    def holds(self) -> tuple[str, ...]:
        """Names of the files of its networks."""
        own = () if COMPLETION in self.uses else (COMPLETION,)
        last = () if self.head is None else ("head",)
        return tuple(f"{part}.onnx" for part in (*own, "scorer", *last))

    def check(self, hand: Hand) -> None:
        """Check the settings of perception too; raises as `PolicyConfig.check`."""
        super().check(hand)
        _check_settings(self.crop, self.grid, self.finder.proposals)
        if self.head is not None:
            self.head.anchors.check(self.crop)


@dataclass(frozen=True, kw_only=True)
class HeadPolicyConfig(PolicyConfig):
    """Configuration of a policy of one network, from a depth image to grasps.

    `preshapes` counts those of the hand. If `filtered`, it executes the best grasp that does not collide with the
    observed
    surface, instead of the best.
    """

    kind: ClassVar[str] = "head"
    carries_hand: ClassVar[bool] = True

    environment: None = None
    preshapes: int
    filtered: bool
    head: HeadConfig
    crop: CropConfig

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range(self, "preshapes", 1, _MOST_MEMBERS)

    @property
    def holds(self) -> tuple[str, ...]:
        """Names of the files of its networks."""
        return ("head.onnx",)

    def check(self, hand: Hand) -> None:
        """Check the settings of perception too; raises as `PolicyConfig.check`."""
        super().check(hand)
        _check_settings(self.crop, HandGridConfig(), ProposalConfig())
        self.head.anchors.check(self.crop)


@dataclass(frozen=True, kw_only=True)
class FeelPolicyConfig(PolicyConfig):
    """Configuration of a policy that checks grasp stability before it lifts; the role ``depth`` chooses the grasps.

    It decides at the last of `times`, seconds after closing began: if the predicted probability of holding is below
    `threshold`, the hand opens. `calibration`, slope and offset of the logit, is part of ``feel.onnx``; `width` and
    `members` are those of `graspbox.learn.models.stability.network.StabilityNet`.
    """

    kind: ClassVar[str] = "feel"
    carries_hand: ClassVar[bool] = True

    environment: None = None
    times: tuple[float, ...]
    threshold: float
    calibration: tuple[float, float]
    width: int
    members: int

    def __post_init__(self) -> None:
        super().__post_init__()
        check_times(self.times)
        if not 0.0 <= self.threshold <= 1.0:
            raise ConfigError(f"threshold is {self.threshold}; pass a probability, 0 to 1")
        check_line("calibration", self.calibration)
        check_range(self, "width", 1, _WIDEST)
        check_range(self, "members", 1, _MOST_MEMBERS)

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles of the policies that it uses."""
        return ("depth",)

    @property
    def holds(self) -> tuple[str, ...]:
        """Names of the files of its networks."""
        return ("feel.onnx",)


@dataclass(frozen=True)
class NetworkInput:
    """An observation that is an input of a network, with shape and type of a row."""

    name: str
    shape: tuple[int, ...]
    dtype: str

    def __post_init__(self) -> None:
        if not all(0 < size <= _LONGEST for size in self.shape):
            raise ConfigError(f"shape is {self.shape!r}; pass integers from 1 to {_LONGEST}")
        try:
            known = np.dtype(self.dtype).kind in "fiub"
        except TypeError:
            known = False
        if not known:
            raise ConfigError(f"dtype is {self.dtype!r}; pass the name of a type of numbers, such as 'float32'")


@dataclass(frozen=True, kw_only=True)
class NetworkPolicyConfig(PolicyConfig):
    """A network from observations to actions.

    ``policy.onnx`` maps `inputs`, one for each name in ``environment.obs``, (n, ...) in the environment's format, to
    ``action`` (n, `actions`) float32. `algorithm` of Stable-Baselines3 and its `policy_kwargs` record the training;
    only
    `graspbox.learn.sb3.export.load_graph` reads and checks them, by building the network in torch.
    """

    kind: ClassVar[str] = "network"
    carries_hand: ClassVar[bool] = True

    environment: Environment
    inputs: tuple[NetworkInput, ...]
    actions: int
    algorithm: str
    policy_kwargs: Mapping[str, Any]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range(self, "actions", 1, _MOST_ACTIONS)
        input_names = [one.name for one in self.inputs]
        if sorted(self.environment.names) != sorted(input_names):
            raise ConfigError(
                f"inputs has {input_names}; pass one for each name in environment.obs, {self.environment.obs}"
            )

    @property
    def holds(self) -> tuple[str, ...]:
        """Names of the files of its networks."""
        return ("policy.onnx",)

    @property
    def settings(self) -> dict[str, Any]:
        """Keywords of the environments besides ``obs``, with the hand."""
        return {**self.environment.settings, "hand": self.hand}

    def check(self, hand: Hand) -> None:
        """Check the settings of its environment too, by making one; raises as `PolicyConfig.check`."""
        super().check(hand)
        try:
            keywords = {**self.environment.settings, "hand": hand, "obs": self.environment.obs, "objects": _ANY_OBJECT}
            env = gymnasium.make_vec(self.environment.id, num_envs=1, num_threads=1, **keywords)
        except GraspboxError as error:
            raise ConfigError(f"environment, with the hand {self.hand!r}: {error}") from None
        size = env.single_action_space.shape
        env.close()
        if size != (self.actions,):
            raise ConfigError(
                f"network.actions is {self.actions}, but the actions of {self.environment.id!r} with the hand "
                f"{self.hand!r} have the shape {size}"
            )


def _check_settings(crop: CropConfig, grid: HandGridConfig, proposals: ProposalConfig) -> None:
    """Validate settings of perception by the core functions that use them; no range depends on the hand."""
    crop_images(np.zeros((1, 4, 4), dtype=np.float32), np.eye(3), np.eye(4)[None], config=crop)
    empty = np.zeros((crop.resolution,) * 3, dtype=np.uint8)
    HandGrid("panda_gripper", grid, crop=crop).propose(empty, proposals)


def _check_hash(name: str, digits: str) -> None:
    if _HASH.fullmatch(digits) is None:
        raise ConfigError(f"{name} is {digits!r}; pass a SHA-256, 64 hexadecimal digits")
