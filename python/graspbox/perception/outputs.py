"""Outputs of networks, checked before they are used."""

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError

__all__ = ["check_finite"]


def check_finite(values: NDArray[np.floating], network: str) -> None:
    """Refuse outputs of a network that are not finite.

    Raises
    ------
    ConfigError
        If there are any; the message names the network, such as ``"scorer"``.
    """
    if wrong := int((~np.isfinite(values)).sum()):
        raise ConfigError(
            f"{wrong} of {np.size(values)} outputs of the {network} are not finite; its network is damaged, so export "
            "the policy again"
        )
