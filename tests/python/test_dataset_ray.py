"""A Ray cluster of two nodes makes the same data set as one process."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from datasets_for_tests import OBJECTS, config, contents
from graspbox import errors
from graspbox.data import trials as dataset

pytestmark = [pytest.mark.train, pytest.mark.filterwarnings("ignore")]
pytest.importorskip("pyarrow")
ray = pytest.importorskip("ray")


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    from ray.cluster_utils import Cluster

    nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    nodes.add_node(num_cpus=1)
    ray.init(address=nodes.address, log_to_driver=False)
    yield nodes
    ray.shutdown()
    nodes.shutdown()


def test_two_nodes_make_the_same_bytes(cluster: Any, tmp_path: Path) -> None:
    assert len([node for node in ray.nodes() if node["Alive"]]) == 2
    dataset.generate(OBJECTS, tmp_path / "here", config=config(images=True), runner=dataset.local(1))
    result = dataset.generate(OBJECTS, tmp_path / "there", config=config(images=True), runner=dataset.on_ray())
    assert result.made == 6
    assert contents(tmp_path / "there") == contents(tmp_path / "here")


def test_errors_come_back_from_the_nodes(cluster: Any, tmp_path: Path) -> None:
    """Errors of a worker are those of a local worker."""
    from graspbox import PlanConfig

    with pytest.raises(errors.ConfigError, match="clearance"):
        dataset.generate(OBJECTS, tmp_path, config=config(planning=PlanConfig(clearance=1.0)), runner=dataset.on_ray())
