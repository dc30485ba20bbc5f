"""Kinds of policies in packages of their own, found by their entry points."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import tiny_policy
from graspbox import policies
from graspbox.errors import ConfigError, MissingExtraError
from graspbox.policies.published.registry import FOLDERS, GROUP
from installing import install

pytest.importorskip("onnxruntime", reason="published policies need onnxruntime, from the extra 'onnx'")
pytest.importorskip("onnx", reason="tests make small networks with onnx, from the extra 'dev'")

PYPROJECT = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "lazy-policies"
version = "1.0"

[project.entry-points."graspbox.policy_kinds"]
lazy = "lazy_policies:LazyPolicy"
"""

MODULE = """
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from graspbox.policies import Policy
from graspbox.policies.published.configs import PolicyConfig
from graspbox.policies.published.folders import load


@dataclass(frozen=True, kw_only=True)
class LazyConfig(PolicyConfig):
    kind = "lazy"
    environment: None = None
    value: float

    @property
    def holds(self):
        return ()


class LazyPolicy(Policy):
    config_class = LazyConfig

    def __init__(self, folder: Path) -> None:
        self.config = load(folder, LazyConfig)
        self.name = self.config.name

    def act(self, observations):
        return np.full((self._task.num_envs, *self._task.action_space.shape), self.config.value)
"""

USE = """
import sys
from pathlib import Path
from graspbox import evaluation, policies
from graspbox.policies.published.folders import save
from lazy_policies import LazyConfig

folder = Path(sys.argv[1])
save(folder, LazyConfig(name="lazy-one", hand="reflex", value=0.0))
del sys.modules["lazy_policies"]
policy = policies.load(str(folder))
assert (policy.name, policy.config.value) == ("lazy-one", 0.0)
print(len(evaluation.evaluate(policy, objects="procedural:can:0", trials=2).trials))
"""


def test_an_installed_package_brings_a_kind(tmp_path: Path) -> None:
    """It is installed by pip, and graspbox knows nothing else of it."""
    pytest.importorskip("hatchling", reason="packages are built with hatchling, from the extra 'dev'")
    package, site, folder = tmp_path / "package", tmp_path / "site", tmp_path / "policy"
    (package / "lazy_policies").mkdir(parents=True)
    folder.mkdir()
    (package / "pyproject.toml").write_text(PYPROJECT)
    (package / "lazy_policies/__init__.py").write_text(MODULE)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*pip, "--target", str(site), str(package)], check=True, capture_output=True)
    paths = os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-c", USE, str(folder)]
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "2"
    with pytest.raises(ConfigError, match=r"there is no policy kind 'lazy'; the installed packages have depth, feel"):
        policies.load(str(folder))


@pytest.mark.parametrize(
    ("package", "value", "message"),
    [
        (
            "broken",
            "no_such_module:Policy",
            "the policy kind 'extra' of broken cannot be imported: No module named 'no_such_module'",
        ),
        (
            "other",
            "graspbox.policies.head:HeadGrasp",
            "the policy kind 'extra' is .*HeadGrasp.* of the kind 'head'; use one name",
        ),
    ],
)
def test_wrong_kinds_name_their_package(
    package: str, value: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tiny_policy.make(tmp_path / "tiny")
    # Only this package offers the kind.
    config = (tmp_path / "tiny/config.json").read_text()
    (tmp_path / "tiny/config.json").write_text(config.replace('"kind": "depth"', '"kind": "extra"'))
    install(tmp_path / "site", package, GROUP, {"extra": value})
    monkeypatch.syspath_prepend(tmp_path / "site")
    with pytest.raises(ConfigError, match=message):
        policies.load(str(tmp_path / "tiny"))


def test_two_packages_with_one_kind_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tiny_policy.make(tmp_path / "tiny")
    install(tmp_path / "site", "again", GROUP, {"depth": "graspbox.policies.depth:DepthGrasp"})
    monkeypatch.syspath_prepend(tmp_path / "site")
    with pytest.raises(
        ConfigError, match=r"the policy kind 'depth' is declared by again and graspbox; uninstall one of them"
    ):
        policies.load(str(tmp_path / "tiny"))


def test_a_run_needs_torch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run's folder is known without torch; its policy is not loaded."""
    kept = {"algorithm": "ppo", "id": "graspbox/Grasp-v0", "env": {}, "model": {}, "normalize": {}}
    (tmp_path / "settings.json").write_text(json.dumps(kept))
    monkeypatch.setattr("graspbox.learn.find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"the policy of a run needs torch and .*'graspbox\[train\]'"):
        policies.load(tmp_path)


def test_an_installed_package_brings_policies_of_other_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site, folder = tmp_path / "site", tmp_path / "run"
    folder.mkdir()
    install(site, "strange", FOLDERS, {"strange": "strange_folders:policy_of"})
    module = "from graspbox import policies\ndef policy_of(folder):\n"
    module += "    return policies.load('zero') if (folder / 'mine').exists() else None\n"
    (site / "strange_folders.py").write_text(module)
    monkeypatch.syspath_prepend(site)
    with pytest.raises(ConfigError, match=r"no config.json in .*; name the folder of a policy or of a run"):
        policies.load(folder)
    (folder / "mine").touch()
    assert policies.load(folder).name == "zero"
