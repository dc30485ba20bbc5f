"""A bounded correction of the grasp that another policy proposes from one depth image.

The hand of the proposal is moved by at most a distance, turned by at most an angle, and its preshape changed by at most
a share of its range (`ResidualConfig`). The policy that corrects sees the voxels around the proposed hand, in the
hand's own frame, and a few numbers of the proposal; nothing of it is privileged. `graspbox.sb3.residual_env` makes
environments of it, in which rewards teach the correction.

The correction is a vector in [-1, 1]:

| entries | meaning | at most |
|---|---|---|
| 0-2 | how the place where the hand closes moves along the hand's axes | ``distance`` |
| 3-5 | how the hand turns about that place: axis times angle, hand axes | ``angle`` |
| 6   | change of the preshape; absent for a hand whose preshape is fixed | ``preshape`` |

Three entries that belong together are a direction and a share. The share is the largest of their sizes, by which a
cube of actions becomes a ball of motions. Zeros are the proposal itself, to the bit.

>>> from graspbox import evaluation, policies
>>> from graspbox.policies.residual import ResidualGrasp
>>> base = policies.load("partial_view_planner")
>>> corrected = ResidualGrasp(base, lambda seen: 0.0 * seen["proposal"][:, :7])
>>> results = [evaluation.evaluate(one, objects="procedural:can:0-3", trials=4) for one in (base, corrected)]
>>> results[0].trials == results[1].trials
True
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from graspbox._core import Hand
from graspbox.envs.coding import encode_action
from graspbox.envs.motion import rotation_matrix
from graspbox.errors import ConfigError
from graspbox.perception.configs import HandGridConfig
from graspbox.perception.finder import FoundGrasp
from graspbox.perception.hand_grids import HAND_CHANNELS, HandGrid
from graspbox.policies.base import Actions, Policy, Task
from graspbox.policies.depth import DepthPolicy

__all__ = ["PROPOSAL", "Proposals", "ResidualConfig", "ResidualGrasp", "moved", "residual_size"]

#: Entries of the observation ``proposal``, in order: name, number, least and greatest value, meaning.
PROPOSAL: tuple[tuple[str, int, float, float, str], ...] = (
    ("down", 3, -1.0, 1.0, "direction of gravity, hand axes"),
    ("away", 3, -1.0, 1.0, "horizontal direction away from the camera, hand axes"),
    ("height", 1, -10.0, 10.0, "height of the hand over the table, in units of 0.1 m"),
    ("preshape", 1, 0.0, 1.0, "share of the preshape's range"),
    ("score", 1, -10.0, 10.0, "score of the proposal, clipped"),
    ("proposed", 1, 0.0, 1.0, "1 where there is a proposal, else 0, as is everything else"),
)
#: Unit of heights, metres.
_LENGTH = 0.1


@dataclass(frozen=True)
class ResidualConfig:
    """How far a proposed grasp may be corrected.

    Attributes
    ----------
    distance : float
        How far the place where the hand closes may move, metres; above 0, at most 0.2.
    angle : float
        How far the hand may turn about it, radians; above 0, at most pi / 2.
    preshape : float
        How far the preshape may change, as a share of its range; 0 to 1.
    grid : HandGridConfig
        The cells around the hand that are observed.
    """

    distance: float = 0.02
    angle: float = 0.35
    preshape: float = 0.25
    grid: HandGridConfig = field(default_factory=HandGridConfig)

    def __post_init__(self) -> None:
        for name, most, unit in (("distance", 0.2, "metres"), ("angle", np.pi / 2, "radians")):
            if not 0.0 < getattr(self, name) <= most:
                raise ConfigError(f"{name} is {getattr(self, name)}; give {unit} above 0, at most {most:.3g}")
        if not 0.0 <= self.preshape <= 1.0:
            raise ConfigError(f"preshape is {self.preshape}; give a share of the preshape's range, 0 to 1")


def residual_size(hand: Hand) -> int:
    """Count the entries of a correction: 7, or 6 for a hand whose preshape is fixed."""
    low, high = hand.preshape_limits
    return 7 if high > low else 6


def moved(
    world_from_hand: NDArray[np.float64], preshape: float, residual: ArrayLike, hand: Hand, config: ResidualConfig
) -> tuple[NDArray[np.float64], float]:
    """Correct a grasp.

    Parameters
    ----------
    world_from_hand : (4, 4) float64
        The proposal, metres.
    preshape : float
        See `graspbox.Hand.preshape_limits`.
    residual : (7,) or (6,) array_like
        The correction, see the module; entries beyond [-1, 1] are clipped.
    hand : Hand
        The hand.
    config : ResidualConfig
        The bounds.

    Returns
    -------
    (4, 4) float64, float
        ``world_from_hand`` and preshape. The place where the hand closes moves by at most ``distance``; the hand's own
        origin, which lies behind it, by the arc of the turn more.

    Raises
    ------
    ConfigError
        For a correction of another size, or one that is not finite.
    """
    correction = np.asarray(residual, dtype=np.float64)
    if correction.shape != (residual_size(hand),) or not np.isfinite(correction).all():
        raise ConfigError(f"the correction is {correction}; give {residual_size(hand)} finite numbers")
    correction = np.clip(correction, -1.0, 1.0)
    pivot = np.asarray(hand.closing_center(preshape), dtype=np.float64)
    turn = rotation_matrix(config.angle * _in_ball(correction[3:6]))
    pose = world_from_hand.copy()
    shift = config.distance * _in_ball(correction[:3]) + (pivot - turn @ pivot)
    pose[:3, 3] += world_from_hand[:3, :3] @ shift
    pose[:3, :3] = world_from_hand[:3, :3] @ turn
    low, high = hand.preshape_limits
    change = config.preshape * (high - low) * correction[6] if len(correction) == 7 else 0.0
    return pose, float(np.clip(preshape + change, low, high))


def _in_ball(cube: NDArray[np.float64]) -> NDArray[np.float64]:
    """Map the cube [-1, 1]^3 onto the unit ball along rays: the largest size becomes the length."""
    length = float(np.linalg.norm(cube))
    return cube * (float(np.abs(cube).max()) / length) if length > 0.0 else cube


class Proposals:
    """The proposals of a base policy in environments of ``GraspPose-v0``, seen from the proposed hand.

    Parameters
    ----------
    base : DepthPolicy
        The policy that proposes: `DepthGrasp`, `HeadGrasp` or another policy of one depth image, without oracles.
    config : ResidualConfig
        The bounds of corrections, and the cells that are observed.

    Attributes
    ----------
    base, config
        The same.
    hand : Hand
        Once it is bound: the hand.

    Raises
    ------
    ConfigError
        For another base policy.
    """

    hand: Hand

    def __init__(self, base: Policy, config: ResidualConfig = ResidualConfig()) -> None:
        if not isinstance(base, DepthPolicy):
            raise ConfigError(
                f"the base policy is a {type(base).__name__}; give one that finds its grasp in a depth image, such as "
                "graspbox.policies.HeadGrasp or DepthGrasp"
            )
        if "state" in base.obs:
            raise ConfigError(f"the base policy {base.name!r} has oracles, which use the true object; give one without")
        self.base, self.config = base, config

    def bind(self, task: Task) -> None:
        """Prepare for environments; raises as `Policy.bind`, and for environments other than ``GraspPose-v0``."""
        if task.closed_loop:
            raise ConfigError(f"corrections act in graspbox/GraspPose-v0, not in {task.env_id!r}")
        self.base.bind(task)
        self.hand = self.base.hand
        self._count = task.num_envs
        self._grid = HandGrid(self.hand, self.config.grid, crop=self.base.finder.crop)

    @property
    def observation_space(self) -> spaces.Dict:
        """The space of `observe`, for one environment.

        ``volume`` (4, X, Y, Z) uint8: `graspbox.perception.hand_grids.HAND_CHANNELS` around the proposed hand;
        ``proposal`` (10,) float32: `PROPOSAL`.
        """
        low, high = (np.repeat([row[i] for row in PROPOSAL], [row[1] for row in PROPOSAL]) for i in (2, 3))
        shape = (len(HAND_CHANNELS), *self._grid.shape)
        return spaces.Dict(
            {
                "volume": spaces.Box(0, 255, shape, np.uint8),
                "proposal": spaces.Box(low.astype(np.float32), high.astype(np.float32)),
            }
        )

    @property
    def action_space(self) -> spaces.Box:
        """A correction of one environment's proposal."""
        return spaces.Box(-1.0, 1.0, (residual_size(self.hand),), np.float32)

    def propose(self, observation: Any) -> None:
        """Let the base policy decide where an episode has begun; `observation` is that of the environments."""
        self.base.act(observation)

    def observe(self) -> dict[str, NDArray[Any]]:
        """Show every proposal: fresh arrays ``volume`` (n, 4, X, Y, Z) and ``proposal`` (n, 10)."""
        size = sum(row[1] for row in PROPOSAL)
        volumes = np.zeros((self._count, len(HAND_CHANNELS), *self._grid.shape), dtype=np.uint8)
        numbers = np.zeros((self._count, size), dtype=np.float32)
        for env, found in enumerate(self.base.found):
            if found is not None:
                pose = np.linalg.inv(found.world_from_crop) @ found.world_from_hand
                volumes[env] = self._grid.crops(found.volume[None], [0], pose[None])[0]
                numbers[env] = self._numbers(found, pose)
        return {"volume": volumes, "proposal": numbers}

    def _numbers(self, found: FoundGrasp, crop_from_hand: NDArray[np.float64]) -> NDArray[np.float64]:
        low, high = self.hand.preshape_limits
        share = (found.preshape - low) / (high - low) if high > low else 0.0
        turn = crop_from_hand[:3, :3]
        height = np.clip(found.world_from_hand[2, 3] / _LENGTH, -10.0, 10.0)
        return np.array([*-turn[2], *turn[0], height, share, np.clip(found.score, -10.0, 10.0), 1.0])

    def actions(self, residuals: ArrayLike) -> Actions:
        """Correct every proposal.

        Parameters
        ----------
        residuals : (n, 7) or (n, 6) array_like
            One correction for each environment.

        Returns
        -------
        (n, 10) float32
            Actions of ``GraspPose-v0``; zeros, which name no pose, where there is no proposal.

        Raises
        ------
        ConfigError
            For corrections of another shape, or that are not finite.
        """
        corrections = np.asarray(residuals, dtype=np.float64)
        if corrections.shape != (self._count, residual_size(self.hand)):
            raise ConfigError(
                f"corrections have shape {corrections.shape}; give ({self._count}, {residual_size(self.hand)}), a row "
                "for each environment"
            )
        found = np.zeros((self._count, *self.base.task.action_space.shape), dtype=np.float32)
        for env, proposed in enumerate(self.base.found):
            if proposed is not None:
                pose, preshape = moved(
                    proposed.world_from_hand, proposed.preshape, corrections[env], self.hand, self.config
                )
                found[env] = encode_action(pose, preshape, hand=self.hand)
        return found


