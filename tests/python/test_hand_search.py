"""The search for a hand's posture: what it changes, that it improves a wrong guess, and that it resumes."""

import json
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from command_line import invoke
from graspbox.errors import ConfigError, HandError
from graspbox.hand_tools import searching
from graspbox.hand_tools.closing import follow
from graspbox.hand_tools.guessing import Guess, begin_guess
from graspbox.hand_tools.postures import Postures
from graspbox.hand_tools.searching import Budget, SearchedHand, search_hand
from graspbox.hand_tools.trials import LEAST_OPENING, Judged, judge, resting
from made_hands import Box, Joint, urdf
from test_hand_guessing import JAWS, turning

pytest.importorskip("cmaes")
#: A small link between the palm and a finger.
ROOT = Box((0.0, 0.0, 0.0), (0.01, 0.01, 0.01))
ASSETS = Path(__file__).parents[2] / "env/hand/assets"


def wrong_guess(folder: Path) -> Guess:
    """Guess two fingers that turn, and let them begin nearly closed: nothing fits between them."""
    path = folder / "made.urdf"
    path.write_text(urdf(JAWS, turning(-0.8, 0.6)))
    guess = begin_guess(path)
    opened = np.full(2, 0.2)
    return replace(guess, closing=follow(guess.fingers, opened, guess.closing.closed, guess.closing.closes))


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search with few objects, few first postures, and as many grasps of each in the search as in the end."""
    objects = {"_OBJECTS": (1,), "_CHOOSING": (4,), "_HELD_OUT": (10,)}
    for name, value in {**objects, "_FIRST": 8, "_POSES": 4, "_FINAL_POSES": 4}.items():
        monkeypatch.setattr(searching, name, value)


def searched(guess: Guess, journal: Path, trials: int, **options: Any) -> SearchedHand:
    return search_hand(guess, Budget(trials=trials), journal, **options)


def test_it_improves_a_wrong_guess_and_says_so(tmp_path: Path, small: None) -> None:
    guess = wrong_guess(tmp_path)
    found = searched(guess, tmp_path / "journal", 150)
    assert found.better
    assert found.finished
    assert 150 <= found.trials < 300
    name, before, after = found.rows[-1]
    assert name == "all"
    assert before.held <= 2
    assert after.held >= before.held + 4
    # Objects that neither has seen, with the planner as it is.
    hands = [graspbox.Hand(guess.fitted.text, text) for text in (guess.write().text, found.guessed.text)]
    first, second = judge(hands, resting(hands[0], 0.08, (20,)), 4)
    assert sum(row.held for row in second) > sum(row.held for row in first)
    grasp = tomllib.loads(found.guessed.text)["grasp"]
    source = grasp["center"]["source"]
    assert source.startswith(
        f"search by `graspbox hand new`: {found.trials} simulated grasps, seed 0; on held-out objects"
    )
    assert grasp["preshapes"][0]["positions"]["turn_left"]["source"] == source
    # Nothing else changes.
    pads = [tomllib.loads(text)["pads"] for text in (guess.write().text, found.guessed.text)]
    assert pads[0] == pads[1]
    assert "simulated grasps" in found.guessed.review[0]


def test_the_same_seed_gives_the_same_file_and_a_journal_resumes(tmp_path: Path, small: None) -> None:
    guess = wrong_guess(tmp_path)
    whole = searched(guess, tmp_path / "whole", 120)
    seen: list[tuple[int, float]] = []

    def interrupt(trials: int, best: float) -> None:
        seen.append((trials, best))
        if len(seen) == 2:
            raise KeyboardInterrupt

    part = searched(guess, tmp_path / "part", 120, told=interrupt)
    assert not part.finished
    assert part.rows == ()
    assert "interrupted" in part.guessed.text
    assert [trials for trials, _ in seen] == [48, 96]  # one object of each family
    # A line that was cut off is judged again.
    text = (tmp_path / "part").read_text()
    (tmp_path / "part").write_text(text[:-20])
    resumed = searched(guess, tmp_path / "part", 120)
    assert resumed.guessed.text == whole.guessed.text
    assert resumed.trials == whole.trials
    assert (tmp_path / "part").read_text() == (tmp_path / "whole").read_text()
    for other in ({"seed": 1}, {}):
        changed = guess if other else replace(guess, name="another")
        with pytest.raises(ConfigError, match="journal of another search"):
            searched(changed, tmp_path / "part", 120, **other)
    (tmp_path / "part").write_bytes(b"\xff\x00")
    with pytest.raises(ConfigError, match="journal of another search"):
        searched(guess, tmp_path / "part", 120)


def test_a_known_journal_is_not_simulated_again(tmp_path: Path, small: None, monkeypatch: pytest.MonkeyPatch) -> None:
    guess = wrong_guess(tmp_path)
    calls: list[int] = []
    searched(guess, tmp_path / "journal", 96)

    def counted(hands: Sequence[graspbox.Hand | None], *rest: Any, **more: Any) -> list[list[Judged]]:
        calls.append(len(hands))
        return judge(hands, *rest, **more)

    monkeypatch.setattr(searching, "judge", counted)
    searched(guess, tmp_path / "journal", 96)
    assert calls == [1, 2]  # the choice among the best and the verdict alone


def same_value(hands: Sequence[graspbox.Hand | None], tasks: Sequence[Any], poses: int, **_: Any) -> list[list[Judged]]:
    return [[Judged(poses, poses, 1, 0, 0.4) for _ in tasks] for _ in hands]


def test_a_journal_counts_when_no_time_is_left(tmp_path: Path, small: None) -> None:
    """The verdict may have been interrupted; and nothing is searched once all grasps hold firmly."""
    guess = wrong_guess(tmp_path)
    searched(guess, tmp_path / "journal", 96)
    again = search_hand(guess, Budget(seconds=0.0), tmp_path / "journal")
    assert again.trials >= 96
    assert again.rows
    perfect = replace(guess, name="perfect")
    with pytest.MonkeyPatch.context() as patched:
        firm = Judged(4, 4, 4, 4, 1.0)
        patched.setattr(searching, "judge", lambda hands, tasks, *_, **__: [[firm] * len(tasks) for _ in hands])
        assert searched(perfect, tmp_path / "perfect", 5000).trials <= 48


def test_large_seeds(tmp_path: Path, small: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of CMA-ES have 32 bits, those of the command 64; each start has its own."""
    monkeypatch.setattr(searching, "judge", same_value)
    guess, points = wrong_guess(tmp_path), []
    for number, seed in enumerate((2**64 - 1, 2**32, 0)):
        assert searched(guess, tmp_path / f"journal_{number}", 200, seed=seed).finished
        rows = (tmp_path / f"journal_{number}").read_text().splitlines()[1:-1]
        points.append([json.loads(row)["point"] for row in rows][8:])
        assert points[-1]
    assert points[0] != points[1] != points[2] != points[0]


