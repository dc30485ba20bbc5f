"""An arm on its path to a grasp, with the object, on a time slider."""

from typing import ClassVar

import numpy as np

from graspbox.simulation.neighbours import Neighbours
from graspbox.simulation.path_motion import PathMotion
from graspbox.tools.viewer.drawn_hand import DrawnHand
from graspbox.tools.viewer.geometry import Color
from graspbox.tools.viewer.page import Page
from graspbox.tools.viewer.playback import Playback
from graspbox.tools.viewer.surroundings import DrawnObjects

#: Colours of the links, in turn.
_LINKS: tuple[Color, Color] = ((233, 233, 230), (207, 210, 214))
#: Share of the way from the object to the base at which the camera looks, and its distance as a multiple of that way.
_AT, _DISTANCE = 0.4, 2.6


class PathPage(Page):
    """Page of a path; `content` is a `PathMotion`."""

    title: ClassVar[str] = "path"

    def build(self) -> None:
        """Draw the arm, the hand, the object and what is around them at the beginning."""
        motion: PathMotion = self.content
        base, thing = motion.world_from_base[:3, 3], motion.world_from_object[0, :3, 3]
        way = base - thing
        self.canvas.look(thing + _AT * way + (0.0, 0.0, 0.2), max(_DISTANCE * float(np.linalg.norm(way)), 1.0))
        self.canvas.table()
        frames = motion.link_frames(0)
        self.links = {
            link: self.canvas.mesh(f"/arm/{link}", shape, frames[link], color=_LINKS[row % 2])
            for row, (link, shape) in enumerate(motion.links())
        }
        self.hand = DrawnHand(self.canvas, "/hand", motion.hand)
        self.node = self.canvas.mesh("/object", motion.mesh, motion.world_from_object[0])
        if (around := motion.neighbours) is not None:
            walls = around.world_from_walls, around.wall_half_extents
            DrawnObjects(self.canvas, "/others").show(Neighbours(around.meshes, around.world_from_objects, *walls))
        count = len(motion.times)
        with self.canvas.gui.add_folder("Time"):
            period = float(motion.times[1] - motion.times[0]) if count > 1 else 1.0
            self.playback = Playback(self.canvas, self.show, period)
            self.reading = self.canvas.gui.add_markdown("")
        joints = len(motion.arm.joints)
        self.canvas.say(
            f"**{motion.arm.name}** with {motion.hand.name}, {motion.mesh.name}  \n"
            f"{joints} joints, {motion.times[-1]:.2f} s; nothing here drives a robot"
        )
        self.playback.load(count)

    def show(self, sample: int) -> None:
        """Show a sample of the path."""
        motion: PathMotion = self.content
        with self.canvas.server.atomic():
            frames = motion.link_frames(sample)
            for link, node in self.links.items():
                self.canvas.move(node, frames[link])
            self.hand.pose(motion.world_from_hand[sample], motion.joints[sample])
            self.canvas.move(self.node, motion.world_from_object[sample])
        positions = ", ".join(f"{position:.3f}" for position in motion.positions[sample])
        self.reading.content = f"{motion.phases[sample]}, {motion.times[sample]:.2f} s  \njoints: {positions}"

    def close(self) -> None:
        """Stop playing."""
        if hasattr(self, "playback"):
            self.playback.stop()
