"""Published policies as folders: configuration, networks, weights and card; loaded and validated without torch.

| file | contents |
|---|---|
| ``config.json`` | the configuration: `graspbox.policies.published.configs.PolicyConfig`, and a section for the kind of
policy |
| ``*.onnx`` | the networks, for onnxruntime; torch reads the weights from them too |
| ``README.md`` | the card: use, scores, data and training, limits |
| ``LICENSE`` | the licence of the weights |

`load` reads and validates a folder, `save` writes ``config.json``; `push_to_hub` uploads a folder to the Hugging Face
hub, from where ``graspbox.policies.load("hf://owner/name")`` downloads it.

A new kind of policy, in any package, needs a class for its section, a class for the policy, an entry point
(`graspbox.policies.published.registry`), and an export, which passes its graphs to
`graspbox.learn.export.exports.export`.
"""

from graspbox.policies.published.folders import load, save, used_folder
from graspbox.policies.published.hub import push_to_hub

__all__ = ["load", "push_to_hub", "save", "used_folder"]
