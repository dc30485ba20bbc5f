"""``graspbox report``: every kind of run, contents and requests of the page, spoilt runs, and the page in a browser."""

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from browsing import Browser, browsing, needs_browser
from command_line import invoke
from graspbox import object_sets
from graspbox._common.files import dumps
from graspbox._common.runs import Run
from graspbox.data import trials as dataset
from graspbox.errors import ConfigError, FileError, GraspboxError
from graspbox.evaluation import wilson
from graspbox.evaluation.replays import ActionLog, Replay, failed
from graspbox.tools.reports import MAX_TABLE, read_run, report
from graspbox.tools.reports.page import page
from graspbox.tools.reports.runs import Counts, Trials
from graspbox.tools.reports.tables import comparisons, difference, mcnemar, reliability_rows, trial_columns
from program_files import imported

ROOT = Path(__file__).parents[2]
OBJECTS = ("--objects", "procedural:can:0-2", "--objects", "procedural:clamp:0-1")


def command(*words: str) -> str:
    """Run a command; return its output."""
    result = invoke(list(words), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a folder with a run of every kind."""
    folder = tmp_path_factory.mktemp("runs")
    for policy in ("zero", "planner"):
        more = ("--trials", "12", "--out", str(folder / f"{policy}.json"))
        printed = command("evaluate", policy, *OBJECTS, *more, "--json")
        (folder / f"{policy}-printed.json").write_text(printed)
    command("grasp", "--objects", "procedural:clamp:0-1", "--poses", "5", "--out", str(folder / "grasps.json"))
    config = dataset.DatasetConfig(poses=16, views=0, shard_trials=16)
    dataset.generate(object_sets.load("procedural:clamp:0-1"), folder / "data", config=config)
    script = imported(ROOT / "scripts/evaluate_policies.py")
    words = ["--policies", "random", "--policies", "zero", "--objects", "procedural:can:0-2", "--trials", "6"]
    words += ["--seeds", "0", "--seeds", "1"]
    assert script.main(["--out", str(folder / "compared"), *words, "--conditions", "nominal", "--json"]) == 0
    with Run(folder / "trained", {"steps": 30}) as run:
        run.log("begins")
        run.stage("scorer", 60.0, scored)
    return folder


def scored(run: Run) -> dict[str, float]:
    """Write losses as a training does."""
    rows = run.rows("losses")
    for step in range(30):
        rows.append({"step": step, "seconds": 0.1 * step, "loss": math.exp(-step), "accuracy": 1 - math.exp(-step)})
    return {"accuracy": 0.9}


def content(path: Path) -> dict[str, Any]:
    """Read the data of a page."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', path.read_text(), re.DOTALL)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


# --- runs ------------------------------------------------------------------------------------------------------------


def test_every_kind_of_run_is_recognised(runs: Path) -> None:
    kinds = {path.name: [run.kind for run in read_run(path)] for path in sorted(runs.iterdir())}
    assert kinds == {
        "compared": ["evaluation"] * 2,
        "data": ["data set"],
        "grasps.json": ["grasps"],
        "planner-printed.json": ["evaluation"],
        "planner.json": ["evaluation"],
        "trained": ["training"],
        "zero-printed.json": ["evaluation"],
        "zero.json": ["evaluation"],
    }


def test_counts_are_those_of_the_files(runs: Path) -> None:
    (planner,) = read_run(runs / "planner.json")
    (printed,) = read_run(runs / "planner-printed.json")
    written = json.loads((runs / "planner.json").read_text())
    assert planner.total is not None
    assert printed.total == planner.total
    assert (planner.total.trials, planner.total.succeeded) == (12, written["succeeded"])
    assert dict(planner.total.failures) == written["failures"]
    assert {n: (c.trials, c.succeeded) for n, c in planner.objects.items()} == {
        row["name"]: (row["trials"], row["succeeded"]) for row in written["objects"]
    }
    assert planner.facts["command"] == written["made"]["command"]
    assert planner.facts["date"] == written["made"]["date"]
    (grasps,) = read_run(runs / "grasps.json")
    table = json.loads((runs / "grasps.json").read_text())
    assert grasps.total is not None
    assert (grasps.total.trials, grasps.total.succeeded) == (table["tried"], table["succeeded"])
    (data,) = read_run(runs / "data")
    assert data.total is not None
    assert data.total.succeeded == int(dataset.column(dataset.load(runs / "data"), "success").sum())
    random, zero = read_run(runs / "compared")
    assert (random.name, zero.name) == ("random, procedural:can:0-2", "zero, procedural:can:0-2")
    assert zero.total is not None
    assert dict(zero.total.failures) == {"infeasible": 12}
    assert "evaluate_policies.py" in zero.facts["command"]


def test_a_report_of_all_runs_holds_them_and_loads_nothing(runs: Path, tmp_path: Path) -> None:
    names = ("planner.json", "zero.json", "grasps.json", "data", "compared", "trained")
    out = tmp_path / "new" / "report.html"
    told = json.loads(
        command("report", *(str(runs / n) for n in names), "--out", str(out), "--pictures", "6", "--json")
    )
    assert told == {"file": str(out), "bytes": out.stat().st_size}
    text = out.read_text()
    # Addresses in the program of Vega are names of schemas and of SVG; no element and no style loads any.
    markup = re.sub(r"<script[^>]*>.*?</script>", "", text, flags=re.DOTALL)
    assert not re.search(r"(src|href)\s*=\s*[\"']?(?!#|data:)|url\(|@import|https?:", markup)
    assert "default-src 'none'" in markup
    data = content(out)
    assert [run["kind"] for run in data["runs"]] == [
        "evaluation", "evaluation", "grasps", "data set", "evaluation", "evaluation", "training",
    ]  # fmt: skip
    titles = [chart["title"] for chart in data["charts"]]
    assert {"Success by class of object", "Success by object", "Failures by kind", "loss", "accuracy"} <= set(titles)
    pictures = data["pictures"]
    assert len(pictures) == 6
    assert {1, 2, 3} <= {row["run"] for row in pictures}
    # The repetition ends as the stored trial did, and its pictures are WebP.
    assert all(row["now"] == row["failure"] for row in pictures)
    assert all(image.startswith("UklGR") for row in pictures for image in row["images"])
    summary = {(row["run"], row["group"], row["name"]): row for row in data["summary"]}
    whole = summary[0, "run", "planner"]
    expected = wilson(round(12 * whole["success"][0]), 12)
    assert whole["success"][1:] == pytest.approx(expected, abs=1e-4)
    assert summary[0, "object", "clamp-000000"]["classes"] == ["flat", "box"]


def test_runs_are_compared_on_their_common_trials(runs: Path) -> None:
    both = [run for name in ("planner.json", "zero.json", "compared") for run in read_run(runs / name)]
    pairs = {(pair["first"], pair["second"]): pair for pair in comparisons(both)}
    assert pairs.keys() == {(0, 1), (0, 2), (2, 3)}
    (planner, zero) = (both[i].trials for i in (0, 1))
    assert planner is not None
    assert zero is not None
    won = int(planner.success.sum())
    assert pairs[0, 1]["trials"] == 12
    assert pairs[0, 1]["only"] == [won, 0]
    assert pairs[0, 1]["difference"][0] == pytest.approx(-won / 12, abs=1e-4)


def test_the_table_is_bounded_and_rates_count_all(runs: Path, tmp_path: Path) -> None:
    report([runs / "zero.json", runs / "planner.json"], tmp_path / "r.html", pictures=0, trials=10)
    data = content(tmp_path / "r.html")
    assert len(data["trials"]["run"]) == 10
    assert data["trials"]["left_out"] == {"0": 7, "1": 7}
    assert [row["trials"] for row in data["summary"] if row["group"] == "run"] == [12, 12]
    assert data["pictures"] == []
    with pytest.raises(ConfigError, match=f"trials is {MAX_TABLE + 1}; it must be in 0 to {MAX_TABLE}"):
        report([runs / "zero.json"], tmp_path / "r.html", trials=MAX_TABLE + 1)


# --- spoilt runs -----------------------------------------------------------------------------------------------------


def changed(path: Path, **changes: Any) -> str:
    return dumps({**json.loads(path.read_text()), **changes})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not JSON"),
        ("[1, 2]", "is no result of"),
        ("{}", "is no result of"),
        ({"rows": [{"seed": 1, "object": "can"}]}, "success is None"),
        ({"rows": [{"seed": "x", "object": "can", "success": True, "secure": True}]}, "seed is 'x'"),
        ({"rows": [], "objects": 3}, "objects is 3"),
        ({"rows": [], "objects": [{"name": "can", "trials": 1, "succeeded": 2}]}, "2 successes"),
        ({"replays": [{"seed": 1}]}, "a replay cannot be read"),
        ({"condition": None}, "condition is None"),
    ],
)
def test_spoilt_evaluations_give_one_sentence(runs: Path, tmp_path: Path, text: Any, message: str) -> None:
    path = tmp_path / "spoilt.json"
    path.write_text(text if isinstance(text, str) else changed(runs / "zero.json", **text))
    with pytest.raises(GraspboxError, match=re.escape(message)) as error:
        report([path], tmp_path / "r.html")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "r.html").exists()


