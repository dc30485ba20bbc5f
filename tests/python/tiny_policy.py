"""Published policies of a few kilobytes, one of each kind, for several test modules.

The policy of the kind ``depth`` completes nothing and prefers grasps near the table.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from graspbox.perception.configs import CropConfig, FinderConfig, HandGridConfig, ProposalConfig
from graspbox.policies.published.calibration import Calibration
from graspbox.policies.published.configs import (
    DepthPolicyConfig,
    Environment,
    FeelPolicyConfig,
    HeadPolicyConfig,
    NetworkInput,
    NetworkPolicyConfig,
    PolicyConfig,
)
from graspbox.policies.published.folders import CONFIG, file_hash, save, use_of
from graspbox.policies.published.head_configs import HeadConfig
from graspbox.policies.published.schema import parse
from graspbox.policies.stability_inputs import STORED_NAME
from graspbox.study.model_configs import ModelConfig
from graspbox.study.pose_folders import PosePolicyConfig

#: The probability of success that it states is that of the logit -10 z, with z the height of the hand in metres.
SLOPE = -10.0
FINALISTS = 4
#: Observations of the policy of the kind ``network``, and their lengths in ``Grasp-v0`` with a ReFlex.
SEEN = {"proprio": 28, "tactile": 27}

Config = TypeVar("Config", bound=PolicyConfig)


def constant(path: Path, inputs: dict[str, Any], outputs: dict[str, Any]) -> None:
    """Write a network that always gives the same; inputs are examples."""
    from onnx import helper, numpy_helper

    def info(name: str, value: Any) -> Any:
        array = np.asarray(value)
        return helper.make_tensor_value_info(name, helper.np_dtype_to_tensor_dtype(array.dtype), array.shape)

    nodes = [
        helper.make_node("Constant", [], [name], value=numpy_helper.from_array(values, name))
        for name, values in outputs.items()
    ]
    given, made = ([info(*item) for item in each.items()] for each in (inputs, outputs))
    _save(path, nodes, given, made, {})


def finish(folder: Path, config: Config) -> Config:
    """Write ``config.json`` of a policy whose networks are there."""
    return save(folder, replace(config, files={name: file_hash(folder / name) for name in config.holds}))


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


def save_again(folder: Path) -> None:
    """Give the files of a policy the hashes that they have now."""
    config = parse((folder / CONFIG).read_bytes(), CONFIG)
    save(folder, replace(config, files={name: file_hash(folder / name) for name in config.holds}))


def give_nan(folder: Path, network: str, output: str) -> None:
    """Make an output of a network NaN, by a weight."""
    import onnx

    path = folder / f"{network}.onnx"
    model = onnx.load(str(path))
    for node in model.graph.node:
        node.output[:] = ["whole" if name == output else name for name in node.output]
    model.graph.initializer.append(onnx.numpy_helper.from_array(np.array(np.nan, dtype=np.float32), "nan"))
    model.graph.node.append(onnx.helper.make_node("Add", ["whole", "nan"], [output]))
    onnx.save(model, str(path))
    save_again(folder)


def make(folder: Path, **changes: Any) -> DepthPolicyConfig:
    """Write a policy of the kind ``depth``; fields of the config may be changed."""
    folder.mkdir(parents=True, exist_ok=True)
    _save_networks(folder)
    config = DepthPolicyConfig(
        name="tiny",
        hand="reflex",
        calibration=Calibration(),
        members=1,
        width=8,
        finalists=FINALISTS,
        completion_width=4,
        crop=CropConfig(),
        grid=HandGridConfig(),
        finder=FinderConfig(ProposalConfig(most=24), refinements=1),
        head=None,
    )
    return finish(folder, replace(config, **changes))


def make_feel(
    folder: Path, threshold: float = 0.5, times: tuple[float, ...] = (1.1, 1.3), weight: float = 1.0
) -> FeelPolicyConfig:
    """Write one of the kind ``feel``: the probability is that of the logit of a multiple of its mean input."""
    from onnx import TensorProto, helper

    make(folder / "chooser")
    _save(
        folder / "feel.onnx",
        [
            helper.make_node("ReduceMean", [STORED_NAME, "axis"], ["mean"], keepdims=0),
            helper.make_node("Mul", ["mean", "weight"], ["logit"]),
            helper.make_node("Sigmoid", ["logit"], ["probability"]),
        ],
        [helper.make_tensor_value_info(STORED_NAME, TensorProto.FLOAT, ["n", "k"])],
        [helper.make_tensor_value_info("probability", TensorProto.FLOAT, ["n"])],
        {"axis": np.array([1], dtype=np.int64), "weight": np.array(weight, dtype=np.float32)},
    )
    config = FeelPolicyConfig(
        name="tiny-feel",
        hand="reflex",
        uses={"depth": use_of(folder, folder / "chooser")},
        times=times,
        threshold=threshold,
        calibration=(1.0, 0.0),
        width=8,
        members=1,
    )
    return finish(folder, config)


def make_head(folder: Path, anchor: int = 0) -> HeadPolicyConfig:
    """Write one of the kind ``head``, which always names the same anchor."""
    folder.mkdir(parents=True, exist_ok=True)
    found: dict[str, Any] = {
        "anchors": np.array([anchor], dtype=np.int64),
        "residuals": np.zeros((1, 6), dtype=np.float32),
        "scores": np.ones(1, dtype=np.float32),
    }
    constant(folder / "head.onnx", {"volumes": np.zeros((1, 2, 48, 48, 48), dtype=np.uint8)}, found)
    config = HeadPolicyConfig(
        name="tiny", hand="reflex", preshapes=3, filtered=False, head=HeadConfig(), crop=CropConfig()
    )
    return finish(folder, config)


def make_study(folder: Path) -> PosePolicyConfig:
    """Write one of the kind ``study``, which always predicts the pose of the object's base."""
    folder.mkdir(parents=True, exist_ok=True)
    poses = {"poses": np.eye(4, dtype=np.float32)[None]}
    constant(folder / "pose.onnx", {"inputs": np.zeros((1, 64, 64, 64), dtype=np.uint8)}, poses)
    return finish(folder, PosePolicyConfig(name="tiny", hand="reflex", model=ModelConfig("cnn3d", "psi4", "binary")))


