"""Recipes that train published policies, from no data to a folder that ``graspbox evaluate`` runs (extra ``train``).

`depth`, `any_hand`, `feel` and `own_hand` are lists of stages, which `stages` runs; `head` trains and evaluates a head.
The other modules are what these share. Nothing is imported here: the stages need torch. ``graspbox train`` runs the
recipes, and ``scripts/publish_sb3.py`` publishes policies trained with Stable-Baselines3.
"""
