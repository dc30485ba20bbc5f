"""An environment, stepped live by a policy, by sliders, or by keys and buttons, with its images."""

import functools
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox import policies
from graspbox.envs import SINGLE_OBJECT_IDS, spaces
from graspbox.envs.coding import hand_pose, rotation_from_columns
from graspbox.errors import ConfigError
from graspbox.hands import Hand, load_hand
from graspbox.policies import Policy, Task
from graspbox.viewer.drawn_hand import DrawnHand
from graspbox.viewer.geometry import Floats, depth_picture
from graspbox.viewer.page import Page
from graspbox.viewer.surroundings import DrawnArrangement

__all__ = ["EnvironmentPage"]

#: Size of the images that the page adds, pixels, where the policy does not choose it.
_IMAGE = 128
#: Steps per press of a key.
_HELD = 4
#: Keys that move the hand: entry of the action within ``linear`` and ``angular``, and sign. viser itself moves its
#: camera by W, A, S, D, Q and E.
_KEYS = {
    "U": ("linear", 0, 1.0), "O": ("linear", 0, -1.0), "J": ("linear", 1, 1.0), "L": ("linear", 1, -1.0),
    "I": ("linear", 2, -1.0), "K": ("linear", 2, 1.0), "R": ("angular", 0, 1.0), "F": ("angular", 0, -1.0),
    "T": ("angular", 1, 1.0), "G": ("angular", 1, -1.0), "Y": ("angular", 2, 1.0), "H": ("angular", 2, -1.0),
    "C": ("actuator", -1, 1.0), "X": ("actuator", -1, -1.0),
}  # fmt: skip
_MEANING = {
    "U": "+x", "O": "-x", "J": "+y", "L": "-y", "I": "back", "K": "forward", "R": "turn +x", "F": "turn -x",
    "T": "turn +y", "G": "turn -y", "Y": "turn +z", "H": "turn -z", "C": "close", "X": "open",
}  # fmt: skip
_BY_POLICY, _BY_SLIDERS, _BY_KEYS = "policy", "sliders", "keys"


