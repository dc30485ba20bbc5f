"""Comparisons with other simulators and with the reference study, for developers; no other package imports them.

| module | comparison |
|---|---|
| `validation.mujoco`      | an independent simulator: the same trials in MuJoCo (extra ``dev``) |
| `validation.choices`     | MuJoCo as a second judge of the grasps that policies choose (extra ``dev``) |
| `validation.forces`      | DexGraspBench's protocol in the core and in MuJoCo (extra ``dev``) |
| `validation.engines`     | `implicit` with `rapier`: labels and speed |
| `validation.speed`       | the speed of `implicit`, of `rapier` and of MuJoCo's rollout (extra ``dev``) |
| `graspbox.study.comparison`       | table 3.1 of the reference study, compared with graspbox (``cli``, ``ycb``) |

``python tests/validate.py mujoco --trials 200 --seed 0 [--json]``
``python tests/validate.py choices policies/depth --trials 100 --seed 0 [--json]``
``python tests/validate.py forces --poses 5 --seed 0 [--json]``
``python tests/validate.py engines --poses 20 --seed 0 [--layout packed] [--json]``
``python tests/validate.py speed --poses 10 --seed 0 [--json]``
``python tests/validate.py study --poses 20 --seed 0 [--json]``
"""
