"""Features extractors: shapes, values that reach the network, gradients, and learning. Needs the extra ``train``."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box

from graspbox.errors import ConfigError

pytestmark = [pytest.mark.train, pytest.mark.usefixtures("one_thread")]

sb3 = pytest.importorskip("stable_baselines3")
torch = pytest.importorskip("torch")

ID = "graspbox/Grasp-v0"
IMAGES = ("rgb", "depth", "rgbd", "segmentation", "points", "voxels")


def make(obs: Any, **settings: Any) -> Any:
    from graspbox.sb3 import VecEnv

    return VecEnv.make(ID, 4, objects=("procedural:can:0", "procedural:box:0"), obs=obs, image_size=32, **settings)


def policy_of(env: Any) -> Any:
    """Make a policy as PPO does: with its wrappers, its preparation of images, and the extractor."""
    from graspbox.sb3 import Extractor

    kind = "MultiInputPolicy" if isinstance(env.observation_space, gymnasium.spaces.Dict) else "MlpPolicy"
    settings = {"features_extractor_class": Extractor, "features_extractor_kwargs": {"features": 24}}
    return sb3.PPO(kind, env, policy_kwargs=settings, n_steps=4, batch_size=8, seed=0, device="cpu")


@pytest.mark.parametrize("obs", IMAGES)
def test_it_learns_to_tell_starts_apart(obs: str) -> None:
    """Overfits 8 pictures: gradients reach every parameter, and differences of the pictures reach the features."""
    env = make(obs)
    env.seed(0)
    seen = np.concatenate([env.reset(), env.reset()])
    model = policy_of(env)
    prepared, _ = model.policy.obs_to_tensor(seen)
    extractor = model.policy.features_extractor
    head = torch.nn.Linear(24, 3)
    wanted = torch.as_tensor(np.random.default_rng(0).normal(size=(8, 3)), dtype=torch.float32)
    optimizer = torch.optim.Adam([*extractor.parameters(), *head.parameters()], lr=3e-3)
    for step in range(800):
        features = model.policy.extract_features(prepared, extractor)
        assert features.shape == (8, 24)
        loss = ((head(features) - wanted) ** 2).mean()
        optimizer.zero_grad()
        loss.backward()
        if step == 0:
            first = loss.item()
            assert all(p.grad is not None and (p.grad != 0).any() for p in extractor.parameters())
        optimizer.step()
        if loss.item() < 0.1 * first:
            return
    raise AssertionError(f"the loss fell from {first} to {loss.item()} only")


@pytest.mark.parametrize("obs", [IMAGES, ("proprio", "depth", "voxels"), "state"])
def test_ppo_takes_it(obs: Any) -> None:
    env = make(obs, max_episode_steps=5)
    model = policy_of(env).learn(32)
    space = env.observation_space
    vectors = sum(s.shape[0] for s in getattr(space, "spaces", {"": space}).values() if len(s.shape) == 1)
    images = sum(len(s.shape) > 1 for s in getattr(space, "spaces", {"": space}).values())
    assert model.policy.features_dim == vectors + 24 * images
    actions, _ = model.predict(env.reset(), deterministic=True)
    assert actions.shape == (4, *env.action_space.shape)


def test_off_policy_takes_it() -> None:
    from graspbox.sb3 import Extractor

    env = make(("proprio", "depth"), max_episode_steps=5)
    policy = {"features_extractor_class": Extractor, "net_arch": [16]}
    model = sb3.SAC(
        "MultiInputPolicy", env, policy_kwargs=policy, buffer_size=64, learning_starts=8, batch_size=8, device="cpu"
    )
    assert model.learn(24).num_timesteps == 24


def test_what_the_networks_see() -> None:
    """Depth and rgbd in [0, 1], colours as they come, one channel for each label, in the image's own layout."""
    from graspbox.sb3.extractors import ImageNet, VoxelNet

    depth = ImageNet(Box(0, 2, (16, 20, 1), np.float32), 8).unit
    picture = torch.rand(2, 16, 20, 1)
    torch.testing.assert_close(depth(picture), picture.permute(0, 3, 1, 2) / 2)
    high = np.broadcast_to(np.array([1, 1, 1, 2], dtype=np.float32), (16, 20, 4))
    rgbd = ImageNet(Box(np.zeros_like(high), high, dtype=np.float32), 8).unit
    torch.testing.assert_close(rgbd(torch.as_tensor(high.copy())[None]), torch.ones(1, 4, 16, 20))
    first = ImageNet(Box(0, 255, (3, 16, 20), np.uint8), 8).unit
    colour = torch.rand(2, 3, 16, 20)
    torch.testing.assert_close(first(colour), colour)
    labels = ImageNet(Box(0, 11, (16, 20, 1), np.uint8), 8).unit
    picture = torch.randint(0, 12, (2, 16, 20, 1)).float()
    assert labels.channels == 12
    assert (labels(picture).argmax(1) == picture[..., 0]).all()
    assert (labels(picture).sum(1) == 1).all()
    voxels = VoxelNet(Box(0, 2, (8, 8, 8), np.uint8), 8).unit
    cube = torch.randint(0, 3, (2, 8, 8, 8)).float()
    assert (voxels(cube).argmax(1) == cube).all()