class EnvironmentPage(Page):
    """Page of an environment; `content` is its id, one of `graspbox.envs.IDS`."""

    title: ClassVar[str] = "environment"

    def build(self) -> None:
        """Make the environment and begin an episode."""
        options = self.options
        self.policy: Policy | None = None if options.policy is None else policies.load(options.policy)
        self.hand: Hand = load_hand(options.hand)
        self.closed_loop = self.content.startswith("graspbox/Grasp-")
        self.clears = self.content not in SINGLE_OBJECT_IDS
        self.env = self._make()
        self.native: Any = self.env.unwrapped
        self.control = "twist" if self.closed_loop else "clear" if self.clears else "grasp_pose"
        self.columns, observed = spaces.columns_of(self.control, spaces.tables(self.hand))
        self._state = observed["state"]
        if self.policy is not None:
            self.policy.bind(Task.of(self.env))
        self.running, self.done = False, True
        self.canvas.look((0.0, 0.0, 0.12), 0.95)
        self.canvas.table()
        self.objects = DrawnArrangement(self.canvas)
        self.drawn = DrawnHand(self.canvas, "/hand", self.hand)
        self._controls()
        self.reset()
        self.canvas.thread(self._run, "environment")

    def _make(self) -> gymnasium.Env[Any, Any]:
        """Make the environment with the observations of the policy and of the page."""
        settings: dict[str, Any] = dict(self.policy.settings) if self.policy is not None else {}
        wanted = () if self.policy is None or self.policy.obs is None else self.policy.obs
        names = [wanted] if isinstance(wanted, str) else list(wanted)
        names += [name for name in ("state", "rgb", "depth") if name not in names]
        if "cameras" not in settings:
            settings.setdefault("image_size", _IMAGE)
        named = {"layout": self.options.layout, "objects_per_scene": self.options.objects_per_scene}
        settings |= {name: value for name, value in named.items() if value is not None}
        objects = self.options.objects or "procedural"
        return gymnasium.make(self.content, objects=objects, obs=tuple(names), hand=self.options.hand, **settings)

    def _controls(self) -> None:
        gui = self.canvas.gui
        modes = [_BY_POLICY] if self.policy is not None else []
        modes += [_BY_SLIDERS, *([_BY_KEYS] if self.closed_loop else [])]
        with gui.add_folder("Episode"):
            self.mode = gui.add_dropdown("stepped by", modes, initial_value=modes[0])
            self.go = gui.add_button("run", icon="player-play")
            self.one = gui.add_button("one step")
            self.seed = gui.add_number("seed", self.options.seed, min=0, step=1)
            self.again = gui.add_button("new episode", hint="with the seed; the next one has the next seed")
            self.automatic = gui.add_checkbox("go on", True, hint="begin the next episode when one ends")
        with gui.add_folder("Images"):
            self.images = {
                name: gui.add_image(np.zeros((_IMAGE, _IMAGE, 3), dtype=np.uint8), label=name, format="jpeg")
                for name, space in self._image_spaces().items()
                if space.shape is not None
            }
        with gui.add_folder("Action", expand_by_default=self.policy is None):
            names = [
                row["name"] if row["size"] == 1 else f"{row['name']} {'xyz'[i] if row['size'] == 3 else i}"
                for row in self.columns
                for i in range(row["size"])
            ]
            start = self._idle()
            self.sliders = [
                gui.add_slider(name, -1.0, 1.0, 0.01, float(value)) for name, value in zip(names, start, strict=True)
            ]
        self._keys()
        self.canvas.on(self.go, call=self.toggle)
        self.canvas.on(self.one, call=self.step)
        self.canvas.on(self.again, call=self.reset)
        if not self.closed_loop:
            self.canvas.on(*self.sliders, call=self._preview)

    def _image_spaces(self) -> dict[str, Any]:
        found: Any = self.env.observation_space
        return {name: space for name, space in found.items() if name.split("_")[0] in ("rgb", "depth")}

    def _keys(self) -> None:
        """Add a button and a key for each motion."""
        if not self.closed_loop:
            return
        with self.canvas.gui.add_folder("Keys", expand_by_default=self.policy is None):
            for key in _KEYS:
                label = f"{_MEANING[key]} ({key})"
                press = functools.partial(self.press, key)
                self.canvas.on(self.canvas.gui.add_button(label, color="gray"), call=press)
                command = self.canvas.gui.add_command(label, hotkey=key)
                command.on_trigger(self.canvas.under_lock(press))

    def _idle(self) -> NDArray[np.float32]:
        """Return the action without motion; for a decision, a pose above the table that looks down."""
        size = spaces.size(self.columns)
        if self.closed_loop:
            found: NDArray[np.float32] = self.native.idle_action
            return found
        action = np.zeros(size, dtype=np.float32)
        action[3:9] = (1, 0, 0, 0, -1, 0)
        return action

    def reset(self) -> None:
        """Begin an episode with the seed of the panel."""
        seed = int(self.seed.value)
        self.observation, info = self.env.reset(seed=seed)
        if self.policy is not None:
            self.policy.reset(seed, info=info)
        self.seed.value = seed + 1
        self.steps, self.reward, self.done, self.info, self._seed = 0, 0.0, False, info, seed
        if not self.closed_loop:
            self.drawn.visible = False
        self.refresh()

    def action(self) -> NDArray[np.float32]:
        """Return the next action of the chosen mode."""
        if self.mode.value == _BY_POLICY and self.policy is not None:
            rows = {name: np.asarray(value)[None] for name, value in self.observation.items()}
            return np.asarray(self.policy.act(rows)[0])
        if self.mode.value == _BY_SLIDERS:
            return np.array([slider.value for slider in self.sliders], dtype=np.float32)
        return self._idle()

    def press(self, key: str) -> None:
        """Carry out the motion of a key."""
        name, entry, sign = _KEYS[key]
        action, first = self._idle(), 0
        for row in self.columns:
            if row["name"] == name:
                places = slice(first, first + row["size"]) if entry < 0 else first + entry
                action[places] = sign
            first += row["size"]
        for _ in range(_HELD):
            if not self.done:
                self.step(action)

    def step(self, action: NDArray[np.float32] | None = None) -> None:
        """Step the environment once; an episode that is over begins anew."""
        if self.done:
            self.reset()
        chosen = self.action() if action is None else action
        if not self.closed_loop:
            self._show_decision(chosen)
        self.observation, reward, terminated, truncated, self.info = self.env.step(chosen)
        self.steps, self.reward = self.steps + 1, self.reward + float(reward)
        self.done = terminated or truncated
        self.refresh()

    def toggle(self) -> None:
        """Run, or pause."""
        self.running = not self.running
        self.go.label = "pause" if self.running else "run"

    def _run(self) -> None:
        period = 1.0 / float(self.env.metadata["render_fps"])
        while not self.canvas.closed.wait(period):
            with self.canvas.lock:
                if not self.running or self.canvas.closed.is_set():
                    continue
                if self.done and not self.automatic.value:
                    self.toggle()
                    continue
                self.canvas.guarded(self.step)()
                if self.canvas.problem.visible:
                    self.toggle()

    def refresh(self) -> None:
        """Draw the present state."""
        state = self.observation["state"]
        with self.canvas.server.atomic():
            if self.closed_loop or self.clears or not self.done:
                # After a decision the scene keeps the object at its place before the grasp; the images show the end.
                self.objects.show(self.native.arrangement())
            if self.closed_loop:
                self.drawn.pose(hand_pose(state, control=self.control, hand=self.hand), self._joints(state))
        for name, node in self.images.items():
            image = np.asarray(self.observation[name])
            node.image = image if image.dtype == np.uint8 else depth_picture(image[..., 0])
        ended = ""
        if self.done or (self.clears and self.steps):
            ended = "**success**" if self.info["is_success"] else f"**{self.info['failure'] or 'time limit'}**"
        name = "" if self.policy is None else f", policy {self.policy.name}"
        left = f", {self.info['cleared']} cleared, {self.info['remaining']} left" if self.clears else ""
        self.canvas.say(
            f"**{self.content}**{name}  \nseed {self._seed}: {self.info['object']}{left}  \nstep {self.steps}, reward "
            f"{self.reward:.2f}, lift {100 * float(self.info.get('lift') or 0):.1f} cm  \n{ended}"
        )

    def _joints(self, state: NDArray[np.float32]) -> Floats:
        """Read joint positions off a state; those that it lacks follow from the first actuator's travel."""
        values, first, share = {}, 0, 0.0
        for row in self._state:
            found = np.asarray(state[first : first + row["size"]], dtype=np.float64)
            if row["name"] == "actuator":
                share = float(np.clip((found[0] - row["low"]) / (row["high"] - row["low"]), 0.0, 1.0))
            values[row["name"]] = (row["meaning"].removeprefix("position of ").split(", "), found)
            first += row["size"]
        low, high = self.hand.preshape_limits
        preshape = float(values["preshape"][1][0]) if "preshape" in values else low
        positions = self.hand.closed(float(np.clip(preshape, low, high)), share)
        for names, found in values.values():
            if len(names) == len(found) and set(names) <= set(self.hand.joints):
                for name, value in zip(names, found, strict=True):
                    positions[self.hand.joints.index(name)] = value
        return positions

    def _show_decision(self, action: NDArray[np.float32]) -> None:
        """Show the open hand at the pose of a decision."""
        values: dict[str, Floats] = {}
        first = 0
        for row in self.columns:
            part = np.asarray(action[first : first + row["size"]], dtype=np.float64)
            low, high = row["low"], row["high"]
            values[row["name"]] = low + (np.clip(part, -1, 1) + 1) / 2 * (high - low)
            first += row["size"]
        turn = rotation_from_columns(values["rotation"][:3], values["rotation"][3:])
        if turn is None:
            raise ConfigError("the rotation is degenerate: two columns are parallel or 0; move the sliders of rotation")
        pose = np.eye(4)
        pose[:3, :3] = turn
        pose[:3, 3] = [float(values[axis][0]) for axis in "xyz"]
        low = self.hand.preshape_limits[0]
        self.drawn.pose(pose, self.hand.open(float(values["preshape"][0]) if "preshape" in values else low))
        self.drawn.visible = True

    def _preview(self) -> None:
        self._show_decision(np.array([slider.value for slider in self.sliders], dtype=np.float32))

    def close(self) -> None:
        """Close the environment."""
        if hasattr(self, "env"):
            with self.canvas.lock:
                self.env.close()
