"""``GraspPose-v0`` in which an agent corrects the grasps of another policy.

At the beginning of an episode the base policy proposes a grasp. The agent observes the voxels around the proposed
hand and a few numbers of the proposal, and answers with a bounded correction (`graspbox.policies.residual`); the trial
of the corrected grasp is the episode. Rewards, infos and seeds are those of the environment.

>>> import gymnasium
>>> from graspbox import policies
>>> from graspbox.sb3.residual_env import ResidualVectorEnv
>>> base = policies.load("partial_view_planner")
>>> envs = gymnasium.make_vec(
...     "graspbox/GraspPose-v0", num_envs=2, objects="procedural:can:0-3", reward="firm", obs=base.obs,
...     autoreset_mode="SameStep", **base.settings,
... )
>>> envs = ResidualVectorEnv(envs, base)
>>> seen, info = envs.reset(seed=0)
>>> seen["volume"].shape, envs.single_action_space.shape
((2, 4, 24, 24, 16), (7,))
>>> seen, reward, terminated, truncated, info = envs.step(0.2 * envs.action_space.sample())
>>> terminated.all()
np.True_

With Stable-Baselines3: ``graspbox.sb3.VecEnv(envs)``, and `graspbox.sb3.Extractor` for the policy.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from graspbox.errors import ConfigError
from graspbox.policies.base import Policy, Task
from graspbox.policies.residual import Proposals, ResidualConfig

__all__ = ["ResidualVectorEnv"]

Step = tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]


class ResidualVectorEnv(VectorWrapper[Any, Any, Any, Any, Any]):
    """Environments of ``GraspPose-v0`` in which an action corrects the proposal of a base policy.

    The last observation of an episode repeats the first: the proposal does not change with the trial.

    Parameters
    ----------
    env : VectorEnv
        Of ``graspbox/GraspPose-v0``, made by ``gymnasium.make_vec`` with ``obs=base.obs`` and ``**base.settings``.
    base : DepthGrasp
        The policy that proposes; see `graspbox.policies.residual.Proposals`.
    config : ResidualConfig
        Bounds of the corrections.

    Attributes
    ----------
    proposals : Proposals
        The proposals of the current episodes.

    Raises
    ------
    ConfigError
        For other environments, or a base policy that cannot act there or does not propose from camera observations.
    """

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        base: Policy,
        config: ResidualConfig = ResidualConfig(),  # noqa: B008 (frozen)
    ) -> None:
        super().__init__(env)
        self.proposals = Proposals(base, config)
        self.proposals.bind(Task.of(env))
        self.single_observation_space = self.proposals.observation_space
        self.single_action_space = self.proposals.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._mode = env.metadata["autoreset_mode"]
        self._over = np.zeros(self.num_envs, dtype=np.bool_)
        self._seen: dict[str, NDArray[Any]] = {}

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Begin episodes, as the environment does; returns the agent's observations of the proposals, and the infos."""
        observation, info = self.env.reset(seed=seed, options=options)  # type: ignore[arg-type]
        mask = (options or {}).get("reset_mask")
        begun = np.ones(self.num_envs, dtype=np.bool_) if mask is None else np.asarray(mask)
        self._over = self._over & ~begun
        return self._begin(observation, begun, info, seed), info

    def step(self, actions: ArrayLike) -> Step:
        """Try every proposal with its correction.

        Parameters
        ----------
        actions : (num_envs, 7) or (num_envs, 6) array_like
            Corrections, see `graspbox.policies.residual`; rows of environments that begin an episode instead are
            ignored.

        Returns
        -------
        observations, rewards, terminated, truncated, infos
            As the environment's; observations describe the proposals.

        Raises
        ------
        ConfigError
            For actions of another shape, or that are not finite; the environments are then unchanged.
        """
        if not self._seen:
            raise ConfigError("call reset before step")
        before, begun = self._seen, self._over
        found = self.env.step(self.proposals.actions(actions))
        observation, rewards, terminated, truncated, info = found
        over = terminated | truncated
        if self._mode == AutoresetMode.SAME_STEP:
            begun, over = over, np.zeros_like(over)
            for env in np.flatnonzero(begun).tolist():
                info["final_obs"][env] = {name: rows[env] for name, rows in before.items()}
        elif self._mode == AutoresetMode.DISABLED:
            begun = np.zeros_like(over)
        self._over = over
        return self._begin(observation, begun, info), rewards, terminated, truncated, info

    def _begin(
        self,
        observation: Any,
        begun: NDArray[np.bool_],
        info: dict[str, Any],
        seed: int | Sequence[int | None] | None = None,
    ) -> dict[str, NDArray[Any]]:
        """Let the base policy decide in new episodes; returns the agent's observations."""
        if begun.any() or not self._seen:
            self.proposals.base.reset(seed, mask=begun, info=info)
            self.proposals.propose(observation)
            self._seen = self.proposals.observe()
        return {name: rows.copy() for name, rows in self._seen.items()}
