"""Data sets of simulated grasps (`trials`) and demonstrations of policies (`episodes`); extra ``data``."""
