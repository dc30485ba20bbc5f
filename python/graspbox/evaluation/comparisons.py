"""Policies side by side: the same trials for all of them, under several conditions; resumable."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from graspbox import evaluation, object_sets
from graspbox.envs import SINGLE_OBJECT_IDS
from graspbox.errors import ConfigError
from graspbox.evaluation.conditions import CONDITIONS, settings_of
from graspbox.evaluation.object_classes import CLASSES, object_classes
from graspbox.evaluation.reports import COLUMNS, Measured, class_table, condition_table, labels, policy_table
from graspbox.evaluation.variants import load_variant
from graspbox.object_sets import ObjectSet, learned_sets
from graspbox.policies import Policy
from graspbox.training.runs import Run

__all__ = ["Comparison"]

#: Called with the title of a measurement and the number of its finished trials.
Told = Callable[[str, int], None]
_KEYS = ("condition", "policy", "objects", "seed")


@dataclass(frozen=True)
class Comparison:
    """Plan of a comparison.

    Attributes
    ----------
    policies : tuple of str
        Policies (`graspbox.evaluation.variants`), in the order of the tables.
    stressed : tuple of str
        Those measured under all conditions; the others run under the first alone. By default all folders.
    conditions : tuple of str
        Names in `graspbox.evaluation.conditions.CONDITIONS`.
    objects : tuple of str
        Object sets; /SPLIT keeps one split.
    trials : int
        Trials of each policy, on each object set, under each condition, with each seed.
    seeds : tuple of int
        Seeds of the trials.
    hand : str, pair of paths or None
        The hand of all policies; by default that of each.

    Raises
    ------
    ConfigError
        If there is none of something, or a condition or stressed policy is unknown.
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

    @property
    def _named_hand(self) -> dict[str, Any]:
        """The setting of the hand, if one is named."""
        return {} if self.hand is None else {"hand": self.hand}

    def _jobs(self) -> Iterator[dict[str, Any]]:
        """List the measurements, the first condition first."""
        stressed = self.stressed or tuple(p for p in self.policies if Path(p).is_dir())
        for n, condition in enumerate(self.conditions):
            for policy in self.policies if n == 0 else stressed:
                for objects in self.objects:
                    for seed in self.seeds:
                        yield dict(zip(_KEYS, (condition, policy, objects, seed), strict=True))

    def run(self, folder: Path, echo: Callable[[str], None], told: Told) -> tuple[list[Measured], dict[str, ObjectSet]]:
        """Run the measurements that are missing in ``results.jsonl`` of a folder.

        Objects from which any of the policies learned are left out for all.

        Returns
        -------
        rows, objects
            The measurements in the order of policies and conditions; the objects of each set that are left.

        Raises
        ------
        ConfigError
            If the folder belongs to another comparison, or a policy cannot have a condition.
        """
        loaded = {name: load_variant(name) for name in self.policies}
        wanted = {tuple(job.values()): job for job in self._jobs()}
        for job in wanted.values():
            # Checked before the work, not after hours of it.
            settings_of(job["condition"], loaded[job["policy"]].env_id or SINGLE_OBJECT_IDS[0])
        objects, left_out = self._unknown_objects(loaded, echo)
        # Policies added later must leave out the same objects.
        settings = {"trials": self.trials, **({"left_out": left_out} if left_out else {}), **self._named_hand}
        with Run(folder, settings) as run:
            rows = run.rows("results")
            done = {tuple(row[key] for key in _KEYS): row for row in rows}
            for key, job in wanted.items():
                if key not in done:
                    done[key] = self._measure(job, loaded[job["policy"]], objects[job["objects"]], echo, told)
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
            found = object_sets.load(name, split=split)
            kept[source] = learned_sets.without(found, learned)
            if not kept[source]:
                raise ConfigError(f"--objects has {source!r}, from which the policies learned; name other objects")
            if missing := len(found) - len(kept[source]):
                left_out[source] = missing
                echo(f"{missing} of {len(found)} objects of {source} are left out: a policy learned from them")
        return kept, left_out

    def _measure(
        self, job: dict[str, Any], policy: Policy, objects: ObjectSet, echo: Callable[[str], None], told: Told
    ) -> dict[str, Any]:
        title = f"{job['policy']}, {job['objects']}, {job['condition']}, seed {job['seed']}"
        found = evaluation.evaluate(
            policy,
            objects=objects,
            include_learned=True,
            trials=self.trials,
            seed=job["seed"],
            progress=lambda done: told(title, done),
            condition=job["condition"],
            **self._named_hand,
        )
        echo(f"{title}: success {found.rate:.1%}, secure {found.secure / self.trials:.1%}")
        return job | {
            "milliseconds": found.ms_per_decision,
            "failures": found.failures,
            "env_id": found.env_id,
            "seeds": [trial.seed for trial in found.trials],
            "kinds": [trial.failure for trial in found.trials],
            "trials": [[getattr(trial, column) for column in COLUMNS] for trial in found.trials],
        }

    def page(self, rows: list[Measured], objects: Mapping[str, ObjectSet], command: str) -> str:
        """Write the tables as Markdown, with the pictures ``policies.png``, ``conditions.png``, ``reliability.png``."""
        classes = {spec.name: object_classes(spec.load()) for found in objects.values() for spec in found}
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
