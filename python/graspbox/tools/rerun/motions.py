"""The motion of hand and objects in one episode, with forces and images, as rerun logs it.

A trial of a hand pose is traced (`graspbox.simulation.Scene.trace`), with the engine's contacts. An episode of an
environment is stepped again (`graspbox.evaluation.replays.Replay`): its forces are those that the tactile sensors
measure. The sum of all contact forces on the object follows from its motion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import config_of
from graspbox._core import Hand, Mesh
from graspbox.configs import PhysicsConfig, TrialConfig
from graspbox.envs import spaces
from graspbox.envs.coding import Codec
from graspbox.envs.settings import GraspConfig, GraspPoseConfig
from graspbox.evaluation.replays import Replay
from graspbox.hands import load_hand
from graspbox.meshes.shapes import Floats
from graspbox.policies.published.configs import ACTING
from graspbox.simulation import Scene
from graspbox.tools.hand_links import HandLinks, state_joints

#: Gravity, m/s2.
_GRAVITY = np.array([0.0, 0.0, -9.81])
#: Time over which velocities are averaged for the force on the object, seconds.
_WINDOW = 0.05
#: Environment whose episodes have one decision.
_DECISIONS = "graspbox/GraspPose-v0"


@dataclass(frozen=True, eq=False)
class Shot:
    """An image of the environment (H, W, c), colours or depth in metres, seconds after the motion began."""

    time: float
    name: str
    image: NDArray[Any]
    intrinsics: Floats
    world_from_camera: Floats


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """A motion of t samples.

    Attributes
    ----------
    time : (t,) float64
        Seconds, from 0.
    world_from_hand, world_from_object : (t, 4, 4) float64
        Poses, metres.
    joints : (t, c) float64
        Positions of the independent joints (`graspbox.Hand.joints`), rad or m.
    scalars : mapping of str to (t,) float64
        Other measures by name, such as ``hand_force`` (N).
    contact_samples : (k,) int64
        Sample of each force of the hand on the object, ascending.
    contact_points, contact_forces : (k, 3) float64
        Where it acts, and the force, world frame, m and N.
    outcome : str
        Kind of the failure, or ``success``.
    probability : float or None
        Probability of success that the policy predicted.
    mass : float
        Mass of the object, kg.
    others : tuple of Mesh
        The k other objects of the scene.
    world_from_others : (t, k, 4, 4) float64
        Their poses, metres.
    world_from_walls, wall_half_extents : (w, 4, 4), (w, 3) float64
        Poses and half extents of the walls, metres.
    """

    name: str
    hand: Hand
    mesh: Mesh
    time: Floats
    world_from_hand: Floats
    world_from_object: Floats
    joints: Floats
    scalars: Mapping[str, Floats]
    outcome: str
    mass: float
    contact_samples: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    contact_points: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    contact_forces: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    probability: float | None = None
    shots: tuple[Shot, ...] = field(default=())
    others: tuple[Mesh, ...] = ()
    world_from_others: Floats = field(default_factory=lambda: np.zeros((0, 0, 4, 4)))
    world_from_walls: Floats = field(default_factory=lambda: np.zeros((0, 4, 4)))
    wall_half_extents: Floats = field(default_factory=lambda: np.zeros((0, 3)))

    def contact_force(self, center_of_mass: Floats) -> tuple[Floats, Floats]:
        """Return the sum of the contact forces on the object: points of action and forces, (t, 3) each, m and N.

        It is the object's mass times its acceleration less gravity; the acceleration is the difference of velocities
        over 50 ms. On the table it includes the table's support.
        """
        points = self.world_from_object[:, :3, :3] @ center_of_mass + self.world_from_object[:, :3, 3]
        if len(self.time) < 3:
            return points, np.tile(-self.mass * _GRAVITY, (len(points), 1))
        width = max(1, round(_WINDOW / float(np.median(np.diff(self.time)))))
        velocity = np.gradient(points, self.time, axis=0)
        if width > 1:
            kernel = np.ones(width) / width
            padded = np.pad(velocity, ((width // 2, width - 1 - width // 2), (0, 0)), mode="edge")
            velocity = np.stack([np.convolve(column, kernel, "valid") for column in padded.T], axis=1)
        return points, self.mass * (np.gradient(velocity, self.time, axis=0) - _GRAVITY)


def of_trial(
    scene: Scene,
    object_from_hand: Floats,
    preshape: float,
    *,
    config: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
    name: str = "",
    probability: float | None = None,
) -> RecordedMotion:
    """Run one trial of a hand pose, and record its motion every 10 ms.

    Parameters
    ----------
    object_from_hand, preshape, config
        As for `graspbox.simulation.Scene.trace`.
    name : str
        Title; by default the object's name.
    probability : float, optional
        Predicted probability of success.

    Raises
    ------
    ConfigError
        As `graspbox.simulation.Scene.trace`.
    """
    outcomes, trace = scene.trace(object_from_hand, preshape, config=config)
    hand = scene.hand
    motion = partial(
        RecordedMotion,
        name=name or scene.name,
        hand=hand,
        mesh=scene.mesh,
        outcome=str(outcomes.failure[0]) or "success",
        mass=float(scene.mesh.mass),
        probability=probability,
        others=scene.others,
        world_from_walls=scene.world_from_walls,
        wall_half_extents=scene.wall_half_extents,
    )
    if not len(trace.time):
        # An infeasible pose: the open hand where it would collide.
        return motion(
            time=np.zeros(1),
            world_from_hand=(scene.world_from_object @ object_from_hand)[None],
            world_from_object=scene.world_from_object[None],
            world_from_others=scene.world_from_others[None],
            joints=hand.open(preshape)[None],
            scalars={},
        )
    scalars = {"hand_force": trace.hand_force, "distance": trace.distance}
    scalars["lift"] = trace.world_from_object[:, 2, 3] - trace.world_from_object[0, 2, 3]
    rises = trace.world_from_others[..., 2, 3] - trace.world_from_others[0, :, 2, 3]
    scalars |= {f"lift_of_others/{i}": rises[:, i] for i in range(len(scene.others))}
    scalars |= {f"tension/{name}": trace.tensions[:, i] for i, name in enumerate(hand.tendons)}
    scalars |= {f"load/{name}": trace.loads[:, i] for i, name in enumerate(hand.actuators)}
    if trace.tactile.size:
        scalars["tactile_sum"] = trace.tactile.sum(axis=1)
    shared = ["time", "world_from_hand", "world_from_object", "world_from_others", "joints"]
    shared += ["contact_samples", "contact_points", "contact_forces"]
    return motion(scalars=scalars, **{column: getattr(trace, column) for column in shared})


def of_replay(replay: Replay, images: Sequence[str] = ("rgb", "depth")) -> RecordedMotion:
    """Step an episode again, and record its motion and images.

    An episode of ``Grasp-v0`` has a sample per step. The one decision of ``GraspPose-v0`` is traced as a trial of the
    pose that the policy chose, without the errors of a condition; the images are those before the decision.

    Raises
    ------
    ConfigError, ObjectSetError, MissingExtraError, MeshError, FileError, SimulationError
        If the environment cannot be made, or the object cannot be simulated.
    """
    chosen = replay.settings.get("hand", "reflex")
    hand = load_hand(tuple(chosen) if isinstance(chosen, list) else chosen)
    decides = replay.env_id == _DECISIONS
    feels = not decides and "tactile" not in spaces.tables(hand)["absent"]
    env = replay.make(obs=("state", *(("tactile",) if feels else ()), *images))
    try:
        return (_decision if decides else _episode)(replay, env, hand, tuple(images))
    finally:
        env.close()


def _title(replay: Replay) -> str:
    return f"{replay.object}, seed {replay.seed}"


def _shots(env: Any, seen: Mapping[str, Any], time: float, images: Sequence[str]) -> list[Shot]:
    cameras = env.cameras()
    shots = []
    for name in images:
        camera = next((key for key in cameras if name.endswith(f"_{key}")), next(iter(cameras)))
        shots.append(Shot(time, name, np.array(seen[name]), *cameras[camera]))
    return shots


def _decision(replay: Replay, env: Any, hand: Hand, images: tuple[str, ...]) -> RecordedMotion:
    seen, _ = env.reset(seed=replay.seed)
    shots = _shots(env, seen, 0.0, images)
    codec = Codec(replay.settings.get("control", GraspPoseConfig.control), hand)
    world_from_object = codec.pose(seen["state"], "object")
    goal, preshape = codec.decode_grasp(replay.actions[0])
    physics = _config(PhysicsConfig, replay.settings.get("physics"))
    config = _config(TrialConfig, replay.settings.get("trial"))
    scene = Scene(replay.spec().load(), hand=hand, world_from_object=world_from_object, physics=physics)
    pose = np.linalg.inv(scene.world_from_object) @ goal
    motion = of_trial(scene, pose, preshape, config=config, name=_title(replay), probability=replay.probability)
    return replace(motion, shots=tuple(shots), outcome=_outcome(replay, motion.outcome))


def _outcome(replay: Replay, now: str) -> str:
    """Describe the outcome of the episode, and that of its repetition where it differs."""
    before = replay.failure or "success"
    if before == "failure" and now != "success":
        return now
    return before if before == now else f"{before}; run again without the errors of its condition: {now}"


def _config(kind: Any, value: Any) -> Any:
    return config_of(kind, value, kind.__name__) if isinstance(value, Mapping) else kind()


def _episode(replay: Replay, env: Any, hand: Hand, images: tuple[str, ...]) -> RecordedMotion:
    chosen = {name: replay.settings.get(name, getattr(GraspConfig, name)) for name in ACTING}
    codec = Codec(chosen["control"], hand, fingers=chosen["fingers"])
    period = 1.0 / chosen["control_freq"]
    columns = state_joints(codec, hand)
    samples: list[tuple[Floats, Floats, Floats]] = []
    shots: list[Shot] = []
    tactile, lift = [], []
    mesh = replay.spec().load()
    info: Mapping[str, Any] = {}
    for step, (seen, info) in enumerate(replay.run(env)):  # noqa: B007 (the last one is used)
        state = seen["state"]
        world_from_object = codec.pose(state, "object")
        # The pose that the arm measures may be off; this one is true.
        world_from_hand = world_from_object @ np.linalg.inv(codec.pose(state, "object_in_hand"))
        samples.append((world_from_hand, world_from_object, columns(state)))
        lift.append(float(codec.column(state, "lift")[0]))
        tactile.append(np.asarray(seen.get("tactile", ()), dtype=np.float64))
        shots += _shots(env, seen, step * period, images)
    hands, objects, joints = (np.array(column) for column in zip(*samples, strict=True))
    forces = np.array(tactile)
    scalars = {"lift": np.array(lift)}
    if forces.size:
        scalars["tactile_sum"] = forces.sum(axis=1)
    contact_samples, contact_points, contact_forces = sensor_forces(hand, hands, joints, forces)
    return RecordedMotion(
        name=_title(replay),
        hand=hand,
        mesh=mesh,
        time=period * np.arange(len(samples)),
        world_from_hand=hands,
        world_from_object=objects,
        joints=joints,
        scalars=scalars,
        outcome=_outcome(replay, "success" if info["is_success"] else str(info["failure"])),
        mass=float(mesh.mass),
        contact_samples=contact_samples,
        contact_points=contact_points,
        contact_forces=contact_forces,
        probability=replay.probability,
        shots=tuple(shots),
    )


def sensor_forces(
    hand: Hand, world_from_hand: Floats, joints: Floats, tactile: Floats
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return samples (k,), points (k, 3) and forces on the object (k, 3), world frame, of tactile readings (t, s), N.

    A force acts along the outward normal of its sensor.
    """
    samples, sensors = np.nonzero(tactile > 0.0)
    links = HandLinks(hand)
    # (t, 2, s, 3): points and normals, hand frame.
    placed = np.array([links.sensors(links.frames(row)) for row in joints])[samples, :, sensors]
    frames = world_from_hand[samples]
    turned = np.einsum("kij,knj->kni", frames[:, :3, :3], placed)
    return samples, turned[:, 0] + frames[:, :3, 3], turned[:, 1] * tactile[samples, sensors][:, None]
