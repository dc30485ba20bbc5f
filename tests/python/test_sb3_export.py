"""Policies of Stable-Baselines3 as folders that act without torch, and the command that publishes a run."""

import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from graspbox import errors, evaluation, policies
from graspbox.data.episodes import record
from graspbox.hands import load_hand
from graspbox.policies import Task
from graspbox.policies.published.configs import NetworkPolicyConfig
from graspbox.policies.published.folders import load
from graspbox.policies.published.runtimes import onnx_network
from test_scripts import script

pytestmark = [pytest.mark.train, pytest.mark.usefixtures("one_thread")]

sb3 = pytest.importorskip("stable_baselines3")
torch = pytest.importorskip("torch")
pytest.importorskip("onnxruntime")
running = pytest.importorskip("graspbox.learn.sb3.running")
export = pytest.importorskip("graspbox.learn.sb3.export")
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor  # noqa: E402

from graspbox.learn.export import weight_files  # noqa: E402
from graspbox.learn.sb3 import cloning, training  # noqa: E402
from graspbox.learn.sb3.running import model_arguments  # noqa: E402
from graspbox.learn.sb3.settings import CloneSettings, Sb3Settings  # noqa: E402
from graspbox.sb3.policy import ModelPolicy  # noqa: E402

OBJECTS = ("procedural:can:0-3",)
SEEING = ("depth", "proprio", "tactile")
GRASP, DECISION = "graspbox/Grasp-v0", "graspbox/GraspPose-v0"
NETWORKS = {"net_arch": [16], "activation_fn": "ELU"}


def trained(algorithm: str, env_id: str, env: dict[str, Any], *, scaled: bool = True) -> ModelPolicy:
    """Train a tiny model for a few steps."""
    envs = running.normalized(running.make_env(env_id, 2, **env), 0.9, observations=scaled, reward=False)
    given: dict[str, Any] = {"policy_kwargs": NETWORKS, "gamma": 0.9}
    given |= {"n_steps": 8, "batch_size": 8} if algorithm == "ppo" else {"buffer_size": 64, "learning_starts": 4}
    kind = running.ALGORITHMS[algorithm]
    model = kind(env=envs, device="cpu", seed=0, **model_arguments(kind, given, envs, 0))
    model.learn(16)
    with torch.no_grad():
        # Large enough actions that some are clipped, or squashed noticeably.
        head = model.policy.action_net if algorithm == "ppo" else model.policy.actor.mu
        for parameter in head.parameters():
            parameter.mul_(40.0)
    return ModelPolicy(model, model.get_vec_normalize_env())


def exported(folder: Path, policy: ModelPolicy, algorithm: str, env_id: str, env: dict[str, Any]) -> Any:
    keywords = {"algorithm": algorithm, "env_id": env_id, "env": env, "policy_kwargs": NETWORKS}
    return export.export_policy(folder, "tiny", policy, learned_from=OBJECTS, **keywords)


@pytest.mark.parametrize(
    ("algorithm", "env_id", "obs", "scaled"),
    [
        ("ppo", GRASP, "state", True),
        ("ppo", GRASP, SEEING, True),
        ("ppo", GRASP, ("voxels", "points", "segmentation"), False),
        ("sac", DECISION, "state", True),
        ("sac", GRASP, ("proprio", "rgb"), False),
        ("td3", GRASP, ("proprio",), True),
        ("tqc", GRASP, ("proprio",), True),
    ],
)
def test_a_published_policy_acts_as_its_model(
    tmp_path: Path, algorithm: str, env_id: str, obs: Any, scaled: bool
) -> None:
    """So do its weights, without the model: on observations that the export has not seen."""
    env: dict[str, Any] = {"obs": obs, "objects": OBJECTS}
    env |= {"fingers": "each", "control_freq": 5, "max_episode_steps": 9} if env_id == GRASP else {}
    env |= {} if obs == "state" else {"image_size": 20}
    model = trained(algorithm, env_id, env, scaled=scaled)
    config = exported(tmp_path, model, algorithm, env_id, env)
    assert load(tmp_path, NetworkPolicyConfig) == config
    policy = policies.load(str(tmp_path))
    assert policy.env_id == env_id
    assert {"obs": policy.obs, **policy.settings, "objects": OBJECTS}.items() >= env.items()
    envs = gymnasium.make_vec(env_id, num_envs=3, objects=OBJECTS, obs=policy.obs, **policy.settings)
    policy.bind(Task.of(envs))
    graph = export.load_graph(tmp_path)
    observation, info = envs.reset(seed=5)
    policy.reset(seed=5, info=info)
    seen = []
    for _ in range(6):
        expected = model.act(observation)
        found = policy.act(observation)
        np.testing.assert_allclose(found, expected, atol=1e-4)
        named = observation if isinstance(observation, dict) else {"state": observation}
        with torch.no_grad():
            again = graph(*(torch.from_numpy(named[name]) for name in graph.inputs)).numpy()
        np.testing.assert_allclose(again, expected, atol=1e-4)
        seen.append(expected)
        observation, _, _, _, info = envs.step(found)
    # The comparison means something: actions differ, and some are at the bounds.
    assert np.std(seen, axis=(0, 1)).max() > 0.02
    assert np.abs(seen).max() > 0.9
    assert np.abs(seen).max() <= 1.0
    envs.close()


