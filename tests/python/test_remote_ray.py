"""Environment servers on a Ray cluster of two nodes: the same bits as in this process, also when a server dies."""

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
from graspbox.errors import ConfigError, MissingExtraError, ObjectSetError
from graspbox.remote import RayServers, ray_servers
from graspbox.remote.ray_cluster import _places

KEYWORDS: dict[str, Any] = {
    "objects": "procedural:can:0-3",
    "obs": ("proprio", "depth"),
    "image_size": 16,
    "max_episode_steps": 6,
}
QUICK = RemoteConfig(reconnect="restore", grace=2.0, checkpoint=3)


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


def rollout(env: Any, steps: int, kill: Any = None) -> list[tuple[str, NDArray[Any]]]:
    """Every array of a few episodes; `kill` is called after four steps."""
    actions = np.random.default_rng(0).uniform(-0.5, 0.5, (steps, *env.action_space.shape)).astype(np.float32)
    observation, _ = env.reset(seed=5)
    seen = list(observation.items())
    for step, action in enumerate(actions):
        if step == 4 and kill is not None:
            kill()
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
    code = "import sys, graspbox.remote as remote; remote.ray_servers; assert 'ray' not in sys.modules"
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
@pytest.mark.parametrize("servers", [1, 2])
def test_a_server_that_dies_changes_nothing(cluster: Any, expected: Any, servers: int) -> None:
    """Its environments continue on the other server, or on the one that Ray starts in its place."""
    remote = RemoteConfig(reconnect="restore", grace=60.0 if servers == 1 else 2.0, checkpoint=3)
    env = ray_servers(5, servers=servers, cpus_per_server=1, remote=remote, **KEYWORDS)
    url = env.servers.remote.urls[-1]
    actor = env.servers._actors[-1]
    process, _ = where(cluster, actor)
    assert same(rollout(env, 14, kill=lambda: os.kill(process, signal.SIGKILL)), expected)
    # Ray restarts it where it was.
    assert cluster.get(actor.url.remote(), timeout=60) == url
    env.close()


@pytest.mark.train
@pytest.mark.filterwarnings("ignore")
def test_a_server_that_is_gone_for_good_changes_nothing(cluster: Any, expected: Any) -> None:
    env = ray_servers(5, cpus_per_server=1, remote=QUICK, **KEYWORDS)
    kill = env.servers._actors[0]
    assert same(rollout(env, 14, kill=lambda: cluster.kill(kill, no_restart=True)), expected)
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
