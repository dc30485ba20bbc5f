"""The adapters in ``scripts/adapters``, driven by the programs that they adapt to.

Each program counts the trials of one scripted grasp, which succeeds sometimes, and graspbox counts them too. The
programs need virtual environments of their own: ``make test-adapters`` and ``make test-lerobot``.
"""

import importlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import graspbox
from graspbox.evaluation import Evaluation, run_trials
from graspbox.policies import Task
from program_files import imported
from top_down import TopDown, TopDownGrasp

pytestmark = pytest.mark.filterwarnings("ignore")

ROOT = Path(__file__).parents[2]
ADAPTERS = ROOT / "scripts/adapters"
#: Keywords that an adapter must pass on: steps of 0.1 s.
CLOSED_LOOP: dict[str, Any] = {"control_freq": 10, "max_episode_steps": 100}
SERVE = """
import signal
from graspbox.tools.remote import EnvironmentServer, ServerSettings
with EnvironmentServer(ServerSettings(port=0, objects=("procedural",))) as server:
    print(server.url, flush=True)
    signal.pause()
"""


def needs(module: str, require: str, recipe: str) -> pytest.MarkDecorator:
    """Skip a test without a module, but not where it must be there: in its recipe."""
    missing = find_spec(module) is None and not os.environ.get(require)
    return pytest.mark.skipif(missing, reason=f"{module} has a virtual environment of its own: make {recipe}")


needs_openenv = needs("graspbox_openenv", "GRASPBOX_REQUIRE_ADAPTERS", "test-adapters")
needs_vla_eval = needs("graspbox_vla_eval", "GRASPBOX_REQUIRE_ADAPTERS", "test-adapters")
needs_lerobot = needs("lerobot_env_graspbox", "GRASPBOX_REQUIRE_LEROBOT", "test-lerobot")


def own_trials(env_id: str, seeds: Sequence[int], **keywords: Any) -> Evaluation:
    """Run trials in graspbox's own loop; some succeed, some fail."""
    envs = gymnasium.make_vec(
        env_id, 3, objects="procedural", obs=("state",), autoreset_mode=AutoresetMode.DISABLED, **keywords
    )
    policy = TopDown()
    policy.bind(Task.of(envs))
    found = run_trials(policy, envs, seeds)
    envs.close()
    assert 0.0 < found.rate < 1.0
    return found


@contextmanager
def running(command: list[str], line: str, **variables: str) -> Iterator[str]:
    """Run a server; gives the address in its first line of output that matches."""
    environment = {**os.environ, **variables}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        try:
            said = ""
            for text in process.stdout:
                said += text
                if found := re.search(line, text):
                    yield found[1]
                    break
            else:
                pytest.fail(said)
        finally:
            process.terminate()


def remote_server() -> Any:
    """Run graspbox's own server of environments."""
    return running([sys.executable, "-c", SERVE], r"^(ws://\S+)")


# --- OpenEnv ---------------------------------------------------------------------------------------------------------


def openenv_server(**variables: str) -> Any:
    """Run the server by its script."""
    command = [str(Path(sys.executable).with_name("server")), "--port", "0"]
    settings = {f"GRASPBOX_OPENENV_{name.upper()}": text for name, text in variables.items()}
    return running(command, r"running on (http://\S+)", PYTHONUNBUFFERED="1", **settings)


def openenv_trials(url: str, seeds: Sequence[int], control: str) -> list[tuple[bool, float]]:
    """Success and sum of rewards of each trial, by OpenEnv's client."""
    adapter = importlib.import_module("graspbox_openenv")
    found = []
    with adapter.GraspboxEnv(base_url=url).sync() as env:
        for seed in seeds:
            grasp, total = TopDownGrasp(control, control_freq=CLOSED_LOOP["control_freq"]), 0.0
            result = env.reset(seed=seed, episode_id=str(seed))
            while not result.done:
                state = adapter.decoded(result.observation.arrays["state"])
                result = env.step(adapter.GraspAction(values=grasp.act(state).tolist()))
                total += result.reward
            assert (env.state().episode_id, env.state().done) == (str(seed), True)
            assert env.state().is_success is result.observation.metadata["is_success"]
            found.append((env.state().is_success, total))
    return found


