"""Cards of published policies: ``README.md`` with metadata for the Hugging Face hub, from measured values alone.

`write_card` is the only writer; a `Card` holds the contents. Needs huggingface_hub (extra ``train``).
"""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

from graspbox._common.files import read_bounded, write_text
from graspbox._common.progress import shown_time
from graspbox.artifacts.configs import PolicyConfig
from graspbox.artifacts.downloads import CARD, hub
from graspbox.evaluation import wilson

__all__ = [
    "Card",
    "ScoreRow",
    "code",
    "listed",
    "package_licence",
    "paragraph",
    "rate",
    "table",
    "times",
    "training_of",
    "write_card",
]

#: Title of the section about the training of a policy.
_TRAINING = "## Data and training"
#: Largest card that is read, bytes.
_LARGEST_CARD = 1_000_000
_LICENCE = "Apache-2.0; see `LICENSE`. `graspbox objects` names the licences of the objects."


@dataclass(frozen=True)
class ScoreRow:
    """Trials of a policy on a set of objects.

    Attributes
    ----------
    objects : str
        The set, in command-line syntax: ``NAME`` or ``NAME/SPLIT``.
    env_id : str
        The environment.
    trials, success, secure : int
        Counts.
    variant : str
        How the policy was run, if the same objects have several rows.
    more : mapping of str to str
        Additional columns of the table.
    """

    objects: str
    env_id: str
    trials: int
    success: int
    secure: int
    variant: str = ""
    more: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Card:
    """Contents of a published policy's card; texts are Markdown.

    Attributes
    ----------
    summary : str
        The policy's task and method.
    commands : sequence of str
        Commands for its use.
    method : str
        How the scores were measured.
    scores : sequence of ScoreRow
        The scores.
    training : str
        How it was trained, and on which data.
    limits : sequence of str
        Its limitations, and where its scores do not hold.
    details : str
        Text after the table of scores.
    """

    summary: str
    commands: Sequence[str]
    method: str
    scores: Sequence[ScoreRow]
    training: str
    limits: Sequence[str]
    details: str = ""


def write_card(folder: Path, config: PolicyConfig, card: Card) -> None:
    """Write ``README.md`` into a policy's folder.

    Raises
    ------
    MissingExtraError
        If huggingface_hub is not installed.
    """
    made = f"Exported by graspbox {config.version} for the hand `{config.hand}`."
    limits = "\n".join(paragraph(f"- {limit}", indent="  ") for limit in card.limits)
    parts = [
        f"# {config.name}",
        paragraph(f"{card.summary} {made}"),
        code(*card.commands),
        "## Scores",
        paragraph(f"{card.method} Brackets hold 95 % intervals (Wilson)."),
        _score_table(card.scores),
        card.details,
        _TRAINING,
        card.training,
        "## Limits",
        limits,
        "## Licence",
        _LICENCE,
    ]
    text = "\n\n".join(part.strip("\n") for part in parts if part)
    write_text(Path(folder) / CARD, f"---\n{_metadata(config, card.scores)}\n---\n\n{text}\n")


def training_of(folder: Path) -> str:
    """Return what the card of a policy says about its training; empty without a card."""
    path = Path(folder) / CARD
    text = read_bounded(path, _LARGEST_CARD).decode() if path.exists() else ""
    return text.partition(f"{_TRAINING}\n")[2].partition("\n## ")[0].strip()


def rate(count: int, trials: int) -> str:
    """Format a rate with its 95 % interval (Wilson)."""
    low, high = wilson(count, trials)
    return f"{count / trials:.1%} ({low:.1%} to {high:.1%})"


def code(*lines: str) -> str:
    """Format commands as a code block."""
    return "\n".join(("```", *lines, "```"))


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], align: str = "l") -> str:
    """Format a table; `align` has an ``l`` or ``r`` for each column; further columns are aligned right."""
    sides = align[: len(columns)].ljust(len(columns), "r")
    rules = ["---" if side == "l" else "--:" for side in sides]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (columns, rules, *rows))


def times(stages: Mapping[str, tuple[float, str]]) -> str:
    """Format the table of stages with seconds, results and the total time; results may all be empty."""
    total = sum(seconds for seconds, _ in stages.values())
    rows = [(name, shown_time(seconds), result) for name, (seconds, result) in (*stages.items(), ("all", (total, "")))]
    width = 3 if any(result for *_, result in rows) else 2
    return table(("stage", "time", "result")[:width], [row[:width] for row in rows], "lrl")


def paragraph(text: str, indent: str = "") -> str:
    """Wrap a paragraph."""
    return textwrap.fill(text, 119, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def listed(names: Sequence[str]) -> str:
    """Join names as in a sentence."""
    quoted = [f"`{name}`" for name in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}"


def _score_table(scores: Sequence[ScoreRow]) -> str:
    more = tuple(dict.fromkeys(name for row in scores for name in row.more))
    rows = []
    for row in scores:
        name = f"`{row.objects}`{f', {row.variant}' if row.variant else ''}"
        rates = [rate(count, row.trials) for count in (row.success, row.secure)]
        rows.append([name, str(row.trials), *rates, *(row.more.get(column, "-") for column in more)])
    return table(("objects", "trials", "success", "secure", *more), rows)


def _metadata(config: PolicyConfig, scores: Sequence[ScoreRow]) -> str:
    """Format the hub's YAML metadata: licence, tags, and the rates with their trials and intervals."""
    library = hub()
    results = []
    for row in scores:
        for name, count in (("success", row.success), ("secure", row.secure)):
            interval = [round(bound, 4) for bound in wilson(count, row.trials)]
            results.append(
                library.EvalResult(
                    task_type="robotics",
                    task_name=row.env_id,
                    dataset_type=row.objects,
                    dataset_name=row.objects,
                    dataset_config=row.variant or None,
                    metric_type=f"{name}_rate",
                    metric_name=f"{name} rate",
                    metric_value=round(count / row.trials, 4),
                    metric_args={"trials": row.trials, "ci95": interval},
                )
            )
    return str(
        library.ModelCardData(
            model_name=config.name,
            language="en",
            license="apache-2.0",
            library_name="graspbox",
            pipeline_tag="robotics",
            tags=["robotics", "grasping", f"policy-{config.kind}", f"hand-{config.hand}"],
            eval_results=results,
        )
    )


def package_licence() -> Path | None:
    """Find the licence of this package, under which trained policies are published."""
    try:
        found = [path for path in files("graspbox") or () if path.name == "LICENSE"]
    except PackageNotFoundError:
        return None
    return Path(str(found[0].locate())) if found else None