def test_spoilt_folders_give_one_sentence(runs: Path, tmp_path: Path) -> None:
    with pytest.raises(FileError, match="there is no such file or folder"):
        read_run(tmp_path / "nothing")
    with pytest.raises(ConfigError, match="is a folder without a run"):
        read_run(tmp_path)
    losses = tmp_path / "losses.jsonl"
    losses.write_text('{"loss": 1}\n')
    with pytest.raises(ConfigError, match="line 1 has no step"):
        read_run(tmp_path)
    losses.write_text("x\n")
    with pytest.raises(ConfigError, match="line 1 is no row of JSON"):
        read_run(tmp_path)
    losses.write_text("")
    with pytest.raises(ConfigError, match="has no losses yet"):
        read_run(tmp_path)
    losses.unlink()
    (tmp_path / "settings.json").write_text("{}")
    results = tmp_path / "results.jsonl"
    results.write_text("")
    with pytest.raises(ConfigError, match="has no results yet"):
        read_run(tmp_path)
    row = json.loads((runs / "compared/results.jsonl").read_text().splitlines()[0])
    results.write_text(json.dumps({**row, "trials": [[1, 2]]}) + "\n")
    with pytest.raises(ConfigError, match="a trial has 2 values"):
        read_run(tmp_path)
    results.write_text(json.dumps({**row, "kinds": ["x"]}) + "\n")
    with pytest.raises(ConfigError, match="differ in number from trials"):
        read_run(tmp_path)


