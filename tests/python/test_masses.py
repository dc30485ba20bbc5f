"""Masses and sizes of a user's own meshes: the table of a folder, options of commands, keywords of environments."""

import json
from pathlib import Path
from typing import Any

import gymnasium
import pytest

from command_line import invoke
from graspbox import object_sets
from graspbox.envs import IDS, SINGLE_OBJECT_IDS
from graspbox.errors import ConfigError, ObjectSetError
from graspbox.evaluation import evaluate
from graspbox.policies import Task
from test_cli_files import write_box

POSE, LOOP = SINGLE_OBJECT_IDS
#: Volume of each box in cubic metres, and its mass at 400 kg/m3.
VOLUME, FILLED = 0.06 * 0.06 * 0.1, 400 * 0.06 * 0.06 * 0.1


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Boxes of several names: two files that share theirs, and one below."""
    (tmp_path / "boxes" / "more").mkdir(parents=True)
    for name in ("milk.off", "pan.off", "more/tea.off"):
        write_box(tmp_path / "boxes" / name, 0.06, 0.06, 0.1)
    (tmp_path / "boxes" / "pan.OFF").write_text((tmp_path / "boxes" / "pan.off").read_text())
    return tmp_path / "boxes"


def masses(folder: Path, table: str | bytes, **choice: Any) -> dict[str, Any]:
    (folder / "masses.csv").write_bytes(table if isinstance(table, bytes) else table.encode())
    found = object_sets.load(f"dir:{folder}", **choice)
    return {spec.name: (round(spec.load().mass, 6), spec.mass_known) for spec in found}


def test_a_table_says_what_objects_weigh(folder: Path) -> None:
    table = "name,mass\nmilk,1.03\npan.off, 0.9\nmore/tea,2e-1\n\n"
    known: dict[str, Any] = {"milk": (1.03, "table"), "pan.off": (0.9, "table"), "more/tea": (0.2, "table")}
    expected: dict[str, Any] = {**known, "pan.OFF": (pytest.approx(FILLED), "density")}
    assert masses(folder, table) == expected
    # As a spreadsheet writes it.
    assert masses(folder, b"\xef\xbb\xbf" + table.replace("\n", "\r\n").encode()) == expected
    assert masses(folder, 'name,mass\n"milk",1.03\n')["milk"] == (1.03, "table")
    # Kilograms are kilograms in any unit of length.
    scaled = masses(folder, table, scale=0.5)
    assert {name: scaled[name] for name in known} == known
    assert scaled["pan.OFF"] == (pytest.approx(FILLED / 8), "density")
    assert set(masses(folder, table, mass=0.4).values()) == {(0.4, "given")}


def test_a_table_goes_before_what_is_known_of_a_name(folder: Path) -> None:
    write_box(folder / "025_mug.off", 0.06, 0.06, 0.1)
    assert masses(folder, "name,mass\n")["025_mug"] == (0.118, "published")
    assert masses(folder, "name,mass\n025_mug,0.3\n")["025_mug"] == (0.3, "table")


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ("name,mass\nmilk,1030\n", r"line 2: the mass of 'milk' is 1030, which looks like grams; .*: 1\.03"),
        ("name,mass\nmilk,1\nmilk,1\n", "line 3 repeats 'milk'"),
        ("name,mass\nmilc,1\n", "line 2 names 'milc', which is not an object of the folder; did you mean 'milk'"),
        ("name,mass\nxyz,1\n", "'graspbox objects' lists the names"),
        ("name,mass\nmilk,one\n", "the mass of 'milk' is 'one'; write a number of kilograms"),
        ("name,mass\nmilk,\n", "the mass of 'milk' is ''"),
        ("name,mass\nmilk,-1\n", "the mass of 'milk' is -1; write a positive number"),
        ("name,mass\nmilk,nan\n", "the mass of 'milk' is nan; write a positive number"),
        ("name,mass\nmilk,0\n", "the mass of 'milk' is 0"),
        ("name,mass\nmilk,1,2\n", "line 2 has 3 columns; write a name and a mass"),
        ("name,mass\nmilk\n", "line 2 has 1 column;"),
        ("milk,1.0\n", "must begin with the line 'name,mass'; masses are in kilograms"),
        ("name,grams\nmilk,1030\n", "must begin with the line 'name,mass'"),
        ("", "must begin with the line 'name,mass'"),
        (b"name,mass\nmilk,\xff\n", "is not a UTF-8 CSV file"),
        ('name,mass\n"milk,1\n', "is not a UTF-8 CSV file"),
    ],
)  # fmt: skip
def test_wrong_tables_are_named(folder: Path, table: str | bytes, complaint: str) -> None:
    with pytest.raises(ObjectSetError, match=complaint):
        masses(folder, table)


def run(*words: Any) -> Any:

    return invoke(list(map(str, words)), catch_exceptions=True)


def test_the_command_line_takes_the_mass_of_one_object(folder: Path, tmp_path: Path) -> None:
    mesh = folder / "milk.off"
    (folder / "masses.csv").write_text("name,mass\nmilk,1.03\n")
    shown = json.loads(run("objects", f"dir:{folder}", "--json").stdout)
    assert {"name": "milk", "split": object_sets.ObjectSpec("milk").split, "mass": 1.03, "mass_known": "table"} in shown
    out = tmp_path / "set"
    done = run("dataset", "--objects", mesh, "--mass", 0.5, "--out", out, "--poses", 1, "--rests", 1, "--workers", 1)
    assert done.exit_code == 0, done.stderr
    assert json.loads((out / "manifest.json").read_text())["objects"][0]["mass"] == 0.5
    for words in (("evaluate", "zero", "--trials", 1), ("grasp", "--poses", 1), ("record", "zero", "--out", tmp_path)):
        refused = run(*words, "--objects", f"dir:{folder}", "--mass", 0.5)
        assert isinstance(refused.exception, ObjectSetError)
        assert "has 4; write their masses into a table masses.csv in their folder" in str(refused.exception)
    # A mass that no object of this size has is refused; so it arrives.
    heavy = run("grasp", "--objects", mesh, "--mass", 20, "--poses", 1, "--json")
    assert heavy.exit_code == 1
    assert "`milk` weighs 20 kg" in json.loads(heavy.stdout)["refused"]["milk"]
    heavy = run("prepare", mesh, "--mass", 20, "--json")
    assert "`milk` weighs 20 kg" in json.loads(heavy.stdout)["refused"]["milk"]
    heavy = run("evaluate", "zero", "--objects", mesh, "--mass", 20, "--trials", 1, "--json")
    assert "`milk` weighs 20 kg" in json.loads(heavy.stdout)["refused"]["milk"]


def test_demonstrations_remember_scale_and_mass(folder: Path, tmp_path: Path) -> None:
    """A mesh in millimetres, which could not be recorded without a copy in metres."""
    from graspbox.data.episodes import Demonstrations

    write_box(folder / "big.off", 60, 60, 100)
    words = ("--out", tmp_path / "out", "--objects", folder / "big.off", "--scale", 0.001, "--mass", 0.25)
    done = run(
        "record", "zero", *words, "--episodes", 1, "--keep", "all", "--set", "max_episode_steps=2", "--num-envs", 1
    )
    assert done.exit_code == 0, done.stderr
    env_id, keywords = Demonstrations(tmp_path / "out").environment()
    assert (keywords["scale"], keywords["mass"]) == (0.001, 0.25)
    env = gymnasium.make(env_id, **keywords)
    (spec,) = env.unwrapped.objects  # type: ignore[attr-defined]
    assert (spec.scale, spec.mass) == (0.001, 0.25)
    assert env.reset(seed=0)[1]["object"] == "big"


@pytest.mark.parametrize("env_id", IDS)
def test_environments_take_scale_and_mass(folder: Path, env_id: str) -> None:
    write_box(folder / "big.off", 60, 60, 100)
    keywords: dict[str, Any] = {"objects": str(folder / "big.off"), "scale": 0.001, "mass": 0.25}
    for env in (gymnasium.make(env_id, **keywords), gymnasium.make_vec(env_id, 2, **keywords)):
        (spec,) = Task.of(env).objects
        assert spec.load().mass == 0.25
        assert spec.load().volume == pytest.approx(VOLUME)
        env.reset(seed=0)
        env.close()
    with pytest.raises(ObjectSetError, match="scale applies when a set is loaded"):
        gymnasium.make(env_id, objects=object_sets.load("procedural:can:0"), scale=0.5)
    with pytest.raises(ObjectSetError, match="mass is -1"):
        gymnasium.make(env_id, objects="procedural:can:0", mass=-1)
    if env_id in SINGLE_OBJECT_IDS:
        found = evaluate("random", env_id, keywords["objects"], 2, scale=0.001, mass=0.25, max_episode_steps=2)
        assert (len(found.trials), found.refused) == (2, {})


def test_servers_take_scale_and_mass(folder: Path) -> None:
    from graspbox.tools.remote import EnvironmentServer, ServerSettings

    write_box(folder / "big.off", 60, 60, 100)
    keywords: dict[str, Any] = {"objects": "one", "obs": "state", "scale": 0.001, "mass": 0.25}
    with EnvironmentServer(ServerSettings(port=0, objects=(f"one={folder / 'big.off'}",))) as server:
        remote = gymnasium.make_vec(LOOP, 1, remote=server.url, **keywords)
        seen = remote.reset(seed=0)[0]
        remote.close()
        with pytest.raises(ObjectSetError, match="mass is -1"):
            gymnasium.make_vec(LOOP, 1, remote=server.url, **{**keywords, "mass": -1})
        (folder / "masses.csv").write_text("name,mass\nmilk,1.03\n")
        known = object_sets.load(f"dir:{folder}")
        with pytest.raises(ConfigError, match="'milk' has its own scale or mass"):
            gymnasium.make_vec(LOOP, 1, objects=known, remote=server.url)
    local = gymnasium.make_vec(LOOP, 1, **{**keywords, "objects": str(folder / "big.off")})
    assert (seen == local.reset(seed=0)[0]).all()
