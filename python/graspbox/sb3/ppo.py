"""PPO whose values may learn faster than its policy.

A policy that begins as a copy of an expert must move slowly, or it forgets; its values know nothing yet, and must learn
fast, or what they say of its actions is noise. Stable-Baselines3 has one learning rate for both.
"""

from typing import Any

import torch
from stable_baselines3 import PPO as _PPO

__all__ = ["PPO"]


class PPO(_PPO):  # type: ignore[misc]
    """Stable-Baselines3's PPO, with one more keyword.

    Parameters
    ----------
    *args, **kwargs
        As Stable-Baselines3's.
    value_rate : float
        The values learn at so many times the learning rate. With another one than 1, what `save` writes is for `load`
        of this class: the optimizer's parameters stand in two groups.
    """

    def __init__(self, *args: Any, value_rate: float = 1.0, **kwargs: Any) -> None:
        self.value_rate = value_rate
        super().__init__(*args, **kwargs)

    def _setup_model(self) -> None:
        super()._setup_model()
        if self.value_rate == 1.0:
            return
        policy: Any = self.policy
        values = [*policy.mlp_extractor.value_net.parameters(), *policy.value_net.parameters()]
        known = {id(parameter) for parameter in values}
        rest = [parameter for parameter in policy.parameters() if id(parameter) not in known]
        groups = [{"params": rest, "rate": 1.0}, {"params": values, "rate": self.value_rate}]
        policy.optimizer = policy.optimizer_class(groups, lr=self.lr_schedule(1), **policy.optimizer_kwargs)

    def _update_learning_rate(self, optimizers: list[torch.optim.Optimizer] | torch.optim.Optimizer) -> None:
        super()._update_learning_rate(optimizers)
        for optimizer in optimizers if isinstance(optimizers, list) else [optimizers]:
            for group in optimizer.param_groups:
                group["lr"] *= group.get("rate", 1.0)
