"""The tools: functions from checked arguments to answers."""

import io
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.imports import imported
from graspbox.captures import Capture, read_capture
from graspbox.configs import DecomposeConfig, ShakeConfig, TrialConfig
from graspbox.errors import ConfigError
from graspbox.perception import real
from graspbox.perception.depth_images import intrinsics_of
from graspbox.perception.perturbations import PoseNoise
from graspbox.planning import plan as plan_grasps
from graspbox.planning.plan_files import grasp_rows
from graspbox.policies.grasp_image import ImageGrasper, ImageGrasps
from graspbox.simulation import Scene
from graspbox.simulation.outcomes import Outcomes
from graspbox.tools.mcp.arguments import GraspImageArguments, LookArguments, PlanArguments, SimulateArguments, SomeGrasp
from graspbox.tools.mcp.settings import MAX_PIXELS
from graspbox.tools.mcp.workspace import CAMERA_SUFFIXES, MARK_SUFFIXES, Workspace

__all__ = ["TOOLS", "Answer", "Tool", "grasp_image", "look", "plan", "simulate"]

#: Colour of objects, that of the other pictures.
_COLOR = "#d8b78c"


@dataclass(frozen=True)
class Answer:
    """Answer of a tool: JSON values, null where nothing was measured, and PNG files."""

    content: dict[str, Any]
    pictures: tuple[bytes, ...] = ()


def _pictures() -> Any:
    return imported("graspbox.pictures", "pictures need matplotlib, from the extra 'cli'", "cli")


def _drawn(save: Callable[[Path], None]) -> bytes:
    """Return the picture that a function writes into a file."""
    with TemporaryDirectory(prefix="graspbox-") as folder:
        path = Path(folder) / "picture.png"
        save(path)
        return path.read_bytes()


def plan(workspace: Workspace, arguments: PlanArguments) -> Answer:
    """Cut an object into boxes and rank poses of the hand that do not collide."""
    spec, hand = workspace.object(arguments), workspace.hand(arguments.hand)
    mesh = spec.load()
    rest = Scene(mesh, hand=hand).world_from_object if arguments.settle else None
    ranked = plan_grasps(
        mesh,
        hand=hand,
        seed=arguments.seed,
        world_from_object=rest,
        decompose=DecomposeConfig(fit=arguments.fit, max_boxes=arguments.max_boxes),
        num_threads=workspace.settings.threads,
    )
    boxes = [
        {"center": box.center.tolist(), "axes": box.axes.tolist(), "half_extents": box.half_extents.tolist()}
        for box in ranked.tree
    ]
    content = {
        "name": ranked.name,
        "hand": ranked.hand_name,
        "world_from_object": ranked.world_from_object.tolist(),
        "boxes": boxes,
        "poses": len(ranked),
        "feasible": int(ranked.feasible.sum()),
        "grasps": grasp_rows(ranked.best(arguments.count)),
    }
    if not arguments.picture:
        return Answer(content)
    return Answer(content, (_drawn(lambda path: _pictures().save_plan(path, mesh, ranked, hand=hand)),))


def simulate(workspace: Workspace, arguments: SimulateArguments) -> Answer:
    """Try grasps of an object at rest; the picture shows the first success, else the first feasible grasp."""
    spec, hand = workspace.object(arguments), workspace.hand(arguments.hand)
    scene = Scene(spec.load(), hand=hand)
    threads = workspace.settings.threads
    trial = TrialConfig(shake=ShakeConfig() if arguments.shake else None)
    if arguments.grasps is None:
        planned = plan_grasps(
            scene.mesh, hand=hand, seed=arguments.seed, world_from_object=scene.world_from_object, num_threads=threads
        ).best(arguments.count)
        poses, preshape = planned.poses, planned.preshape
    else:
        poses, preshape = _arrays(arguments.grasps)
    outcomes = scene.simulate(poses, preshape, config=trial, num_threads=threads)
    content = {
        "name": scene.name,
        "hand": hand,
        "world_from_object": scene.world_from_object.tolist(),
        "tried": len(outcomes),
        "succeeded": int(outcomes.success.sum()),
        "secure": int(outcomes.secure.sum()),
        "shown": None,
        "grasps": _rows(poses, preshape, outcomes),
    }
    possible = np.flatnonzero(outcomes.failure != "infeasible")
    if not arguments.picture or not len(possible):
        return Answer(content)
    won = np.flatnonzero(outcomes.success)
    shown = int((won if len(won) else possible)[0])
    picture = _stages(scene, poses, preshape, shown)
    return Answer({**content, "shown": shown}, (picture,))


