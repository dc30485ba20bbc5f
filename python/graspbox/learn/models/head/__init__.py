"""Heads: one network that predicts grasps from the channels of a crop."""
