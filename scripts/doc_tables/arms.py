"""Tables of the arms that come with the package."""

from collections.abc import Callable

import numpy as np

from doc_tables import environments
from graspbox.arms import Arm


def tables() -> dict[str, Callable[[], str]]:
    """Return the tables that a marker can name."""
    return {"included arms": included}


def included() -> str:
    """Row by row: name, joints, ranges, speeds, payload."""
    rows = []
    for name in Arm.names():
        arm = Arm.named(name)
        span = np.degrees(arm.joint_limits)
        ranges = ", ".join(f"{low:.0f} .. {high:.0f}" for low, high in span)
        speeds = _few(np.degrees(arm.speeds), "degrees/s")
        limits = (_few(arm.accelerations, "rad/s2"), _few(arm.jerks, "rad/s3"))
        rows.append((f"`{name}`", str(len(arm.joints)), ranges, speeds, *limits, f"{arm.payload:g} kg"))
    return environments.markdown("name joints ranges/degrees speed acceleration jerk payload", rows)


def _few(numbers: np.ndarray, unit: str) -> str:
    if not np.isfinite(numbers).all():
        return "none published"
    least, most = numbers.min(), numbers.max()
    return f"{least:.3g} {unit}" if least == most else f"{least:.3g} to {most:.3g} {unit}"
