"""Stages ``trials`` and ``collect-N``: trials of all hands, in turns, so that a time limit leaves all about as many.

The first stage tries random proposals, each round those that the scorer chose.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from graspbox import object_sets
from graspbox._common.runs import Run
from graspbox.errors import ConfigError
from graspbox.learn.models.trials import GraspTrials
from graspbox.learn.recipes.any_hand.context import AnyHandContext, TrainedHand
from graspbox.learn.recipes.collection import CollectConfig, collect, rates_of
from graspbox.learn.recipes.settings.any_hand import AnyHandSizes

__all__ = ["collect_trials", "turns"]

#: Scenes that one hand collects before it is the next one's turn.
_TURN = 20
#: Proposals of a scene from which trials are taken.
_MOST = 256
#: Most validation scenes of a random hand.
_HELD_OUT = 2


def collect_trials(context: AnyHandContext, stage: Run, number: int) -> dict[str, Any]:
    """Collect the trials of a round, 0 for those of random proposals."""
    share = 1.0 if number == 0 else context.sizes.round_share
    order = list(turns(context.hands, context.sizes, share))
    done, total, results = 0, sum(len(scenes) for *_, scenes in order), dict[str, Any]()
    for hand, split, scenes in order:
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


def turns(
    hands: Sequence[TrainedHand], sizes: AnyHandSizes, share: float
) -> Iterator[tuple[TrainedHand, object_sets.Split, range]]:
    """List which scenes each hand collects, turn by turn, of the training scenes this share."""
    parts = list[tuple[TrainedHand, object_sets.Split, range]]()
    for hand in hands:
        held_out = range(sizes.held_out_scenes if hand.named else min(sizes.held_out_scenes, _HELD_OUT))
        parts += [(hand, "validation", held_out), (hand, "train", hand.scenes[: round(share * len(hand.scenes))])]
    count = -(-max(len(scenes) for *_, scenes in parts) // _TURN)
    for turn in range(count):
        for hand, split, scenes in parts:
            # Few scenes have their turns spread over those of the others.
            first, last = (round(len(scenes) * at / count) for at in (turn, turn + 1))
            if last > first:
                yield hand, split, scenes[first:last]