def own_hand(own: Path, copied: str) -> list[str]:
    """Write the files of a shipped hand as those of the hand `mine`; their paths."""
    own.mkdir()
    urdf, toml = load_hand(copied).files
    (own / "a.urdf").write_text(urdf)
    (own / "a.toml").write_text(toml.replace(f'name = "{copied}"', 'name = "mine"'))
    return [str(own / "a.urdf"), str(own / "a.toml")]


def test_a_policy_of_a_hand_of_ones_own_takes_its_files_along(tmp_path: Path) -> None:
    """It acts in another place once the original files are gone."""
    own = tmp_path / "own"
    env: dict[str, Any] = {"obs": "state", "objects": OBJECTS, "hand": own_hand(own, "panda_gripper")}
    exported(tmp_path / "made", trained("ppo", DECISION, env), "ppo", DECISION, env)
    shutil.rmtree(own)
    folder = (tmp_path / "made").rename(tmp_path / "moved")
    policy = policies.load(folder)
    assert policy.settings["hand"] == (str(folder / "hand.urdf"), str(folder / "hand.toml"))
    envs = gymnasium.make_vec(DECISION, num_envs=2, objects=OBJECTS, obs=policy.obs, **policy.settings)
    policy.bind(policies.Task.of(envs))
    observation, info = envs.reset(seed=0)
    policy.reset(seed=0, info=info)
    action = policy.act(observation)
    np.testing.assert_allclose(export.load_graph(folder)(torch.from_numpy(observation)).detach(), action, atol=1e-4)
    envs.step(action)
    envs.close()
    other = gymnasium.make_vec(DECISION, num_envs=1, objects=OBJECTS, obs=policy.obs, hand="panda_gripper")
    with pytest.raises(errors.ConfigError, match="was trained for the hand 'mine', not 'panda_gripper'"):
        policies.load(folder).bind(policies.Task.of(other))
    other.close()


def test_an_export_that_differs_is_refused(tmp_path: Path) -> None:
    env = {"obs": "state", "objects": OBJECTS}
    model = trained("ppo", DECISION, env)
    exported(tmp_path / "whole", model, "ppo", DECISION, env)
    network = onnx_network(tmp_path / "whole/policy.onnx")
    envs = gymnasium.make_vec(DECISION, num_envs=2, objects=OBJECTS)
    observation, _ = envs.reset(seed=0)
    envs.close()
    export.check_parity(network, model, [observation], ("state",), "whole")

    def wrong(inputs: Any) -> Any:
        return {"action": network(inputs)["action"] + 2e-4}

    with pytest.raises(errors.ConfigError, match=r"wrong differs from the model by 0\.0002 in 'action'"):
        export.check_parity(wrong, model, [observation], ("state",), "wrong")

    def broken(inputs: Any) -> Any:
        return {"action": network(inputs)["action"] * np.nan}

    with pytest.raises(errors.ConfigError, match="differs from the model by nan"):
        export.check_parity(broken, model, [observation], ("state",), "broken")


def test_what_cannot_be_published_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    env: dict[str, Any] = {"obs": "state", "objects": OBJECTS}
    model = trained("ppo", DECISION, env)
    with pytest.raises(errors.FileError, match=r"a\.urdf"):
        exported(tmp_path / "x", model, "ppo", DECISION, {**env, "hand": ["a.urdf", "a.toml"]})
    monkeypatch.setattr(weight_files, "LARGEST_NETWORK", 1000)
    with pytest.raises(errors.ConfigError, match="a file of 0 MB; published networks have at most 0 MB"):
        exported(tmp_path / "x", model, "ppo", DECISION, env)
    assert not (tmp_path / "x").exists()


class Outside(BaseFeaturesExtractor):  # type: ignore[misc]
    """Leaves torch during its forward pass, like a network that crops its input by other means."""

    def __init__(self, space: Any) -> None:
        super().__init__(space, space.shape[0])

    def forward(self, seen: Any) -> Any:
        """Sort the numbers."""
        return torch.from_numpy(np.sort(seen.detach().numpy(), axis=1))


