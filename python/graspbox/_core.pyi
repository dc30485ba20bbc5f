"""Interface of the Rust core. Public functions of the package wrap everything here.

Arrays are float64 and C-contiguous unless they say otherwise; the ones returned are fresh. Configs are
dictionaries of numbers, text, lists and dictionaries.
"""

from collections.abc import Sequence
from os import PathLike
from typing import Any, NotRequired, TypeAlias, TypedDict, final, type_check_only

import numpy as np
from numpy.typing import NDArray
from typing_extensions import disjoint_base

__all__ = [
    "CLEAR_OF_TABLE",
    "MESH_SUFFIXES",
    "PACKED_ATTEMPTS",
    "REACH_REASONS",
    "REST_TIME",
    "Arm",
    "Client",
    "EnvPool",
    "EnvironmentListener",
    "Hand",
    "HandVolumes",
    "Job",
    "Listener",
    "Mesh",
    "Objects",
    "PolicyClient",
    "PolicyJob",
    "PolicyListener",
    "SettledScene",
    "__version__",
    "add_depth_noise",
    "arm_path",
    "arrange",
    "bin_walls",
    "camera_poses",
    "channel_names",
    "crops",
    "decompose",
    "describe_urdf",
    "env_tables",
    "goal_rewards",
    "image_kinds",
    "image_tables",
    "is_rigid",
    "load_binvox",
    "num_threads",
    "occupancies",
    "occupancy",
    "pictures",
    "pixel_groups",
    "pixel_heights",
    "plan",
    "poses_of_cameras",
    "procedural",
    "procedural_families",
    "rank_weights",
    "render",
    "render_scenes",
    "sampled_objects",
    "save_binvox",
    "solids",
    "urdf_meshes",
    "views",
    "voxelize",
]

_Config: TypeAlias = dict[str, Any]

__version__: str
#: Suffixes of mesh files that are read, in lower case.
MESH_SUFFIXES: tuple[str, ...]
#: Attempts to place objects in a packed scene.
PACKED_ATTEMPTS: int
#: Names of the members of `graspbox.arms.Reason`, in the order of their values.
REACH_REASONS: tuple[str, ...]
#: Once the object has risen this far, it counts as dropped if it is lost, not as slipped, m.
CLEAR_OF_TABLE: float
#: Time over which the speed of an object in the hand is measured, s.
REST_TIME: float

@type_check_only
class BoxArrays(TypedDict):
    center: NDArray[np.float64]
    axes: NDArray[np.float64]
    half_extents: NDArray[np.float64]
    children: NDArray[np.int64]
    depth: NDArray[np.int64]

@type_check_only
class PlanArrays(TypedDict):
    tree: BoxArrays
    world_from_object: NDArray[np.float64]
    poses: NDArray[np.float64]
    preshape: NDArray[np.float64]
    box: NDArray[np.int64]
    face: NDArray[np.int64]
    score: NDArray[np.float64]
    touch: NDArray[np.float64]
    press: NDArray[np.float64]
    feasible: NDArray[np.bool_]
    features: NotRequired[NDArray[np.float64]]

@type_check_only
class ForceArrays(TypedDict):
    """Of n grasps with m contacts in all.

    The rows of `motions` (n, 7, 2, 2) are six pulls and the lift: shift and turn since the start, then since the hand
    closed; `verdicts` (n, 7, 2) compares them with the limits. `contact_of` (m,) is the grasp of each contact, and
    `contacts` (m, 9) its link, point, normal into the link, force and friction.
    """

    start_depth: NDArray[np.float64]
    closed_depth: NDArray[np.float64]
    motions: NDArray[np.float64]
    verdicts: NDArray[np.bool_]
    time: NDArray[np.float64]
    contact_of: NDArray[np.int64]
    contacts: NDArray[np.float64]

@type_check_only
class OutcomeArrays(TypedDict):
    success: NDArray[np.bool_]
    secure: NDArray[np.bool_]
    legacy_success: NDArray[np.bool_]
    kindness: NDArray[np.float64]
    kindness_rate: NDArray[np.float64]
    survives_shake: NDArray[np.bool_]
    shake_shift: NDArray[np.float64]
    lift: NDArray[np.float64]
    time: NDArray[np.float64]
    unconverged_steps: NDArray[np.int64]
    failure: list[str]

