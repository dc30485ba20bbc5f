"""An environment, stepped live by a policy, by sliders, or by keys and buttons, with its images."""

import functools
from typing import Any, ClassVar, cast

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox import policies
from graspbox.envs import IDS, SINGLE_OBJECT_IDS, spaces
from graspbox.envs.coding import codec
from graspbox.hands import Hand, load_hand
from graspbox.policies import Policy, Task
from graspbox.policies.base import is_closed_loop
from graspbox.tools.hand_links import state_joints
from graspbox.tools.viewer.drawn_hand import DrawnHand
from graspbox.tools.viewer.geometry import depth_picture
from graspbox.tools.viewer.page import Page
from graspbox.tools.viewer.surroundings import DrawnObjects

#: Size of the images that the page adds, pixels, where the policy does not choose it.
_IMAGE = 128
#: Steps per press of a key.
_HELD = 4
#: Keys that move the hand: label, columns of the action, entry (-1: all), sign. viser uses W, A, S, D, Q and E itself.
_KEYS = {
    "U": ("+x", "linear", 0, 1.0), "O": ("-x", "linear", 0, -1.0), "J": ("+y", "linear", 1, 1.0),
    "L": ("-y", "linear", 1, -1.0), "I": ("back", "linear", 2, -1.0), "K": ("forward", "linear", 2, 1.0),
    "R": ("turn +x", "angular", 0, 1.0), "F": ("turn -x", "angular", 0, -1.0), "T": ("turn +y", "angular", 1, 1.0),
    "G": ("turn -y", "angular", 1, -1.0), "Y": ("turn +z", "angular", 2, 1.0), "H": ("turn -z", "angular", 2, -1.0),
    "C": ("close", "actuator", -1, 1.0), "X": ("open", "actuator", -1, -1.0),
}  # fmt: skip
_BY_POLICY, _BY_SLIDERS, _BY_KEYS = "policy", "sliders", "keys"


