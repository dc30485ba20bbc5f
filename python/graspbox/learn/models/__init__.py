"""Learned components of policies: networks, inputs, losses, training and the training data that they share.

`scenes` and `cluttered` are rendered scenes and their text, `scene_views` cached views of them, `scene_trials`
simulated trials in them. Modules named `network`, `shared`, `training`, `batches`, `policy` and `graph` need torch
(extra ``train``); the others do not.
"""