@type_check_only
class EnvArrays(TypedDict):
    """One row per environment. Observations are float32 (rows, size), if the config names them.

    ``info`` holds an array per row of the core's table: bool, float64 or int64 (for ``str``, an index into names).
    """

    proprio: NotRequired[NDArray[np.float32]]
    tactile: NotRequired[NDArray[np.float32]]
    state: NotRequired[NDArray[np.float32]]
    terms: NDArray[np.float32]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    reset: NDArray[np.bool_]
    env: NDArray[np.int64]
    info: dict[str, NDArray[Any]]

@final
class Mesh:
    """A triangle mesh with a name and a mass, held in Rust: metres, kilograms, the frame of its file.

    Immutable; copies share it, and it is pickled by its arrays.
    """

    def __new__(
        cls,
        vertices: NDArray[np.float64],
        faces: NDArray[np.uint32],
        name: str,
        mass: float | None,
        cleaning: _Config | None,
        parts: Sequence[NDArray[np.float64]] | None,
        solid: bool = True,
    ) -> Mesh:
        """Not `solid`, it has the mass properties of its convex hull."""
    def __getnewargs__(
        self,
    ) -> tuple[NDArray[np.float64], NDArray[np.uint32], str, float | None, None, list[NDArray[np.float64]] | None]: ...
    def __copy__(self) -> Mesh: ...
    def __deepcopy__(self, _memo: object, /) -> Mesh: ...
    @staticmethod
    def load(
        path: str | PathLike[str],
        name: str,
        mass: float | None,
        options: _Config,
        cleaning: _Config | None,
        solid: bool = True,
    ) -> Mesh:
        """Read a file; `solid` as in the constructor."""
    @staticmethod
    def in_parts(
        vertices: NDArray[np.float64], faces: NDArray[np.uint32], name: str, mass: float, parts: _Config
    ) -> Mesh:
        """Make a mesh of a closed surface, in convex parts that are made with settings `parts`."""
    def scaled(self, scale: float, cache: str | PathLike[str] | None) -> Mesh:
        """Multiply every length by `scale`, at the same density."""
    @property
    def name(self) -> str:
        """Name of the object."""
    @property
    def vertices(self) -> NDArray[np.float64]:
        """Vertices (n, 3), metres: a fresh copy."""
    @property
    def faces(self) -> NDArray[np.uint32]:
        """Faces (m, 3) as indices of vertices, counter-clockwise seen from outside: a fresh copy."""
    @property
    def bounds(self) -> NDArray[np.float64]:
        """Least and greatest corner (2, 3) of the axis-aligned bounds, metres."""
    @property
    def area(self) -> float:
        """Surface area, m2."""
    @property
    def volume(self) -> float:
        """Volume that the mesh encloses, m3; that of its convex hull if it encloses hardly anything."""
    @property
    def mass(self) -> float:
        """Mass, kg: as given, else the volume times 400 kg/m3."""
    @property
    def center_of_mass(self) -> NDArray[np.float64]:
        """Centre of mass (3,), metres, for uniform density."""
    @property
    def inertia(self) -> NDArray[np.float64]:
        """Inertia tensor (3, 3) about the centre of mass, along the mesh's axes, kg m2."""
    @property
    def watertight(self) -> bool:
        """Whether every edge has exactly two faces, which agree on a side."""
    def sample(self, count: int, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Points (n, 3) and outward unit normals (n, 3) of the surface, uniform by area.

        `count` is at most 20 million. Same mesh, count and seed: same samples.
        """
    def resting_poses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Stable poses on a table, the most probable first: (n, 4, 4) `world_from_object`, and probabilities (n,)."""
    def least_width(self, world_from_object: NDArray[np.float64]) -> float:
        """Smallest distance of two vertical planes between which the object lies, metres.

        `world_from_object` is a pose (4, 4), metres; the z axis of the world is vertical.
        """

@final
class Arm:
    """An arm, held in Rust: immutable, pickled and compared by the text of its URDF and its ``arm.toml``.

    The flange frame is on the face that a hand is screwed to, z out of it; k is the number of joints that move it.
    """

    def __new__(
        cls, urdf: str, toml: str, names: tuple[str, str] | None = None, assumptions: Sequence[str] = ...
    ) -> Arm:
        """Read an arm from the text of its files; `names` are those of the files in errors.

        `assumptions` are those about the source of the URDF.
        """
    def __getnewargs__(self) -> tuple[str, str, tuple[str, str], list[str]]: ...
    def __copy__(self) -> Arm: ...
    def __deepcopy__(self, _memo: object, /) -> Arm: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    @staticmethod
    def named(name: str) -> Arm:
        """Take an arm that comes with the package."""
    @staticmethod
    def names() -> list[str]:
        """Names of the arms that come with the package."""
    @staticmethod
    def load(urdf: str | PathLike[str], toml: str | PathLike[str]) -> Arm: ...
    @property
    def name(self) -> str: ...
    @property
    def files(self) -> tuple[str, str]:
        """The text of its URDF and of its ``arm.toml``."""
    @property
    def assumptions(self) -> tuple[str, ...]:
        """What its URDF does not state and was assumed: a sentence each, with file, line and element."""
    @property
    def joints(self) -> list[str]:
        """Names of the k joints between base and flange."""
    @property
    def links(self) -> list[str]:
        """Names of the links, the base first."""
    @property
    def joint_limits(self) -> NDArray[np.float64]:
        """Least and greatest position of each joint, (k, 2), rad or m."""
    @property
    def speeds(self) -> NDArray[np.float64]:
        """Greatest speed of each joint, (k,), rad/s or m/s."""
    @property
    def accelerations(self) -> NDArray[np.float64]:
        """Greatest acceleration of each joint, (k,), rad/s2 or m/s2; inf where none is known."""
    @property
    def jerks(self) -> NDArray[np.float64]:
        """Greatest jerk of each joint, (k,), rad/s3 or m/s3; inf where none is known."""
    @property
    def slowing(self) -> NDArray[np.float64]:
        """Lower speeds near the ends of ranges, (k, 4), rad or m and s.

        At a distance d from the least position (column 0) or the greatest (1) a joint moves towards it by at most
        sqrt(rate d) - offset (columns 2 and 3); infinite positions where nothing is slowed.
        """
    @property
    def home(self) -> NDArray[np.float64]:
        """Positions of the joints at home, (k,), rad or m."""
    @property
    def payload(self) -> float:
        """Greatest mass at the flange, kg."""
    @property
    def reach_length(self) -> float:
        """Bound of the distance between a point of the first joint's axis and one of the last's, metres."""
    @property
    def touching_by_design(self) -> list[tuple[str, str]]:
        """Links that touch by design, beside neighbours: at home, or in nearly all postures."""
    def flange_from_base_of(self, hand: Hand) -> NDArray[np.float64]:
        """Pose of a hand's base link on the flange, (4, 4), as the files of both state it."""
    def flange_poses(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """``base_from_flange`` (n, 4, 4), with the joints at `positions` (n, k): forward kinematics."""
    def link_frames(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """``base_from_link`` (l, 4, 4), with the joints at `positions` (k,)."""
    def link_surfaces(self) -> list[tuple[int, NDArray[np.float64], NDArray[np.uint32]]]:
        """Surfaces of collision shapes: index of the link, vertices (n, 3) in its frame, metres, and faces (m, 3)."""
    def jacobian(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Jacobian of the flange in the base's frame, (6, k): velocity (m), then angular velocity, per rad or m."""
    def inverse(
        self, poses: NDArray[np.float64], params: _Config, num_threads: int | None = None
    ) -> dict[str, Any]: ...
    def reach(
        self,
        poses: NDArray[np.float64],
        preshapes: NDArray[np.float64],
        hand: Hand,
        world_from_base: NDArray[np.float64],
        mount: NDArray[np.float64] | None,
        points: NDArray[np.float64],
        objects: Sequence[tuple[Mesh, NDArray[np.float64]]],
        walls: Sequence[tuple[NDArray[np.float64], Sequence[float]]],
        params: _Config,
        cache: str | PathLike[str] | None,
        num_threads: int | None,
    ) -> dict[str, Any]: ...
    def on_arm(
        self,
        points: NDArray[np.float64],
        distances: NDArray[np.float64],
        positions: NDArray[np.float64],
        world_from_base: NDArray[np.float64],
        hand: Hand | None = None,
        mount: NDArray[np.float64] | None = None,
        num_threads: int | None = None,
    ) -> NDArray[np.bool_]: ...

@final
class Hand:
    """A hand, held in Rust: immutable, pickled and compared by the text of its URDF and its ``hand.toml``."""

    def __new__(
        cls, urdf: str, toml: str, names: tuple[str, str] | None = None, assumptions: Sequence[str] = ...
    ) -> Hand:
        """Read a hand from the text of its files; `names` are those of the files in errors.

        `assumptions` are those about the source of the URDF.
        """
    def __getnewargs__(self) -> tuple[str, str, tuple[str, str], list[str]]: ...
    def __copy__(self) -> Hand: ...
    def __deepcopy__(self, _memo: object, /) -> Hand: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    @staticmethod
    def named(name: str) -> Hand:
        """Take a hand that comes with the package."""
    @staticmethod
    def names() -> list[str]:
        """Names of the hands that come with the package."""
    @staticmethod
    def load(urdf: str | PathLike[str], toml: str | PathLike[str]) -> Hand: ...
    @property
    def name(self) -> str: ...
    @property
    def files(self) -> tuple[str, str]:
        """The text of its URDF and of its ``hand.toml``."""
    @property
    def assumptions(self) -> tuple[str, ...]:
        """What its URDF does not state and was assumed: a sentence each, with file, line and element."""
    @property
    def description(self) -> dict[str, Any]:
        """All that the files say, as plain values: see `graspbox.hands.description.HandDescription`."""
    @property
    def chains(self) -> list[str]:
        """Names of the chains of joints that leave the base (fingers, in most hands), each by its first link."""
    @property
    def joints(self) -> list[str]:
        """Names of the c independent joints, in the order of their positions."""
    @property
    def joint_chains(self) -> list[int]:
        """Index of the chain that each independent joint belongs to."""
    @property
    def joint_limits(self) -> NDArray[np.float64]:
        """Least and greatest position of each independent joint, (c, 2), rad or m."""
    @property
    def actuators(self) -> list[str]:
        """Names of the actuators, in the order of the file."""
    @property
    def tendons(self) -> list[str]:
        """Names of the tendons."""
    @property
    def closing_speeds(self) -> list[float]:
        """Speed at which a trial closes each actuator but the preshape's, rad/s or m/s; 0 for one that stays."""
    @property
    def preshape_limits(self) -> tuple[float, float]:
        """Least and greatest preshape: positions of the preshape's actuator, or numbers of named preshapes."""
    @property
    def preshape_unit(self) -> str:
        """``rad`` or ``m`` of the preshape's actuator, or ``1`` for the number of a name."""
    @property
    def preshapes(self) -> dict[str, float]:
        """The preshapes that the planner tries, by name."""
    @property
    def widest(self) -> float:
        """Width of the widest object that goes between the open fingers, metres; inf if a preshape states none."""
    @property
    def grasp_center(self) -> NDArray[np.float64]:
        """Grasp centre: (3,), hand frame, metres; between the fingers, in front of the palm."""
    def closing_center(self, preshape: float) -> NDArray[np.float64]:
        """Where the hand closes with `preshape`: (3,), hand frame, metres."""
    def open(self, preshape: float) -> NDArray[np.float64]:
        """Positions (c,) of the independent joints of the open hand, rad or m."""
    def open_positions(self, preshape: float) -> NDArray[np.float64]:
        """Positions (a,) of the actuators but the preshape's of the open hand, rad or m."""
    def closed(self, preshape: float, share: float) -> NDArray[np.float64]:
        """Positions (c,) of the independent joints of the hand, closed by a share of their way (0 to 1), rad or m."""
    def shapes(
        self, positions: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], NDArray[np.int64]]:
        """Collision shapes as boxes with the independent joints at `positions` (c,).

        ``hand_from_shape`` (n, 4, 4), half extents (n, 3), which are pads (n,), and the row of `joint_frames` of the
        joint that carries each, -1 for the palm (n,).
        """
    def link_frames(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Frames of the links of `description` with the independent joints at `positions` (c,): (l, 4, 4), metres."""
    def joint_frames(
        self, positions: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_]]:
        """Frames of all joints that move, chain by chain from root to tip, with the independent ones at `positions`.

        ``hand_from_joint`` (j, 4, 4) whose x axis is the joint's, the index of the chain of each (j,), and which are
        revolute (j,).
        """

@final
class SettledScene:
    """An object at rest on the table, held in Rust."""

    def __new__(
        cls,
        mesh: Mesh,
        hand: Hand,
        physics: _Config,
        world_from_object: NDArray[np.float64] | None,
        cache: str | PathLike[str] | None,
    ) -> SettledScene: ...
    @staticmethod
    def of_objects(
        meshes: Sequence[Mesh],
        world_from_objects: NDArray[np.float64],
        walls: Sequence[tuple[NDArray[np.float64], Sequence[float]]],
        target: int | None,
        hand: Hand,
        physics: _Config,
        cache: str | PathLike[str] | None,
    ) -> SettledScene: ...
    @property
    def name(self) -> str: ...
    @property
    def mesh(self) -> Mesh: ...
    @property
    def world_from_object(self) -> NDArray[np.float64]: ...
    @property
    def target(self) -> int: ...
    @property
    def world_from_others(self) -> NDArray[np.float64]: ...
    @property
    def center_of_mass(self) -> NDArray[np.float64]: ...
    def body(self) -> tuple[list[NDArray[np.float64]], float, NDArray[np.float64], NDArray[np.float64]]: ...
    def check(
        self,
        poses: NDArray[np.float64],
        preshape: NDArray[np.float64],
        clearance: float,
        standoff: float,
        num_threads: int | None,
    ) -> NDArray[np.bool_]:
        """Whether the open hand reaches each pose from `standoff` m behind, with `clearance` m to spare: (n,)."""
    def simulate(
        self,
        poses: NDArray[np.float64],
        preshape: NDArray[np.float64],
        factors: NDArray[np.float64],
        config: _Config,
        num_threads: int | None,
    ) -> OutcomeArrays:
        """Try every pose, with the object's friction and mass multiplied by `factors` (n, 2)."""
    def simulate_masses(
        self,
        poses: NDArray[np.float64],
        preshape: NDArray[np.float64],
        masses: NDArray[np.float64],
        config: _Config,
        num_threads: int | None,
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Try every pose with the object's mass multiplied by each of `masses` (k,): success and security, (n, k)."""
    def forces(
        self,
        poses: NDArray[np.float64],
        preshape: NDArray[np.float64],
        config: _Config,
        num_threads: int | None,
    ) -> ForceArrays:
        """Pull the object at every pose along and against each axis of the world, and lift it off the table."""
    def trace(
        self, pose: NDArray[np.float64], preshape: float, factors: Sequence[float], config: _Config
    ) -> tuple[OutcomeArrays, dict[str, NDArray[Any]]]:
        """Run a trial with factors on friction and mass; its samples are the fields of `graspbox.Trace` by name."""

@final
class Objects:
    """Objects that environments share; each is prepared ahead or at its first use."""

    def __new__(
        cls,
        sources: Sequence[Mesh | _Config],
        hand: Hand,
        physics: _Config,
        cache: str | PathLike[str] | None,
        arm: Arm | None = None,
        base: NDArray[np.float64] | None = None,
    ) -> Objects: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def world_from_arm(self) -> NDArray[np.float64] | None: ...
    def __len__(self) -> int: ...
    def prepare(self, indices: Sequence[int], model: bool, num_threads: int | None) -> None: ...

@final
class EnvPool:
    """Environments side by side, stepped in one call."""

    def __new__(cls, objects: Objects, config: _Config, num_envs: int, num_threads: int | None) -> EnvPool: ...
    @property
    def num_envs(self) -> int: ...
    def reset(
        self,
        seeds: Sequence[int | None] | None = None,
        mask: NDArray[np.bool_] | None = None,
        options: Sequence[_Config] | None = None,
        out: dict[str, NDArray[np.float32]] | None = None,
    ) -> EnvArrays: ...
    def step(
        self, actions: NDArray[np.float32], out: dict[str, NDArray[np.float32]] | None = None
    ) -> tuple[EnvArrays, EnvArrays | None]: ...
    def send(self, actions: NDArray[np.float32], envs: Sequence[int]) -> None: ...
    def recv(self, count: int) -> tuple[EnvArrays, EnvArrays | None]: ...
    def now(self) -> EnvArrays: ...
    def get_state(self, env: int) -> bytes: ...
    def set_state(self, env: int, state: bytes) -> EnvArrays: ...
    def poses(self) -> list[NDArray[np.float64]]: ...
    def scene(self, env: int) -> SceneArrays: ...

@disjoint_base
class Listener:
    """A server that listens."""

    @property
    def address(self) -> tuple[str, int]: ...
    @property
    def busy(self) -> bool: ...
    def metrics(self) -> str: ...
    def drain(self) -> None: ...
    def stop(self) -> None: ...

@final
class EnvironmentListener(Listener):
    """Environments for clients on other machines."""

    def __new__(cls, settings: _Config, offer: _Config) -> EnvironmentListener: ...
    def next_job(self, seconds: float) -> Job | None: ...

@final
class Job:
    """A request for environments."""

    @property
    def request(self) -> dict[str, Any]: ...
    def accept(
        self, pool: EnvPool, weights: Sequence[float], picture: _Config | None, description: _Config
    ) -> None: ...
    def refuse(self, kind: str, field: str, message: str) -> None: ...

@final
class Client:
    """A session on a server."""

    def __new__(cls, url: str, *, token: str | None, ca: str | None, grace: float) -> Client: ...
    @property
    def hello(self) -> dict[str, Any]: ...
    def submit(self, command: str, fields: dict[str, Any]) -> int: ...
    def poll(self, id: int) -> dict[str, Any] | None: ...
    def lost(self) -> float | None: ...
    def open_segment(self, name: str) -> None: ...
    def forget(self, id: int) -> None: ...
    def _break_off(self) -> None: ...

@final
class PolicyListener(Listener):
    """A policy for clients on other machines."""

    def __new__(cls, settings: _Config, metadata: _Config) -> PolicyListener: ...
    def next_jobs(self, most: int, seconds: float) -> list[PolicyJob]: ...
    def gone(self) -> list[int]: ...
    def decided(self, seconds: float) -> None: ...

@final
class PolicyJob:
    """A request for a decision."""

    @property
    def connection(self) -> int: ...
    @property
    def json(self) -> bool: ...
    @property
    def age(self) -> float: ...
    def body(self) -> bytes: ...
    def observation(self) -> Any: ...
    def answer(self, value: dict[str, Any]) -> None: ...
    def answer_json(self, text: str) -> None: ...
    def refuse(self, kind: str, field: str, message: str) -> None: ...

@final
class PolicyClient:
    """A connection to a policy server."""

    def __new__(cls, url: str, *, token: str | None, ca: str | None) -> PolicyClient: ...
    @property
    def metadata(self) -> Any: ...
    def send(self, observation: dict[str, Any]) -> None: ...
    def receive(self) -> Any: ...

def env_tables(hand: Hand, arm: Arm | None = None) -> Any: ...
def goal_rewards(
    achieved: NDArray[np.float32], desired: NDArray[np.float32], threshold: float
) -> NDArray[np.float32]: ...
def sampled_objects(seeds: Sequence[int], count: int) -> list[int]: ...
def decompose(mesh: Mesh, params: _Config) -> BoxArrays: ...
def plan(
    mesh: Mesh,
    hand: Hand,
    params: _Config,
    world_from_object: NDArray[np.float64] | None,
    cache: str | PathLike[str] | None,
    num_threads: int | None,
    features: bool,
    neighbours: Sequence[tuple[Mesh, NDArray[np.float64]]],
    walls: Sequence[tuple[NDArray[np.float64], Sequence[float]]],
) -> PlanArrays: ...
def describe_urdf(urdf: str, name: str, *, anyway: bool = False) -> list[dict[str, Any]] | None:
    """Links and joints of the text of a URDF, as in `Hand.description`; errors call the file `name`.

    With `anyway`, also where numbers are wrong, such as millimetres; None where there is no tree of links.
    """

def urdf_meshes(urdf: str, name: str) -> tuple[list[dict[str, Any]], list[tuple[int, str]]]:
    """Collision meshes of the text of a URDF, and the names that shapes beside them need.

    A mesh has ``name``, ``line``, ``file``, ``scale``, ``link_from_mesh``, and its ``element`` from byte ``start`` to
    ``end``. A name is inserted at a byte, as an attribute.
    """

def is_rigid(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of `poses` (n, 4, 4) the core takes for rigid motions: flags (n,)."""

def rank_weights(hand: Hand) -> list[tuple[str, float]]: ...
def procedural(family_name: str, seed: int, scale: float, mass: float | None) -> Mesh: ...
def procedural_families() -> list[str]: ...
def voxelize(
    mesh: Mesh, resolution: int, mode: str, down: int, remove_internal: bool, exact: bool
) -> tuple[tuple[NDArray[np.bool_], NDArray[np.float64], float], str | None]: ...
def load_binvox(path: str | PathLike[str]) -> tuple[NDArray[np.bool_], NDArray[np.float64], float]: ...
def save_binvox(
    path: str | PathLike[str], occupancy: NDArray[np.bool_], origin: NDArray[np.float64], voxel_size: float
) -> None: ...
def arm_path(
    arm: Arm,
    poses: NDArray[np.float64],
    preshapes: NDArray[np.float64],
    hand: Hand,
    start: NDArray[np.float64],
    accelerations: NDArray[np.float64],
    world_from_base: NDArray[np.float64],
    mount: NDArray[np.float64] | None,
    points: NDArray[np.float64],
    objects: Sequence[tuple[Mesh, NDArray[np.float64]]],
    walls: Sequence[tuple[NDArray[np.float64], tuple[float, float, float]]],
    thing: tuple[Mesh, NDArray[np.float64]] | None,
    place: NDArray[np.float64] | None,
    params: _Config,
    cache: str | PathLike[str] | None,
    num_threads: int | None,
) -> dict[str, Any]:
    """Plan the path to the first of the grasps `poses`, (n, 4, 4) world_from_hand, that has one.

    ``grasp`` is its index, -1 without one; ``pieces`` are tuples of phase, postures (m, k) and, for straight lines of
    the hand, the distances (m,) of the postures; ``failures`` are tuples of phase, code and sentence, one per grasp
    before it. `params` is a `graspbox.PathConfig`.
    """

def num_threads(requested: int | None = None) -> int: ...

@type_check_only
class ViewArrays(TypedDict):
    depth: NDArray[np.float32]
    rgb: NotRequired[NDArray[np.uint8]]
    segmentation: NotRequired[NDArray[np.uint8]]
    intrinsics: NDArray[np.float64]
    world_from_camera: NDArray[np.float64]
    camera_from_object: NDArray[np.float64]

def render(
    meshes: Sequence[Mesh],
    world_from_mesh: NDArray[np.float64],
    colors: NDArray[np.float64],
    casts_shadow: Sequence[bool],
    hand: tuple[Hand, NDArray[np.float64], NDArray[np.float64]] | None,
    intrinsics: NDArray[np.float64],
    world_from_camera: NDArray[np.float64],
    config: _Config,
    num_threads: int | None,
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Render meshes and a hand: picture (H, W, 3), depth (H, W) in metres along the optical axis, 0 where nothing is.

    `world_from_mesh` is (n, 4, 4), `colors` (n, 3) in [0, 1]; `hand` is a hand, its `world_from_hand` (4, 4), and
    the positions (c,) of its independent joints, rad or m. Camera frames have x right, y down, z forward.
    """

def image_kinds() -> list[str]: ...
def image_tables(hand: Hand, cameras: _Config, objects: int = 1, arm: Arm | None = None) -> Any: ...
def pictures(pool: EnvPool, envs: Sequence[int], picture: _Config) -> NDArray[np.uint8]: ...
def poses_of_cameras(pool: EnvPool) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]: ...
def views(
    mesh: Mesh,
    viewpoints: _Config,
    config: _Config,
    world_from_object: NDArray[np.float64] | None,
    target: NDArray[np.float64] | None,
    num_threads: int | None,
    neighbours: Sequence[tuple[Mesh, NDArray[np.float64]]],
    walls: Sequence[tuple[NDArray[np.float64], Sequence[float]]],
) -> ViewArrays: ...

@type_check_only
class WallArrays(TypedDict):
    world_from_walls: NDArray[np.float64]
    wall_half_extents: NDArray[np.float64]

@type_check_only
class ArrangementArrays(WallArrays):
    objects: NDArray[np.int64]
    world_from_objects: NDArray[np.float64]

@type_check_only
class SceneArrays(ArrangementArrays):
    meshes: list[Mesh]
    target: int | None

def arrange(
    meshes: Sequence[Mesh],
    most: int | None,
    spread: float,
    hand: Hand,
    layout: _Config,
    physics: _Config,
    seed: int,
    cache: str | PathLike[str] | None,
) -> ArrangementArrays:
    """Let meshes come to rest in a layout: those that stayed (k,), their poses (k, 4, 4), and the walls."""

def bin_walls(inside: Sequence[float]) -> WallArrays:
    """Place the walls of a bin: poses (4, 4, 4) and half extents (4, 3), metres."""

@type_check_only
class SceneImageArrays(TypedDict):
    depth: NDArray[np.float32]
    rgb: NotRequired[NDArray[np.uint8]]
    segmentation: NotRequired[NDArray[np.uint8]]

def render_scenes(
    meshes: Sequence[Mesh],
    meshes_of: Sequence[Sequence[int]],
    world_from_objects: NDArray[np.float64],
    walls: Sequence[Sequence[tuple[NDArray[np.float64], Sequence[float]]]],
    world_from_camera: NDArray[np.float64],
    config: _Config,
    num_threads: int | None,
) -> SceneImageArrays:
    """Render n images, each of the meshes with the indices `meshes_of`, and of walls.

    `world_from_objects` (m, 4, 4) are the poses of all of them, one image after the other.
    """

def camera_poses(plan: _Config, target: Sequence[float], count: int, seed: int) -> NDArray[np.float64]:
    """Where the cameras of a plan stand around `target` (3,): ``world_from_camera`` (count, 4, 4)."""

def occupancies(
    depth: NDArray[np.float32],
    intrinsics: NDArray[np.float64],
    frame_from_camera: NDArray[np.float64],
    resolution: int,
    origin: Sequence[float],
    side: float,
    far: float,
    nothing_is_free: bool,
    num_threads: int | None,
) -> NDArray[np.uint8]:
    """Fuse the V images of each of n scenes, (n, V, H, W), into voxels (n, N, N, N); poses are (n V, 4, 4)."""

def occupancy(
    depth: NDArray[np.float32],
    intrinsics: NDArray[np.float64],
    frame_from_camera: NDArray[np.float64],
    resolution: int,
    origin: NDArray[np.float64],
    side: float,
    far: float,
    nothing_is_free: bool,
) -> NDArray[np.uint8]: ...

@type_check_only
class CropArrays(TypedDict):
    world_from_crop: NDArray[np.float64]
    found: NDArray[np.bool_]
    object: NDArray[np.bool_]
    channels: NDArray[np.uint8]

@type_check_only
class ProposalArrays(TypedDict):
    poses: NDArray[np.float64]
    preshape: NDArray[np.float64]
    source: list[str]

def channel_names() -> tuple[list[str], list[str]]:
    """Names of the channels of crops, and of those around a hand."""

def add_depth_noise(
    depth: NDArray[np.float32],
    intrinsics: NDArray[np.float64],
    seeds: Sequence[int],
    noise: _Config,
    num_threads: int | None,
) -> NDArray[np.uint16]: ...
def crops(
    depth: NDArray[np.float32],
    intrinsics: NDArray[np.float64],
    world_from_camera: NDArray[np.float64],
    marked: tuple[NDArray[np.bool_] | None, NDArray[np.bool_] | None],
    crop: _Config,
    num_threads: int | None,
) -> CropArrays: ...
def pixel_heights(
    depth: NDArray[np.float32], intrinsics: NDArray[np.float64], world_from_camera: NDArray[np.float64]
) -> NDArray[np.float32]: ...
def pixel_groups(
    depth: NDArray[np.float32],
    intrinsics: NDArray[np.float64],
    world_from_camera: NDArray[np.float64],
    chosen: NDArray[np.bool_],
    gap: float,
) -> NDArray[np.uint32]: ...
def solids(
    meshes: Sequence[Mesh],
    mesh_of: Sequence[int],
    crop_from_object: NDArray[np.float64],
    crop: _Config,
    num_threads: int | None,
) -> NDArray[np.uint8]: ...

@final
class HandVolumes:
    """A hand, prepared for perception."""

    def __new__(cls, hand: Hand, config: _Config) -> HandVolumes: ...
    @property
    def shape(self) -> list[int]: ...
    @property
    def origin(self) -> NDArray[np.float64]: ...
    @property
    def cell(self) -> float: ...
    @property
    def preshapes(self) -> NDArray[np.float64]: ...
    @property
    def swept(self) -> NDArray[np.uint8]: ...
    def nearest(self, preshape: NDArray[np.float64]) -> NDArray[np.int64]: ...
    def propose(
        self,
        occupancy: NDArray[np.uint8],
        crop: _Config,
        config: _Config,
        whole: NDArray[np.uint8] | None,
        obstacles: NDArray[np.float64],
        num_threads: int | None,
    ) -> ProposalArrays: ...
    def meets(
        self,
        occupancy: NDArray[np.uint8],
        crop: _Config,
        points: int,
        obstacles: NDArray[np.float64],
        poses: NDArray[np.float64],
        preshape: NDArray[np.float64],
        num_threads: int | None,
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]: ...
    def levers(
        self,
        occupancy: NDArray[np.uint8],
        crop: _Config,
        poses: NDArray[np.float64],
        preshape: NDArray[np.float64],
        num_threads: int | None,
    ) -> NDArray[np.float64]: ...
    def crops(
        self,
        channels: NDArray[np.uint8],
        crop: _Config,
        crop_of: Sequence[int],
        poses: NDArray[np.float64],
        num_threads: int | None,
    ) -> NDArray[np.uint8]: ...
