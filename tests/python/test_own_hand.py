"""``graspbox hand train``: all stages, also after SIGKILL and Ctrl-C; what it refuses."""

import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest

for module in ("torch", "typer", "pyarrow", "onnx", "onnxruntime", "onnxscript", "cmaes"):
    pytest.importorskip(module, reason="the command needs the extras 'data', 'search' and 'train'")

from command_line import invoke  # noqa: E402
from graspbox import load_hand  # noqa: E402
from graspbox.errors import ConfigError, FileError, HandError  # noqa: E402
from graspbox.hand_tools import guess_hand  # noqa: E402
from graspbox.hand_tools.searching import search_hand  # noqa: E402
from graspbox.learn.recipes import own_hand  # noqa: E402
from graspbox.learn.recipes.settings.depth import DepthSettings  # noqa: E402
from graspbox.learn.recipes.settings.own_hand import Minutes, OwnHandSettings  # noqa: E402
from graspbox.learn.training.options import TrainingOutcome  # noqa: E402
from graspbox.policies.published.folders import hand_of, read_depth_policy  # noqa: E402
from interrupting import train_despite_kills  # noqa: E402
from made_hands import urdf  # noqa: E402
from test_hand_guessing import JAWS, turning  # noqa: E402

pytestmark = pytest.mark.train
POLICIES = Path(__file__).parents[2] / "policies"
#: The published policies are installed for users; here they are folders.
PUBLISHED: dict[str, Any] = {"start": str(POLICIES / "any_hand"), "completion": str(POLICIES / "depth")}
BOTTLES = "procedural:bottle:2000-2003"


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write two fingers that turn."""
    path = tmp_path_factory.mktemp("own_hand") / "made.urdf"
    path.write_text(urdf(JAWS, turning(-0.8, 0.6)))
    return path


def words(file: Path, out: Path) -> list[str]:
    published = [word for name, folder in PUBLISHED.items() for word in (f"--{name}", folder)]
    return ["hand", "train", str(file), "--out", str(out), "--quick", *published]


@pytest.fixture(scope="module")
def trained(file: Path) -> Path:
    """Train quickly; the command is killed in the search and in the training, and each time continues."""
    out = file.parent / "run"
    command = [sys.executable, "-m", "graspbox", *words(file, out)]
    train_despite_kills(command, out, ("hand/search.jsonl", "training/scorer/checkpoint.pt"))
    return out


def test_all_stages_state_what_they_found(file: Path, trained: Path) -> None:
    result = invoke([*words(file, trained), "--json"])
    assert result.exit_code == 0, result.output
    table = json.loads(result.stdout)
    stages = {each["stage"]: each for each in table["stages"]}
    assert list(stages) == ["hand", "check", "start", "tuned"]
    held = stages["hand"]["search"]["held_out"]["all"]
    assert held["guess"]["held"] > 60
    assert f"the guess holds {held['guess']['held']} of 120" in stages["hand"]["figure"]
    assert stages["check"]["counts"]["error"] == 0
    assert Path(stages["check"]["picture"]).read_bytes()[:4] == b"\x89PNG"
    for name in ("start", "tuned"):
        found = stages[name]["objects"][BOTTLES]
        assert found["trials"] == 6
        assert f"{BOTTLES} {found['rate']:.1%}" in stages[name]["figure"]
    assert all(each["seconds"] > 0 and Path(each["folder"]).is_dir() for each in stages.values())
    assert table["policy"] == str(trained / "tuned" / "policy")
    config = read_depth_policy(trained / "tuned" / "policy")
    assert (config.name, config.hand) == ("made", "made")
    # The policy has the searched hand, and the numbers of the policy of many hands.
    own, searched = (
        load_hand(hand_of(trained / "tuned/policy", config)),
        load_hand((trained / "hand/hand.urdf", trained / "hand/hand.toml")),
    )
    assert own.files[1] == searched.files[1]
    assert table["next"][0] == f"graspbox evaluate {trained / 'tuned' / 'policy'} --objects {BOTTLES}"
    assert table["next"][-1] == shown(file, trained) + " --minutes.own 108"
    # Nothing was done twice.
    log = (trained / "log.txt").read_text()
    assert len(re.findall("check: begins", log)) == 1


def shown(file: Path, out: Path) -> str:
    return " ".join(["graspbox", *words(file, out), "--json"])


def test_a_later_call_adds_the_hand_s_own_policy(file: Path, trained: Path) -> None:
    before = (trained / "tuned.json").read_text()
    result = invoke([*words(file, trained), "--minutes.own", "1"])
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert [line.split()[0] for line in lines[:5]] == ["hand", "check", "start", "tuned", "own"]
    assert f"{trained / 'own'}: the hand's own policy grasps {BOTTLES}" in lines[4]
    assert (trained / "tuned.json").read_text() == before
    assert read_depth_policy(trained / "tuned/policy").name == read_depth_policy(trained / "own/policy").name == "made"
    assert (trained / "training" / "round-2.json").exists()


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch) -> list[DepthSettings | KeyboardInterrupt]:
    """Replace trainings and evaluations, which take minutes; interrupts in the list are raised."""
    calls: list[Any] = []

    def train(options: DepthSettings, command: str, echo: Any) -> TrainingOutcome:
        if calls and isinstance(calls[-1], KeyboardInterrupt):
            raise calls.pop()
        calls.append(options)
        return TrainingOutcome({"evaluate": {each: result(len(calls)) for each in options.evaluated}}, "")

    def result(number: int) -> dict[str, Any]:
        return {"trials": 6, "succeeded": 7 - number, "rate": (7 - number) / 6, "ci95": [0.0, 1.0]}

    monkeypatch.setattr("graspbox.learn.recipes.depth.train", train)
    monkeypatch.setattr(own_hand, "evaluated", lambda *_: result(5))
    return calls


def test_the_clock_decides_rounds_and_ctrl_c_loses_nothing(
    file: Path, tmp_path: Path, called: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "run"

    def run(**minutes: float) -> TrainingOutcome:
        settings = OwnHandSettings(file=str(file), out=out, quick=True, minutes=Minutes(**minutes), **PUBLISHED)
        return own_hand.train(settings, "graspbox train hand", lambda _: None)

    def interrupt(*given: Any, told: Any, **more: Any) -> Any:
        def stop(trials: int, best: float) -> None:
            raise KeyboardInterrupt

        return search_hand(*given, told=stop, **more)

    with monkeypatch.context() as patched:
        patched.setattr(own_hand, "search_hand", interrupt)
        with pytest.raises(KeyboardInterrupt):
            run()
    assert not (out / "hand.json").exists()
    journal = (out / "hand/search.jsonl").read_text()
    assert len(journal.splitlines()) == 5  # its head, and the first candidates
    called.append(KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        run()
    assert (out / "hand/search.jsonl").read_text().startswith(journal)
    made = (out / "hand.json").read_text()
    tuned = run()
    assert (out / "hand.json").read_text() == made
    assert [each["stage"] for each in tuned.results["stages"]] == ["hand", "check", "start", "tuned"]
    assert "grasps more of these objects" not in tuned.text
    run(own=36.0)
    assert [options.sizes.rounds for options in called] == [1, 3]
    assert called[1].publish == out / "own/policy"
    assert {options.sizes.rehearsed for options in called} == {0}, "jaws rehearse nothing"
    settings = OwnHandSettings(file=str(file), out=out, **PUBLISHED)
    assert settings.training("a,b", "hand", out / "policy", fingers=3, own=False).sizes.rehearsed == 16
    assert 2 * (called[1].hours.collect + called[1].hours.round) == pytest.approx(0.85 * 0.6)
    # With too little more nothing is done; another round keeps the earlier policy aside.
    (out / "own/policy").mkdir()
    run(own=50.0)
    assert len(called) == 2
    more = run(own=54.0)
    assert called[2].sizes.rounds == 4
    assert (out / "with-2-rounds_of_minutes_own/own/policy").is_dir()
    assert "tuned grasps more of these objects than own" in more.text
    with pytest.raises(ConfigError, match="rounds_of_minutes_own was 3, is now 0"):
        run()


def test_a_hand_that_holds_nothing_is_corrected(file: Path, tmp_path: Path, called: list[Any]) -> None:
    """The check ends the command, which goes on with the corrected file; a hand.toml of the user's is not searched."""
    text, out = guess_hand(file).text, tmp_path / "run"
    toml = tmp_path / "made.toml"
    toml.write_text(re.sub(r"(?m)^(rpy = { value = )\[[^]]*\]", r"\1[3.14159, 0.0, 0.0]", text))
    given = OwnHandSettings(file=f"{file},{toml}", out=out, quick=True, name="other", **PUBLISHED)
    with pytest.raises(HandError, match=r"hand\.toml: no policy can use this hand; correct the file \(see .*hand\.png"):
        own_hand.train(given, "", lambda _: None)
    assert not called
    (out / "hand/hand.toml").write_text(text)
    done = own_hand.train(given, "", lambda _: None)
    assert done.results["stages"][0]["figure"] == "as given"
    assert called[0].name == "other"
    assert called[0].hand == f"{out / 'hand/hand.urdf'},{out / 'hand/hand.toml'}"


