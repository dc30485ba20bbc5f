"""Train a policy of Stable-Baselines3 to act as recorded demonstrations show (behaviour cloning), and evaluate it.

    graspbox record expert --out out/shown --objects procedural:can:0-99 --split train --set frame_skip=4
    python scripts/clone_sb3.py ppo out/shown out/clone
    python scripts/clone_sb3.py ppo out/shown out/seeing --obs depth --obs proprio --obs tactile
    python scripts/train_sb3.py ppo out/tuned --clone out/clone

The environment is that of the demonstrations; networks and normalization are those of ``scripts/sb3.yaml``, in which
``--set`` replaces values, as in ``train_sb3.py``. Every tenth episode is held out of training. ``--resume`` continues
after the last epoch that was saved. The folder holds

| file | contents |
|---|---|
| ``evaluations.jsonl`` | the settings, then a row per evaluation on held-out objects; ``timesteps`` counts updates |
| ``losses.jsonl`` | a row per epoch: mean squared error of the actions, in training and held out |
| ``checkpoint/`` | model, statistics that scale observations, state of the optimizer |
| ``tensorboard/`` | the curves |

so that ``evaluate_sb3.py`` and ``plot_sb3.py`` take it. Exit status: 0, 2 for wrong arguments, 130 after Ctrl-C.

Needs the extras ``cli``, ``data`` and ``train``.
"""

import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
import yaml

from graspbox import sb3
from graspbox.cli.common import console, print_json, progress
from graspbox.demonstrations import Demonstrations
from graspbox.errors import ConfigError, GraspboxError
from graspbox.resume_log import ResumeLog

PARAMETERS = Path(__file__).with_name("sb3.yaml")
#: As in train_sb3.py: the trials of the evaluations.
EVALUATION_SEED = 10_000


@dataclass(frozen=True)
class Settings:
    """Arguments of one run."""

    algorithm: tyro.conf.Positional[str]
    """Whose policy: ppo, sac or td3."""
    demonstrations: tyro.conf.Positional[Path]
    """Folder that `graspbox record` wrote."""
    folder: tyro.conf.Positional[Path]
    """Folder of the run."""
    obs: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """What the policy observes, `state` by default; may be repeated."""
    keep: str = "secure"
    """Which episodes to imitate: secure, success or all."""
    shown: int | None = None
    """Imitate only the first episodes; all by default."""
    epochs: int = 60
    """Passes over the demonstrations."""
    batch: int = 256
    """Steps of an update."""
    rate: float = 1e-3
    """Learning rate at the start; it falls to zero along half a cosine."""
    parameters: Path = PARAMETERS
    """File of parameters, by algorithm and environment."""
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """Replace a parameter, for example model.policy_kwargs.net_arch=[64]; may be repeated."""
    save_every: int = 5
    """Epochs between two checkpoints."""
    evaluations: int = 1
    """Evaluations, evenly spaced in epochs; the last one is at the end."""
    episodes: int = 100
    """Trials of an evaluation."""
    evaluate: str = "validation"
    """Split of the objects that evaluations take."""
    seed: int = 0
    """Seed of the networks and of the order of batches."""
    resume: bool = False
    """Continue the run in the folder, if there is one."""
    torch_threads: int = 1
    """Threads of the networks."""
    device: str = "cpu"
    """Where the networks run: cpu, cuda."""
    json: bool = False
    """Print JSON, and nothing else, on standard output."""


def check(settings: Settings) -> None:
    """Refuse arguments that are out of range."""
    if settings.algorithm not in ("ppo", "sac", "td3"):
        raise ConfigError(f"there is no algorithm {settings.algorithm!r}; choose from ppo, sac, td3")
    for name in ("epochs", "batch", "save_every", "evaluations", "episodes", "torch_threads"):
        if getattr(settings, name) < 1:
            raise ConfigError(f"--{name.replace('_', '-')} is {getattr(settings, name)}; give 1 or more")
    if not 0.0 < settings.rate < 1.0:
        raise ConfigError(f"--rate is {settings.rate}; give a number between 0 and 1")


