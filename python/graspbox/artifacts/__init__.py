"""Published policies as folders: configuration, networks, weights and card; loaded and validated without torch.

| file | contents |
|---|---|
| ``config.json`` | the configuration: `graspbox.artifacts.configs.PolicyConfig`, and a section for the kind of policy |
| ``*.onnx`` | the networks, for onnxruntime |
| ``*.safetensors`` | their weights |
| ``README.md`` | the card: use, scores, data and training, limits |
| ``LICENSE`` | the licence of the weights |

| kind | the policy | section |
|---|---|---|
| ``depth`` | `graspbox.policies.DepthGrasp` | `graspbox.artifacts.configs.DepthPolicyConfig` |
| ``head`` | `graspbox.policies.HeadGrasp` | `graspbox.artifacts.configs.HeadPolicyConfig` |
| ``feel`` | `graspbox.policies.FeelThenLift` | `graspbox.artifacts.configs.FeelPolicyConfig` |
| ``network`` | `graspbox.policies.NetworkPolicy` | `graspbox.artifacts.configs.NetworkPolicyConfig` |
| ``study`` | `graspbox.study.regressor.PoseRegressor` | `graspbox.study.pose_folders.PosePolicyConfig` |

A new kind of policy needs a class for its section, a class for the policy, a row in `graspbox.artifacts.registry`, and
an export, which passes its graphs to `graspbox.artifacts.exports.export`.

`load` reads and validates a folder, `save` writes ``config.json``; `push_to_hub` uploads a folder to the Hugging Face
hub, from where ``graspbox.policies.load("hf://owner/name")`` downloads it.
"""

from graspbox.artifacts.folders import load, save, used_folder
from graspbox.artifacts.hub import push_to_hub

__all__ = ["load", "push_to_hub", "save", "used_folder"]
