"""Environment servers on a Ray cluster of two nodes: the same bits as in this process."""

import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox.envs.remote_config import RemoteConfig
from graspbox.errors import ConfigError, ConnectionLostError, MissingExtraError, ObjectSetError
from graspbox.tools.remote import RayServers, ray_servers
from graspbox.tools.remote.ray_cluster import _places

KEYWORDS: dict[str, Any] = {
    "objects": "procedural:can:0-3",
    "obs": ("proprio", "depth"),
    "image_size": 16,
    "max_episode_steps": 6,
}


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two nodes of two CPUs."""
    ray = pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 2, "include_dashboard": False})
    nodes.add_node(num_cpus=2)
    ray.init(address=nodes.address, log_to_driver=False)
    yield ray
    ray.shutdown()
    nodes.shutdown()


def rollout(env: Any, steps: int) -> list[tuple[str, NDArray[Any]]]:
    """Every array of a few episodes."""
    actions = np.random.default_rng(0).uniform(-0.5, 0.5, (steps, *env.action_space.shape)).astype(np.float32)
    observation, _ = env.reset(seed=5)
    seen = list(observation.items())
    for action in actions:
        observation, rewards, terminated, truncated, _ = env.step(action)
        seen += [*observation.items(), ("reward", rewards), ("terminated", terminated), ("truncated", truncated)]
    return seen


def same(ours: list[tuple[str, NDArray[Any]]], theirs: list[tuple[str, NDArray[Any]]]) -> bool:
    return len(ours) == len(theirs) and all(
        name == other and one.dtype == two.dtype and one.tobytes() == two.tobytes()
        for (name, one), (other, two) in zip(ours, theirs, strict=True)
    )


@pytest.fixture(scope="module")
def expected() -> list[tuple[str, NDArray[Any]]]:
    return rollout(gymnasium.make_vec("graspbox/Grasp-v0", num_envs=5, **KEYWORDS), 14)


def where(ray: Any, actor: Any) -> tuple[int, str]:
    """Process and node of an actor."""
    found: tuple[int, str] = ray.get(
        actor.__ray_call__.remote(lambda _: (os.getpid(), ray.get_runtime_context().get_node_id()))
    )
    return found


def dead(ray: Any, actor: Any) -> bool:
    """Whether an actor ends within half a minute."""
    for _ in range(300):
        try:
            ray.get(actor.url.remote(), timeout=30)
        except ray.exceptions.RayActorError:
            return True
        time.sleep(0.1)
    return False


def test_importing_the_package_does_not_import_ray() -> None:
    code = "import sys, graspbox.tools.remote as remote; remote.ray_servers; assert 'ray' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_without_ray_an_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingExtraError, match=r"graspbox\[ray\]"):
        RayServers()


def test_servers_are_dealt_out_to_the_nodes() -> None:
    nodes = [{"NodeID": name, "Alive": True, "Resources": {"CPU": cpus}} for name, cpus in (("b", 4.0), ("a", 8.0))]
    nodes.append({"NodeID": "c", "Alive": False, "Resources": {"CPU": 9.0}})
    nodes.append({"NodeID": "d", "Alive": True, "Resources": {}})
    assert _places(nodes, None, None) == [("a", 8), ("b", 4)]
    assert _places(nodes, 3, None) == [("a", 4), ("b", 4), ("a", 4)]
    assert _places(nodes, 1, 3) == [("a", 3)]
    for servers, cpus, sentence in ((0, None, "at least 1"), (2, 5, "do not fit"), (20, None, "do not fit")):
        with pytest.raises(ConfigError, match=sentence):
            _places(nodes, servers, cpus)
    with pytest.raises(ConfigError, match="no node"):
        _places(nodes[2:], None, None)


@pytest.mark.train
@pytest.mark.filterwarnings("ignore")
def test_results_are_those_of_this_process(cluster: Any, expected: Any) -> None:
    env = ray_servers(5, cpus_per_server=1, **KEYWORDS)
    assert len(env.servers.remote.urls) == 2
    assert same(rollout(env, 14), expected)
    actors = list(env.servers._actors)
    env.close()
    assert all(dead(cluster, actor) for actor in actors)


@pytest.mark.train
@pytest.mark.filterwarnings("ignore")
def test_servers_are_on_both_nodes_and_know_a_token(cluster: Any) -> None:
    with RayServers(cpus_per_server=1) as servers:
        assert len({where(cluster, actor)[1] for actor in servers._actors}) == 2
        token = servers.remote.token()
        assert token is not None
        assert token not in repr(servers.remote)
        url = servers.remote.urls[0].replace("ws", "http", 1) + "/metrics"
        with pytest.raises(urllib.error.HTTPError, match="401"):
            urllib.request.urlopen(url)
        request = urllib.request.Request(url, headers={"Authorization": f"Bearer {token}"})
        assert urllib.request.urlopen(request).status == 200
        two = [gymnasium.make_vec("graspbox/Grasp-v0", 2, remote=servers.remote, **KEYWORDS) for _ in range(2)]
        assert same(*(rollout(env, 2) for env in two))


@pytest.mark.train
@pytest.mark.filterwarnings("ignore")
def test_a_server_that_dies_is_restarted_at_its_address(cluster: Any, expected: Any) -> None:
    """Its environments are lost, and the error says so; new ones have the same bits."""
    env = ray_servers(5, cpus_per_server=1, remote=RemoteConfig(grace=2.0), **KEYWORDS)
    url, actor = env.servers.remote.urls[-1], env.servers._actors[-1]
    env.reset(seed=5)
    os.kill(where(cluster, actor)[0], signal.SIGKILL)
    with pytest.raises(ConnectionLostError, match=f"{url}.*environments 2 to 4 are on it"):
        env.reset(seed=5)
    assert cluster.get(actor.url.remote(), timeout=60) == url
    again = gymnasium.make_vec("graspbox/Grasp-v0", 5, remote=env.servers.remote, **KEYWORDS)
    assert same(rollout(again, 14), expected)
    env.close()


@pytest.mark.train
@pytest.mark.filterwarnings("ignore")
def test_what_cannot_be_made_leaves_no_actor(cluster: Any) -> None:
    with pytest.raises(ObjectSetError):
        ray_servers(2, objects="procedural:nothing", cpus_per_server=1)
    with pytest.raises(ConfigError, match="do not fit"):
        ray_servers(2, cpus_per_server=3)
    # All CPUs are free again.
    ray_servers(2, **KEYWORDS).close()