def test_wrong_input_is_refused_before_anything_is_written(
    file: Path, tmp_path: Path, trained: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(own_hand, "run_stages", lambda *_: pytest.fail("it was not refused"))

    def refused(match: str, kind: type[Exception] = ConfigError, **more: Any) -> None:
        with pytest.raises(kind, match=match):
            own_hand.train(
                OwnHandSettings(**{"file": str(file), "out": tmp_path / "run", **PUBLISHED, **more}), "", print
            )
        assert not (tmp_path / "run").exists()

    empty = tmp_path / "empty.urdf"
    empty.write_text('<robot name="x"><link name="a"/></robot>')
    refused("none.urdf", FileError, file="none.urdf")
    refused("empty.urdf has no joint that moves by itself", HandError, file=str(empty))
    refused("there is no link 'wrist'", HandError, base="wrist")
    refused(r"--base is 'palm', but the hand has its hand\.toml", file="leap", base="palm")
    refused("a policy of the hand 'reflex'; name one of many hands", start=PUBLISHED["completion"])
    refused("name objects from which nothing is learned", evaluated=("procedural:prism:300",))
    refused("there is no policy 'any_hans'", start="any_hans")
    refused("--minutes.search is 0; pass a positive number", minutes=Minutes(search=0.0))
    refused("--minutes.tuned is 2; pass 5 or more", minutes=Minutes(tuned=2.0))
    refused("--minutes.tuned is nan; pass 5 or more", minutes=Minutes(tuned=float("nan")))
    refused("--minutes.own is -1; pass 0 or more", minutes=Minutes(own=-1.0))
    refused("--minutes.own is 5; a round takes 18", minutes=Minutes(own=5.0))
    refused("a comma separates the two files", out=tmp_path / "a,b")
    other = tmp_path / "other.urdf"
    other.write_text(file.read_text())
    refused(
        "was begun with other settings: file was 'made.urdf', is now 'other.urdf'",
        file=str(other),
        out=trained,
        quick=True,
    )
    changed = tmp_path / "made.urdf"
    changed.write_text(file.read_text() + "\n")
    refused("contents was", file=str(changed), out=trained, quick=True)
