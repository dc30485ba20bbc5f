"""The motion of hand and object in one episode, with forces and images, as rerun logs it.

A trial of a hand pose is traced (`graspbox.simulation.Scene.trace`); an episode of an environment is stepped again
(`graspbox.evaluation.replays.Replay`). Neither has the single contacts of the engine: forces are those that the tactile
sensors measure, and the sum of all contact forces on the object, which follows from its motion.
"""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import config_of
from graspbox._core import Hand, Mesh
from graspbox.configs import PhysicsConfig, TrialConfig
from graspbox.envs import spaces
from graspbox.envs.coding import Codec
from graspbox.evaluation.replays import Replay
from graspbox.hands import load_hand
from graspbox.object_sets import ObjectSpec
from graspbox.rerun.links import link_frames
from graspbox.rerun.touch import felt, joint_columns, nothing_felt
from graspbox.simulation import Scene

__all__ = ["Motion", "Shot", "hand_links", "of_replay", "of_trial"]

Floats = NDArray[np.float64]
#: Gravity, m/s2.
_GRAVITY = np.array([0.0, 0.0, -9.81])
#: Time over which velocities are averaged for the force on the object, seconds.
_WINDOW = 0.05
#: Environment whose episodes have one decision.
_DECISIONS = "graspbox/GraspPose-v0"


@dataclass(frozen=True, eq=False)
class Shot:
    """Images of one camera at one time.

    Attributes
    ----------
    time : float
        Seconds since the motion began.
    name : str
        The environment's name of the image.
    image : (H, W, c) uint8 or float32
        Colours; or depth, metres.
    intrinsics : (3, 3) float64
        Pixels.
    world_from_camera : (4, 4) float64
        Metres.
    """

    time: float
    name: str
    image: NDArray[Any]
    intrinsics: Floats
    world_from_camera: Floats


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion of t samples.

    Attributes
    ----------
    name : str
        Title of the episode.
    hand, mesh : Hand, Mesh
        The hand and the object.
    time : (t,) float64
        Seconds, from 0.
    world_from_hand, world_from_object : (t, 4, 4) float64
        Poses, metres.
    joints : (t, c) float64
        Positions of the independent joints (`graspbox.Hand.joints`), rad or m.
    scalars : mapping of str to (t,) float64
        Other measures by name, such as ``hand_force`` (N).
    felt_at : (k,) int64
        Samples at which the tactile sensors were read.
    tactile : (k, s) float64
        Force on each tactile sensor then, N.
    outcome : str
        Kind of the failure, or ``success``.
    probability : float or None
        Probability of success that the policy predicted.
    shots : tuple of Shot
        Images.
    mass : float
        Mass of the object, kg.
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
    felt_at: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    tactile: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    probability: float | None = None
    shots: tuple[Shot, ...] = field(default=())

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

    def sensor_forces(self) -> Iterator[tuple[Floats, Floats]]:
        """Yield, for each row of `tactile`, where a force is felt (n, 3), and the force on the object (n, 3); m, N."""
        rows, places, normals = _sensors(self.hand)
        for sample, forces in zip(self.felt_at, self.tactile, strict=True):
            felt = np.flatnonzero(forces > 0.0)
            frames = self.world_from_hand[sample] @ hand_links(self.hand, self.joints[sample])[rows[felt]]
            points = np.einsum("nij,nj->ni", frames[:, :3, :3], places[felt]) + frames[:, :3, 3]
            ways = np.einsum("nij,nj->ni", frames[:, :3, :3], normals[felt])
            yield points, ways * forces[felt, None]


def hand_links(hand: Hand, joints: Floats) -> Floats:
    """Return the frames of the links in the hand's frame, (1 + j, 4, 4): the palm, then each joint that moves."""
    frames, _, _ = hand.joint_frames(np.ascontiguousarray(joints, dtype=np.float64))
    return np.concatenate([np.eye(4)[None], frames])