@needs_openenv
def test_openenv_accepts_the_folder_and_its_server() -> None:
    """``openenv validate``, of the folder and of the running server."""
    openenv = str(Path(sys.executable).with_name("openenv"))
    folder = [openenv, "validate", str(ADAPTERS / "openenv"), "--level", "static", "--skip-build", "--json"]
    report = json.loads(subprocess.run(folder, check=True, capture_output=True, text=True).stdout)
    assert report["verdict"] == "pass"
    with openenv_server() as url:
        running_server = [openenv, "validate", "--url", url, "--timeout", "30", "--json"]
        report = json.loads(subprocess.run(running_server, check=True, capture_output=True, text=True).stdout)
    assert report["passed"]
    assert not report["summary"]["failed_criteria"]


@needs_openenv
def test_openenv_client_counts_the_same_successes() -> None:
    seeds = range(1000, 1020)
    wanted = [(one.success, one.reward) for one in own_trials("graspbox/GraspPose-v0", seeds).trials]
    with openenv_server(obs="state") as url:
        assert openenv_trials(url, seeds, "grasp_pose") == wanted
    seeds, keywords = range(1009, 1015), {**CLOSED_LOOP, "reward": "dense"}
    wanted = [(one.success, one.reward) for one in own_trials("graspbox/Grasp-v0", seeds, **keywords).trials]
    settings = {"env_id": "graspbox/Grasp-v0", "obs": "proprio,state", "keywords": json.dumps(keywords)}
    with openenv_server(**settings) as url:
        assert openenv_trials(url, seeds, "twist") == wanted


@needs_openenv
@pytest.mark.parametrize("images", ["png", "raw"])
def test_openenv_arrays_are_those_of_the_environment(images: str) -> None:
    """Bit for bit, in two sessions at once, one of which began later; and the same on a server of environments."""
    adapter = importlib.import_module("graspbox_openenv")
    obs = ("depth", "proprio", "rgb", "segmentation", "voxels")
    env = gymnasium.make("graspbox/GraspPose-v0", objects="procedural", obs=obs)

    def check(client: Any, seed: int) -> None:
        arrays = client.reset(seed=seed).observation.arrays
        wanted, _ = env.reset(seed=seed)
        assert arrays.keys() == wanted.keys()
        assert arrays["rgb"].encoding == arrays["segmentation"].encoding == images
        for name, array in wanted.items():
            found = adapter.decoded(arrays[name])
            assert (found.dtype, found.shape) == (array.dtype, array.shape)
            assert (found == array).all()

    settings = {"obs": ",".join(obs), "images": images}
    with (
        remote_server() as remote,
        openenv_server(**settings) as near,
        openenv_server(**settings, remote=remote) as far,
    ):
        for url in (near, far):
            with adapter.GraspboxEnv(base_url=url).sync() as one, adapter.GraspboxEnv(base_url=url).sync() as two:
                check(one, 5)
                check(two, 6)
                check(one, 7)


@needs_openenv
def test_openenv_errors_say_what_is_wrong() -> None:
    adapter = importlib.import_module("graspbox_openenv")
    with openenv_server() as url, adapter.GraspboxEnv(base_url=url).sync() as env:
        with pytest.raises(RuntimeError, match="did you mean 'friction'"):
            env.reset(seed=0, options={"frictoin": 0.5})
        with pytest.raises(RuntimeError, match="no argument 'object'"):
            env.reset(seed=0, object="mug-000000")
        result = env.reset(seed=0, options={"object": 3, "friction": 0.5})
        assert not result.observation.truncated
        result = env.step(adapter.GraspAction(values=[0.0] * env.state().action_size))
        assert result.done
        with pytest.raises(RuntimeError, match="call reset"):
            env.step(adapter.GraspAction(values=[0.0] * 10))
    settings = importlib.import_module("graspbox_openenv.server.settings").ServerSettings
    with pytest.raises(ValueError, match="there is no variable GRASPBOX_OPENENV_OBJECT;"):
        settings.from_environment({"GRASPBOX_OPENENV_OBJECT": "ycb"})


# --- vla-eval --------------------------------------------------------------------------------------------------------