def _arrays(grasps: list[SomeGrasp]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return poses (n, 4, 4) and preshapes (n,)."""
    return np.array([one.object_from_hand for one in grasps]), np.array([one.preshape for one in grasps])


def _rows(poses: NDArray[np.float64], preshape: NDArray[np.float64], outcomes: Outcomes) -> list[dict[str, Any]]:
    """Return grasps with their outcomes, in order; null for NaN."""
    rows = []
    for pose, angle, outcome in zip(poses, preshape, outcomes, strict=True):
        facts = {
            key: None if isinstance(value, float) and math.isnan(value) else value
            for key, value in vars(outcome).items()
        }
        rows.append({"object_from_hand": pose.tolist(), "preshape": float(angle), **facts})
    return rows


def _stages(scene: Scene, poses: NDArray[np.float64], preshape: NDArray[np.float64], index: int) -> bytes:
    """Show the stages of one trial."""
    pictures = _pictures()
    outcome, trace = scene.trace(poses[index], float(preshape[index]))
    trial = pictures.Trial(index, float(preshape[index]), outcome, trace)
    return _drawn(lambda path: pictures.save_stages(path, scene, [trial]))


def look(workspace: Workspace, arguments: LookArguments) -> Answer:
    """Show an object at rest on the table, with the open hand at a grasp if the call has one."""
    spec, hand = workspace.object(arguments), workspace.hand(arguments.hand)
    scene = Scene(spec.load(), hand=hand)
    mesh, rest = scene.mesh, scene.world_from_object
    pictures = _pictures()
    points = mesh.vertices @ rest[:3, :3].T + rest[:3, 3]
    posed, free, shown, camera = None, None, points, pictures.Camera(elevation=arguments.elevation)
    if arguments.grasp is not None:
        poses, preshape = _arrays([arguments.grasp])
        # The check also refuses poses that are no rigid motions.
        free = bool(scene.check(poses, preshape, clearance=0.0)[0])
        posed = pictures.PosedHand.open(scene.hand, rest @ poses[0], float(preshape[0]))
        shown = np.concatenate([points, posed.corners()])
        camera = pictures.Camera.across(posed.world_from_hand[:3, 2], elevation=arguments.elevation)
    if arguments.azimuth is not None:
        camera = replace(camera, azimuth=arguments.azimuth)
    size = (arguments.width, arguments.height)
    solid = pictures.Solid(mesh, _COLOR, rest)
    view = pictures.View([solid], camera, shown=shown, size=size, hand=posed, table=points)
    content = {
        "name": scene.name,
        "mass": mesh.mass,
        "volume": mesh.volume,
        "watertight": mesh.watertight,
        "size": np.ptp(points, axis=0).tolist(),
        "world_from_object": rest.tolist(),
        "center_of_mass": (rest[:3, :3] @ scene.center_of_mass + rest[:3, 3]).tolist(),
        "hand": hand,
        "preshapes": scene.hand.preshapes,
        "preshape_unit": scene.hand.preshape_unit,
        "grasp_is_free": free,
        "intrinsics": view.lens.intrinsics.tolist(),
        "world_from_camera": view.lens.world_from_camera.tolist(),
    }
    return Answer(content, (_png(view.image),))


def _png(image: NDArray[np.uint8]) -> bytes:
    """Write an image (H, W, 3) as PNG."""
    pillow = imported("PIL.Image", "PNG files need Pillow, from the extra 'cli'", "cli")
    packed = io.BytesIO()
    pillow.fromarray(image).save(packed, format="png", optimize=True)
    return packed.getvalue()


@cache
def _grasper(policy: str, threads: int | None) -> ImageGrasper:
    """Load the networks of a policy once per process."""
    return ImageGrasper(policy, num_threads=threads)


def _capture(workspace: Workspace, arguments: GraspImageArguments) -> Capture:
    """Read the depth image that a call names, with its intrinsics and labels."""
    if arguments.intrinsics is not None and arguments.camera_info is not None:
        raise ConfigError("intrinsics and camera_info both state the intrinsics; pass one of them")
    if arguments.label is not None and arguments.labels is None:
        raise ConfigError("label chooses a thing of labels; pass both")
    if arguments.all and (arguments.mask is not None or arguments.label is not None):
        raise ConfigError("all asks for every thing, mask and label for one; leave either out")
    lens: NDArray[np.float64] | Path | None = None
    if arguments.intrinsics is not None:
        lens = intrinsics_of(*arguments.intrinsics)
    if arguments.camera_info is not None:
        lens = workspace.file(arguments.camera_info, CAMERA_SUFFIXES, "file of intrinsics")
    mask, labels = (
        None if name is None else workspace.file(name, MARK_SUFFIXES, kind)
        for name, kind in ((arguments.mask, "mask"), (arguments.labels, "image of labels"))
    )
    seen = read_capture(
        workspace.capture(arguments.depth),
        intrinsics=lens,
        depth_scale=arguments.depth_scale,
        depth_is=arguments.depth_is,
        mask=mask,
        labels=labels,
        topic=arguments.topic,
        time=arguments.time,
    )
    if seen.depth.size > MAX_PIXELS:
        raise ConfigError(
            f"{arguments.depth[:100]} has more than {MAX_PIXELS} pixels; pass a smaller image, with its own intrinsics"
        )
    return seen


def grasp_image(workspace: Workspace, arguments: GraspImageArguments) -> Answer:
    """Find grasps of the object, or of every thing, in a depth image of the folder."""
    seen = _capture(workspace, arguments)
    place = (seen.depth, seen.intrinsics, arguments.table_from_camera)
    options: dict[str, Any] = {
        "count": arguments.count,
        "region": None if arguments.region is None else tuple(arguments.region),
        "workspace": real.Workspace.of(arguments.workspace, arguments.workspace_frame),
        "hand_error": None if arguments.hand_error is None else PoseNoise.in_millimetres(*arguments.hand_error),
        "seed": arguments.seed,
    }
    assert workspace.settings.policy is not None
    grasper = _grasper(workspace.settings.policy, workspace.settings.threads)
    if arguments.all:
        scene = grasper.find_all(*place, labels=seen.labels, **options)
        best = scene.best()
        content = {**scene.to_json(), "warnings": list(seen.warnings), "shown": best[0][0] if best else None}
        return Answer(content, _picture(scene.grasps[best[0][0]]) if arguments.picture and best else ())
    grasps = grasper.find(*place, mask=None if seen.labels is None else seen.mask(arguments.label), **options)
    grasps = replace(grasps, warnings=(*seen.warnings, *grasps.warnings))
    return Answer(grasps.to_json(), _picture(grasps) if arguments.picture else ())


def _picture(grasps: ImageGrasps) -> tuple[bytes]:
    return (_drawn(lambda path: _pictures().save_grasp_image(path, grasps)),)


@dataclass(frozen=True)
class Tool:
    """A tool: the schema of its arguments, its function, and its description for agents."""

    arguments: type[Any]
    run: Callable[[Workspace, Any], Answer]
    title: str
    description: str


#: The tools by name.
TOOLS = {
    "plan": Tool(
        PlanArguments,
        plan,
        "Plan grasps",
        "Cut an object into boxes and rank collision-free poses of a robot hand, best first. The answer has boxes, "
        "counts, `grasps` (object_from_hand 4x4 in metres, preshape, score), and a picture of boxes, poses and hand.",
    ),
    "simulate": Tool(
        SimulateArguments,
        simulate,
        "Simulate grasps",
        "Try grasps of an object in a physics simulation: the hand closes, lifts and holds. Without `grasps` the best "
        "planned ones are tried. The answer has success, secure, failure and lift of each grasp, and a picture of the "
        "stages of the grasp with the index `shown`.",
    ),
    "look": Tool(
        LookArguments,
        look,
        "Look at an object",
        "Show an object at rest on the table from any direction, with the open hand at a grasp if one is given. The "
        "answer has size, mass, resting pose and camera, and `grasp_is_free`: whether the open hand reaches the grasp "
        "without a collision.",
    ),
    "grasp_image": Tool(
        GraspImageArguments,
        grasp_image,
        "Grasp from a depth image",
        "Find ranked grasps of the object in a depth image, cloud or recording of the folder, with a trained policy. "
        "The answer has camera_from_hand, table_from_hand, preshape and probabilities of each grasp, and a picture; "
        "with `all` it has `things`, the grasps of each, and `order`, the picture being of the thing `shown`.",
    ),
}
