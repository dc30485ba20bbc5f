"""The protocol in MuJoCo: the models of hand and object, and the drive, of `validation.mujoco`.

Friction is that of the benchmark: 0.6 along the surface, and 0.02 against turning about the normal, which the core's
contacts do not have.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import mujoco
import numpy as np

from graspbox.configs import PhysicsConfig
from graspbox.hands.description import Array, HandDescription
from graspbox.simulation import Scene
from graspbox.tools.scene_export.contents import object_data
from validation.forces.config import PULLS, Contact, ForceConfig, Verdict
from validation.mujoco.compare import describe
from validation.mujoco.replay import Replay, TrialTimes
from validation.mujoco.scene import Numerics, ObjectData, build
from validation.mujoco.scene import Scene as Model

__all__ = ["TORSION", "judge_in_mujoco"]

#: Coefficient of torsional friction of the benchmark, metres.
TORSION = 0.02
#: Height of an object in the air above its place on the table, metres, as in the core.
_IN_THE_AIR = 1.0
#: Time between two looks at the object, at which a lost one ends a pull, seconds, as in the core.
_LOOK_EVERY = 0.05


def judge_in_mujoco(
    scene: Scene,
    poses: Array,
    preshape: Array,
    config: ForceConfig | None = None,
    threads: int = 1,
    numerics: Numerics | None = None,
) -> Iterator[Verdict]:
    """Judge grasps, as `judge_in_core`, in MuJoCo with `numerics`; yields the verdicts in the order of the poses."""
    settings, hand = config or ForceConfig(), describe(scene.hand)
    item = _weighed(object_data(scene), settings.mass)
    pads = hand.pad_friction
    air = np.array(item.world_from_object)
    air[2, 3] += _IN_THE_AIR
    numerics = numerics or Numerics()
    models = [
        _model(hand, replace(item, world_from_object=place), settings, pads, numerics)
        for place in (air, item.world_from_object)
    ]

    def run(pose: Array, angle: float) -> Verdict:
        return _judged(models, pose, float(angle), settings)

    with ThreadPoolExecutor(threads) as pool:
        # MuJoCo releases the GIL while it steps.
        yield from pool.map(run, poses, preshape)


def _weighed(item: ObjectData, mass: float | None) -> ObjectData:
    """Return the object with another mass, its inertia in proportion."""
    return item if mass is None else replace(item, mass=mass, inertia=item.inertia * (mass / item.mass))


def _model(hand: HandDescription, item: ObjectData, config: ForceConfig, pads: float, numerics: Numerics) -> Model:
    """Compile the model without gravity and with the protocol's friction."""
    scene = build(hand, item, PhysicsConfig(gravity=0.0), numerics)
    if config.friction is not None:
        scene.model.geom_friction[:, 0] *= config.friction / pads
    scene.model.geom_friction[scene.is_object | scene.is_hand, 1] = TORSION
    # A contact takes the greater number of directions of its two geoms; pairs of hand and table have their own.
    scene.model.geom_condim[scene.is_object] = 4
    return scene