@needs_vla_eval
@pytest.mark.parametrize("env_id", ["graspbox/Grasp-v0", "graspbox/GraspPose-v0"])
def test_vla_eval_counts_the_same_successes(env_id: str, tmp_path: Path) -> None:
    """Its whole loop: a model server, the orchestrator, the recording and its export."""
    vla_eval: Any = importlib.import_module("vla_eval")
    predict: Any = importlib.import_module("vla_eval.model_servers.predict")
    specs: Any = importlib.import_module("vla_eval.specs")
    closed_loop = env_id == "graspbox/Grasp-v0"
    control, control_freq = "delta_pose" if closed_loop else "grasp_pose", CLOSED_LOOP["control_freq"]

    class Server(predict.PredictModelServer):  # type: ignore[misc]
        def predict(self, obs: dict[str, Any], ctx: Any) -> dict[str, Any]:
            assert obs["images"]["rgb"].dtype == np.uint8
            assert obs["images"]["rgb"].shape == (32, 32, 3)
            assert obs["state"].shape == (28,)
            assert obs["task_description"] == "Grasp the object and lift it."
            if ctx.is_first:
                self.grasp = TopDownGrasp(control, control_freq=control_freq)
            return {"actions": self.grasp.act(obs["environment_state"])}

        def get_action_spec(self) -> dict[str, Any]:
            return {"action": specs.DimSpec("action", 8 if closed_loop else 10, f"graspbox_{control}", (-1.0, 1.0))}

        def get_observation_spec(self) -> dict[str, Any]:
            return {"image": specs.IMAGE_RGB, "language": specs.LANGUAGE}

    keywords: dict[str, Any] = {"image_size": 32}
    if closed_loop:
        keywords |= {"control": control, "control_freq": control_freq}
    obs = ["rgb", "proprio", "state"]
    params = {"env_id": env_id, "objects": "procedural", "obs": obs, "seed": 7, "keywords": keywords}
    if closed_loop:
        params["max_episode_steps"] = CLOSED_LOOP["max_episode_steps"]
    name = "graspbox_vla_eval:GraspboxBenchmark"
    config = {"benchmarks": [{"benchmark": name, "episodes_per_task": 12, "params": params}]}
    (found,) = vla_eval.evaluate(Server(), config, output_dir=tmp_path, docker=False)
    settings: dict[str, Any] = {**CLOSED_LOOP, "control": control} if closed_loop else {}
    own = graspbox.evaluation.evaluate(TopDown(), env_id, "procedural", trials=12, seed=7, **settings)
    assert 0.0 < own.rate < 1.0
    episodes = found["tasks"][0]["episodes"]
    assert [(one["metrics"]["success"], one["metrics"]["secure"], one["steps"]) for one in episodes] == [
        (one.success, one.secure, one.steps) for one in own.trials
    ]
    assert [one["metrics"]["object"] for one in episodes] == [one.object for one in own.trials]
    assert found["mean_success"] == pytest.approx(own.rate, abs=1e-4)
    assert found["num_errors"] == 0


# --- LeRobot ---------------------------------------------------------------------------------------------------------


def lerobot_eval(out: Path, *arguments: str, episodes: int = 14) -> dict[str, Any]:
    """Run the real ``lerobot-eval`` with the policy of `lerobot_policy_top_down`; returns its output."""
    command = [
        str(Path(sys.executable).with_name("lerobot-eval")),
        "--env.type=graspbox",
        "--env.picture_size=[48,64]",
        "--env.image_size=32",
        "--policy.discover_packages_path=lerobot_policy_top_down",
        "--policy.type=top_down",
        "--policy.device=cpu",
        "--policy.push_to_hub=false",
        f"--eval.n_episodes={episodes}",
        "--eval.batch_size=3",
        f"--output_dir={out}",
        "--seed=1006",
        *arguments,
    ]
    variables = {"PYTHONPATH": str(Path(__file__).parent), "HF_HUB_OFFLINE": "1"}
    result = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **variables})
    assert result.returncode == 0, result.stderr[-4000:]
    found: dict[str, Any] = json.loads((out / "eval_info.json").read_text())
    return found