def test_spoilt_grasps_give_one_sentence(runs: Path, tmp_path: Path) -> None:
    table = json.loads((runs / "grasps.json").read_text())
    path = tmp_path / "spoilt.json"
    for name, value in (("object_from_hand", [[1, 2], [3]]), ("preshape", "x"), ("success", None), ("failure", 3)):
        objects = json.loads(json.dumps(table["objects"]))
        objects[0]["grasps"][0][name] = value
        path.write_text(json.dumps({**table, "objects": objects}))
        with pytest.raises(ConfigError, match=f"{name} is"):
            read_run(path)
    path.write_text(json.dumps({**table, "objects": [3]}))
    with pytest.raises(ConfigError, match="an entry of objects is not an object"):
        read_run(path)


def test_the_command_refuses_in_one_line(tmp_path: Path) -> None:
    result = invoke(["report", str(tmp_path / "no.json"), "--out", str(tmp_path / "r.html")])
    assert isinstance(result.exception, FileError)
    assert invoke(["report", "--out", "r.html"]).exit_code == 2


# --- replays and tables ----------------------------------------------------------------------------------------------


def test_a_logged_policy_decides_alike_and_its_failures_can_be_run_again() -> None:
    from graspbox import policies
    from graspbox.evaluation import evaluate

    found = object_sets.load(["procedural:can:0-1", "procedural:clamp:0-1"])
    log = ActionLog(policies.load("random"))
    arguments = ("graspbox/Grasp-v0", found, 4, 1)
    result = evaluate(log, *arguments, max_episode_steps=20, num_envs=3, condition="friction_0.5")
    assert result == evaluate("random", *arguments, max_episode_steps=20, num_envs=3, condition="friction_0.5")
    replays = failed(result, log, found)
    assert replays
    for replay in replays:
        stored = json.loads(json.dumps({"settings": result.settings, "row": replay.to_json()}))
        again = Replay.from_json(stored["row"], result.env_id, stored["settings"])
        env = again.make(obs="proprio")
        *_, (_, info) = again.run(env)
        env.close()
        assert info["failure"] == replay.failure
        np.testing.assert_array_equal(again.actions, replay.actions)


