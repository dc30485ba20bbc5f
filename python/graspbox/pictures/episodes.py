"""Pictures of an episode of ``graspbox/Grasp-v0``, and images observed in it."""

from typing import Any

import gymnasium
import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from graspbox._common.colors import COLORS
from graspbox.configs import CameraConfig, PictureConfig
from graspbox.envs.expert import ExpertGrasp, planned
from graspbox.envs.scripted import MotionOptions
from graspbox.errors import ConfigError
from graspbox.pictures.files import PathLike, check_path, pixels, write
from graspbox.policies.base import SCRIPTED

#: Moments of an episode to show.
MOMENTS = ("start", "approach", "closed", "lift", "held")
#: Images to show, from the first camera and from the palm camera.
IMAGES = ("rgb", "depth", "segmentation", "rgb_palm", "depth_palm")
#: Colours of segmentation labels: background, table, object; then the hand's links, repeating.
_LABELS = ("#ffffff", "#d9d9d9", COLORS[1])
_LINKS = (COLORS[0], COLORS[4], COLORS[2], COLORS[3], COLORS[5])
#: Colour map of depths, and candidate ticks of its colour bar, metres.
_DEPTHS = "viridis_r"
_TICKS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5, 2.0, 3.0, 5.0)
#: Least distance between ticks, as a share of the bar's length.
_TICK_GAP = 0.13
#: Viewer camera: from the side, close enough to show the fingers closing.
_CAMERA = CameraConfig("viewer", eye=(-0.45, -0.75, 0.5), target=(0.015, -0.015, 0.19), fov=0.56, far=30.0)
#: Every 0.05 s there is an action, and a picture to choose from.
_MOTION = MotionOptions(fingers=SCRIPTED["fingers"], control_freq=SCRIPTED["control_freq"])
#: Steps of 0.05 s from the approach to the start of closing, from there to closed, and from there into the lift.
_BEFORE, _CLOSING, _LIFTING = 8, 25, 9


def play(
    objects: str, seed: int, picture: PictureConfig, observed: str, image_size: int = 128
) -> tuple[str, list[tuple[str, float, NDArray[np.uint8]]], dict[str, NDArray[Any]]]:
    """Solve an episode: the object, name, second and picture (H, W, 3) of moments, and images `observed` at one."""
    if observed not in MOMENTS:
        raise ConfigError(f"observed is {observed!r}; use one of {', '.join(MOMENTS)}")
    env: Any = gymnasium.make(
        "graspbox/Grasp-v0",
        objects=objects,
        obs=("state", *IMAGES),
        image_size=image_size,
        render_mode="rgb_array",
        picture=picture,
        max_episode_steps=SCRIPTED["max_episode_steps"],
        **_MOTION,
    ).unwrapped
    observation, info = env.reset(seed=seed)
    mesh = env.objects[env.objects.names.index(info["object"])].load()
    plan = planned(mesh, observation["state"], seed=seed)
    if not len(plan):
        raise ConfigError(f"the planner finds no feasible pose for {mesh.name} at seed {seed}; choose another seed")
    expert = ExpertGrasp(observation["state"], plan.poses[0], plan.preshape[0], **_MOTION)
    states, closes, done = [env.get_state()], [], False
    while not done and not expert.finished:
        action = expert.act(observation["state"])
        observation, _, done, _, info = env.step(action)
        states.append(env.get_state())
        closes.append(bool(action[6] > 0))
    if not info["is_success"]:
        raise ConfigError(f"the expert fails with {mesh.name} at seed {seed}; choose another seed")
    first, last = closes.index(True), len(states) - 1
    closed = first + _CLOSING
    steps = dict(zip(MOMENTS, (0, first - _BEFORE, closed, closed + _LIFTING, last), strict=True))
    moments: list[tuple[str, float, NDArray[np.uint8]]] = []
    images: dict[str, NDArray[Any]] = {}
    for name, step in steps.items():
        observation, _ = env.set_state(states[step])
        moments.append((name, step / env.metadata["render_fps"], env.render()))
        if name == observed:
            images = {image: observation[image] for image in IMAGES}
    return mesh.name, moments, images


