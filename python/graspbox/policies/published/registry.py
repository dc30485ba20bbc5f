"""The kinds of published policies, which packages offer by entry points of the group ``graspbox.policy_kinds``.

An entry point has the name of the kind in ``config.json`` and refers to the class of its policies::

    [project.entry-points."graspbox.policy_kinds"]
    mine = "my_package.policies:MyPolicy"

That class is a `graspbox.policies.Policy` that takes its folder; its attribute ``config_class`` is the class of its
``config.json``, a `graspbox.policies.published.configs.PolicyConfig` whose ``kind`` has the same name. graspbox offers
its own kinds in the same way. Imports are deferred until a policy of the kind is loaded.

A folder without ``config.json``, such as that of a training, may be a policy too. An entry point of the group
``graspbox.policy_folders`` names a function of the folder, which returns the policy, or None for a folder of another
kind::

    [project.entry-points."graspbox.policy_folders"]
    mine = "my_package.runs:policy_of_run"
"""

from pathlib import Path
from typing import Any

from graspbox._common.entry_points import entry_points_of, load_entry_point
from graspbox.errors import ConfigError
from graspbox.policies.published.configs import PolicyConfig

__all__ = ["FOLDERS", "GROUP", "config_class", "kinds", "other_policy", "policy_class"]

#: Groups of the entry points: kinds of ``config.json``, and functions of other folders.
GROUP, FOLDERS = "graspbox.policy_kinds", "graspbox.policy_folders"


def kinds() -> tuple[str, ...]:
    """Names of the kinds that installed packages offer, sorted."""
    return tuple(sorted(entry_points_of(GROUP)))


def policy_class(kind: Any) -> Any:
    """Import the class of the policies of a kind, which exactly one package must offer."""
    advice = f"the installed packages have {', '.join(kinds())}: install the package of that kind"
    made = load_entry_point(GROUP, kind, "policy kind", advice)
    if (expected := getattr(getattr(made, "config_class", None), "kind", None)) != kind:
        raise ConfigError(f"the policy kind {kind!r} is {made!r} of the kind {expected!r}; use one name")
    return made


def config_class(kind: Any) -> type[PolicyConfig]:
    """Import the class of the ``config.json`` of a kind; raises as `policy_class`."""
    found: type[PolicyConfig] = policy_class(kind).config_class
    return found


def other_policy(folder: Path) -> Any:
    """Make the policy of a folder without ``config.json``; None if no package knows the folder."""
    for name in sorted(entry_points_of(FOLDERS)):
        made = load_entry_point(FOLDERS, name, "kind of policy folders", "install its package")(folder)
        if made is not None:
            return made
    return None