class ResidualGrasp(Policy):
    """Grasps as a base policy proposes, corrected.

    Parameters
    ----------
    base : DepthPolicy
        See `Proposals`.
    correct : callable
        From `Proposals.observe` to corrections (n, 7) or (n, 6): ``ModelPolicy(model).act`` of
        `graspbox.sb3.policy`, or any function.
    config : ResidualConfig
        The bounds with which `correct` was trained.

    Raises
    ------
    ConfigError
        For a base policy that does not find its grasp in a depth image.
    """

    def __init__(
        self,
        base: Policy,
        correct: Callable[[dict[str, NDArray[Any]]], ArrayLike],
        config: ResidualConfig = ResidualConfig(),
    ) -> None:
        self.base, self.proposals, self._correct = base, Proposals(base, config), correct
        self.name, self.obs, self.settings = f"{base.name} + residual", base.obs, base.settings
        self.learned_from = base.learned_from

    def _bind(self, task: Task) -> None:
        self.proposals.bind(task)

    def act(self, observation: Any) -> Actions:
        """Propose and correct."""
        self.proposals.propose(observation)
        return self.proposals.actions(self._correct(self.proposals.observe()))

    def found_nothing(self, env: int) -> bool:
        """Whether the base policy found no grasp to correct."""
        return self.proposals.base.found_nothing(env)
