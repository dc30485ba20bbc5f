"""Learned components of policies: networks, inputs, losses, training and the training data that they share.

| module | contents |
|---|---|
| `completion` | an object's occupancy from one view |
| `scorer`     | the probability that a grasp holds, from the voxels around the hand |
| `head`       | grasps predicted from a crop by one network |
| `stability`  | the probability that a closed grasp holds, from joints, loads and tactile sensors |
| `scenes`, `scene_views`, `scene_trials` | rendered scenes; cached views of them; simulated trials in them |
| `trials`, `nearest_finder` | grasp trials for training; retrieval of a grasp from the nearest known scene |
| `calibration` | calibrated probabilities |
Modules named `network`, `training`, `graph` and `heads` need torch (extra ``train``); the others do not.
"""