def test_a_hand_that_does_not_open_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Postures, "opening", lambda _: 0.0004)
    with pytest.raises(HandError, match=r"made.urdf: the hand opens by 0.4 mm between its fingers, .* leave out"):
        searched(wrong_guess(tmp_path), tmp_path / "journal", 100)
    hand = graspbox.load_hand("panda_gripper")
    assert len(resting(hand, LEAST_OPENING, (0, 1, 10, 11, 12, 13))) == 18  # such small objects can be simulated


def test_numbers_of_a_hand(tmp_path: Path) -> None:
    """Parallel fingers share theirs; mirrors of the hand fix turns and shifts; the guess is the first posture."""
    leap = begin_guess(ASSETS / "leap/leap.urdf")
    postures = Postures(leap)
    joints = leap.fingers.hand.joints
    groups = [[joints[joint] for joint in group] for group in postures.groups]
    for kind in ("mcp", "rot", "pip", "dip"):
        assert [f"{finger}_{kind}" for finger in ("if", "mf", "rf")] in groups
    assert [group for group in groups if group[0].startswith("th_")] == [["th_cmc"], ["th_axl"], ["th_mcp"], ["th_ipl"]]
    assert postures.free == [0, 1, 2, 3, 4, 5]
    first = next(postures.first(np.random.default_rng(0)))
    again = postures.hand(first)
    guessed = graspbox.Hand(leap.fitted.text, leap.write().text)
    np.testing.assert_allclose(again.open(0.0), guessed.open(0.0), atol=0.2)
    np.testing.assert_allclose(again.closing_center(0.0), guessed.closing_center(0.0), atol=0.02)
    jaw = Postures(begin_guess(ASSETS / "panda_gripper/panda_gripper.urdf"))
    assert (len(jaw.groups), jaw.free, jaw.size) == (1, [5], 3)


def spreading(folder: Path) -> Guess:
    """Guess two fingers whose roots spread over mirrored ranges, and let one of them begin further open."""
    path = folder / "spreads.urdf"
    roots = {"root_left": [ROOT], "root_right": [ROOT]}
    joints = {
        "spread_left": Joint("palm", "root_left", (-0.04, 0.0, 0.03), (0.0, 0.0, 1.0), (-0.5, 1.3)),
        "spread_right": Joint("palm", "root_right", (0.04, 0.0, 0.03), (0.0, 0.0, 1.0), (-1.3, 0.5)),
        "turn_left": Joint("root_left", "left", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-0.8, 0.6)),
        "turn_right": Joint("root_right", "right", (0.0, 0.0, 0.0), (0.0, -1.0, 0.0), (-0.8, 0.6)),
    }
    path.write_text(urdf({**JAWS, **roots}, joints))
    guess = begin_guess(path)
    names = guess.fingers.hand.joints
    opened = np.where(guess.closing.closes, guess.closing.opened + 0.1 * np.arange(4), guess.closing.opened)
    assert dict(zip(names, guess.closing.closes.tolist(), strict=True)) == {name: name[0] == "t" for name in names}
    return replace(guess, closing=follow(guess.fingers, opened, guess.closing.closed, guess.closing.closes))