def test_points_come_in_any_order_and_missing_ones_do_not_count() -> None:
    from graspbox.sb3.extractors import PointNet

    space = Box(np.full((50, 3), -1, np.float32), np.full((50, 3), 1, np.float32))
    net = PointNet(space, 8)
    cloud = torch.rand(1, 50, 3) - 0.5
    found = net(cloud)
    torch.testing.assert_close(net(cloud[:, torch.randperm(50)]), found)
    torch.testing.assert_close(net(torch.cat([cloud, torch.zeros(1, 30, 3)], dim=1)), found)
    assert not torch.allclose(net(cloud * 0.5), found)
    assert torch.isfinite(net(torch.zeros(1, 50, 3))).all()


def test_voxels_with_channels_are_scaled_by_their_bounds() -> None:
    from graspbox.sb3.extractors import VolumeNet, network

    net, size = network(Box(0, 255, (4, 12, 16, 8), np.uint8), 24)
    assert isinstance(net, VolumeNet)
    assert size == 24
    seen = torch.randint(0, 256, (3, 4, 12, 16, 8)).float()
    found = net(seen)
    assert found.shape == (3, 24)
    torch.testing.assert_close(found, net.net(seen / 255))
    found.sum().backward()
    assert all(parameter.grad is not None and parameter.grad.any() for parameter in net.parameters())
    # No channel and no layer is left out.
    for place in ((0, 0), (3, 11)):
        other = seen.clone()
        other[:, *place] = 255.0 - other[:, *place]
        assert not torch.allclose(net(other), found)


@pytest.mark.parametrize(
    ("space", "message"),
    [
        (gymnasium.spaces.Discrete(3), "no network"),
        (Box(0, 1, (20, 30, 40), np.float32), "no network"),
        (Box(0, 1, (20, 8, 8, 8), np.float32), "no network"),
        (Box(0, 1, (2, 8, 8, 8, 8), np.float32), "no network"),
        (Box(0, np.inf, (2, 8, 8, 8), np.float32), "finite"),
        (Box(0, np.inf, (16, 16, 1), np.float32), "finite"),
        (gymnasium.spaces.Dict({"a": gymnasium.spaces.Dict({})}), "no network"),
    ],
)
def test_other_spaces_are_refused(space: Any, message: str) -> None:
    from graspbox.sb3 import Extractor

    with pytest.raises(ConfigError, match=message):
        Extractor(space)
    with pytest.raises(ConfigError, match="at least 1"):
        Extractor(Box(0, 1, (3,)), features=0)
