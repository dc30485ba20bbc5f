"""Example grasps of DexGraspBench, judged in a checkout of it by its own protocol, hand and objects.

Nothing of the checkout is part of graspbox. The hand's meshes are those of MuJoCo Menagerie, which is a submodule of
the benchmark; its README says how to get it.

The hand hangs on a weld that follows prescribed postures: pregrasp, grasp, squeeze, each reached in ten steps of 40 ms.
Then a force pulls the object for two seconds, looked at every 0.2 s, and the first loss ends the trial. Source:
JYChen18/DexGraspBench, ``config`` and ``src``; the numbers here are those of its files.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

import mujoco
import numpy as np
import yaml
from numpy.typing import NDArray

from graspbox.errors import ConfigError, FileError
from validation.forces.config import PULLS
from validation.versions import MUJOCO_VERSION

__all__ = ["Checkout", "ExampleReport", "ExampleRow", "judge_examples"]

Array = NDArray[np.float64]

#: Folder of the example grasps, and where the benchmark writes what it finds.
EXAMPLES = "output/example_shadow"
_HAND, _PREFIX = "assets/hand/shadow/right_hand.xml", "hand_"
_MENAGERIE = "third_party/mujoco_menagerie"
#: Settings of the simulation: time step (s), contacts of the hand, and the weld by which it is moved.
_STEP, _SOLREF, _SOLIMP = 0.004, [0.005, 1.0], [0.5, 0.99, 0.0001]
_WELD = [0.9, 0.95, 0.001, 0.5, 2.0]
#: Postures of a grasp, in their order.
_STAGES = ("pregrasp", "grasp", "squeeze")
#: Steps of a motion from one posture to the next, and of the simulation in each of them.
_MOVES, _INNER = 10, 10
#: Looks at the object during a pull, and steps of the simulation between them.
_LOOKS, _BETWEEN = 10, 50


@dataclass(frozen=True)
class ExampleRow:
    """One example grasp.

    Attributes
    ----------
    file : str
        Its file, below the folder of the grasps.
    passes : bool
        No pull moved the object beyond the limits.
    shift, turn : float
        Motion of the object's frame since the start when the trial ended, metres and degrees; NaN if hand and object,
        or two links, overlapped too much at the start.
    depth : float
        Greatest overlap of hand and object at the grasp posture, metres.
    stored : bool or None
        The benchmark's own verdict, where the checkout has its evaluation.
    """

    file: str
    passes: bool
    shift: float
    turn: float
    depth: float
    stored: bool | None


@dataclass(frozen=True)
class ExampleReport:
    """All example grasps of a checkout.

    Attributes
    ----------
    rows : list of ExampleRow
        In the order of their files.
    """

    rows: list[ExampleRow]

    @property
    def passed(self) -> int:
        """Number of grasps that pass."""
        return sum(row.passes for row in self.rows)

    @property
    def compared(self) -> list[ExampleRow]:
        """The rows whose verdict the checkout knows."""
        return [row for row in self.rows if row.stored is not None]

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        compared = self.compared
        return {
            "mujoco_version": MUJOCO_VERSION,
            "grasps": len(self.rows),
            "passed": self.passed,
            "compared": len(compared),
            "equal": sum(row.passes == row.stored for row in compared),
            "rows": [{k: None if v != v else v for k, v in asdict(row).items()} for row in self.rows],
        }


class Checkout:
    """A checkout of the benchmark.

    Parameters
    ----------
    root : Path
        Its folder.

    Raises
    ------
    FileError
        If it lacks a file: the message names it and where to get it.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        settings = self._yaml("config/task/eval.yaml")
        try:
            limits = settings["simulation_metrics"]
            self.mass, self.friction = float(settings["obj_mass"]), [float(x) for x in settings["miu_coef"]]
            self.max_shift, self.max_turn = float(limits["trans_thre"]), float(limits["angle_thre"])
            self.max_depth = float(limits["max_pene"])
        except (KeyError, TypeError, ValueError) as error:
            raise FileError(f"{root / 'config/task/eval.yaml'} lacks a setting, or it is no number: {error}") from None
        self.grasps = sorted((root / EXAMPLES / "graspdata").rglob("*.npy"))
        if not self.grasps:
            raise FileError(f"{root / EXAMPLES / 'graspdata'} holds no .npy file; give a checkout of DexGraspBench")
        self._check_meshes()

    def _path(self, name: str, where: str = "give a checkout of github.com/JYChen18/DexGraspBench") -> Path:
        path = self.root / name
        if not path.exists():
            raise FileError(f"{path} does not exist; {where}")
        return path

    def _yaml(self, name: str) -> dict[str, Any]:
        try:
            content: dict[str, Any] = yaml.safe_load(self._path(name).read_text())
        except yaml.YAMLError as error:
            raise FileError(f"{self.root / name} cannot be read: {error}") from None
        return content

    def _check_meshes(self) -> None:
        spec = mujoco.MjSpec.from_file(str(self._path(_HAND)))
        where = f"its README gets {_MENAGERIE} with `git submodule update --init --recursive --progress`"
        for mesh in spec.meshes:
            self._path(str(Path(_HAND).parent / spec.meshdir / mesh.file), where)

    def fields(self, file: Path) -> dict[str, Any]:
        """Read a grasp.

        Raises
        ------
        FileError
            If its object is not in the checkout.
        ConfigError
            If it is no file of the benchmark.
        """
        fields = _fields(file)
        for name in ("obj_path", "obj_pose", "obj_scale", *(f"{stage}_qpos" for stage in _STAGES)):
            if name not in fields:
                raise ConfigError(f"{file} has no entry {name!r}; give a file of DexGraspBench")
        self._path(str(fields["obj_path"]), "its README, section Object Preparation, says where to download objects")
        return fields

    def stored(self, file: Path) -> bool | None:
        """Return the benchmark's verdict on a grasp; None where the checkout has no evaluation of it."""
        path = self.root / EXAMPLES / "evaluation" / file.relative_to(self.root / EXAMPLES / "graspdata")
        return bool(np.asarray(_fields(path)["succ_flag"]).item()) if path.exists() else None

    def model(self, fields: dict[str, Any]) -> mujoco.MjModel:
        """Compile the hand on its weld, and the object."""
        spec = mujoco.MjSpec()
        spec.option.timestep, spec.option.integrator = _STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_GRAVITY
        spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0
        spec.option.noslip_iterations = 2
        spec.meshdir = str(self.root.resolve())
        self._add_hand(spec)
        self._add_object(spec, self.root / str(fields["obj_path"]), float(fields["obj_scale"]))
        for geom in spec.geoms:
            geom.friction[:2], geom.condim = self.friction, 4
        return spec.compile()

    def _add_hand(self, spec: Any) -> None:
        folder = (self.root / _HAND).parent.resolve()
        hand = mujoco.MjSpec.from_file(str(folder / Path(_HAND).name))
        for mesh in hand.meshes:
            mesh.file = str(folder / hand.meshdir / mesh.file)
        hand.meshdir = spec.meshdir
        for geom in hand.geoms:
            geom.solref[:2], geom.solimp[:3] = _SOLREF, _SOLIMP
        base = spec.worldbody.add_frame().attach_body(hand.worldbody, _PREFIX, "")
        base.add_freejoint(name="hand")
        spec.worldbody.add_body(name="guide", mocap=True)
        weld = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY)
        weld.name1, weld.name2, weld.solimp = "guide", base.name, _WELD
        # The hand's base is at the guide: no offset, the identity, and the weight of rotations.
        weld.data[:11] = [0.0] * 10 + [1.0]

    def _add_object(self, spec: Any, folder: Path, scale: float) -> None:
        facts = json.loads((folder / "info" / "simplified.json").read_text())
        density = self.mass * facts["density"] / facts["mass"] * (facts["scale"] / scale) ** 3
        body = spec.worldbody.add_body(name="object")
        body.add_freejoint(name="object")
        for index, part in enumerate(sorted((folder / "urdf" / "meshes").iterdir())):
            spec.add_mesh(name=f"part_{index}", file=str(part.resolve()), scale=[scale] * 3)
            shape = body.add_geom(name=f"part_{index}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"part_{index}")
            shape.density = density


class _Trial:
    """One grasp in MuJoCo."""

    def __init__(self, checkout: Checkout, fields: dict[str, Any]) -> None:
        self.checkout, self.model = checkout, checkout.model(fields)
        self.data = mujoco.MjData(self.model)
        self.object = self.model.body("object").id
        self.is_object = self.model.geom_bodyid == self.object
        self.postures = [np.asarray(fields[f"{name}_qpos"], float) for name in _STAGES]
        self.pose = np.asarray(fields["obj_pose"], float)
        for name, posture in zip(_STAGES, self.postures, strict=True):
            if posture.shape != (self.model.nq - 7,):
                raise ConfigError(f"{name}_qpos has {posture.size} numbers; the hand needs {self.model.nq - 7}")
        if self.pose.shape != (7,):
            raise ConfigError(f"obj_pose has {self.pose.size} numbers; give 7, position and quaternion")
        self.place(self.postures[0])
        moments = np.zeros((self.model.nu, self.model.nv))
        data = self.data
        mujoco.mju_sparse2dense(
            moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
        )
        #: From positions of the joints to commands of the actuators.
        self.commands = moments[:, 6:-6]

    def place(self, posture: Array) -> None:
        """Put hand and object at rest."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = np.concatenate([posture, self.pose])
        self.data.mocap_pos[0], self.data.mocap_quat[0] = posture[:3], posture[3:7]
        mujoco.mj_forward(self.model, self.data)

    def depths(self, posture: Array) -> tuple[float, float]:
        """Return the greatest overlap of hand and object, and of two links, at a posture, metres."""
        self.place(posture)
        deepest = [0.0, 0.0]
        for contact in self.data.contact:
            own = not self.is_object[contact.geom].any()
            deepest[own] = max(deepest[own], -float(contact.dist))
        return deepest[0], deepest[1]

    def move(self, start: Array, end: Array) -> None:
        """Move from one posture to the next."""
        turn = np.zeros(3)
        mujoco.mju_subQuat(turn, end[3:7] / np.linalg.norm(end[3:7]), start[3:7] / np.linalg.norm(start[3:7]))
        for share in np.linspace(0.0, 1.0, _MOVES + 1)[1:]:
            quaternion = start[3:7] / np.linalg.norm(start[3:7])
            mujoco.mju_quatIntegrate(quaternion, turn, float(share))
            self.data.mocap_pos[0] = start[:3] + share * (end[:3] - start[:3])
            self.data.mocap_quat[0] = quaternion
            self.data.ctrl[:] = self.commands @ (start[7:] + share * (end[7:] - start[7:]))
            mujoco.mj_step(self.model, self.data, nstep=_INNER)

    def moved(self) -> tuple[float, float]:
        """Return the motion of the object since the start, metres and degrees."""
        now, turn = self.data.qpos[-7:], np.zeros(3)
        mujoco.mju_subQuat(turn, now[3:7], self.pose[3:7] / np.linalg.norm(self.pose[3:7]))
        return float(np.linalg.norm(now[:3] - self.pose[:3])), float(np.degrees(np.linalg.norm(turn)))

    def judge(self) -> tuple[bool, float, float]:
        """Run the protocol; returns the verdict and the motion at its end."""
        checkout = self.checkout
        if max(self.depths(self.postures[0])) > checkout.max_depth:
            return False, float("nan"), float("nan")
        for pull in PULLS:
            self.place(self.postures[0])
            self.data.ctrl[:] = self.commands @ self.postures[0][7:]
            for start, end in zip(self.postures, self.postures[1:], strict=False):
                self.move(start, end)
            self.data.xfrc_applied[self.object, :3] = 10.0 * checkout.mass * pull
            for _ in range(_LOOKS):
                mujoco.mj_step(self.model, self.data, nstep=_BETWEEN)
                shift, turn = self.moved()
                if not (shift < checkout.max_shift and turn < checkout.max_turn):
                    return False, shift, turn
        return True, shift, turn


def judge_examples(
    checkout: Checkout,
    threads: int = 1,
    files: Sequence[Path] | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> ExampleReport:
    """Judge the example grasps.

    Parameters
    ----------
    checkout : Checkout
        The benchmark.
    threads : int
        Number of threads.
    files : sequence of Path, optional
        Grasps below the checkout's folder of examples; by default all.
    progress : callable
        Called with the number of grasps that are judged.

    Raises
    ------
    FileError
        If an object is missing.
    ConfigError
        If a file is not one of the benchmark.
    """

    def one(file: Path) -> ExampleRow:
        trial = _Trial(checkout, checkout.fields(file))
        depth, _ = trial.depths(trial.postures[1])
        name = str(file.relative_to(checkout.root / EXAMPLES / "graspdata"))
        return ExampleRow(name, *trial.judge(), depth, checkout.stored(file))

    rows: list[ExampleRow] = []
    with ThreadPoolExecutor(threads) as pool:
        for row in pool.map(one, checkout.grasps if files is None else files):
            rows.append(row)
            progress(len(rows))
    return ExampleReport(rows)


def _fields(path: Path) -> dict[str, Any]:
    """Read the entries of a file of the checkout, which must be trusted: it is a pickle.

    Raises
    ------
    ConfigError
        If it has other contents.
    """
    try:
        fields = np.load(path, allow_pickle=True).item()
    except (ValueError, EOFError, UnpicklingError) as error:
        raise ConfigError(f"{path} is not a file of DexGraspBench: {error}") from None
    if not isinstance(fields, dict):
        raise ConfigError(f"{path} holds no dict of names and arrays; give a checkout of DexGraspBench")
    return fields
