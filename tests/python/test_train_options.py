"""``graspbox train``: its commands and options; parsing them needs no torch."""

import subprocess
import sys
from dataclasses import asdict, fields, replace
from importlib.util import find_spec
from pathlib import Path

import pytest

from graspbox.errors import ConfigError, GraspboxError

pytest.importorskip("typer", reason="graspbox train needs typer, from the extra 'cli'")
pytest.importorskip("yaml", reason="graspbox train sb3 needs pyyaml, from the extra 'train'")

from graspbox._common.entry_points import entry_points_of
from graspbox.learn.commands import OPTIONS, TRAININGS, parse, train
from graspbox.learn.recipes.settings.depth import DepthSettings, Hours, Sizes
from graspbox.learn.sb3.settings import Sb3Settings, read_parameters

#: Required options of each command besides ``--out``.
NEEDED = {
    "depth": [],
    "any-hand": [],
    "hand": ["hand.urdf"],
    "feel": ["--policy", "policies/depth"],
    "head": ["--data", "out/data"],
    "clone": ["ppo", "out/shown"],
    "sb3": ["ppo"],
    "student": ["out/train/ppo"],
    "study": [],
}


def test_every_training_has_options() -> None:
    assert set(entry_points_of(OPTIONS)) == set(entry_points_of(TRAININGS)) == set(NEEDED)


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "graspbox", *words], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", NEEDED)
def test_help_names_every_option_and_loads_no_torch(name: str) -> None:
    code = (
        f"import sys; from graspbox.learn.commands import train\n"
        f"try: train({name!r}, ['--help'])\n"
        "except SystemExit as ended: print(ended.code, [m for m in ('torch', 'stable_baselines3') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.rstrip().endswith("0 []")
    options = parse(name, ["--out", "x", *NEEDED[name]])
    for field in (one.name for one in fields(options)):
        if field not in ("base", "algorithm", "demonstrations", "teacher", "file", "hours", "minutes", "sizes"):
            assert f"--{field.replace('_', '-')}" in done.stdout, field
    listed = run("train", "--help")
    assert listed.returncode == 0
    assert name in listed.stdout


def test_a_policy_is_trained_in_four_hours() -> None:
    """The help, and the guide, say so of the default time limits."""
    options = parse("depth", ["--out", "x"])
    assert isinstance(options, DepthSettings)
    limits, rounds = asdict(options.hours), options.sizes.rounds
    per_round = limits.pop("collect") + limits.pop("round")
    assert sum(limits.values()) + rounds * per_round <= 4.0


@pytest.mark.parametrize("name", NEEDED)
def test_every_training_has_the_shared_options(name: str) -> None:
    given = ["--out", "x", *NEEDED[name]]
    plain = parse(name, given)
    assert (plain.out, plain.resume, plain.seed, plain.device, plain.json) == (Path("x"), True, 0, "cpu", False)
    more = [*given, "--no-resume", "--seed", "3", "--device", "cuda:1", "--torch-threads", "2", "--json"]
    found = parse(name, more)
    assert (found.resume, found.seed, found.device, found.torch_threads, found.json) == (False, 3, "cuda:1", 2, True)
    with pytest.raises(SystemExit) as ended:
        parse(name, [*given, "--seed", "-1"])
    assert ended.value.code == 2


@pytest.mark.parametrize("name", ["depth", "head", "study", "sb3"])
def test_the_hand_is_an_option(name: str) -> None:
    options = parse(name, ["--out", "x", *NEEDED[name], "--hand", "panda_gripper"])
    assert options.load_hand().name == "panda_gripper"  # type: ignore[attr-defined]
    if name == "sb3":
        assert options.read_parameters().env["hand"] == "panda_gripper"  # type: ignore[attr-defined]


@pytest.mark.train
@pytest.mark.parametrize("device", ["cuda:77", "gpu"])
def test_a_device_that_does_not_exist_is_named(device: str, tmp_path: Path) -> None:
    pytest.importorskip("torch")
    with pytest.raises(ConfigError, match=f"--device is '{device}', which this machine does not have"):
        train("study", ["--out", str(tmp_path / "x"), "--device", device])
    assert not (tmp_path / "x").exists()


def test_a_network_of_the_study_has_a_hand_with_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse("study", ["--out", "x", "--hand", "a.urdf,b.toml"])
    assert "a published policy names its hand" in " ".join(capsys.readouterr().err.split())


def test_arguments_replace_the_defaults(tmp_path: Path) -> None:
    given = ["ppo", "--out", "x", "--steps", "64", "--set", "model.gamma=0.5", "--set", "env.obs=[proprio, depth]"]
    found = parse("sb3", [*given, "--target", "0.5"])
    assert isinstance(found, Sb3Settings)
    assert (found.steps, found.target) == (64, 0.5)
    assert found.set == ("model.gamma=0.5", "env.obs=[proprio, depth]")


def test_tuples_are_repeated_and_nested_settings_have_dots() -> None:
    given = (
        "--out",
        "x",
        "--data",
        "a",
        "--data",
        "b",
        "--layout",
        "pile",
        "--sizes.rounds",
        "2",
        "--hours.data",
        "0.1",
    )
    found = parse("depth", given)
    assert isinstance(found, DepthSettings)
    assert (found.data, found.layout) == ((Path("a"), Path("b")), ("pile",))
    assert (found.sizes, found.hours) == (replace(Sizes(), rounds=2), replace(Hours(), data=0.1))
    assert parse("study", ["--out", "x", "--losses", "psi4", "--losses", "euler"]).losses == ("psi4", "euler")  # type: ignore[attr-defined]
    assert parse("any-hand", ["--out", "x", "--hands", ""]).hands == ()  # type: ignore[attr-defined]


def test_parameters_are_those_of_the_file_but_for_what_is_replaced(tmp_path: Path) -> None:
    before = Sb3Settings(algorithm="ppo", out=tmp_path).read_parameters()
    changes = ("model.gamma=0.5", "model.policy_kwargs.net_arch=[8]", "env.obs=[proprio, depth]", "num_envs=3")
    after = Sb3Settings(algorithm="ppo", out=tmp_path, set=changes, steps=64).read_parameters()
    assert (after.steps, after.num_envs, after.model["gamma"]) == (64, 3, 0.5)
    assert after.env == {**before.env, "obs": ["proprio", "depth"]}
    assert after.model["policy_kwargs"] == {**before.model["policy_kwargs"], "net_arch": [8]}
    unchanged = set(before.model) - {"gamma", "policy_kwargs"}
    assert {name: after.model[name] for name in unchanged} == {name: before.model[name] for name in unchanged}


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3"])
@pytest.mark.parametrize("env_id", ["graspbox/GraspPose-v0", "graspbox/Grasp-v0"])
def test_every_algorithm_has_parameters_for_every_environment(algorithm: str, env_id: str) -> None:
    found = read_parameters(Sb3Settings.parameters, algorithm, env_id)
    assert found.steps >= 10_000
    assert set(found.normalize) == {"observations", "reward"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("sb3", "dqn", "--out", "x"), "'dqn' is not one of 'ppo', 'sac', 'td3'"),
        (("sb3", "ppo", "--out", "x", "--evaluations", "0"), "--evaluations is 0; pass 1 or more"),
        (("sb3", "ppo", "--out", "x", "--episodes", "-1"), "--episodes is -1; pass 1 or more"),
        (("sb3", "ppo", "--out", "x", "--torch-threads", "0"), "--torch-threads is 0"),
        (("depth", "--out", "x", "--real", "2"), "--real is 2.0; it is a share of the scenes"),
        (("sb3", "ppo", "--out", "x", "--minutes", "0"), "--minutes is 0.0; pass a positive number"),
        (("sb3", "ppo", "--out", "x", "--minutes", "nan"), "--minutes is nan"),
        (("sb3", "ppo", "--out", "x", "--target", "80"), "--target is 80.0; give a rate between 0 and 1"),
        (("sb3", "ppo", "--out", "x", "--steps", "many"), "Invalid value for '--steps'"),
        (("sb3", "ppo"), "--out"),
        (("head", "--out", "x", "--data", "y", "--trials", "-1"), "--trials is -1; pass 0 or more"),
        (("head", "--out", "x", "--data", "y", "--heads", "leg"), "--heads"),
        (("study", "--out", "x", "--samples", "5"), "--samples is 5; pass 20 or more"),
        (("study", "--out", "x", "--losses", "psi4", "--losses", "psi4"), "--losses is 'psi4 psi4'; name each once"),
        (
            ("study", "--out", "x", "--losses", "psi4", "psi3"),
            "unexpected 'psi3'; an option with several values is repeated",
        ),
        (("clone", "ppo", "y", "--out", "x", "--rate", "2"), "--rate is 2.0; give a number between 0 and 1"),
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
    with pytest.raises(SystemExit) as ended:
        train(arguments[0], arguments[1:])
    assert ended.value.code == 2
    assert message in " ".join(capfd.readouterr().err.replace("│", " ").split())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--env", "CartPole-v1"), "has no entry 'ppo', 'CartPole-v1'"),
        (("--env", "graspbox/Reach-v0"), "has no entry 'ppo', 'graspbox/Reach-v0'; add one"),
        (("--parameters", "none.yaml"), "none.yaml"),
        (("--set", "gamma"), "--set 'gamma' names no parameter"),
        (("--set", "model.gamma.x=1"), "names no parameter"),
        (("--set", "colour=1"), "there is no parameter 'colour'; choose from steps, num_envs"),
        (("--set", "env.obs=[proprio"), "has a value that is not valid YAML"),
    ],
)
def test_parameters_that_do_not_exist_are_named(words: tuple[str, ...], message: str) -> None:
    settings = parse("sb3", ["ppo", "--out", "x", *words])
    with pytest.raises((GraspboxError, OSError), match=message):
        settings.kept()


@pytest.mark.skipif(find_spec("torch") is not None, reason="torch is installed")
def test_without_torch_the_extra_is_named(tmp_path: Path) -> None:
    done = run("train", "sb3", "ppo", "--out", str(tmp_path / "run"))
    assert done.returncode == 2
    assert "pip install 'graspbox[train]'" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "run").exists()
