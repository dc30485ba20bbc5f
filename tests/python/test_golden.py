"""Labels and episodes stay the same to the bit: see `golden`, which also remakes the file."""

import json

import golden


def test_labels_and_episodes_are_those_of_the_golden_file() -> None:
    """A difference is a bug, or a change of physics, planner or observations that remakes the file."""
    kept = json.loads(golden.FILE.read_text())
    differing = golden.differences(kept, golden.remake(kept))
    assert not differing, f"{len(differing)} values differ, first {differing[:5]}"
