"""The programs in ``scripts/examples`` run unchanged."""

import importlib
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
import pytest

from graspbox.policies.grasp_image import ImageGrasper
from graspbox.tools.remote import EnvironmentServer, ServerSettings
from graspbox.tools.remote.grasp_requests import decide
from graspbox.tools.remote.policy_serving import PolicyServer, PolicyServerSettings
from program_files import imported

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "scripts/examples"
TOKEN = "a-token-of-some-length"


def need(module: str, why_not: str) -> None:
    """Skip a test without a module, but where it must be there (`make test-examples`)."""
    if os.environ.get("GRASPBOX_REQUIRE_EXAMPLES"):
        importlib.import_module(module)
    else:
        pytest.importorskip(module, reason=why_not)


def example(name: str) -> ModuleType:
    """Import a program without running it."""
    return imported(EXAMPLES / f"{name}.py")


@pytest.mark.train
def test_cleanrl_style_ppo(capsys: pytest.CaptureFixture[str]) -> None:
    """A few updates, over ends of episodes."""
    pytest.importorskip("torch")
    example("cleanrl_ppo").main(
        "graspbox/Grasp-v0",
        ["procedural:can:0-9"],
        steps=3 * 4 * 30,
        num_envs=4,
        rollout=30,
        learning_rate=5e-4,
        seed=0,
    )
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert lines[-1].startswith("360 steps, return ")
    assert "return nan" in lines[0]
    assert "nan" not in lines[-1]


@pytest.mark.train
def test_its_advantages_are_those_of_the_definition() -> None:
    """Sums of temporal differences, discounted, that stop where an episode does."""
    torch = pytest.importorskip("torch")
    program = example("cleanrl_ppo")
    rewards, values, after = torch.rand(3, 6, 1).unbind(0)
    dones = torch.tensor([0.0, 0, 1, 0, 0, 0])[:, None]
    found = program.advantages(rewards, values, after, dones)
    delta = rewards + program.GAMMA * after - values
    for t in range(6):
        end = 2 if t <= 2 else 5
        wanted = sum((program.GAMMA * program.LAMBDA) ** (k - t) * delta[k] for k in range(t, end + 1))
        torch.testing.assert_close(found[t], wanted)


@pytest.mark.filterwarnings("ignore")
def test_torchrl_trains() -> None:
    need("torchrl", "TorchRL is in no extra; the example says how to install it")
    program = example("torchrl_ppo")
    first, second = (program.main(5120, 16, ["procedural:can:0"], seed) for seed in (1, 1))
    assert first == second
    assert len(first) > 3
    assert all(0 <= rate <= 1 for rate in first.values())


def test_a_planner_on_distance_fields_clears_objects() -> None:
    """It sees no mesh, and lifts things in most attempts."""
    found = example("clear_with_your_planner").main("packed", rounds=3)
    assert found.policy == "your_planner"
    assert found.success_rate > 0.3
    assert found.cleared.sum() >= 3


@pytest.fixture
def ray_of_its_own() -> Iterator[None]:
    """Start Ray here, so that no test joins another one's cluster."""
    need("ray.rllib", "RLlib pins another Gymnasium; it has an extra of its own, rllib")
    ray = importlib.import_module("ray")
    ray.init(address="local", include_dashboard=False, log_to_driver=False)
    yield
    ray.shutdown()


@pytest.mark.filterwarnings("ignore")
def test_rllib_trains(ray_of_its_own: None) -> None:
    example("rllib_ppo").main(iterations=1, runners=0)


