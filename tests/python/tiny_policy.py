"""A policy of a few kilobytes that several test modules run: it completes nothing and prefers grasps near the table."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from graspbox.perception.calibration import Calibration
from graspbox.perception.configs import ProposalConfig
from graspbox.perception.feel_folders import FeelConfig, write_feel
from graspbox.perception.finder_configs import FinderConfig
from graspbox.perception.policy_folders import DepthPolicyConfig, file_hash, write_depth_policy

#: The probability of success that it states is that of the logit -10 z, with z the height of the hand in metres.
SLOPE = -10.0
FINALISTS = 4


def _save(path: Path, nodes: list[Any], inputs: list[Any], outputs: list[Any], constants: dict[str, Any]) -> None:
    import onnx
    from onnx import helper, numpy_helper

    held = [numpy_helper.from_array(value, key) for key, value in constants.items()]
    graph = helper.make_graph(nodes, path.stem, inputs, outputs, held)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def _save_networks(folder: Path) -> None:
    from onnx import TensorProto, helper

    node, info = helper.make_node, helper.make_tensor_value_info
    _save(
        folder / "completion.onnx",
        [node("Gather", ["channels", "first"], ["occupancy"], axis=1)],
        [info("channels", TensorProto.UINT8, ["n", 3, 48, 48, 48])],
        [info("occupancy", TensorProto.UINT8, ["n", 48, 48, 48])],
        {"first": np.array(0, dtype=np.int64)},
    )
    cells, preshape = (
        info("cells", TensorProto.UINT8, ["m", 4, 24, 24, 16]),
        info("preshape", TensorProto.INT64, ["m"]),
    )
    _save(
        folder / "scorer.onnx",
        [
            node("Gather", ["poses", "row"], ["rows"], axis=1),
            node("Gather", ["rows", "column"], ["height"], axis=1),
            node("Mul", ["height", "slope"], ["logit"]),
            node("Sigmoid", ["logit"], ["success"]),
            node("Mul", ["success", "half"], ["secure"]),
            node("Identity", ["success"], ["choice"]),
            node("Unsqueeze", ["logit", "axis"], ["column_of_logits"]),
            node("Concat", ["column_of_logits", "column_of_logits"], ["logits"], axis=1),
        ],
        [cells, info("poses", TensorProto.FLOAT, ["m", 4, 4]), preshape],
        [
            *(info(name, TensorProto.FLOAT, ["m"]) for name in ("choice", "success", "secure")),
            info("logits", TensorProto.FLOAT, ["m", 2]),
        ],
        {
            "row": np.array(2, dtype=np.int64),
            "column": np.array(3, dtype=np.int64),
            "slope": np.array(SLOPE, dtype=np.float32),
            "half": np.array(0.5, dtype=np.float32),
            "axis": np.array([1], dtype=np.int64),
        },
    )


def make(folder: Path, **changes: Any) -> DepthPolicyConfig:
    """Write the policy's folder; fields of the config may be changed."""
    folder.mkdir(parents=True, exist_ok=True)
    _save_networks(folder)
    config = DepthPolicyConfig(
        name="tiny",
        graspbox="0",
        hand="reflex",
        calibration=Calibration(),
        files={name: file_hash(folder / name) for name in ("completion.onnx", "scorer.onnx")},
        members=1,
        width=8,
        finalists=FINALISTS,
        completion_width=4,
        finder=FinderConfig(ProposalConfig(most=24), refinements=1),
    )
    config = replace(config, **changes)
    write_depth_policy(folder, config)
    return config


def make_feeling(folder: Path, threshold: float = 0.5, times: tuple[float, ...] = (1.1, 1.3)) -> FeelConfig:
    """Write a policy that feels: the probability that a grasp holds is that of the logit of its mean input."""
    from onnx import TensorProto, helper

    make(folder)
    _save(
        folder / "feel.onnx",
        [
            helper.make_node("ReduceMean", ["felt", "axis"], ["logit"], keepdims=0),
            helper.make_node("Sigmoid", ["logit"], ["probability"]),
        ],
        [helper.make_tensor_value_info("felt", TensorProto.FLOAT, ["n", "k"])],
        [helper.make_tensor_value_info("probability", TensorProto.FLOAT, ["n"])],
        {"axis": np.array([1], dtype=np.int64)},
    )
    config = FeelConfig(times, threshold, (1.0, 0.0), 8, 1, {"feel.onnx": file_hash(folder / "feel.onnx")})
    write_feel(folder, config)
    return config