def make_network(folder: Path) -> NetworkPolicyConfig:
    """Write one of the kind ``network``: its actions are the first entries of ``proprio``, halved and clipped."""
    from onnx import TensorProto, helper

    folder.mkdir(parents=True, exist_ok=True)
    _save(
        folder / "policy.onnx",
        [
            helper.make_node("MatMul", ["proprio", "weight"], ["moved"]),
            helper.make_node("MatMul", ["tactile", "none"], ["nothing"]),
            helper.make_node("Add", ["moved", "nothing"], ["sum"]),
            helper.make_node("Clip", ["sum", "low", "high"], ["action"]),
        ],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size]) for name, size in SEEN.items()],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["n", 10])],
        {
            "weight": 0.5 * np.eye(SEEN["proprio"], 10, dtype=np.float32),
            "none": np.zeros((SEEN["tactile"], 10), dtype=np.float32),
            "low": np.array(-1, dtype=np.float32),
            "high": np.array(1, dtype=np.float32),
        },
    )
    settings = {"control": "twist", "fingers": "each", "control_freq": 5, "max_episode_steps": 6}
    config = NetworkPolicyConfig(
        name="tiny",
        hand="reflex",
        environment=Environment("graspbox/Grasp-v0", tuple(SEEN), settings),
        inputs=tuple(NetworkInput(name, (size,), "float32") for name, size in SEEN.items()),
        actions=10,
        algorithm="ppo",
        policy_kwargs={},
    )
    return finish(folder, config)


#: Makers of a policy of each kind.
MAKERS: dict[str, Callable[[Path], Any]] = {
    "depth": make,
    "feel": make_feel,
    "head": make_head,
    "network": make_network,
    "study": make_study,
}
