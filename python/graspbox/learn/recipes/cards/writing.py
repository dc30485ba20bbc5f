"""Cards of published policies: ``README.md`` with metadata for the Hugging Face hub, from measured values only.

`write_card` is the only writer. A template (Jinja) of a kind of policy defines the parts ``summary``, ``commands``,
``training`` and, where they differ from those of ``card.md.jinja``, ``method``, ``details`` and ``limits``. Needs
huggingface_hub (extra ``train``).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import Any

from graspbox._common.files import read_bounded, write_text
from graspbox._common.progress import shown_time
from graspbox.data.trials.learned import evaluated_split
from graspbox.evaluation import wilson
from graspbox.policies.published.configs import PolicyConfig
from graspbox.policies.published.downloads import CARD, hub

__all__ = ["ScoreRow", "listed", "package_licence", "rate", "training_of", "with_split", "write_card"]

#: Text that all cards share; it follows the template of the kind of policy.
_SHARED = Path(__file__).parent / "card.md.jinja"
#: Title of the section about the training of a policy.
_TRAINING = "## Data and training"
#: Largest card that is read, bytes.
_LARGEST_CARD = 1_000_000


@dataclass(frozen=True)
class ScoreRow:
    """Counts of trials of a policy in an environment, on a set of objects: ``NAME`` or ``NAME/SPLIT``.

    The variant tells how the policy was run, if the same objects have several rows; `more` are additional columns.
    """

    objects: str
    env_id: str
    trials: int
    success: int
    secure: int
    variant: str = ""
    more: Mapping[str, str] = field(default_factory=dict)


def write_card(folder: Path, config: PolicyConfig, template: Path, scores: Sequence[ScoreRow], **values: Any) -> None:
    """Write ``README.md`` into a policy's folder, from the template of its kind, with scores and other values.

    All templates use ``command``, the command that made the policy; those of recipes ``stages``, the results of each
    stage by name, with its seconds. Raises MissingExtraError if huggingface_hub is not installed.
    """
    text = template.read_text() + _SHARED.read_text()
    columns = tuple(dict.fromkeys(name for row in scores for name in row.more))
    helpers = {"listed": listed, "rate": rate, "time": shown_time, "with_split": with_split}
    card = hub().ModelCard.from_template(
        _metadata(config, scores),
        template_str=text,
        **{"folder": folder, "config": config, "scores": scores, "columns": columns, **helpers, **values},
    )
    write_text(Path(folder) / CARD, re.sub(r"\n{3,}", "\n\n", str(card)).strip("\n") + "\n")


def training_of(folder: Path) -> str:
    """Return the section about the training from the card of a policy; empty without a card."""
    path = Path(folder) / CARD
    text = read_bounded(path, _LARGEST_CARD).decode() if path.exists() else ""
    return text.partition(f"{_TRAINING}\n")[2].partition("\n## ")[0].strip()


def rate(count: int, trials: int) -> str:
    """Format a rate with its 95 % interval (Wilson)."""
    low, high = wilson(count, trials)
    return f"{count / trials:.1%} ({low:.1%} to {high:.1%})"


def listed(names: Sequence[str]) -> str:
    """Join names as in a sentence."""
    quoted = [f"`{name}`" for name in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}"


def with_split(objects: str) -> str:
    """Name an object set with the split of its evaluation."""
    split = evaluated_split(objects)
    return f"{objects}/{split}" if split else objects


def _metadata(config: PolicyConfig, scores: Sequence[ScoreRow]) -> Any:
    """Build the hub's metadata: licence, tags, and the rates with their trials and intervals."""
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
    return library.ModelCardData(
        model_name=config.name,
        language="en",
        license="apache-2.0",
        library_name="graspbox",
        pipeline_tag="robotics",
        tags=["robotics", "grasping", f"policy-{config.kind}", f"hand-{config.hand}"],
        eval_results=results,
    )


def package_licence() -> Path | None:
    """Find the licence of this package, under which trained policies are published."""
    try:
        paths = [path for path in files("graspbox") or () if path.name == "LICENSE"]
    except PackageNotFoundError:
        return None
    return Path(str(paths[0].locate())) if paths else None