@pytest.mark.filterwarnings("ignore")
def test_rllib_trains_on_servers_of_a_cluster(ray_of_its_own: None, capsys: pytest.CaptureFixture[str]) -> None:
    example("rllib_remote").main(iterations=1, runners=0)
    said = capsys.readouterr().out
    assert re.search(r"servers: ws://\S+:\d+\n", said)
    assert re.search(r"steps [1-9]\d+\.?0? return", said)


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path, list[str], dict[str, Any]]]:
    """Run a server of the depth policy; its address, an image of a can, four intrinsics, and the answer to it."""
    pytest.importorskip("onnxruntime")
    env = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:can:0", obs="depth", image_size=(120, 160))
    image, _ = env.reset(seed=3)
    lens, _ = next(iter(env.unwrapped.cameras().values()))  # type: ignore[attr-defined]
    depth = (image[..., 0] * 1000).astype(np.uint16)
    folder, policy = tmp_path_factory.mktemp("image"), ROOT / "policies/depth"
    np.save(folder / "depth.npy", depth)
    depth.tofile(folder / "depth.raw")
    numbers = [repr(float(lens[entry])) for entry in ((0, 0), (1, 1), (0, 2), (1, 2))]
    expected = decide(ImageGrasper(policy), {"depth": depth, "intrinsics": lens})
    with PolicyServer(policy, PolicyServerSettings(port=0, token=TOKEN)) as server:
        yield server.url.replace("ws", "http", 1), folder, numbers, expected


def run(command: list[str], **variables: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(command, capture_output=True, text=True, env={**os.environ, **variables})


def test_a_robot_without_graspbox_gets_grasps(asked: tuple[str, Path, list[str], dict[str, Any]]) -> None:
    url, folder, lens, expected = asked
    program = str(EXAMPLES / "robot_grasps.py")
    start = "import runpy, sys; sys.modules['graspbox'] = None; sys.argv = sys.argv[1:]; "
    start += "runpy.run_path(sys.argv[0], run_name='__main__')"
    command = [sys.executable, "-c", start, program, str(folder / "depth.npy"), *lens, "--url", url]
    found = run(command, GRASPBOX_TOKEN=TOKEN)
    assert found.returncode == 0, found.stderr
    lines = found.stdout.splitlines()
    assert len(lines) == 5
    assert lines[0].startswith(
        f"success {expected['success'][0]:.2f}: position {np.round(expected['position'][0], 4)} m"
    )
    assert run(command, GRASPBOX_TOKEN="").stderr.startswith(f"{url} answers 401")


@pytest.mark.skipif(shutil.which("curl") is None, reason="needs curl")
def test_curl_gets_grasps(asked: tuple[str, Path, list[str], dict[str, Any]]) -> None:
    url, folder, lens, expected = asked
    command = ["sh", str(EXAMPLES / "grasps.sh"), str(folder / "depth.raw"), "120", "160", *lens]
    found = run(command, GRASPBOX_TOKEN=TOKEN, GRASPBOX_URL=url)
    assert found.returncode == 0, found.stderr
    np.testing.assert_array_equal(json.loads(found.stdout)["camera_from_hand"], expected["camera_from_hand"])
    assert "401" in run(command, GRASPBOX_TOKEN="", GRASPBOX_URL=url).stderr


def test_an_agent_in_rust_steps_an_environment_of_this_process() -> None:
    """The sum of its rewards is that of the same actions here."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    program = target / "release/examples/remote_env"
    if not program.is_file():
        pytest.skip("cargo test --release builds it")
    with EnvironmentServer(ServerSettings(port=0, token=TOKEN)) as server:
        found = run([str(program), server.url, "6"], GRASPBOX_TOKEN=TOKEN)
        refused = run([str(program), server.url, "6"], GRASPBOX_TOKEN="another-token-of-some-length")
    assert found.returncode == 0, found.stderr
    env = gymnasium.make("graspbox/Grasp-v0", objects="procedural:can:0-9", reward="dense", max_episode_steps=150)
    env.reset(seed=7)
    state, total = 1, 0.0
    for _ in range(6):
        numbers = []
        for _ in range(len(env.action_space.sample())):
            state = (state * 6_364_136_223_846_793_005 + 1_442_695_040_888_963_407) % 2**64
            numbers.append((state >> 40) / 2**23 - 1)
        total += float(env.step(np.array(numbers, dtype=np.float32))[1])
    assert found.stdout.splitlines()[-1] == f"6 steps, return {total:.6f}"
    assert refused.returncode == 1
    assert "401" in refused.stderr
