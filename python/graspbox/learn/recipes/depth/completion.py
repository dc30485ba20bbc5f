"""Stage ``completion``: the network that predicts an object's occupancy from one view, trained or adopted.

It is exported at once: onnxruntime runs it twice as fast for the stages after it.
"""

from typing import Any

from graspbox import object_sets
from graspbox._common.runs import Run
from graspbox.learn.export.exports import write_completion
from graspbox.learn.models.completion.network import train_completion
from graspbox.learn.recipes.depth.context import TUNING_RATE, DepthContext
from graspbox.learn.recipes.stages import reporter, results_of, train_config
from graspbox.learn.training.configs import TrainConfig
from graspbox.policies.published.downloads import folder_of

__all__ = ["complete"]

#: Number of validation scenes, and with ``--quick``.
_VALIDATION_SCENES, _QUICK_SCENES = 48, 4


def complete(context: DepthContext, stage: Run) -> dict[str, Any]:
    """Train the completion, or take that of another policy."""
    settings, sizes, networks = context.settings, context.sizes, context.networks
    start, adopted = None, dict[str, Any]()
    if settings.completion is not None:
        policy = networks.adopt_completion(folder_of(settings.completion))
        adopted = {"policy": policy.name, "sha256": policy.files["completion.onnx"]}
        # That of single objects is poor among several, and that of rendered images in real ones.
        if not (context.has_several or settings.real) or not sizes.completion_steps:
            return adopted
        start = networks.completion_net()
    config = train_config(
        stage,
        settings,
        learning_rate=TrainConfig.learning_rate if start is None else TUNING_RATE,
        batch_size=sizes.completion_batch,
        max_steps=sizes.completion_steps,
        validate_every=sizes.validate_every,
        # Most of the gain comes as the learning rate falls, after a long plateau.
        patience=sizes.completion_steps,
    )
    objects, held_out = (object_sets.load(settings.objects, split=s) for s in ("train", "validation"))
    trained = train_completion(
        stage.folder,
        objects,
        held_out,
        config,
        context.scenes,
        layouts=context.layouts,
        validation_scenes=_QUICK_SCENES if settings.quick else _VALIDATION_SCENES,
        width=sizes.completion_width,
        start=start,
        progress=reporter(stage, "overlap"),
    )
    net = networks.trained_completion() if start is None else start
    write_completion(net, stage.folder / "completion.onnx", context.scenes.crop)
    return adopted | results_of(trained)