def test_differences_of_paired_rates_are_those_of_the_paper() -> None:
    """Newcombe 1998, table II: method 10 for 36 both, 12 and 2 alone, of 50; and for no difference at all."""
    low, high = difference(36, 12, 2, 54 - 4)
    assert (-high, -low) == pytest.approx((0.0569, 0.3404), abs=5e-4)
    low, high = difference(0, 0, 0, 10)
    assert low == -high
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(1, 9) == pytest.approx(2 * 11 / 1024)
    assert mcnemar(500, 600) == pytest.approx(mcnemar(450, 540), abs=0.01)


def trials_of(count: int) -> Trials:
    rng = np.random.default_rng(0)
    stated = rng.uniform(0, 1, count)
    success = rng.uniform(0, 1, count) < stated
    names = tuple(f"object-{i % 7}" for i in range(count))
    kinds = tuple("" if won else "slipped" for won in success)
    return Trials(tuple(map(str, range(count))), names, success, success, kinds, stated)


def test_calibrated_probabilities_lie_within_their_intervals() -> None:
    from graspbox.tools.reports.runs import ReportRun

    trials = trials_of(2000)
    run = ReportRun("made", "evaluation", "", {}, trials.counts(), trials.by_object(), trials)
    rows = reliability_rows([run])
    assert len(rows) == 10
    assert sum(row["low"] <= row["stated"] <= row["high"] for row in rows) >= 8
    columns = trial_columns([run], 100)
    assert columns["left_out"] == {0: 1900}
    assert columns["p"][:3] == [round(float(p), 3) for p in trials.probability[:3]]


def test_counts_and_columns_must_fit() -> None:
    with pytest.raises(ConfigError, match="do not fit together"):
        Counts(2, 3)
    with pytest.raises(ConfigError, match="not within 0 to 1"):
        Trials(("a",), ("b",), np.array([True]), np.array([True]), ("",), np.array([1.5]))


def test_names_of_runs_are_text_in_the_page(tmp_path: Path) -> None:
    hostile = "</script><script>document.title = 'owned'</script><!--"
    made = page(hostile, {"runs": [{"name": hostile}]})
    assert hostile not in made
    assert len(re.findall(r"<script", re.sub(r"(?s)<script>.*?</script>", "", made))) == 1


# --- the page in a browser -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browsing(tmp_path_factory.mktemp("profile")) as one:
        yield one