def save_episode(path: PathLike, objects: str, *, seed: int = 0, observed: str = "approach") -> None:
    """Save an episode of ``graspbox/Grasp-v0`` solved by the scripted expert, and the images observed at one moment.

    Each depth image has a colour bar in metres.

    Parameters
    ----------
    objects : str
        The object: see `graspbox.object_sets`.
    seed : int
        Seed of the episode and of the plan.
    observed : {"start", "approach", "closed", "lift", "held"}
        The moment at which to show the images.

    Raises
    ------
    ConfigError, FileError
        As `check_path`; also if the planner finds no feasible pose, or the expert fails.
    """
    target = check_path(path)
    figure = Figure(figsize=(10, 5.6), dpi=125)
    panels = figure.subplots(2, len(IMAGES), gridspec_kw={"height_ratios": (1.2, 1.0)})
    figure.subplots_adjust(left=0.004, right=0.996, bottom=0.1, top=0.905, wspace=0.03, hspace=0.12)
    width, height = pixels(panels[0, 0])
    shown, moments, images = play(objects, seed, PictureConfig((height, width), 4, _CAMERA), observed)
    for axes, (name, seconds, picture) in zip(panels[0], moments, strict=True):
        axes.imshow(picture)
        axes.set_title(f"{name}, {seconds:.2f} s", fontsize=9, pad=3)
    for axes, (name, image) in zip(panels[1], images.items(), strict=True):
        axes.imshow(colored(image), interpolation="nearest")
        axes.set_title(f'"{name}" at {observed}', fontsize=9, pad=3)
        if name.startswith("depth"):
            _depth_bar(figure, axes, *depth_limits(image))
    for axes in panels.flat:
        axes.set_axis_off()
    figure.suptitle(f"graspbox/Grasp-v0, {shown}: the scripted expert", fontsize=11, weight="bold", y=0.985)
    write(figure, target, palette=False)


def depth_limits(image: NDArray[Any]) -> tuple[float, float]:
    """Return least and greatest depth of an image, metres, for a colour scale; 0 (not measured) is ignored."""
    depths = image[image > 0]
    low, high = (float(depths.min()), float(depths.max())) if len(depths) else (0.1, 1.0)
    return low, max(high, 1.01 * low)


def depth_ticks(low: float, high: float) -> list[float]:
    """Choose round depths, metres, spaced widely enough for their labels on a logarithmic bar."""
    ticks: list[float] = []
    for tick in (tick for tick in _TICKS if low <= tick <= high):
        if not ticks or np.log(tick / ticks[-1]) > _TICK_GAP * np.log(high / low):
            ticks.append(tick)
    return ticks


def colored(image: NDArray[Any]) -> NDArray[Any]:
    """Map an image (H, W, c) to colours (H, W, 3).

    Depth ranges from yellow (near) to violet (far) on a logarithmic scale, which resolves near depths best; white means
    not measured. Each segmentation label has its colour.
    """
    if image.shape[2] == 3:
        return image
    values = image[..., 0]
    if image.dtype == np.uint8:
        links = max(0, int(values.max()) + 1 - len(_LABELS))
        colors = [*_LABELS, *(_LINKS[i % len(_LINKS)] for i in range(links))]
        return np.take([to_rgb(color) for color in colors], values, axis=0)
    low, high = depth_limits(image)
    measured = values > 0
    rgb = colormaps[_DEPTHS](LogNorm(low, high)(np.where(measured, values, high)))[..., :3]
    rgb[~measured] = 1.0
    return np.asarray(rgb)


def _depth_bar(figure: Figure, axes: Any, low: float, high: float) -> None:
    """Add a colour bar in metres below a depth image."""
    box = axes.get_position()
    place = figure.add_axes((box.x0 + 0.08 * box.width, box.y0 - 0.03, 0.84 * box.width, 0.016))
    bar = figure.colorbar(ScalarMappable(LogNorm(low, high), _DEPTHS), cax=place, orientation="horizontal")
    ticks = depth_ticks(low, high)
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    bar.ax.minorticks_off()
    bar.ax.tick_params(labelsize=8, length=2, pad=1)
    bar.set_label("depth (m)", fontsize=8, labelpad=1)
