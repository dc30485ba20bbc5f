"""The kinds of published policies, one row each. Imports are deferred until use."""

from importlib import import_module
from typing import Any, NamedTuple

from graspbox.artifacts.configs import PolicyConfig
from graspbox.errors import ConfigError

__all__ = ["KINDS", "Kind", "kind_of"]


class Kind(NamedTuple):
    """A kind of policy; both classes as ``module:Class``.

    Attributes
    ----------
    config : str
        The class of its ``config.json``, a `PolicyConfig`; its ``holds`` names the other files.
    policy : str
        The class of the policy, a `graspbox.policies.Policy` that takes its folder.
    """

    config: str
    policy: str

    def config_class(self) -> type[PolicyConfig]:
        """Import the class of the configuration."""
        found: type[PolicyConfig] = _imported(self.config)
        return found

    def policy_class(self) -> Any:
        """Import the class of the policy."""
        return _imported(self.policy)


#: Kinds by their names in ``config.json``.
KINDS: dict[str, Kind] = {
    "depth": Kind("graspbox.artifacts.configs:DepthPolicyConfig", "graspbox.policies.depth:DepthGrasp"),
    "head": Kind("graspbox.artifacts.configs:HeadPolicyConfig", "graspbox.policies.head:HeadGrasp"),
    "feel": Kind("graspbox.artifacts.configs:FeelPolicyConfig", "graspbox.policies.feel:FeelThenLift"),
    "network": Kind("graspbox.artifacts.configs:NetworkPolicyConfig", "graspbox.policies.network:NetworkPolicy"),
    "study": Kind("graspbox.study.pose_folders:PosePolicyConfig", "graspbox.study.regressor:PoseRegressor"),
}


def kind_of(name: object) -> Kind:
    """Find a kind by its name.

    Raises
    ------
    ConfigError
        If there is none of that name.
    """
    if not isinstance(name, str) or name not in KINDS:
        raise ConfigError(f"kind is {name!r}; this version of graspbox reads {', '.join(KINDS)}")
    return KINDS[name]


def _imported(name: str) -> Any:
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)