def test_a_network_that_leaves_torch_is_refused(tmp_path: Path) -> None:
    env = {"obs": "state", "objects": OBJECTS}
    envs = running.make_env(DECISION, 2, **env)
    kwargs = {"features_extractor_class": Outside}
    model = ModelPolicy(running.ALGORITHMS["ppo"]("MlpPolicy", envs, policy_kwargs=kwargs, device="cpu"))
    with pytest.raises(
        errors.ConfigError, match="its features extractor, Outside, or a layer has an operation that ONNX lacks"
    ):
        exported(tmp_path / "x", model, "ppo", DECISION, env)
    envs.close()
    assert not (tmp_path / "x/config.json").exists()
    assert not (tmp_path / "x/policy.onnx").exists()


def clone(source: Path, folder: Path, **given: Any) -> None:
    """Clone demonstrations."""
    cloning.train(CloneSettings(algorithm="ppo", demonstrations=(source,), out=folder, **given), "", lambda _: None)


def train(algorithm: Any, folder: Path, **given: Any) -> None:
    """Train by rewards."""
    settings = Sb3Settings(algorithm=algorithm, out=folder, episodes=2, evaluations=1, video=0, **given)
    assert training.train(settings, "", lambda _: None).status == 0


def published(run: Path, out: Path, *more: str) -> dict[str, Any]:
    """Publish a run; the rows of its scores."""
    program = script("publish_sb3")
    given = [str(run), "--out", str(out), "--objects", "procedural:can:0-19", "--objects", "procedural:can:0-199/test"]
    code = program.main([*given, "--trials", "3", *more])
    return {"code": code, "card": (out / "README.md").read_text() if code == 0 else ""}


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten episodes of the expert."""
    out = tmp_path_factory.mktemp("publishing") / "shown"
    keywords: dict[str, Any] = {
        "objects": ("procedural:can:0-9",),
        "fingers": "each",
        "control_freq": 5,
        "max_episode_steps": 50,
    }
    record("expert", out, episodes=10, obs=("state", *SEEING), num_envs=4, split="train", image_size=16, **keywords)
    return out


def test_a_clone_and_what_learns_from_rewards_are_published(shown: Path, tmp_path: Path) -> None:
    """By one command each; the card tells every step with a command, and the folder runs without torch."""
    changes = ("num_envs=2", "model.n_steps=32", "model.batch_size=32", "model.n_epochs=1",
               "model.policy_kwargs={net_arch: [16], log_std_init: -3.0}")  # fmt: skip
    given = {"epochs": 2, "episodes": 2, "batch": 64, "set": changes, "obs": SEEING}
    clone(shown, tmp_path / "clone", **given)
    found = published(tmp_path / "clone", tmp_path / "policies/copy")
    card = found["card"]
    assert all(title in card for title in ("## Scores", "## Data and training", "## Limits", "## Licence"))
    assert "# copy\n\nA clone of demonstrations, a policy of Stable-Baselines3's PPO" in card
    assert "observes `depth`, `proprio` and `tactile`" in " ".join(card.split())
    assert "privileged" not in card
    assert "| `procedural:can:0-19` | 3 | " in card
    assert " | 4 of 20 | " in card
    assert "| `procedural:can:0-199/test` | 3 | " in card
    assert "Training objects: `procedural:can:0-9`, split `train`." in card
    (recorded,) = (line for line in card.splitlines() if line.startswith("graspbox record"))
    words = shlex.split(recorded)
    assert words[:5] == ["graspbox", "record", "expert", "--out", "out/shown"]
    assert words[words.index("--episodes") + 1] == "10"
    assert {"control_freq=5", "image_size=16", "max_episode_steps=50"} <= set(words)
    (cloned,) = (line for line in card.splitlines() if line.startswith("graspbox train clone"))
    words = shlex.split(cloned)
    assert words[3:7] == ["ppo", "out/shown", "--out", "out/clone"]
    assert {"num_envs=2", "model.batch_size=32"} <= set(words)
    # It has no activation_fn, unlike the file of parameters: no single value says that.
    assert "model.policy_kwargs={net_arch: [16], log_std_init: -3.0}" in words
    assert str(tmp_path) not in card
    code = (
        "import sys; from graspbox import evaluation\n"
        f"result = evaluation.evaluate({str(tmp_path / 'policies/copy')!r}, objects='procedural:can:0', trials=2)\n"
        "assert result.env_id == 'graspbox/Grasp-v0' and all(trial.steps <= 50 for trial in result.trials)\n"
        "assert 'torch' not in sys.modules and 'onnxruntime' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    # From rewards, and published as it was at its best.
    env = ("env.objects=[procedural:can:0-9]", "env.reward=firm", "env.image_size=16", f"env.obs={json.dumps(SEEING)}")
    train("ppo", tmp_path / "run", steps=64, set=(*changes, *env))
    card = published(tmp_path / "run", tmp_path / "policies/run", "--best")["card"]
    assert "# run\n\nA policy trained by rewards with Stable-Baselines3's PPO" in card
    steps = [line.split()[1] for line in card.splitlines() if line.startswith(("| demonst", "| clone", "| train"))]
    assert steps == ["training"]
    (line,) = (line for line in card.splitlines() if line.startswith("graspbox train sb3"))
    words = shlex.split(line)
    assert "env.reward=firm" in words
    assert "env.obs=[depth, proprio, tactile]" in words
    assert (tmp_path / "policies/run/LICENSE").is_file()
    assert not list((tmp_path / "policies/run").glob("*.pkl"))


def test_a_clone_of_a_hand_of_ones_own_is_recorded_and_published(tmp_path: Path) -> None:
    """A hand with fingers and without tactile sensors, by its files, which are gone when its policy acts."""
    from command_line import invoke

    files = own_hand(tmp_path / "own", "inspire")
    words = ["record", "expert", "--out", str(tmp_path / "shown"), "--hand", ",".join(files), "--obs", "proprio"]
    words += ["--objects", "procedural:can:0-9", "--split", "train", "--episodes", "10", "--keep", "success"]
    words += ["--set", "control_freq=5", "--set", "max_episode_steps=50"]
    invoke(words, catch_exceptions=False)
    changes = ("num_envs=2", "model.n_steps=32", "model.batch_size=32", "model.policy_kwargs={net_arch: [16]}")
    given = {"epochs": 2, "episodes": 2, "batch": 64, "set": changes, "obs": ("proprio",), "keep": "success"}
    clone(tmp_path / "shown", tmp_path / "clone", **given)
    found = published(tmp_path / "clone", tmp_path / "policies/copy")
    assert "observes `proprio`." in " ".join(found["card"].split())
    assert "for the hand `mine`" in " ".join(found["card"].split())
    (recorded,) = (line for line in found["card"].splitlines() if line.startswith("graspbox record"))
    words = shlex.split(recorded)
    assert words[words.index("--hand") + 1] == "out/a.urdf,out/a.toml"
    shutil.rmtree(tmp_path / "own")
    shutil.rmtree(tmp_path / "clone")
    folder = (tmp_path / "policies/copy").rename(tmp_path / "moved")
    result = evaluation.evaluate(str(folder), objects="procedural:bottle:2000-2003", trials=2)
    assert len(result.trials) == 2
    assert policies.load(folder).settings["hand"] == (str(folder / "hand.urdf"), str(folder / "hand.toml"))


def test_a_run_from_the_state_is_privileged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changes = ("num_envs=2", "steps=16", "model.learning_starts=8", "model.buffer_size=64", "model.batch_size=8",
               "env.objects=[procedural:can:0-9]", "model.policy_kwargs={net_arch: [16]}")  # fmt: skip
    train("sac", tmp_path / "run", env=DECISION, set=changes)
    found = published(tmp_path / "run", tmp_path / "policies/sac")
    assert "It is **privileged**: no sensor measures `state`" in " ".join(found["card"].split())
    assert "`graspbox/GraspPose-v0`" in found["card"]
    capsys.readouterr()
    for arguments, message in (
        ((tmp_path / "none",), "there is no run in"),
        ((tmp_path / "run", "--trials", "0"), "--trials is 0; give 1 to"),
        ((tmp_path / "run", "--objects", "procedural:chair"), "chair"),
    ):
        assert published(arguments[0], tmp_path / "x", *arguments[1:])["code"] == 2
        assert message in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    "wrong", [{"net_arch": ["a"]}, {"widths": [16]}, {"activation_fn": "Nothing"}, {"activation_fn": 3}]
)
def test_networks_that_the_folder_misdescribes_are_refused(tmp_path: Path, wrong: dict[str, Any]) -> None:
    """The policy itself does not read them."""
    env = {"obs": "state", "objects": OBJECTS}
    exported(tmp_path, trained("ppo", GRASP, env), "ppo", GRASP, env)
    content = json.loads((tmp_path / "config.json").read_text())
    content["network"]["policy_kwargs"] = wrong
    (tmp_path / "config.json").write_text(json.dumps(content))
    assert policies.load(str(tmp_path)).name == "tiny"
    with pytest.raises(errors.ConfigError, match=r"config\.json: network\.policy_kwargs is .*, which makes no policy"):
        export.load_graph(tmp_path)