@pytest.fixture(scope="module")
def shown(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    report([runs / name for name in ("planner.json", "zero.json", "trained")], path, pictures=3)
    return path


COLUMN = """
const [table, column] = arguments;
return [...document.querySelectorAll(`#${table} tbody tr`)].map((row) => row.cells[column].textContent);
"""
CLICK = "const [table, column] = arguments; document.querySelectorAll(`#${table} thead button`)[column].click();"
CHOOSE = """
const [id, value] = arguments, place = document.getElementById(id);
place.value = value;
place.dispatchEvent(new Event(place.tagName === "INPUT" ? "input" : "change"));
"""


@needs_browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 400])
def test_the_page_is_drawn_without_scrolling_and_complaints(
    browser: Browser, shown: Path, width: int, scheme: str
) -> None:
    browser.emulate(width, 900, scheme)
    browser.open(shown.as_uri())
    ready, wide, loaded = browser.run("""
        const places = [...document.querySelectorAll(".chart")];
        for (let i = 0; i < 200 && places.some((place) => !place.querySelector("svg")); i += 1)
          await new Promise((wait) => setTimeout(wait, 50));
        return [document.documentElement.dataset.ready, document.documentElement.scrollWidth,
                performance.getEntriesByType("resource").filter((r) => !r.name.startsWith("data:")).length];
    """)
    assert ready == "yes"
    assert wide <= width
    assert loaded == 0
    drawn = browser.run("return [...document.querySelectorAll('.chart')].map((c) => c.querySelectorAll('svg').length)")
    assert len(drawn) >= 6
    assert set(drawn) == {1}
    paper = browser.run("return getComputedStyle(document.body).backgroundColor")
    assert paper == ("rgb(255, 255, 255)" if scheme == "light" else "rgb(20, 24, 31)")
    assert browser.complaints() == []


@needs_browser
def test_a_reader_sorts_and_filters_by_clicking(browser: Browser, shown: Path, runs: Path) -> None:
    browser.emulate(1280, 900, "light")
    browser.open(shown.as_uri())
    browser.run(CHOOSE, "group", "object")
    names = browser.run(COLUMN, "summary-table", 1)
    assert len(names) > 4
    browser.run(CLICK, "summary-table", 1)
    assert browser.run(COLUMN, "summary-table", 1) == sorted(names)
    browser.run(CLICK, "summary-table", 1)
    assert browser.run(COLUMN, "summary-table", 1) == sorted(names, reverse=True)
    browser.run(CLICK, "summary-table", 3)
    rates = [float(text.split()[0]) for text in browser.run(COLUMN, "summary-table", 3)]
    assert rates == sorted(rates, reverse=True)
    assert browser.run("return document.querySelectorAll('#summary-table th')[3].ariaSort") == "descending"
    browser.run(CHOOSE, "object", "clamp")
    assert {name[:5] for name in browser.run(COLUMN, "summary-table", 1)} == {"clamp"}
    assert {name[:5] for name in browser.run(COLUMN, "trials-table", 1)} == {"clamp"}
    browser.run(CHOOSE, "object", "")
    browser.run(CHOOSE, "class", "round")
    assert {name[:3] for name in browser.run(COLUMN, "trials-table", 1)} == {"can"}
    browser.run(CHOOSE, "class", "")
    browser.run(CHOOSE, "failure", "infeasible")
    assert set(browser.run(COLUMN, "trials-table", 3)) == {"infeasible"}
    browser.run(CHOOSE, "run", "0")
    count = browser.run("return document.getElementById('count').textContent")
    assert count.startswith(f"{json.loads((runs / 'planner.json').read_text())['failures'].get('infeasible', 0)} of 24")
    browser.run("document.getElementById('clear').click()")
    count = browser.run("return document.getElementById('count').textContent")
    won = json.loads((runs / "planner.json").read_text())["succeeded"]
    low, high = wilson(won, 24)
    assert count == f"24 of 24 trials, {won} successes: {won / 24:.1%} ({low:.1%} to {high:.1%})".replace("%", " %")


@needs_browser
def test_long_tables_have_pages(browser: Browser, shown: Path) -> None:
    browser.open(shown.as_uri())
    first = browser.run(COLUMN, "trials-table", -1 % 5)
    assert len(first) == 15
    browser.run("document.querySelectorAll('#trials .pages button')[1].click()")
    assert len(browser.run(COLUMN, "trials-table", 1)) == 9
    assert browser.run("return document.querySelector('#trials .pages span').textContent") == "16 to 24 of 24"
