"""graspbox as an environment of LeRobot's EnvHub: the one file that a repository of it needs.

It needs the package `lerobot_env_graspbox` of this folder, installed.
"""

from typing import Any

from lerobot_env_graspbox import GraspboxEnv

__all__ = ["make_env"]


def make_env(n_envs: int = 1, use_async_envs: bool = False, cfg: Any = None) -> dict[str, dict[int, Any]]:
    """Make environments.

    Parameters
    ----------
    n_envs : int
        Number of environments.
    use_async_envs : bool
        Is ignored: the environments step in threads.
    cfg : EnvConfig, optional
        A `GraspboxEnv`; of any other config only `task` is read, if it names an environment of graspbox.

    Returns
    -------
    dict
        ``{"graspbox": {0: environments}}``.
    """
    if not isinstance(cfg, GraspboxEnv):
        task = getattr(cfg, "task", None)
        cfg = GraspboxEnv(task=task) if task else GraspboxEnv()
    return cfg.create_envs(n_envs, use_async_envs)
