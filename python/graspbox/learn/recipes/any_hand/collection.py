"""Stages ``trials`` and ``collect-N``: trials of all hands, in turns, so that a time limit leaves all about as many.

The first stage tries random proposals, each round those that the scorer chose.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from graspbox import object_sets
from graspbox._common.runs import Run
from graspbox.errors import ConfigError
from graspbox.learn.models.trials import GraspTrials
from graspbox.learn.recipes.any_hand.context import AnyHandContext, TrainedHand
from graspbox.learn.recipes.collection import CollectConfig, collect, rates_of

__all__ = ["collect_trials"]

#: Scenes that one hand collects before it is the next one's turn.
_TURN = 20
#: Proposals of a scene from which trials are taken.
_MOST = 256
#: Most validation scenes of a random hand.
_HELD_OUT = 2


def collect_trials(context: AnyHandContext, stage: Run, number: int) -> dict[str, Any]:
    """Collect the trials of a round, 0 for those of random proposals."""
    share = 1.0 if number == 0 else context.sizes.round_share
    turns = list(_turns(context, share))
    done, total, results = 0, sum(len(scenes) for *_, scenes in turns), dict[str, Any]()
    for hand, split, scenes in turns:
        if stage.late():
            break
        proposals = replace(hand.finder.proposals, most=_MOST)
        collect(
            stage.folder / hand.name / split,
            context.sampler(split, context.settings.seed + 1000 * number),
            scenes,
            hand.grid,
            CollectConfig(finder=replace(hand.finder, proposals=proposals)),
            complete=context.completion,
            score=context.scorer(hand, number - 1) if number else None,
            stop=stage.late,
        )
        done += len(scenes)
        stage.report(f"{done} of {total} scenes", done / total)
    for split in ("train", "validation"):
        parts = [trials for hand in context.hands if (trials := context.trials(number, hand, split)) is not None]
        if not parts:
            option = "collect" if number else "trials"
            raise ConfigError(
                f"no hand had a trial with {split} objects before the time ended; raise --hours.{option}, and the same "
                "command goes on"
            )
        results[split] = {"hands": len(parts), **rates_of(GraspTrials.joined(parts))}
    return results


def _turns(context: AnyHandContext, share: float) -> Iterator[tuple[TrainedHand, object_sets.Split, range]]:
    """List which scenes each hand collects, turn by turn."""
    parts = list[tuple[TrainedHand, object_sets.Split, range]]()
    held_out = context.sizes.held_out_scenes
    for hand in context.hands:
        parts.append((hand, "validation", range(held_out if hand.named else min(held_out, _HELD_OUT))))
        parts.append((hand, "train", hand.scenes[: round(share * len(hand.scenes))]))
    turns = -(-max(len(scenes) for *_, scenes in parts) // _TURN)
    for turn in range(turns):
        for hand, split, scenes in parts:
            # Few scenes have their turns spread over those of the others.
            first, last = (round(len(scenes) * at / turns) for at in (turn, turn + 1))
            if last > first:
                yield hand, split, scenes[first:last]
