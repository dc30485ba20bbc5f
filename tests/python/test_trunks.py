"""Trained networks as features extractors of Stable-Baselines3. Needs the extra ``train``."""

import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox.configs import CameraConfig, CamerasConfig
from graspbox.errors import ConfigError, FileError

pytestmark = [pytest.mark.train, pytest.mark.usefixtures("one_thread")]

sb3 = pytest.importorskip("stable_baselines3")
torch = pytest.importorskip("torch")

from graspbox.models.head.configs import HeadConfig  # noqa: E402
from graspbox.models.head.heads import head_of  # noqa: E402
from graspbox.perception.anchors import AnchorConfig  # noqa: E402
from graspbox.sb3 import TrunkExtractor, VecEnv  # noqa: E402
from graspbox.study.model import ModelConfig, PoseModel  # noqa: E402
from graspbox.study.regressor import cameras, centered_image, cropped_voxels  # noqa: E402

ID = "graspbox/GraspPose-v0"
PAGE = Path(__file__).parents[2] / "docs" / "guides" / "train.md"
SMALL = HeadConfig(width=8, features=8, hidden=16, anchors=AnchorConfig(cells=12, heights=14))


def regressor(folder: Path, kind: Any = "binary", network: Any = "cnn3d") -> Path:
    model = PoseModel(ModelConfig(network, "psi3", kind, fully_connected=(16,)), seed=1)
    model.input_shift.fill_(0.2)
    model.save(folder)
    return folder


def head(folder: Path, kind: Any = "anchor") -> Path:
    config = HeadConfig(kind, SMALL.width, SMALL.features, SMALL.hidden, SMALL.anchors)
    torch.manual_seed(0)
    folder.mkdir(exist_ok=True)
    (folder / "head.json").write_text(json.dumps(asdict(config)))
    torch.save(head_of(3, config).state_dict(), folder / "weights.pt")
    return folder


def make(obs: Any, **settings: Any) -> Any:
    return VecEnv.make(ID, 2, objects=("procedural:can:0", "procedural:box:0"), obs=obs, **settings)


def ppo(env: Any, folder: Path, **keywords: Any) -> Any:
    kind = "MultiInputPolicy" if hasattr(env.observation_space, "spaces") else "MlpPolicy"
    policy = {
        "features_extractor_class": TrunkExtractor,
        "features_extractor_kwargs": {"folder": str(folder), "features": 12, **keywords},
    }
    return sb3.PPO(kind, env, policy_kwargs=policy, n_steps=2, batch_size=4, n_epochs=2, seed=0, device="cpu")


def weights(module: Any) -> list[Any]:
    return [parameter.detach().clone() for parameter in module.parameters()]


@pytest.mark.parametrize("frozen", [True, False])
def test_ppo_begins_with_the_trained_weights_and_keeps_them_if_frozen(tmp_path: Path, frozen: bool) -> None:
    """PPO draws the weights of its features extractor anew, unless that prevents it."""
    env = make("voxels", cameras=cameras("binary"))
    model = ppo(env, regressor(tmp_path), frozen=frozen)
    extractor = model.policy.features_extractor
    trained = PoseModel.load(tmp_path)
    convolutions = [layer.weight for layer in trained.network.layers if hasattr(layer, "weight")][:-1]
    loaded = [layer.weight for layer in extractor.trunk.model.network.layers if hasattr(layer, "weight")]
    assert len(loaded) == len(convolutions) == 8
    assert all(torch.equal(a, b) for a, b in zip(loaded, convolutions, strict=True))
    before, neck = weights(extractor.trunk), weights(extractor.neck)
    model.learn(8)
    same = [torch.equal(a, b) for a, b in zip(before, weights(extractor.trunk), strict=True)]
    assert all(same) == frozen
    assert not all(torch.equal(a, b) for a, b in zip(neck, weights(extractor.neck), strict=True))
    env.close()


def test_the_features_are_those_of_the_regressor(tmp_path: Path) -> None:
    env = make("voxels", cameras=cameras("binary"))
    env.seed(3)
    seen = env.reset()
    model = ppo(env, regressor(tmp_path), frozen=True)
    extractor = model.policy.features_extractor
    trained = PoseModel.load(tmp_path)
    crops = [cropped_voxels(row, "binary") for row in seen]
    inputs = np.stack([found[0] for found in crops if found is not None])
    assert len(inputs) == 2
    with torch.no_grad():
        units = extractor.trunk(torch.from_numpy(inputs))
        outputs = trained.network.layers[-1](units)
        wanted = trained(torch.from_numpy(inputs))
        features = model.policy.extract_features(model.policy.obs_to_tensor(seen)[0], extractor)
        neck = extractor.neck(units)
    torch.testing.assert_close(outputs, wanted, rtol=1e-5, atol=1e-6)
    assert features.shape == (2, 12 + 3)
    torch.testing.assert_close(features[:, :12], neck)
    for row, found in zip(features[:, 12:].numpy(), crops, strict=True):
        assert found is not None
        np.testing.assert_allclose(row, [1.0, *found[1][:2, 3]], atol=1e-6)
    nothing = extractor(torch.zeros(1, 64, 64, 64))
    assert not nothing[:, 12:].any()
    env.close()