def make(settings: Settings, demonstrations: Demonstrations) -> tuple[Any, Any, dict[str, Any]]:
    """Make the model, with statistics that scale its observations; its steps; the settings for the log."""
    from graspbox.sb3.cloning import ClonedSteps, observe
    from graspbox.sb3.parameters import read_parameters
    from graspbox.sb3.running import ALGORITHMS, make_env, normalized
    from graspbox.sb3.training import model_arguments

    env_id, keywords = demonstrations.environment(settings.obs)
    parameters = read_parameters(settings.parameters, settings.algorithm, env_id, settings.set)
    steps = ClonedSteps(demonstrations, keywords["obs"], settings.keep, settings.shown)
    env = make_env(env_id, parameters.num_envs, **{**keywords, "split": "train"})
    env = normalized(env, parameters.model.get("gamma", 0.99), **{**parameters.normalize, "reward": False})
    algorithm = ALGORITHMS[settings.algorithm]
    arguments = model_arguments(algorithm, parameters.model, env, 0)
    # Cloning needs no memory of its own; train_sb3.py makes a buffer of the size in the parameters.
    arguments |= {"buffer_size": 1} if "buffer_size" in arguments else {}
    model = algorithm(env=env, seed=settings.seed, device=settings.device, **arguments)
    if model.get_vec_normalize_env() is not None:
        observe(model.get_vec_normalize_env(), steps)
    what = {"algorithm": settings.algorithm, "id": env_id, "evaluate": settings.evaluate, "seed": settings.seed}
    what |= {"episodes": settings.episodes, **asdict(parameters), "env": keywords}
    names = ("keep", "shown", "epochs", "batch", "rate")
    what["clone"] = {
        "demonstrations": str(settings.demonstrations.resolve()),
        "shown_by": demonstrations.settings,
        **{name: getattr(settings, name) for name in names},
    }
    return model, steps, what