def check_counts(found: dict[str, Any], own: Evaluation) -> None:
    """Compare every episode, and the rate, with graspbox's own."""
    metrics = found["per_task"][0]["metrics"]
    assert metrics["successes"] == [one.success for one in own.trials]
    assert metrics["sum_rewards"] == pytest.approx([one.reward for one in own.trials])
    assert found["overall"]["pc_success"] == pytest.approx(100 * own.rate)


@needs_lerobot
def test_lerobot_eval_counts_the_same_successes_in_closed_loop(tmp_path: Path) -> None:
    """Episodes of different lengths side by side, with videos and dense rewards, 14 of them in batches of 3."""
    found = lerobot_eval(
        tmp_path,
        "--env.task=Grasp-v0",
        "--env.obs=[rgb,rgb_palm,depth,proprio,state,tactile]",
        "--env.control_freq=10",
        "--env.episode_length=100",
        "--env.keywords={reward: dense}",
        "--policy.control_freq=10",
    )
    own = own_trials("graspbox/Grasp-v0", range(1006, 1020), reward="dense", **CLOSED_LOOP)
    assert len({one.steps for one in own.trials}) > 3
    check_counts(found, own)
    assert len(list(tmp_path.glob("videos/*/*.mp4"))) == 10


@needs_lerobot
def test_lerobot_eval_counts_the_same_successes_of_decisions(tmp_path: Path) -> None:
    with remote_server() as remote:
        found = lerobot_eval(
            tmp_path,
            "--env.task=GraspPose-v0",
            "--env.obs=[rgb,state]",
            f"--env.remote={remote}",
            "--policy.control=grasp_pose",
        )
    check_counts(found, own_trials("graspbox/GraspPose-v0", range(1006, 1020)))


@needs_lerobot
def test_lerobot_records_what_it_evaluates(tmp_path: Path) -> None:
    lerobot_eval(
        tmp_path,
        "--env.obs=[rgb,proprio,state]",
        "--env.control_freq=10",
        "--env.episode_length=100",
        "--policy.control_freq=10",
        "--eval.recording=true",
        episodes=3,
    )
    infos = [json.loads(path.read_text()) for path in sorted(tmp_path.glob("recordings/*/env_*/meta/info.json"))]
    own = own_trials("graspbox/Grasp-v0", range(1006, 1020), **CLOSED_LOOP).trials[:3]
    assert [(info["fps"], info["total_frames"]) for info in infos] == [(10, one.steps) for one in own]
    names = {"observation.images.rgb", "agent_pos", "environment_state"}
    assert all(names <= info["features"].keys() for info in infos)


@needs_lerobot
def test_lerobot_makes_environments_of_a_hub_file() -> None:
    """LeRobot's use of a downloaded ``env.py``, without the download."""
    from lerobot.envs import utils

    module = imported(ADAPTERS / "lerobot/env.py")
    raw = utils._call_make_env(module, n_envs=2, use_async_envs=True, cfg=None)
    ((suite, envs),) = utils._normalize_hub_result(raw).items()
    assert (suite, envs[0].num_envs) == ("graspbox", 2)
    observation, _ = envs[0].reset(seed=[3, 4], options={"lerobot_new_rollout": True})
    wanted, _ = gymnasium.make("graspbox/Grasp-v0", obs=("rgb", "proprio"), image_size=96).reset(seed=4)
    assert (observation["pixels"]["rgb"][1] == wanted["rgb"]).all()
    assert (observation["agent_pos"][1] == wanted["proprio"]).all()
    assert envs[0].observation_space.contains(observation)
    utils.close_envs(raw)


@needs_lerobot
def test_lerobot_depth_is_that_of_exported_data_sets() -> None:
    """Channel first, millimetres, under the key that the export writes."""
    from lerobot.envs import preprocess_observation

    adapter = importlib.import_module("lerobot_env_graspbox")
    (envs,) = adapter.GraspboxEnv(obs=["depth", "depth_palm"], image_size=32).create_envs(2)["graspbox"].values()
    observation, _ = envs.reset(seed=3)
    found = preprocess_observation(observation)["observation.images.depth"].numpy()
    wanted, _ = gymnasium.make("graspbox/Grasp-v0", obs=("depth",), image_size=32).reset(seed=4)
    assert found.shape == (2, 1, 32, 32)
    assert found[1, 0] == pytest.approx(1000 * wanted["depth"][..., 0])
    envs.close()