@pytest.mark.parametrize("kind", ["anchor", "set"])
def test_the_trunk_of_a_head_sees_the_crop_around_the_object(tmp_path: Path, kind: str) -> None:
    env = make(("depth", "proprio"), image_size=128)
    env.seed(3)
    seen = env.reset()
    model = ppo(env, head(tmp_path, kind), frozen=False)
    extractor = model.policy.features_extractor
    prepared, _ = model.policy.obs_to_tensor(seen)
    channels = extractor.trunk.prepare(seen["depth"])[0]
    assert channels.shape == (2, 2, 48, 48, 48)
    assert channels[:, 0].any(axis=(1, 2, 3)).all()
    features = model.policy.extract_features(prepared, extractor)
    assert features.shape == (2, 12 + 5 + 28)
    found = features[:, 12:17].detach().numpy()
    np.testing.assert_allclose(found[:, 0], 1.0)
    np.testing.assert_allclose(np.linalg.norm(found[:, 3:], axis=1), 1.0, rtol=1e-5)
    np.testing.assert_allclose(features[:, 17:].detach().numpy(), seen["proprio"], rtol=1e-5)
    features.sum().backward()
    assert all(parameter.grad is not None for parameter in extractor.trunk.net.parameters())
    before = [norm.running_mean.clone() for norm in extractor.modules() if hasattr(norm, "running_mean")]
    model.learn(4)
    after = [norm.running_mean for norm in extractor.modules() if hasattr(norm, "running_mean")]
    assert len(before) > 3
    assert all(torch.equal(a, b) for a, b in zip(before, after, strict=True))
    env.close()


def test_a_picture_regressor_under_sac_is_saved_and_loaded(tmp_path: Path) -> None:
    folder = regressor(tmp_path / "trained", "image", "cnn2d_dropout")
    env = make("rgbd", cameras=cameras("image"))
    settings = {
        "features_extractor_class": TrunkExtractor,
        "features_extractor_kwargs": {"folder": str(folder), "features": 8},
        "net_arch": [8],
    }
    model = sb3.SAC("MlpPolicy", env, policy_kwargs=settings, buffer_size=8, learning_starts=2, batch_size=2, seed=0)
    model.learn(6)
    seen = env.reset()
    inputs = model.actor.features_extractor.trunk.prepare(seen)[0]
    found = centered_image(seen[0])
    assert found is not None
    assert (inputs[0] == found[0]).all()
    model.save(tmp_path / "model.zip")
    again = sb3.SAC.load(tmp_path / "model.zip", device="cpu")
    np.testing.assert_array_equal(
        again.predict(seen, deterministic=True)[0], model.predict(seen, deterministic=True)[0]
    )
    env.close()


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    depth, voxels = make("depth", image_size=32), make("voxels", cameras=cameras("binary"))
    small = make("voxels", cameras=CamerasConfig(voxels=16))
    with pytest.raises(ConfigError, match=r"holds neither model\.json nor head\.json"):
        TrunkExtractor(depth.observation_space, tmp_path)
    folder = regressor(tmp_path / "regressor")
    with pytest.raises(ConfigError, match=r"has shape \(16, 16, 16\); the network in .* \(64, 64, 64\)"):
        TrunkExtractor(small.observation_space, folder)
    named = make(("depth", "proprio"), image_size=32)
    with pytest.raises(ConfigError, match=r"needs obs='voxels'; there are depth, proprio"):
        TrunkExtractor(named.observation_space, folder)
    with pytest.raises(ConfigError, match="features is 0"):
        TrunkExtractor(voxels.observation_space, folder, features=0)
    wrist = CamerasConfig(cameras=(CameraConfig("wrist", "hand"),))
    with pytest.raises(ConfigError, match="mounted on the hand"):
        TrunkExtractor(depth.observation_space, head(tmp_path / "head"), cameras=wrist)
    with pytest.raises(ConfigError, match="of another kind than 'constant'"):
        TrunkExtractor(depth.observation_space, head(tmp_path / "constant", "constant"))
    (folder / "weights.pt").unlink()
    with pytest.raises(FileError, match="no weights"):
        TrunkExtractor(voxels.observation_space, folder)
    for env in (depth, voxels, small, named):
        env.close()


def test_the_lines_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    regressor(tmp_path / "out" / "regressor")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    (lines,) = [block for block in blocks if "TrunkExtractor" in block]
    names: dict[str, Any] = {}
    exec(compile(lines, PAGE.name, "exec"), names)
    assert names["model"].num_timesteps == 16
    assert names["model"].policy.features_extractor.frozen