def _sensors(hand: Hand) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return the sensors of a hand: rows of `hand_links`, places and unit normals (s, 3) in these frames, metres.

    In the order of the observation ``tactile``: link by link, and for each the tables of ``hand.toml`` in turn.
    """
    carriers, offsets = link_frames(hand)
    order = list(carriers)
    tables = tomllib.loads(hand.files[1]).get("sensors", [])
    found = [(order.index(link), link, table) for table in tables for link in table["links"]]
    found.sort(key=lambda one: one[0])
    rows = np.array([carriers[link] for _, link, _ in found], dtype=np.int64)
    places = [offsets[link] @ np.append(table["position"]["value"], 1.0) for _, link, table in found]
    normals = [offsets[link][:3, :3] @ table["normal"]["value"] for _, link, table in found]
    units = [normal / np.linalg.norm(normal) for normal in normals]
    return rows, np.array(places).reshape(-1, 4)[:, :3], np.array(units).reshape(-1, 3)


def of_trial(
    scene: Scene,
    object_from_hand: Floats,
    preshape: float,
    *,
    config: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
    spec: ObjectSpec | None = None,
    physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
    name: str = "",
    probability: float | None = None,
) -> Motion:
    """Run one trial of a hand pose, and record its motion every 10 ms.

    Parameters
    ----------
    scene : Scene
        Object and hand.
    object_from_hand : (4, 4) float64
        Pose of the hand's grasp frame, metres.
    preshape : float
        See `graspbox.Hand.preshape_limits`.
    config : TrialConfig
        The trial.
    spec : ObjectSpec, optional
        The object of the scene: with it, and a hand with tactile sensors, the same grasp is executed in ``Grasp-v0``
        and its sensors are read at 20 Hz, while its object stays within 5 mm of that of the trial.
    physics : PhysicsConfig
        Physics of the scene.
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
    outcome = str(outcomes.failure[0]) or "success"
    title, mass, hand = name or scene.name, float(scene.mesh.mass), scene.hand
    if not len(trace.time):
        # An infeasible pose: the open hand where it would collide.
        pose = (scene.world_from_object @ object_from_hand)[None]
        still = (np.zeros(1), pose, scene.world_from_object[None], hand.open(preshape)[None])
        return Motion(title, hand, scene.mesh, *still, {}, outcome, mass, probability=probability)
    scalars = {"hand_force": trace.hand_force, "distance": trace.distance}
    scalars["lift"] = trace.world_from_object[:, 2, 3] - trace.world_from_object[0, 2, 3]
    scalars |= {f"tension/{name}": trace.tensions[:, i] for i, name in enumerate(hand.tendons)}
    scalars |= {f"load/{name}": trace.loads[:, i] for i, name in enumerate(hand.actuators)}
    felt_at, tactile = felt(spec, scene, trace, preshape, physics) if spec is not None else nothing_felt()
    poses = trace.time, trace.world_from_hand, trace.world_from_object, trace.joints
    return Motion(title, hand, scene.mesh, *poses, scalars, outcome, mass, felt_at, tactile, probability)


def of_replay(replay: Replay, images: Sequence[str] = ("rgb", "depth")) -> Motion:
    """Step an episode again, and record its motion and images.

    An episode of ``Grasp-v0`` has a sample per step. The one decision of ``GraspPose-v0`` is traced as a trial of the
    pose that the policy chose, without the errors of a condition; the images are those before the decision.

    Parameters
    ----------
    replay : Replay
        The episode.
    images : sequence of str
        Images of the environment to record.

    Raises
    ------
    ConfigError, ObjectSetError, MissingExtraError, MeshError, FileError, SimulationError
        If the environment cannot be made, or the object cannot be simulated.
    """
    hand = load_hand(_hand_argument(replay.settings.get("hand", "reflex")))
    decides = replay.env_id == _DECISIONS
    feels = not decides and "tactile" not in spaces.tables(hand)["absent"]
    env = replay.make(obs=("state", *(("tactile",) if feels else ()), *images))
    try:
        return (_decision if decides else _episode)(replay, env, hand, tuple(images))
    finally:
        env.close()


