"""The arm that carries out grasps of an image: where it stands, what of the image shows it, and what it reaches."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats
from graspbox.arms import Arm, ArmLike, Reach, load_arm, on_arm, plan_path, reachable
from graspbox.arms.masking import checked_joints
from graspbox.configs import PathConfig, ReachConfig
from graspbox.errors import ConfigError, PathError
from graspbox.hands import Hand
from graspbox.perception.depth_views import DepthView

__all__ = ["ABOVE", "ArmAt"]

#: Points lower than this over the table are the table's, metres.
ABOVE = 0.012

#: Grasps among which reached ones are looked for, for each one that is returned, and in all.
_AMONG, _MOST = 8, 100
#: Reached grasps to which a path is planned.
_TRIED = 20
#: Pixels nearer to a link or the hand show the arm, metres: this, and a share of the squared depth, as noise grows.
_MARGIN, _NOISE = 0.02, 0.01
#: From so many pixels of the networks' image on, something where the arm at home would be is told.
_MANY = 100


@dataclass(frozen=True, eq=False)
class ArmAt:
    """An arm at its place.

    Attributes
    ----------
    arm : Arm
        The arm.
    table_from_base : (4, 4) float64
        Pose of its base, metres; the table is the plane z = 0.
    mount : (4, 4) float64, optional
        Pose of the hand's base on its flange; by default as the files of both state it.
    joints : (k,) float64, optional
        Positions of its joints when the image was taken, rad or m.
    config : ReachConfig
        Settings.
    """

    arm: Arm
    table_from_base: NDArray[np.float64]
    mount: NDArray[np.float64] | None = None
    joints: NDArray[np.float64] | None = None
    config: ReachConfig = field(default_factory=ReachConfig)

    @classmethod
    def of(
        cls,
        arm: ArmLike | None,
        base: ArrayLike | None,
        mount: ArrayLike | None,
        joints: ArrayLike | None,
        hand: Hand,
        *,
        pose_given: bool,
    ) -> "ArmAt | None":
        """Check the arguments of a search, also whether the arm can carry the hand; None without an arm."""
        if arm is None:
            if base is not None or mount is not None or joints is not None:
                raise ConfigError("base, mount and joints place an arm; pass arm too")
            return None
        if base is None:
            raise ConfigError("an arm needs its place: pass base, the pose of its base in the table's frame")
        if not pose_given:
            raise ConfigError(
                "base is in the table's frame, which a table found in the image does not fix; pass table_from_camera"
            )
        mounted = None if mount is None else floats(mount, "mount")
        loaded = load_arm(arm)
        measured = None if joints is None else checked_joints(loaded, joints)
        made = cls(loaded, floats(base, "base"), mounted, measured)
        # Wrong arguments are no refusals of things.
        made.reach(hand, np.zeros((0, 4, 4)), np.zeros(0))
        return made

    def shown(
        self, hand: Hand, points: NDArray[np.float64], depths: NDArray[np.float64], joints: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Return which points (n, 3) of an image, table's frame, at depths (n,), show the arm or its hand."""
        margins = _MARGIN + _NOISE * depths**2
        return on_arm(self.arm, joints, points, self.table_from_base, hand=hand, mount=self.mount, distance=margins)

    def hint(self, hand: Hand, points: NDArray[np.float64]) -> tuple[str, ...]:
        """Return a warning if the image, whose points above the table are given, may show an arm of unknown joints."""
        if self.joints is not None:
            return ()
        at_home = int(self.shown(hand, points, np.zeros(len(points)), self.arm.home).sum())
        if at_home < _MANY:
            return ()
        return (
            f"{at_home} pixels show something where the arm {self.arm.name} at home would be; if the image shows the "
            "arm, pass joints (--joints), its positions when the image was taken: all else that is seen is an obstacle",
        )

    def among(self, count: int) -> int:
        """Return among how many grasps those that are reached are looked for."""
        return max(count, min(_AMONG * count, _MOST))

    def hidden(self, hand: Hand, view: DepthView) -> DepthView:
        """Return an image of the table without the pixels that show the arm or its hand."""
        depth = view.metres().copy()
        pixels = np.nonzero(depth)
        joints = self.arm.home if self.joints is None else self.joints
        shown = self.shown(hand, view.points(), depth[pixels], joints)
        depth[pixels] = np.where(shown, 0.0, depth[pixels])
        return replace(view, depth=depth)

    def carried(
        self,
        hand: Hand,
        points: NDArray[np.float64],
        config: PathConfig,
        poses: NDArray[np.float64],
        preshapes: NDArray[np.float64],
    ) -> int | None:
        """Return the first of some grasps (m, 4, 4) to which a path leads, and up, among points (k, 3)."""
        tried = np.flatnonzero(self.reach(hand, poses, preshapes, points).reached)[:_TRIED]
        if not len(tried):
            return None
        try:
            path = plan_path(
                self.arm,
                hand,
                poses[tried],
                preshapes[tried],
                self.table_from_base,
                points=points,
                mount=self.mount,
                start=self.joints,
                config=replace(config, reach=self.config),
            )
        except PathError:
            return None
        return int(tried[path.grasp])

    def reach(
        self,
        hand: Hand,
        poses: NDArray[np.float64],
        preshapes: NDArray[np.float64],
        points: NDArray[np.float64] | None = None,
    ) -> Reach:
        """Return which grasps (m, 4, 4), table's frame, it reaches among points (k, 3) that are seen, metres."""
        return reachable(
            self.arm,
            hand,
            poses,
            preshapes,
            self.table_from_base,
            mount=self.mount,
            points=points,
            config=self.config,
        )