class _PullTest:
    """A hand that closes around an object; copies of the closed state are pulled."""

    def __init__(self, scene: Model, world_from_hand: Array, preshape: float, config: ForceConfig) -> None:
        times = TrialTimes(config.close_time, config.lift_height, config.lift_time, 0.0)
        self.run, self.config = Replay(scene, world_from_hand, preshape, times), config
        self.body = scene.object_body
        self.before = self._pose()
        self.closed = self.before

    def _pose(self) -> tuple[Array, Array]:
        """Return the centre of mass in the frame of the rising hand, and the orientation of the object."""
        return self.run.object_place(), self.run.data.xmat[self.body].reshape(3, 3).copy()

    def _moved(self, since: tuple[Array, Array]) -> tuple[float, float]:
        place, turn = self._pose()
        cosine = 0.5 * (float(np.trace(since[1].T @ turn)) - 1.0)
        return float(np.linalg.norm(place - since[0])), float(np.arccos(np.clip(cosine, -1.0, 1.0)))

    def _within(self, moved: tuple[float, float]) -> bool:
        """Compare a motion with the limits; one that is not finite is beyond them."""
        return moved[0] < self.config.max_shift and moved[1] < self.config.max_turn

    def push(self, along: Array) -> None:
        """Set the force on the object, along a unit vector of the world."""
        mass = float(self.run.model.body_mass[self.body])
        self.run.data.xfrc_applied[self.body, :3] = self.config.acceleration * mass * along

    def steps(self, seconds: float) -> None:
        """Advance."""
        for _ in range(round(seconds / self.run.dt)):
            self.run.step()

    def close(self) -> None:
        """Close the hand."""
        self.steps(self.config.close_time)
        self.closed = self._pose()

    def branch(self) -> _PullTest:
        """Return a copy that can be advanced by itself."""
        other = copy.copy(self)
        other.run = copy.copy(self.run)
        other.run.model, other.run.data = copy.copy(self.run.model), copy.copy(self.run.data)
        other.run.drive = copy.copy(self.run.drive)
        # The hand does not rise while it is pulled.
        other.run.times = replace(self.run.times, lift_height=0.0)
        return other

    def pull(self, along: Array) -> tuple[bool, bool, tuple[float, float]]:
        """Pull to the end or until the object is lost; returns both verdicts and the motion since the hand closed."""
        self.push(along)
        passes = True
        looks = max(1, round(self.config.pull_time / _LOOK_EVERY)) if self.config.pull_time > 0.0 else 0
        for _ in range(looks):
            self.steps(self.config.pull_time / looks)
            passes = passes and self._within(self._moved(self.before))
            if not self._within(self._moved(self.closed)):
                break
        return self.verdict(passes)

    def verdict(self, passes: bool = True) -> tuple[bool, bool, tuple[float, float]]:
        """Return both verdicts on the present state, and the motion since the hand closed."""
        moved = self._moved(self.closed)
        return passes and self._within(self._moved(self.before)), self._within(moved), moved

    def contacts(self) -> list[Contact]:
        """Return the contacts of hand and object that press, world frame."""
        run, contacts = self.run, []
        for index, contact in enumerate(run.data.contact):
            one, two = contact.geom
            if not (run.scene.is_object[[one, two]].any() and run.scene.is_hand[[one, two]].any()):
                continue
            force = np.zeros(6)
            mujoco.mj_contactForce(run.model, run.data, index, force)
            if force[0] > 0.0:
                # MuJoCo's normal is from the first geom to the second.
                sign = 1.0 if run.scene.is_object[two] else -1.0
                link = int(run.model.geom_bodyid[one if run.scene.is_object[two] else two])
                friction = float(contact.friction[0])
                contacts.append(Contact(link, np.array(contact.pos), sign * np.array(contact.frame[:3]), friction))
        return contacts


def _judged(models: list[Model], object_from_hand: Array, preshape: float, config: ForceConfig) -> Verdict:
    """Judge one grasp in the models in the air and on the table."""
    air, table = (_PullTest(m, m.object.world_from_object @ object_from_hand, preshape, config) for m in models)
    start_depth = air.run.contacts()[2]
    if start_depth > config.max_depth:
        return Verdict.refused(start_depth)
    air.close()
    contacts, closed_depth = air.contacts(), air.run.contacts()[2]
    verdicts = [air.branch().pull(along) for along in PULLS]
    table.push(np.array([0.0, 0.0, -1.0]))
    table.close()
    table.steps(config.lift_time)
    verdicts.append(table.verdict())
    moved = np.array([motion for _, _, motion in verdicts])
    return Verdict(
        passes=all(passes for passes, _, _ in verdicts[:-1]),
        holds=all(holds for _, holds, _ in verdicts[:-1]),
        lifts=verdicts[-1][0],
        keeps=verdicts[-1][1],
        shift=moved[:, 0],
        turn=moved[:, 1],
        start_depth=start_depth,
        closed_depth=closed_depth,
        contacts=contacts,
    )
