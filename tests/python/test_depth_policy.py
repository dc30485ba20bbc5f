"""The policy that sees one depth image: with oracles for its parts, in both environments, and what it refuses."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
import tiny_policy
from graspbox import errors, evaluation, policies
from graspbox.configs import CamerasConfig
from graspbox.perception import ProposalConfig
from graspbox.perception.finder_configs import FinderConfig
from graspbox.policies import DepthGrasp

QUICK = FinderConfig(proposals=ProposalConfig(most=24), refinements=1)


def test_with_oracles_it_grasps_what_it_sees() -> None:
    policy = DepthGrasp(None, oracles=("completion", "scorer"), config=QUICK)
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
    policy = DepthGrasp(None, oracles=("completion", "scorer"), config=QUICK)
    result = evaluation.evaluate(policy, "graspbox/Grasp-v0", "procedural:can:1", trials=1, seed=1, num_envs=1)
    assert result.succeeded == 1


def test_without_an_oracle_it_reads_no_state(tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="small networks are made with onnx, from the extra 'dev'")

    class Lowest(DepthGrasp):
        """Takes the proposal that is lowest; scores need no weights."""

        def _make_finder(self) -> Any:
            from graspbox.perception import HandGrid
            from graspbox.perception.finder import GraspFinder, observed_only

            grid = HandGrid(self.hand)
            return GraspFinder(grid, observed_only, lambda volume, poses, preshape: -poses[:, 2, 3], self._config)

    tiny_policy.make(tmp_path)
    policy = Lowest(tmp_path, config=QUICK)
    assert policy.obs == ("depth", "proprio")
    result = evaluation.evaluate(policy, objects="procedural:can:0", trials=2, seed=0, num_envs=2)
    assert len(result.trials) == 2
    found = policy.found[0]
    assert found is not None
    # Refined grasps come last, and none is worse than the best proposal.
    assert len(found.scores) > 24
    assert found.score >= found.scores[:24].max()
    np.testing.assert_allclose(found.world_from_hand, found.world_from_crop @ found.poses[found.scores.argmax()])


def test_what_it_cannot_do_is_refused(tmp_path: Path) -> None:
    with pytest.raises(errors.ConfigError, match="nothing to score"):
        DepthGrasp(None)
    with pytest.raises(errors.ConfigError, match="no oracle 'luck'"):
        DepthGrasp(None, oracles=("luck",))  # type: ignore[arg-type]
    with pytest.raises(errors.FileError, match="no policy"):
        policies.load(str(tmp_path))
    wrist = graspbox.CameraConfig("wrist", "hand")
    policy = DepthGrasp(None, oracles=("scorer",))
    with pytest.raises(errors.ConfigError, match="mounted on the hand"):
        evaluation.evaluate(policy, objects="procedural:can:0", trials=1, cameras=CamerasConfig(cameras=(wrist,)))
    with pytest.raises(errors.ConfigError, match="needs obs"):
        evaluation.evaluate(policy, objects="procedural:can:0", trials=1, obs=("depth", "proprio"))