class EnvironmentPage(Page):
    """Page of an environment; `content` is its id, one of `graspbox.envs.IDS`, or a policy that acts in its own."""

    title: ClassVar[str] = "environment"

    def build(self) -> None:
        """Make the environment and begin an episode."""
        options = self.options
        self.policy: Policy | None = None if options.policy is None else policies.load(options.policy)
        if isinstance(self.content, Policy):
            self.policy = self.content
        self.env_id: str = (self.content.env_id or IDS[0]) if isinstance(self.content, Policy) else self.content
        self.settings: dict[str, Any] = {} if self.policy is None else self.policy.settings_in(self.env_id)
        self.settings["hand"] = options.hand_or(self.settings.get("hand", "reflex"))
        self.hand: Hand = load_hand(self.settings["hand"])
        self.closed_loop = is_closed_loop(self.env_id)
        self.clears = self.env_id not in SINGLE_OBJECT_IDS
        self.env = self._make()
        self.native = cast(Any, self.env.unwrapped)
        core = self.native._core
        self.columns = core.action_columns
        self._codec = codec(core.control, self.hand, core.config.fingers)
        self._joints = state_joints(self._codec, self.hand) if self.closed_loop else None
        if self.policy is not None:
            self.policy.bind(Task.of(self.env))
        self.running, self.done = False, True
        self.canvas.look((0.0, 0.0, 0.12), 0.95)
        self.canvas.table()
        self.objects = DrawnObjects(self.canvas, "/objects")
        self.drawn = DrawnHand(self.canvas, "/hand", self.hand)
        self._controls()
        self.reset()
        self.canvas.thread(self._run, "environment")

    def _make(self) -> gymnasium.Env[Any, Any]:
        """Make the environment with the observations of the policy and of the page."""
        settings = dict(self.settings)
        wanted = () if self.policy is None or self.policy.obs is None else self.policy.obs
        names = [wanted] if isinstance(wanted, str) else list(wanted)
        names += [name for name in ("state", "rgb", "depth") if name not in names]
        if "cameras" not in settings:
            settings.setdefault("image_size", _IMAGE)
        named = {"layout": self.options.layout, "objects_per_scene": self.options.objects_per_scene}
        settings |= {name: value for name, value in named.items() if value is not None}
        objects: Any = self.options.objects or "procedural"
        if self.options.objects is None and self.policy is not None:
            objects, settings["split"] = self.policy.default_objects()
        return gymnasium.make(self.env_id, objects=objects, obs=tuple(names), **settings)

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
            observed: Any = self.env.observation_space
            self.images = {
                name: gui.add_image(np.zeros((_IMAGE, _IMAGE, 3), dtype=np.uint8), label=name, format="jpeg")
                for name in observed
                if name.split("_")[0] in ("rgb", "depth")
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
        if self.closed_loop:
            self._keys()
        else:
            self.canvas.on(*self.sliders, call=lambda: self._show_decision(self._of_sliders()))
        self.canvas.on(self.go, call=self.toggle)
        self.canvas.on(self.one, call=self.step)
        self.canvas.on(self.again, call=self.reset)

    def _keys(self) -> None:
        """Add a button and a key for each motion."""
        with self.canvas.gui.add_folder("Keys", expand_by_default=self.policy is None):
            for key, (meaning, *_) in _KEYS.items():
                label = f"{meaning} ({key})"
                press = functools.partial(self.press, key)
                self.canvas.on(self.canvas.gui.add_button(label, color="gray"), call=press)
                command = self.canvas.gui.add_command(label, hotkey=key)
                command.on_trigger(self.canvas.under_lock(press))

    def _idle(self) -> NDArray[np.float32]:
        """Return the action without motion; for a decision, a pose above the table that looks down."""
        if self.closed_loop:
            return np.asarray(self.native.idle_action)
        action = np.zeros(spaces.size(self.columns), dtype=np.float32)
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
            return self._of_sliders()
        return self._idle()

    def _of_sliders(self) -> NDArray[np.float32]:
        return np.array([slider.value for slider in self.sliders], dtype=np.float32)

    def press(self, key: str) -> None:
        """Carry out the motion of a key."""
        _, name, entry, sign = _KEYS[key]
        action = self._idle()
        names = [row["name"] for row in self.columns for _ in range(row["size"])]
        places = [place for place, column in enumerate(names) if column == name]
        action[places if entry < 0 else places[entry]] = sign
        for _ in range(_HELD):
            if not self.done:
                self.step(action)

    def step(self, action: NDArray[np.float32] | None = None) -> None:
        """Step the environment once, after a reset if the episode has ended."""
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
            if self._joints is not None:
                self.drawn.pose(self._codec.pose(state, "hand"), self._joints(state))
        for name, node in self.images.items():
            image = np.asarray(self.observation[name])
            node.image = image if image.dtype == np.uint8 else depth_picture(image[..., 0])
        ended = ""
        if self.done or (self.clears and self.steps):
            ended = "**success**" if self.info["is_success"] else f"**{self.info['failure'] or 'time limit'}**"
        name = "" if self.policy is None else f", policy {self.policy.name}"
        left = f", {self.info['cleared']} cleared, {self.info['remaining']} left" if self.clears else ""
        self.canvas.say(
            f"**{self.env_id}**{name}  \nseed {self._seed}: {self.info['object']}{left}  \nstep {self.steps}, reward "
            f"{self.reward:.2f}, lift {100 * float(self.info.get('lift') or 0):.1f} cm  \n{ended}"
        )

    def _show_decision(self, action: NDArray[np.float32]) -> None:
        """Show the open hand at the pose of a decision."""
        pose, preshape = self._codec.decode_grasp(action)
        self.drawn.pose(pose, self.hand.open(max(preshape, self.hand.preshape_limits[0])))
        self.drawn.visible = True

    def close(self) -> None:
        """Close the environment."""
        if hasattr(self, "env"):
            with self.canvas.lock:
                self.env.close()