def _hand_argument(given: Any) -> Any:
    return tuple(given) if isinstance(given, list) else given


def _title(replay: Replay) -> str:
    return f"{replay.object}, seed {replay.seed}"


def _shots(env: Any, seen: Mapping[str, Any], time: float, images: Sequence[str]) -> list[Shot]:
    cameras = env.cameras()
    found = []
    for name in images:
        camera = next((key for key in cameras if name.endswith(f"_{key}")), next(iter(cameras)))
        found.append(Shot(time, name, np.array(seen[name]), *cameras[camera]))
    return found


def _decision(replay: Replay, env: Any, hand: Hand, images: tuple[str, ...]) -> Motion:
    seen, _ = env.reset(seed=replay.seed)
    shots = _shots(env, seen, 0.0, images)
    codec = Codec("grasp_pose", hand)
    world_from_object = codec.pose(seen["state"], "object")
    goal, preshape = codec.decode_grasp(replay.actions[0])
    physics = _config(PhysicsConfig, replay.settings.get("physics"))
    config = _config(TrialConfig, replay.settings.get("trial"))
    spec = replay.spec()
    scene = Scene(spec.load(), hand=hand, world_from_object=world_from_object, physics=physics)
    motion = of_trial(
        scene,
        np.linalg.inv(scene.world_from_object) @ goal,
        preshape,
        config=config,
        spec=spec,
        physics=physics,
        name=_title(replay),
        probability=replay.probability,
    )
    return replace(motion, shots=tuple(shots), outcome=_outcome(replay, motion.outcome))


def _outcome(replay: Replay, now: str) -> str:
    """Tell the outcome of the episode, and that of its repetition where it differs."""
    before = replay.failure or "success"
    if before == "failure" and now != "success":
        return now
    return before if before == now else f"{before}; run again without the errors of its condition: {now}"


def _config(kind: Any, given: Any) -> Any:
    return config_of(kind, given, kind.__name__) if isinstance(given, Mapping) else kind()


def _episode(replay: Replay, env: Any, hand: Hand, images: tuple[str, ...]) -> Motion:
    codec = Codec(replay.settings.get("control", "twist"), hand)
    period = spaces.tables(hand)["control_period"] * replay.settings.get("frame_skip", 1)
    columns = joint_columns(codec, hand, replay.settings.get("control", "twist"))
    samples: list[tuple[Floats, Floats, Floats]] = []
    shots: list[Shot] = []
    tactile, lift = [], []
    mesh = replay.spec().load()
    infos: list[Mapping[str, Any]] = []
    for step, (seen, info) in enumerate(replay.run(env)):
        infos.append(info)
        state = seen["state"]
        world_from_object = codec.pose(state, "object")
        # The pose that the arm measures may be off; this one is true.
        world_from_hand = world_from_object @ np.linalg.inv(codec.pose(state, "object_in_hand"))
        samples.append((world_from_hand, world_from_object, columns(state)))
        lift.append(float(codec.column(state, "lift")[0]))
        tactile.append(np.asarray(seen.get("tactile", ()), dtype=np.float64))
        shots += _shots(env, seen, step * period, images)
    hands, objects, joints = (np.array(column) for column in zip(*samples, strict=True))
    outcome = _outcome(replay, "success" if infos[-1]["is_success"] else str(infos[-1]["failure"]))
    time = period * np.arange(len(samples))
    poses = (_title(replay), hand, mesh, time, hands, objects, joints)
    at, forces = (np.arange(len(time)), np.array(tactile)) if tactile[0].size else nothing_felt()
    scalars = {"lift": np.array(lift)}
    if len(forces):
        scalars["tactile_sum"] = forces.sum(axis=1)
    mass = float(mesh.mass)
    return Motion(*poses, scalars, outcome, mass, at, forces, replay.probability, tuple(shots))
