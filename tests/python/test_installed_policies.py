"""Policies of installed packages: names resolve to their folders, and errors say which package is missing."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import EntryPoints
from pathlib import Path

import pytest

import graspbox
import tiny_policy
from graspbox import policies
from graspbox.errors import ConfigError, MissingExtraError
from graspbox.policies.grasp_image import ImageGrasper
from graspbox.policies.published import installed
from graspbox.policies.published.folders import load, save, use_of, used_folder
from installing import offer

pytest.importorskip("onnxruntime", reason="published policies need onnxruntime, from the extra 'onnx'")
pytest.importorskip("onnx", reason="tests make small networks with onnx, from the extra 'dev'")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install a package with the policies ``depth`` and ``feel``, which uses the other one; its code must not run."""
    found = tmp_path / "site"
    package = found / "graspbox_policies"
    tiny_policy.make(package / "depth")
    (package / "feel").mkdir()
    config = tiny_policy.make_feel(package / "feel")
    shutil.rmtree(package / "feel/chooser")
    save(package / "feel", replace(config, uses={"depth": use_of(package / "feel", package / "depth")}))
    (package / "__init__.py").write_text("raise RuntimeError('a name is resolved without an import')\n")
    offer(found, "graspbox-policies", depth="graspbox_policies.depth", feel="graspbox_policies.feel")
    monkeypatch.syspath_prepend(found)
    monkeypatch.chdir(tmp_path)
    return found


@pytest.fixture
def nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install no package with policies."""
    monkeypatch.setattr(installed, "entry_points", lambda **_: EntryPoints(()))
    monkeypatch.chdir(tmp_path)


def test_an_installed_policy_is_found_by_its_name(site: Path) -> None:
    assert policies.available() == (*policies.names(), "depth", "feel")
    assert policies.load("depth").name == "tiny"
    assert ImageGrasper("depth").config == load(site / "graspbox_policies/depth")
    feel = policies.load("feel")
    assert (feel.name, feel.base and feel.base.name) == ("tiny-feel", "tiny")
    found = graspbox.evaluation.evaluate("depth", objects="procedural:can:0", trials=1)
    assert len(found.trials) == 1


def test_commands_take_the_name(site: Path) -> None:
    pytest.importorskip("typer", reason="the command line needs typer, from the extra 'cli'")

    def run(name: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "graspbox", "evaluate", name, "--objects", "procedural:can:0"]
        env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])}
        return subprocess.run([*command, "--trials", "1", "--json"], capture_output=True, text=True, env=env)

    assert json.loads(run("depth").stdout)["policy"] == "tiny"
    wrong = run("dept")
    assert wrong.returncode == 2
    assert "there is no policy 'dept'; did you mean 'depth'? choose from random" in wrong.stderr
    assert "Traceback" not in wrong.stderr


def test_servers_take_the_name(site: Path) -> None:
    from graspbox.tools.remote.policy_serving import PolicyServer
    from graspbox.tools.remote.settings import PolicyServerSettings

    with PolicyServer("depth", PolicyServerSettings(port=0)) as server:
        assert server.url.startswith("ws://")


def test_a_folder_hides_an_installed_policy(site: Path, tmp_path: Path) -> None:
    tiny_policy.make(tmp_path / "depth", name="mine")
    assert policies.load("depth").name == "mine"
    with pytest.raises(ConfigError, match="there is no policy 'feel/'; choose from random"):
        policies.load("feel/")
    with pytest.raises(ConfigError, match="there is no policy 'feel'"):
        policies.load(Path("feel"))


def test_without_the_package_the_error_names_it(nothing: None) -> None:
    assert policies.available() == policies.names()
    for find in (policies.load, ImageGrasper):
        with pytest.raises(MissingExtraError) as caught:
            find("depth")
        message = str(caught.value)
        assert "'depth' is in the package graspbox-policies, which is not installed" in message
        assert f"pip install graspbox-policies=={graspbox.__version__}" in message
    with pytest.raises(ConfigError, match=r"there is no policy 'dept'; did you mean 'depth'\? name a folder"):
        ImageGrasper("dept")


def test_the_known_names_are_those_that_are_published() -> None:
    folder = Path(__file__).parents[2] / "policies"
    assert tuple(sorted(path.name for path in folder.iterdir() if path.is_dir())) == installed.PUBLISHED


def test_a_damaged_package_is_named(site: Path) -> None:
    offer(site, "more", gone="graspbox_policies.gone", wrong="no-module:x", nowhere="no_such_package_at_all.x")
    for name in ("gone", "wrong", "nowhere"):
        with pytest.raises(ConfigError, match=f"the package more offers the policy '{name}', but .* is no folder"):
            policies.load(name)


def test_two_packages_with_one_name_are_refused(site: Path) -> None:
    offer(site, "more", depth="graspbox_policies.feel")
    with pytest.raises(ConfigError, match="the packages graspbox-policies and more both offer a policy 'depth'"):
        policies.load("depth")


def test_a_reference_leads_to_an_installed_policy(site: Path, tmp_path: Path) -> None:
    """By its name if the policy was made with it, by its hash if the folder beside is missing; never to another."""
    made, depth = tmp_path / "made", site / "graspbox_policies/depth"
    made.mkdir()
    config = tiny_policy.make_feel(made)
    named = save(made, replace(config, uses={"depth": use_of(made, depth)}))
    assert named.uses["depth"].policy == "depth"
    assert used_folder(made, named, "depth") == depth.resolve()
    # A folder that was copied without the one beside it.
    alone = shutil.copytree(site / "graspbox_policies/feel", tmp_path / "copied/feel")
    copied = load(alone)
    assert copied.uses["depth"].policy == "../depth"
    assert used_folder(alone, copied, "depth") == depth.resolve()
    tiny_policy.make(depth, finalists=tiny_policy.FINALISTS + 1)
    for folder, one in ((made, named), (alone, copied)):
        with pytest.raises(
            ConfigError, match="is missing, or differs from the policy that 'tiny-feel' was published with"
        ):
            used_folder(folder, one, "depth")


@pytest.mark.train
def test_trainings_take_the_name(site: Path, tmp_path: Path) -> None:
    pytest.importorskip("torch")
    from graspbox.learn.recipes import feel
    from graspbox.learn.recipes.settings.feel import FeelSettings

    with pytest.raises(ConfigError, match="did you mean 'depth'"):
        feel.train(FeelSettings(out=tmp_path / "run", policy=Path("dept")), "graspbox train feel", print)
    with pytest.raises(ConfigError, match="kind is 'feel'; expected 'depth'"):
        feel.train(FeelSettings(out=tmp_path / "run", policy=Path("feel")), "graspbox train feel", print)
