"""Arguments of `scripts/train_sb3.py`; parsing them needs no torch."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from graspbox.errors import ConfigError
from test_scripts import SCRIPTS, script

pytest.importorskip("tyro", reason="scripts/train_sb3.py needs tyro, from the extra 'train'")
pytest.importorskip("yaml", reason="scripts/train_sb3.py needs pyyaml, from the extra 'train'")

import tyro

PROGRAM = str(SCRIPTS / "train_sb3.py")


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, PROGRAM, *arguments], capture_output=True, text=True, check=False)


def test_help_names_every_argument() -> None:
    done = run("--help")
    assert done.returncode == 0
    for name in script("train_sb3").Settings.__annotations__:
        if name not in ("algorithm", "folder"):
            assert f"--{name.replace('_', '-')}" in done.stdout
    assert "ppo, sac or td3" in done.stdout
    assert "Exit status" in done.stdout


def test_arguments_replace_the_defaults(tmp_path: Path) -> None:
    program = script("train_sb3")
    plain = tyro.cli(program.Settings, args=["sac", str(tmp_path)])
    assert (plain.algorithm, plain.folder, plain.set, plain.steps, plain.resume) == ("sac", tmp_path, (), None, False)
    assert plain.evaluations >= 10
    given = ["ppo", "x", "--steps", "64", "--set", "model.gamma=0.5", "--set", "env.obs=[proprio, depth]", "--resume"]
    found = tyro.cli(program.Settings, args=[*given, "--target", "0.5", "--torch-threads", "2"])
    assert (found.steps, found.resume, found.target, found.torch_threads) == (64, True, 0.5, 2)
    assert found.set == ("model.gamma=0.5", "env.obs=[proprio, depth]")


def test_parameters_are_those_of_the_file_but_for_what_is_replaced(tmp_path: Path) -> None:
    program = script("train_sb3")
    before = program.read_parameters(program.Settings("ppo", tmp_path))
    changes = ("model.gamma=0.5", "model.policy_kwargs.net_arch=[8]", "env.obs=[proprio, depth]", "num_envs=3")
    after = program.read_parameters(program.Settings("ppo", tmp_path, set=changes, steps=64))
    assert (after.steps, after.num_envs, after.model["gamma"]) == (64, 3, 0.5)
    assert after.env == {**before.env, "obs": ["proprio", "depth"]}
    assert after.model["policy_kwargs"] == {**before.model["policy_kwargs"], "net_arch": [8]}
    unchanged = set(before.model) - {"gamma", "policy_kwargs"}
    assert {name: after.model[name] for name in unchanged} == {name: before.model[name] for name in unchanged}


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3"])
@pytest.mark.parametrize("env_id", ["graspbox/GraspPose-v0", "graspbox/Grasp-v0"])
def test_every_algorithm_has_parameters_for_every_environment(algorithm: str, env_id: str, tmp_path: Path) -> None:
    program = script("train_sb3")
    found = program.read_parameters(program.Settings(algorithm, tmp_path, env=env_id))
    assert found.steps >= 10_000
    assert set(found.normalize) == {"observations", "reward"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("dqn", "x"), "no algorithm 'dqn'; choose from ppo, sac, td3"),
        (("ppo", "x", "--steps", "0"), "--steps is 0; give 1 or more"),
        (("ppo", "x", "--evaluations", "0"), "--evaluations is 0; give 1 or more"),
        (("ppo", "x", "--episodes", "-1"), "--episodes is -1; give 1 or more"),
        (("ppo", "x", "--torch-threads", "0"), "--torch-threads is 0"),
        (("ppo", "x", "--seed", "-1"), "--seed is -1; give 0 or more"),
        (("ppo", "x", "--minutes", "0"), "--minutes is 0.0; give a positive number"),
        (("ppo", "x", "--minutes", "nan"), "--minutes is nan"),
        (("ppo", "x", "--target", "80"), "--target is 80.0; give a rate between 0 and 1"),
        (("ppo", "x", "--env", "CartPole-v1"), "has no entry 'ppo', 'CartPole-v1'"),
        (("ppo", "x", "--parameters", "none.yaml"), "none.yaml"),
        (("ppo", "x", "--set", "gamma"), "--set 'gamma' names no parameter"),
        (("ppo", "x", "--set", "model.gamma.x=1"), "names no parameter"),
        (("ppo", "x", "--set", "colour=1"), "parameters are steps, num_envs"),
        (("ppo", "x", "--steps", "many"), "Error parsing --steps"),
        (("ppo",), "PATH"),
    ],
)
def test_wrong_arguments_are_named(
    arguments: tuple[str, ...],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    program = script("train_sb3")
    try:
        status = program.main(list(arguments))
    except SystemExit as ended:
        status = ended.code
    assert status == 2
    assert message in " ".join(capfd.readouterr().err.split())
    assert not list(tmp_path.iterdir())


def test_a_folder_with_evaluations_but_no_checkpoint_is_refused(tmp_path: Path) -> None:
    program = script("train_sb3")
    assert not program.has_run(tmp_path)
    (tmp_path / "evaluations.jsonl").write_text('{"settings": {}}\n{"success": 0.5}\n')
    with pytest.raises(ConfigError, match="evaluations but no checkpoint"):
        program.has_run(tmp_path)
    (tmp_path / "checkpoint.old").mkdir()
    assert program.has_run(tmp_path)


@pytest.mark.skipif(find_spec("torch") is not None, reason="torch is installed")
def test_without_torch_the_extra_is_named(tmp_path: Path) -> None:
    done = run("ppo", str(tmp_path / "run"))
    assert done.returncode == 2
    assert "pip install 'graspbox[train]'" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "run").exists()
