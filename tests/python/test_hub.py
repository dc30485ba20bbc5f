"""Policies on the Hugging Face hub: pushed to, and loaded from, a server on this machine."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import tiny_policy
from graspbox import errors, policies
from graspbox.policies.published import push_to_hub
from graspbox.policies.published.downloads import repository
from hub_server import Hub, running

pytest.importorskip("onnx", reason="small networks are made with onnx, from the extra 'dev'")
pytest.importorskip("huggingface_hub", reason="policies on the hub need the extra 'hub'")

#: Runs a line of Python with `folder`, and returns its output, or its error message.
Python = Callable[[str], str]
_BEGIN = """
import sys
from graspbox import errors, policies
from graspbox.policies import published as artifacts
try:
    {line}
except errors.GraspboxError as error:
    print(f"{{type(error).__name__}}: {{error}}")
"""


@pytest.fixture
def hub() -> Iterator[Hub]:
    with running() as server:
        yield server


@pytest.fixture
def python(hub: Hub, tmp_path: Path) -> Python:
    """Run lines in processes of their own: huggingface_hub reads its settings once."""
    env = {
        "HF_ENDPOINT": hub.url,
        "HF_HOME": str(tmp_path / "cache"),
        "HF_TOKEN": "hf_test",
        "HF_HUB_DISABLE_XET": "1",
        "HF_HUB_DISABLE_PROGRESS_BARS": "1",
        "PYTHONPATH": str(Path(policies.__file__).parents[2]),
    }

    def run(line: str) -> str:
        command = [sys.executable, "-c", _BEGIN.format(line=line)]
        done = subprocess.run(command, env=env, capture_output=True, text=True, check=False, timeout=120)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    return run


def files_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_policy_is_pushed_loaded_and_kept(hub: Hub, python: Python, tmp_path: Path) -> None:
    config = tiny_policy.make(tmp_path / "tiny")
    (tmp_path / "tiny" / "README.md").write_text("a card")
    (tmp_path / "tiny" / "notes.txt").write_text("private")
    name = python(f"print(artifacts.push_to_hub({str(tmp_path / 'tiny')!r}, 'somebody/tiny'))")
    assert name.startswith("hf://somebody/tiny@")
    held = hub.repositories["somebody/tiny"]["main"]
    assert set(held) == {"config.json", "README.md", *config.holds}
    assert held == {file: (tmp_path / "tiny" / file).read_bytes() for file in held}
    assert python("print(policies.load('hf://somebody/tiny').name)") == "tiny"
    assert python(f"print(policies.load({name!r}).name)") == "tiny"
    # Once there, it needs no connection, by the branch as by the commit.
    hub.repositories.clear()
    hub.server_close()
    for each in (name, "hf://somebody/tiny"):
        assert python(f"print(policies.load({each!r}).name)") == "tiny"
    assert python("policies.load('hf://somebody/else')").startswith(
        "ConnectionLostError: hf://somebody/else is not in the cache, and the hub cannot be reached"
    )


def test_nothing_but_the_policy_is_downloaded(hub: Hub, python: Python, tmp_path: Path) -> None:
    tiny_policy.make(tmp_path / "tiny")
    hub.commit("somebody/tiny", {**files_of(tmp_path / "tiny"), "other.bin": b"x" * 1000, "evil.onnx": b"x"})
    assert python("print(policies.load('hf://somebody/tiny').name)") == "tiny"
    got = {line.partition("/resolve/")[2].split()[0].partition("/")[2] for line in hub.requests if "/resolve/" in line}
    assert got == {"config.json", *tiny_policy.make(tmp_path / "again").holds}


def test_a_policy_that_uses_another_names_it_on_the_hub(hub: Hub, python: Python, tmp_path: Path) -> None:
    tiny_policy.make_feel(tmp_path / "feel")
    chooser, folder = str(tmp_path / "feel" / "chooser"), str(tmp_path / "feel")
    said = python(f"artifacts.push_to_hub({folder!r}, 'somebody/feel')")
    assert said.startswith("ConfigError: uses.depth.policy is 'chooser', which the hub does not have")
    name = python(f"print(artifacts.push_to_hub({chooser!r}, 'somebody/chooser'))")
    tiny_policy.make(tmp_path / "other", learned_from=("ycb",))
    other = python(f"print(artifacts.push_to_hub({str(tmp_path / 'other')!r}, 'somebody/other'))")
    push = "artifacts.push_to_hub({!r}, 'somebody/feel', uses={{'depth': {!r}}})"
    said = python(push.format(folder, other))
    assert said == f"ConfigError: {other} is another policy than the one that is used as 'depth'; push that one"
    assert "somebody/feel" not in hub.repositories
    python(push.format(folder, name))
    held = json.loads(hub.repositories["somebody/feel"]["main"]["config.json"])
    assert held["uses"]["depth"]["policy"] == name
    assert python("print(policies.load('hf://somebody/feel').name)") == "tiny-feel"


@pytest.mark.parametrize(
    ("change", "name", "message"),
    [
        ({}, "somebody/nothing", "the hub has no repository somebody/nothing, or it is private"),
        ({}, "somebody/tiny@v9", "the hub has no revision 'v9' of somebody/tiny"),
        ({"scorer.onnx": b"tampered"}, "somebody/tiny", "scorer.onnx is not the file that"),
        (
            {"scorer.onnx": None},
            "somebody/tiny",
            "hf://somebody/tiny has no file scorer.onnx; its policy is missing or incomplete",
        ),
        ({"config.json": None}, "somebody/tiny", "hf://somebody/tiny has no file config.json"),
        ({"config.json": b"{"}, "somebody/tiny", "hf://somebody/tiny: config.json is not valid JSON"),
        ({"config.json": b" " * 2_000_000}, "somebody/tiny", "config.json have 2000000 bytes; at most 1048576 are"),
    ],
)
def test_what_is_no_policy_is_refused(
    hub: Hub, python: Python, tmp_path: Path, change: dict[str, bytes | None], name: str, message: str
) -> None:
    tiny_policy.make(tmp_path / "tiny")
    files = {**files_of(tmp_path / "tiny"), **change}
    hub.commit("somebody/tiny", {file: content for file, content in files.items() if content is not None})
    said = python(f"policies.load('hf://{name}')")
    assert said.startswith("ConfigError: ")
    assert message in said


def test_a_policy_that_is_too_large_is_not_downloaded(hub: Hub, python: Python, tmp_path: Path) -> None:
    tiny_policy.make(tmp_path / "tiny")
    hub.commit("somebody/tiny", files_of(tmp_path / "tiny"))
    hub.stated["scorer.onnx"] = 1 << 40
    assert "at most 268435456 are downloaded" in python("policies.load('hf://somebody/tiny')")
    assert not any("scorer.onnx" in request for request in hub.requests)


def test_names_and_the_missing_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert repository("hf://owner/a.b-c@refs/pr/1") == ("owner/a.b-c", "refs/pr/1")
    for name in ("hf://owner", "hf://owner/name/more", "hf:///x", "hf://a/b@", "hf://a/../b"):
        with pytest.raises(errors.ConfigError, match="pass hf://owner/name"):
            policies.load(name)
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(errors.MissingExtraError, match=r"pip install 'graspbox\[hub\]'"):
        policies.load("hf://owner/name")
    tiny_policy.make(tmp_path)
    with pytest.raises(errors.MissingExtraError, match=r"pip install 'graspbox\[hub\]'"):
        push_to_hub(tmp_path, "owner/name")
