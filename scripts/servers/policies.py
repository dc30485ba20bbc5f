"""Measurements of a server of policies: grasps for images, actions for observations."""

import sys
import time
from functools import partial
from typing import Any

import gymnasium
import numpy as np

import graspbox  # noqa: F401 (registers the environments)
from graspbox import _core
from servers.measuring import Args, at_once
from servers.processes import served


def connect(url: str) -> Any:
    """Connect a client."""
    return _core.PolicyClient(url, token=None, ca=None)


def is_named(args: Args, part: str) -> bool:
    """Whether there is a policy to measure."""
    if not args.policy:
        print(f"{part}: left out, name a folder with --policy", file=sys.stderr)
    return bool(args.policy)


def policy(args: Args) -> None:
    """Measure grasps for an image of 480 x 640: the overhead of the wire, and eight clients at once against one."""
    if not is_named(args, "policy"):
        return
    env = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:mug:0", obs="depth", image_size=(480, 640))
    image, _ = env.reset(seed=1)
    intrinsics, pose = next(iter(env.unwrapped.cameras().values()))  # type: ignore[attr-defined]
    request = {"depth": (image[..., 0] * 1000).astype(np.uint16), "intrinsics": intrinsics, "camera_pose": pose}
    with served(args.policy, command="serve-policy") as server:
        peers, beyond = [connect(server.url) for _ in range(8)], []

        def decide(client: Any, count: int) -> None:
            for _ in range(count):
                started = time.perf_counter()
                client.send(request)
                answer = client.receive()
                seconds = time.perf_counter() - started
                beyond.append(1e3 * seconds - answer["server_timing"]["infer_ms"])

        decide(peers[0], 24)
        args.add("grasps for 480 x 640, beyond the decision", beyond[4:], "ms")
        work = {"one client": partial(at_once, decide, peers[:1], 16)}
        args.compare("decisions/s", {**work, "eight clients": partial(at_once, decide, peers, 16)})


def acting(args: Args) -> None:
    """Measure actions for observations: the first one of a connection, and eight clients at once against one."""
    if not is_named(args, "acting"):
        return
    with served(args.policy, command="serve-policy") as server:
        hello: Any = connect(server.url).metadata
        made = {"objects": "procedural:mug:0", "obs": hello["observations"], **hello["settings"]}
        seen, _ = gymnasium.make(hello["environment"], **made).reset(seed=1)
        request = {name: np.ascontiguousarray(value) for name, value in seen.items()}

        def first() -> float:
            started = time.perf_counter()
            client = connect(server.url)
            client.send({**request, "reset": True})
            client.receive()
            return 1e3 * (time.perf_counter() - started)

        args.add(f"first answer of a connection: {hello['policy']}", [first() for _ in range(3 * args.runs)], "ms")
        peers, inferring = [connect(server.url) for _ in range(8)], []

        def act(client: Any, count: int) -> None:
            for _ in range(count):
                client.send(request)
                inferring.append(client.receive()["server_timing"]["infer_ms"])

        work = {"one client": partial(at_once, act, peers[:1], 1600)}
        args.compare(f"actions/s, {hello['policy']}", {**work, "eight clients": partial(at_once, act, peers, 1600)})
        act(peers[0], 400)
        args.add("of an answer, in the policy itself", inferring[-400:], "ms")
