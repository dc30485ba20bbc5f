"""Comparisons with other simulators and with the reference study, for developers; no other package imports them.

| module | comparison |
|---|---|
| `graspbox.validation.mujoco`      | an independent simulator: the same trials in MuJoCo (extra ``dev``) |
| `graspbox.validation.choices`     | MuJoCo as a second judge of the grasps that policies choose (extra ``dev``) |
| `graspbox.validation.forces`      | DexGraspBench's protocol in the core and in MuJoCo (extra ``dev``) |
| `graspbox.validation.engines`     | `newton` with `rapier`: labels and speed |
| `graspbox.validation.speed`       | the speed of `newton`, of `rapier` and of MuJoCo's rollout (extra ``dev``) |
| `graspbox.study.comparison`       | table 3.1 of the reference study, compared with graspbox (extra ``ycb``) |

``python -m graspbox.validation mujoco --trials 200 --seed 0 [--json]``
``python -m graspbox.validation choices policies/depth --trials 100 --seed 0 [--json]``
``python -m graspbox.validation forces --poses 5 --seed 0 [--json]``
``python -m graspbox.validation engines --poses 20 --seed 0 [--layout packed] [--json]``
``python -m graspbox.validation speed --poses 10 --seed 0 [--json]``
``python -m graspbox.validation study --poses 20 --seed 0 [--json]``
"""