class Loop:
    """The training loop: its model, optimizer and logs."""

    def __init__(self, settings: Settings, model: Any, steps: Any, what: dict[str, Any]) -> None:
        import torch
        from torch.utils.tensorboard import SummaryWriter

        from graspbox.sb3.cloning import actor_parameters, held_out

        self.settings, self.model, self.steps = settings, model, steps
        folder = settings.folder
        self.log = ResumeLog(folder / "evaluations.jsonl", what)
        self.losses = ResumeLog(folder / "losses.jsonl", {"clone": what["clone"]})
        self.board = SummaryWriter(folder / "tensorboard")
        aside = held_out(steps.episode)
        self.rows, self.aside = np.flatnonzero(~aside), np.flatnonzero(aside)
        if not len(self.aside):
            raise ConfigError(f"{steps.episode[-1] + 1} episodes are too few; ten or more leave one to hold out")
        self.optimizer = torch.optim.Adam(actor_parameters(model), lr=settings.rate)
        self.schedule = torch.optim.lr_scheduler.CosineAnnealingLR(self.optimizer, settings.epochs)
        self.epoch, self.updates, self.before, self.began = 0, 0, 0.0, time.monotonic()

    @property
    def seconds(self) -> float:
        """Time of the run, including that before it was resumed."""
        return self.before + time.monotonic() - self.began

    def batches(self, rows: Any, seed: int | None) -> Any:
        """Load batches of some rows, in an order that the seed determines, or as they are."""
        import torch
        from torch.utils.data import BatchSampler, DataLoader, SubsetRandomSampler

        order: Any = rows.tolist()
        if seed is not None:
            order = SubsetRandomSampler(order, torch.Generator().manual_seed(seed))
        # A sampler of batches: the steps of a batch are read at once.
        return DataLoader(self.steps, sampler=BatchSampler(order, self.settings.batch, False), batch_size=None)

    def train_epoch(self) -> float:
        """Pass over the demonstrations once; the mean squared error of the actions meanwhile."""
        from graspbox.sb3.cloning import cloning_loss

        self.model.policy.set_training_mode(True)
        total, count = 0.0, 0
        for observations, actions in self.batches(self.rows, self.settings.seed + 1000 * self.epoch):
            loss, error = cloning_loss(self.model, observations, actions)
            self.optimizer.zero_grad()
            loss.backward()
            self.optimizer.step()
            total, count = total + error.item() * len(actions), count + len(actions)
            self.updates += 1
        self.schedule.step()
        self.epoch += 1
        return total / count

    def measure(self) -> float:
        """Mean squared error of the actions on the steps held out."""
        import torch

        from graspbox.sb3.cloning import cloning_loss

        self.model.policy.set_training_mode(False)
        total = 0.0
        with torch.no_grad():
            for observations, actions in self.batches(self.aside, None):
                total += cloning_loss(self.model, observations, actions)[1].item() * len(actions)
        return total / len(self.aside)

    def save(self) -> None:
        """Write the checkpoint: the folder is replaced whole."""
        import torch

        from graspbox.sb3.running import save

        state = {"epoch": self.epoch, "updates": self.updates, "optimizer": self.optimizer.state_dict()}
        state["schedule"] = self.schedule.state_dict()
        self.model.num_timesteps = self.updates
        folder = self.settings.folder / "checkpoint"
        save(self.model, folder, self.seconds, buffer=False, also=lambda new: torch.save(state, new / "cloning.pt"))

    def load(self) -> None:
        """Go on from the checkpoint."""
        import torch

        folder = self.settings.folder / "checkpoint"
        folder = folder if folder.exists() else folder.with_name("checkpoint.old")
        state = torch.load(folder / "cloning.pt", weights_only=True)
        self.model.set_parameters(str(folder / "model.zip"), device=self.settings.device)
        self.optimizer.load_state_dict(state["optimizer"])
        self.schedule.load_state_dict(state["schedule"])
        self.epoch, self.updates = state["epoch"], state["updates"]
        self.before = json.loads((folder / "progress.json").read_text())["seconds"]

    def evaluate(self) -> None:
        """Run the policy on held-out objects."""
        from graspbox import evaluation
        from graspbox.sb3.goal_env import with_goals
        from graspbox.sb3.policy import ModelPolicy, summary

        what = json.loads(self.log.path.read_text().splitlines()[0])["settings"]
        policy: Any = ModelPolicy(self.model, self.model.get_vec_normalize_env(), "clone")
        policy, keywords = with_goals(policy, what["env"])
        # A validation: the policy that gives goals may know these objects.
        keywords |= {"split": self.settings.evaluate, "trials": self.settings.episodes, "include_learned": True}
        keywords |= {"seed": EVALUATION_SEED, "num_envs": min(what["num_envs"], self.settings.episodes)}
        row = summary(evaluation.evaluate(policy, what["id"], **keywords))
        self.log.append({"timesteps": self.updates, "seconds": round(self.seconds, 1), **row})
        for name in ("success", "secure"):
            self.board.add_scalar(f"eval/{name}", row[name], self.updates)

    def run(self) -> None:
        """Train to the last epoch."""
        every = max(1, self.settings.epochs // self.settings.evaluations)
        with progress() as bar:
            task = bar.add_task("cloning", total=self.settings.epochs, completed=self.epoch)
            while self.epoch < self.settings.epochs:
                trained, aside = self.train_epoch(), self.measure()
                row = {"epoch": self.epoch, "updates": self.updates, "trained": trained, "held_out": aside}
                bar.update(task, completed=self.epoch, description=f"cloning, held-out error {aside:.4f}")
                for name in ("trained", "held_out"):
                    self.board.add_scalar(f"clone/{name}", row[name], self.updates)
                last = self.epoch == self.settings.epochs
                if last or self.epoch % self.settings.save_every == 0:
                    self.save()
                # A resumed run repeats epochs that were not saved.
                if all(known["epoch"] != self.epoch for known in self.losses.rows):
                    self.losses.append({**row, "seconds": round(self.seconds, 1)})
                if not last and self.epoch % every == 0 and all(r["timesteps"] != self.updates for r in self.log.rows):
                    self.evaluate()
        if all(known["timesteps"] != self.updates for known in self.log.rows):
            self.evaluate()
        self.board.close()


def clone(settings: Settings) -> dict[str, Any]:
    """Clone; returns what came of it."""
    check(settings)
    sb3.require()
    import torch

    if (settings.folder / "evaluations.jsonl").exists() and not settings.resume:
        raise ConfigError(f"{str(settings.folder)!r} holds a run; continue it with --resume, or name another folder")
    torch.set_num_threads(settings.torch_threads)
    loop = Loop(settings, *make(settings, Demonstrations(settings.demonstrations)))
    if any((settings.folder / name).exists() for name in ("checkpoint", "checkpoint.old")):
        loop.load()
    loop.run()
    losses, last = loop.losses.rows[-1], loop.log.rows[-1]
    names = ("success", "ci95", "secure", "episodes")
    return {"folder": str(settings.folder), **losses, **{name: last[name] for name in names}}


def main(arguments: list[str] | None = None) -> int:
    """Parse the arguments and clone; returns the exit status."""
    settings = tyro.cli(Settings, args=arguments, description=__doc__)
    try:
        found = clone(settings)
    except (GraspboxError, OSError, yaml.YAMLError) as error:
        console.print(f"error: {error}", markup=False)
        return 2
    except KeyboardInterrupt:
        return 130
    if settings.json:
        print_json(found)
    else:
        for name, value in found.items():
            console.print(f"{name}: {value}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
