"""The policy of one depth image: with oracles for its components, in both environments, and its refusals."""

from pathlib import Path

import numpy as np
import pytest

import graspbox
from graspbox import errors, evaluation, policies
from graspbox.configs import CamerasConfig
from graspbox.perception import GraspFinder, HandGrid, ProposalConfig
from graspbox.perception.configs import FinderConfig
from graspbox.perception.finder import observed_only
from graspbox.policies import DepthPolicy, Observer
from graspbox.policies.baselines.oracles import DepthOracle

QUICK = FinderConfig(proposals=ProposalConfig(most=24), refinements=1)


def test_with_oracles_it_grasps_what_it_sees() -> None:
    # A rehearsal does not overrule them.
    policy = DepthOracle(None, ("completion", "scorer"), config=QUICK.rehearsing(4))
    result = evaluation.evaluate(policy, objects="procedural:can:0-3", trials=4, seed=0, num_envs=2)
    assert result.succeeded >= 3
    found = policy.found[0]
    assert found is not None
    assert set(found.seconds) == {"crop", "complete", "propose", "score", "refine"}
    # One grasp at least held in every replay, and that one was taken.
    assert found.score == found.scores.max() > 1.0
    again = evaluation.evaluate(policy, objects="procedural:can:0-3", trials=4, seed=0, num_envs=4)
    assert again.trials == result.trials


def test_in_the_closed_loop_the_hand_goes_where_it_was_decided() -> None:
    policy = DepthOracle(None, ("completion", "scorer"), config=QUICK)
    result = evaluation.evaluate(policy, "graspbox/Grasp-v0", "procedural:can:1", trials=1, seed=1, num_envs=1)
    assert result.succeeded == 1


def test_a_policy_is_made_of_an_observer_a_finder_and_an_executor() -> None:
    """Here it takes the proposal that is lowest; scores need no weights."""
    policy = DepthPolicy(
        Observer,
        lambda hand: GraspFinder(HandGrid(hand), observed_only, lambda volume, poses, shapes: -poses[:, 2, 3], QUICK),
    )
    assert policy.obs == ("depth", "proprio")
    result = evaluation.evaluate(policy, objects="procedural:can:0", trials=2, seed=0, num_envs=2)
    assert len(result.trials) == 2
    assert policy.confidence(0) is None
    found = policy.found[0]
    assert found is not None
    # Refined grasps come last, and none is worse than the best proposal.
    assert len(found.scores) > 24
    assert found.score >= found.scores[:24].max()
    np.testing.assert_allclose(found.world_from_hand, found.world_from_crop @ found.poses[found.scores.argmax()])


def test_what_it_cannot_do_is_refused(tmp_path: Path) -> None:
    with pytest.raises(errors.ConfigError, match="nothing to score"):
        DepthOracle(None, ("completion",))
    with pytest.raises(errors.ConfigError, match="no oracle 'luck'"):
        DepthOracle(None, ("luck",))  # type: ignore[arg-type]
    with pytest.raises(errors.ConfigError, match=r"no config\.json in"):
        policies.load(str(tmp_path))
    wrist = graspbox.CameraConfig("wrist", "hand")
    policy = DepthOracle(None, ("scorer",))
    with pytest.raises(errors.ConfigError, match="mounted on the hand"):
        evaluation.evaluate(policy, objects="procedural:can:0", trials=1, cameras=CamerasConfig(cameras=(wrist,)))
    with pytest.raises(errors.ConfigError, match="needs obs"):
        evaluation.evaluate(policy, objects="procedural:can:0", trials=1, obs=("depth", "proprio"))
