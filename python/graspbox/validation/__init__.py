"""Comparisons with what others found; developers run them, the rest of the package does not import them.

| module | what it compares with |
|---|---|
| `graspbox.validation.mujoco`      | an independent simulator: the same trials in MuJoCo (extra ``dev``) |
| `graspbox.validation.engines`     | our own solver with rapier: labels and speed |
| `graspbox.validation.speed`       | the speed of our own solver, of rapier and of MuJoCo's rollout (extra ``dev``) |
| `graspbox.validation.study`       | table 3.1 of the reference study, compared with graspbox (extra ``ycb``) |
| `graspbox.validation.study_chart` | that table as a bar chart (extra ``cli``) |

``python -m graspbox.validation mujoco --trials 200 --seed 0 [--json]``
``python -m graspbox.validation engines --poses 20 --seed 0 [--json]``
``python -m graspbox.validation speed --poses 10 --seed 0 [--json]``
``python -m graspbox.validation study --poses 20 --seed 0 [--json]``
"""
