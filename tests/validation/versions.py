"""The version of MuJoCo, printed with every figure: its defaults of contacts and meshes change between versions."""

from importlib.metadata import version

__all__ = ["MUJOCO_VERSION", "judged_by"]

#: The installed version.
MUJOCO_VERSION = version("mujoco")


def judged_by() -> str:
    """Return the line that names the version of the figures."""
    return f"MuJoCo {MUJOCO_VERSION}"
