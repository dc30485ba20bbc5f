"""The policy: one `TopDownGrasp` per row of a batch."""

from typing import Any

import numpy as np
import torch
from lerobot.policies import PreTrainedPolicy

from lerobot_policy_top_down.configuration_top_down import TopDownConfig
from top_down import TopDownGrasp

__all__ = ["TopDownPolicy"]

STATE = "observation.environment_state"


class TopDownPolicy(PreTrainedPolicy):  # type: ignore[misc]
    """Chooses the actions of a batch."""

    config_class = TopDownConfig
    name = "top_down"

    def __init__(self, config: TopDownConfig, **kwargs: Any) -> None:
        super().__init__(config)
        # LeRobot expects a module with parameters.
        self.unused = torch.nn.Parameter(torch.zeros(1))
        self.reset()

    def reset(self) -> None:
        """Begin episodes."""
        self._grasps: list[TopDownGrasp] = []

    def select_action(self, batch: dict[str, Any], **kwargs: Any) -> torch.Tensor:
        """Choose an action per row."""
        self._check(batch)
        states = batch[STATE].numpy()
        if not self._grasps:
            config = self.config
            self._grasps = [TopDownGrasp(config.control, config.fingers, config.control_freq) for _ in states]
        actions = [grasp.act(state) for grasp, state in zip(self._grasps, states, strict=True)]
        return torch.from_numpy(np.stack(actions))

    def _check(self, batch: dict[str, Any]) -> None:
        """Find the observations of the features, and the instruction."""
        for name, feature in self.config.input_features.items():
            assert tuple(batch[name].shape[1:]) == tuple(feature.shape), name
        assert set(batch["task"]) == {"Grasp the object and lift it."}

    def predict_action_chunk(self, batch: dict[str, Any], **kwargs: Any) -> torch.Tensor:
        """Give a chunk of one action."""
        return self.select_action(batch)[:, None]

    def forward(self, batch: dict[str, Any]) -> Any:
        """Refuse: it does not learn."""
        raise NotImplementedError

    def get_optim_params(self) -> Any:
        """Refuse: it does not learn."""
        raise NotImplementedError
