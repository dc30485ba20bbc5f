"""Policies side by side: the same trials for all of them, under several conditions; resumable."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from graspbox import evaluation, object_sets
from graspbox._common.runs import Run
from graspbox.envs import SINGLE_OBJECT_IDS
from graspbox.errors import ConfigError
from graspbox.evaluation.conditions import CONDITIONS, settings_of
from graspbox.evaluation.object_classes import CLASSES, object_classes
from graspbox.evaluation.reports import COLUMNS, Measured, class_table, condition_table, labels, policy_table
from graspbox.evaluation.variants import load_variant
from graspbox.object_sets import ObjectSet, learned_sets
from graspbox.policies import Policy

__all__ = ["PolicyComparison"]

#: Called with the title of a measurement and the number of its finished trials.
Progress = Callable[[str, int], None]
_KEYS = ("condition", "policy", "objects", "seed")


@dataclass(frozen=True)
class PolicyComparison:
    """Plan of a comparison; refuses empty lists and unknown names.

    Attributes
    ----------
    policies : tuple of str
        Policies (`graspbox.evaluation.variants`), in the order of the tables.
    stressed : tuple of str
        Those measured under all conditions; the others run only under the first. By default all folders.
    conditions : tuple of str
        Names in `graspbox.evaluation.conditions.CONDITIONS`.
    objects : tuple of str
        Object sets; /SPLIT keeps one split.
    trials : int
        Trials of each policy, on each object set, under each condition, with each seed.
    hand : str, pair of paths or None
        The hand of all policies; by default that of each.
    """

    policies: tuple[str, ...]
    stressed: tuple[str, ...] = ()
    conditions: tuple[str, ...] = tuple(CONDITIONS)
    objects: tuple[str, ...] = ("procedural:unseen:0-19", "ycb/test")
    trials: int = 1000
    seeds: tuple[int, ...] = (0,)
    hand: str | tuple[str, str] | None = None

    def __post_init__(self) -> None:
        for name, known in (("conditions", tuple(CONDITIONS)), ("stressed", self.policies)):
            if unknown := [one for one in getattr(self, name) if one not in known]:
                raise ConfigError(f"--{name} has {', '.join(unknown)}; choose from {', '.join(known)}")
        for name in ("policies", "conditions", "objects", "seeds"):
            if not getattr(self, name):
                raise ConfigError(f"--{name} is empty; name one")

    def _hand(self) -> dict[str, Any]:
        return {} if self.hand is None else {"hand": self.hand}

    def _jobs(self) -> Iterator[dict[str, Any]]:
        """List the measurements, the first condition first."""
        stressed = self.stressed or tuple(p for p in self.policies if Path(p).is_dir())
        for condition in self.conditions:
            chosen = self.policies if condition == self.conditions[0] else stressed
            for values in product((condition,), chosen, self.objects, self.seeds):
                yield dict(zip(_KEYS, values, strict=True))

    def run(
        self, folder: Path, echo: Callable[[str], None], progress: Progress
    ) -> tuple[list[Measured], dict[str, ObjectSet]]:
        """Run the measurements that are missing in ``results.jsonl`` of a folder.

        Objects from which any of the policies learned are left out for all. Returns the measurements in the order of
        policies and conditions, and the remaining objects of each set. Refuses the folder of another comparison, and
        conditions that a policy cannot have.
        """
        loaded = {name: load_variant(name) for name in self.policies}
        wanted = {tuple(job.values()): job for job in self._jobs()}
        for job in wanted.values():
            # Checked before the work, not after hours of it.
            settings_of(job["condition"], loaded[job["policy"]].env_id or SINGLE_OBJECT_IDS[0])
        objects, left_out = self._unknown_objects(loaded, echo)
        # Policies added later must leave out the same objects.
        settings = {"trials": self.trials, **({"left_out": left_out} if left_out else {}), **self._hand()}
        with Run(folder, settings) as run:
            rows = run.rows("results")
            done = {tuple(row[key] for key in _KEYS): row for row in rows}
            for key, job in wanted.items():
                if key not in done:
                    done[key] = self._measure(job, loaded[job["policy"]], objects[job["objects"]], echo, progress)
                    rows.append(done[key])
        named = labels(self.policies)
        return [Measured.of(done[key], named[job["policy"]]) for key, job in wanted.items()], objects

    def _unknown_objects(
        self, loaded: Mapping[str, Policy], echo: Callable[[str], None]
    ) -> tuple[dict[str, ObjectSet], dict[str, int]]:
        """Load the objects of each set from which no policy learned; also count the objects left out, if any."""
        learned = sorted({name for policy in loaded.values() for name in policy.learned_from})
        kept, left_out = {}, {}
        for source in self.objects:
            name, split = object_sets.name_and_split(source)
            every = object_sets.load(name, split=split)
            kept[source] = learned_sets.without(every, learned)
            if not kept[source]:
                raise ConfigError(f"--objects has {source!r}, from which the policies learned; name other objects")
            if missing := len(every) - len(kept[source]):
                left_out[source] = missing
                echo(f"{missing} of {len(every)} objects of {source} are left out: a policy learned from them")
        return kept, left_out

    def _measure(
        self, job: dict[str, Any], policy: Policy, objects: ObjectSet, echo: Callable[[str], None], progress: Progress
    ) -> dict[str, Any]:
        title = f"{job['policy']}, {job['objects']}, {job['condition']}, seed {job['seed']}"
        result = evaluation.evaluate(
            policy,
            objects=objects,
            include_learned=True,
            trials=self.trials,
            seed=job["seed"],
            progress=lambda done: progress(title, done),
            condition=job["condition"],
            **self._hand(),
        )
        echo(f"{title}: success {result.rate:.1%}, secure {result.secure / self.trials:.1%}")
        return job | {
            "milliseconds": result.ms_per_decision,
            "failures": result.failures,
            "env_id": result.env_id,
            "seeds": [trial.seed for trial in result.trials],
            "kinds": [trial.failure for trial in result.trials],
            "trials": [[getattr(trial, column) for column in COLUMNS] for trial in result.trials],
        }

    def page(self, rows: list[Measured], objects: Mapping[str, ObjectSet], command: str) -> str:
        """Write the tables as Markdown, with the pictures ``policies.png``, ``conditions.png``, ``reliability.png``."""
        classes = {spec.name: object_classes(spec.load()) for each in objects.values() for spec in each}
        first, stressed = self.first(rows), self.under_all(rows)
        meanings = "\n".join(f"- `{name}`: {meaning}" for name, meaning in CLASSES.items())
        text = f"# Evaluation\n\n```\n{command}\n```\n\n"
        text += f"In brackets 95 % intervals (Wilson). Seeds of the trials: {', '.join(map(str, self.seeds))}.\n"
        text += f"\n## Policies\n\n{policy_table(first)}\n![policies](policies.png)\n"
        text += f"\n## By class of object\n\n{class_table(first, classes)}\n{meanings}\n"
        if stressed:
            text += f"\n## Conditions\n\n{condition_table(stressed)}\n![conditions](conditions.png)\n"
        if any(row.calibration_error is not None for row in first):
            text += "\n## Calibration\n\n![reliability](reliability.png)\n"
        return text

    def first(self, rows: list[Measured]) -> list[Measured]:
        """Return the rows of the first condition."""
        return [row for row in rows if row.condition == self.conditions[0]]

    def under_all(self, rows: list[Measured]) -> list[Measured]:
        """Return the rows of policies that were measured under further conditions."""
        others = {row.policy for row in rows if row.condition != self.conditions[0]}
        return [row for row in rows if row.policy in others]
