"""PPO with a separate learning rate for the value function.

A policy initialized by cloning must change slowly, or it forgets; its value function starts from scratch and must learn
fast, or its advantages are noise. Stable-Baselines3 has one learning rate for both.
"""

from typing import Any

import torch
from stable_baselines3 import PPO as _PPO

__all__ = ["PPO"]


class PPO(_PPO):  # type: ignore[misc]
    """Stable-Baselines3's PPO, with one additional keyword.

    Parameters
    ----------
    *args, **kwargs
        As in Stable-Baselines3.
    value_lr_scale : float
        Learning rate of the value function, as a multiple of the learning rate. With values other than 1 only this
        class can load a saved model, because the optimizer has two parameter groups.
    """

    def __init__(self, *args: Any, value_lr_scale: float = 1.0, **kwargs: Any) -> None:
        self.value_lr_scale = value_lr_scale
        super().__init__(*args, **kwargs)

    def _setup_model(self) -> None:
        super()._setup_model()
        if self.value_lr_scale == 1.0:
            return
        policy: Any = self.policy
        values = [*policy.mlp_extractor.value_net.parameters(), *policy.value_net.parameters()]
        known = {id(parameter) for parameter in values}
        rest = [parameter for parameter in policy.parameters() if id(parameter) not in known]
        groups = [{"params": rest, "scale": 1.0}, {"params": values, "scale": self.value_lr_scale}]
        policy.optimizer = policy.optimizer_class(groups, lr=self.lr_schedule(1), **policy.optimizer_kwargs)

    def _update_learning_rate(self, optimizers: list[torch.optim.Optimizer] | torch.optim.Optimizer) -> None:
        super()._update_learning_rate(optimizers)
        for optimizer in optimizers if isinstance(optimizers, list) else [optimizers]:
            for group in optimizer.param_groups:
                group["lr"] *= group.get("scale", 1.0)
