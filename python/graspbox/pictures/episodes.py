"""An episode of ``graspbox/Grasp-v0`` in pictures, and what is observed in it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from graspbox.configs import CameraConfig, PictureConfig
from graspbox.envs.expert import Expert, planned
from graspbox.errors import ConfigError
from graspbox.pictures.view import pixels, write

#: Images that are shown, the first camera's and the palm's.
IMAGES = ("rgb", "depth", "segmentation", "rgb_palm", "depth_palm")
#: Colours of labels: background, table, object; then those of the hand's links in turn.
_LABELS = ("#ffffff", "#d9d9d9", "#d55e00")
_LINKS = ("#0072b2", "#56b4e9", "#009e73", "#cc79a7", "#e69f00")
#: From the side, near enough to see the fingers close.
_CAMERA = CameraConfig("viewer", eye=(-0.45, -0.75, 0.5), target=(0.015, -0.015, 0.19), fov=0.56, far=30.0)
#: Steps of 0.05 s: from approach to closing, from there to closed, from there into the lift.
_BEFORE, _CLOSING, _LIFTING = 8, 25, 9


@dataclass(frozen=True, eq=False)
class Episode:
    """Moments of an episode.

    Attributes
    ----------
    name : str
        The object's name.
    moments : sequence of (str, float, array)
        Name, seconds since the episode began, picture (H, W, 3).
    images : mapping
        Observed at one of the moments, by name.
    observed : str
        The name of that moment.
    """

    name: str
    moments: Sequence[tuple[str, float, NDArray[np.uint8]]]
    images: dict[str, NDArray[Any]]
    observed: str


def play(objects: str, *, seed: int = 0, image_size: int = 128, picture: PictureConfig, observed: str) -> Episode:
    """Let the scripted expert solve an episode, and keep five of its moments.

    Raises
    ------
    ConfigError
        If nothing can be planned for the object as it lies, or the expert fails.
    """
    env: Any = gymnasium.make(
        "graspbox/Grasp-v0",
        objects=objects,
        obs=("state", *IMAGES),
        image_size=image_size,
        render_mode="rgb_array",
        picture=picture,
    ).unwrapped
    seen, info = env.reset(seed=seed)
    mesh = env.objects[env.objects.names.index(info["object"])].load()
    plan = planned(mesh, seen["state"], seed=seed)
    if not len(plan):
        raise ConfigError(f"there is no pose for {mesh.name} as seed {seed} lays it; choose another seed")
    expert = Expert(seen["state"], plan.poses[0], plan.preshape[0])
    states, closes, done = [env.get_state()], [], False
    while not done and not expert.finished:
        action = expert.act(seen["state"])
        seen, _, done, _, info = env.step(action)
        states.append(env.get_state())
        closes.append(bool(action[6] > 0))
    if not info["is_success"]:
        raise ConfigError(f"the expert fails with {mesh.name} from seed {seed}; choose another seed")
    first, last = closes.index(True), len(states) - 1
    closed = first + _CLOSING
    steps = {"start": 0, "approach": first - _BEFORE, "closed": closed, "lift": closed + _LIFTING, "held": last}
    moments, images = [], {}
    for name, step in steps.items():
        seen, _ = env.set_state(states[step])
        moments.append((name, step / env.metadata["render_fps"], env.render()))
        if name == observed:
            images = {image: seen[image] for image in IMAGES}
    return Episode(mesh.name, moments, images, observed)


def save_episode(path: Path, objects: str, *, seed: int = 0, observed: str = "approach") -> None:
    """Write an episode of ``graspbox/Grasp-v0`` that the scripted expert solves, and what it could see in one moment.

    Parameters
    ----------
    path : Path
        The picture's file.
    objects : str
        The object: see `graspbox.object_sets`.
    seed : int
        Of the episode and of the plan.
    observed : {"start", "approach", "closed", "lift", "held"}
        The moment whose images are shown.

    Raises
    ------
    ConfigError
        If the expert has no pose, or fails.
    """
    figure = Figure(figsize=(10, 4.95), dpi=130)
    panels = figure.subplots(2, len(IMAGES), gridspec_kw={"height_ratios": (1.2, 1.0)})
    figure.subplots_adjust(left=0.004, right=0.996, bottom=0.006, top=0.955, wspace=0.03, hspace=0.12)
    width, height = pixels(panels[0, 0])
    episode = play(objects, seed=seed, picture=PictureConfig((height, width), 4, _CAMERA), observed=observed)
    for axes, (name, seconds, picture) in zip(panels[0], episode.moments, strict=True):
        axes.imshow(picture)
        axes.set_title(f"{name}, {seconds:.2f} s", fontsize=9, pad=3)
    for axes, (name, image) in zip(panels[1], episode.images.items(), strict=True):
        axes.imshow(shown(image), interpolation="nearest")
        axes.set_title(f'"{name}" at {observed}', fontsize=9, pad=3)
    for axes in panels.flat:
        axes.set_axis_off()
    write(figure, path, palette=False)


def shown(image: NDArray[Any]) -> NDArray[Any]:
    """Turn an image into colours (H, W, 3): depths from yellow to violet and white for none, labels one by one."""
    if image.shape[2] == 3:
        return image
    values = image[..., 0]
    if image.dtype == np.uint8:
        links = max(0, int(values.max()) + 1 - len(_LABELS))
        colors = [*_LABELS, *(_LINKS[i % len(_LINKS)] for i in range(links))]
        return np.take([to_rgb(color) for color in colors], values, axis=0)
    there = values > 0
    # What is near varies least: the logarithm shows it.
    values = np.log(np.where(there, values, values[there].min()))
    low, high = values.min(), values.max()
    colored = colormaps["viridis_r"]((values - low) / max(high - low, 1e-6))[..., :3]
    colored[~there] = 1.0
    return np.asarray(colored)