def test_the_guess_is_a_posture(tmp_path: Path) -> None:
    """Also of joints that spread over mirrored ranges, and of alike ones that are open by different shares."""
    for guess in (spreading(tmp_path), wrong_guess(tmp_path), begin_guess(ASSETS / "leap/leap.urdf")):
        postures = Postures(guess)
        closing = postures.closing_of(postures.guessed())
        np.testing.assert_allclose(closing.opened, guess.closing.opened, atol=1e-12)
        np.testing.assert_allclose(closing.closed, guess.closing.closed, atol=1e-12)
        np.testing.assert_array_equal(closing.closes, guess.closing.closes)
    postures = Postures(spreading(tmp_path))
    assert len(postures.groups) == 2
    wider = postures.guessed()
    spread = next(number for number, joints in enumerate(postures.groups) if 0 in joints)
    wider.point[spread] += 0.1
    moved = postures.closing_of(wider).opened - postures.guess.closing.opened
    np.testing.assert_allclose(np.sort(moved), [-0.18, 0.0, 0.0, 0.18], atol=1e-12)


def test_other_objects_choose_among_the_best(tmp_path: Path, small: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the finalists the best with them, not with those of the search."""
    asked: list[int] = []

    def judged(hands: Sequence[Any], tasks: Sequence[Any], poses: int, **options: Any) -> list[list[Judged]]:
        if options.get("seed") != 2:
            return judge(hands, tasks, poses, **options)
        asked.append(len(hands))
        return [[Judged(poses, value=float(number)) for _ in tasks] for number in range(len(hands))]

    guess = wrong_guess(tmp_path)
    own = searched(guess, tmp_path / "own", 150)
    monkeypatch.setattr(searching, "judge", judged)
    other = searched(guess, tmp_path / "other", 150)
    assert len(asked) == 1
    assert asked[0] > 1
    assert (tmp_path / "own").read_text() == (tmp_path / "other").read_text()
    assert other.rows[-1][2] != own.rows[-1][2]


def test_budgets() -> None:
    assert [Budget.of(text) for text in ("10min", "90s", "1.5h", "5000")] == [
        Budget(seconds=600.0), Budget(seconds=90.0), Budget(seconds=5400.0), Budget(trials=5000)
    ]  # fmt: skip
    for text in ("", "0", "-5", "10 minutes", "1.5", "nan", "0s"):
        with pytest.raises(ConfigError, match="--search is"):
            Budget.of(text)


def test_the_command(tmp_path: Path, small: None) -> None:
    path, out, picture = tmp_path / "made.urdf", tmp_path / "hand.toml", tmp_path / "hand.png"
    path.write_text(urdf(JAWS, turning(-0.8, 0.6)))
    words = ["hand", "new", path, "--out", out, "--search", "48", "--picture", picture]
    result = invoke([*words, "--json"])
    assert result.exit_code == 0, result.output
    table = json.loads(result.stdout)
    assert table["search"]["finished"]
    assert set(table["search"]["held_out"]) == {"can", "box", "ball", "all"}
    assert set(table["search"]["held_out"]["all"]["search"]) == {"asked", "tried", "held", "firm", "value"}
    assert graspbox.load_hand((path, out)).name == "made"
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "hand.search.jsonl").exists()
    # The file of a finished search may have been edited since.
    out.write_text(edited := out.read_text() + "# edited")
    refused = invoke(words, catch_exceptions=True)
    assert isinstance(refused.exception, ConfigError)
    assert "hand.toml' exists; give --force" in str(refused.exception)
    assert out.read_text() == edited
    # An interrupted one resumes, and replaces its own file.
    journal = tmp_path / "hand.search.jsonl"
    journal.write_text("\n".join(journal.read_text().splitlines()[:-1]) + "\n")
    result = invoke(words)
    assert result.exit_code == 0, result.output
    assert "held-out objects" in result.stdout
    assert not out.read_text().endswith("# edited")
    wrong = invoke([*words[:-3], "ten", "--force"], catch_exceptions=True)
    assert isinstance(wrong.exception, ConfigError)
