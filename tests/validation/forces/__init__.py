"""Grasps judged by the protocol of DexGraspBench, in the core and in MuJoCo: six forces, a lift, and force closure.

The hand closes around an object in the air (0.1 kg, friction 0.6); then a force of 10 m/s2 times the mass pulls it
along and against each axis of the world for two seconds, each time from the same closed hand. It passes if it moves
less than 5 cm and 15 degrees, the limits of a *secure* grasp. The second trial lifts the object by 10 cm off the table.

| module | contents |
|---|---|
| `config`    | settings, contacts, and the verdict on a grasp |
| `core`      | the protocol in the core's engines |
| `in_mujoco` | the protocol in MuJoCo (extra ``dev``) |
| `measures`  | force closure of contacts: Ferrari and Canny's Q1, and the residual of a quadratic program |
| `sources`   | grasps of the planner, of files of other programs, and of policies |
| `report`    | shares, intervals, agreement |
| `checkout`  | the benchmark's own example grasps, hand and objects, in a checkout of it |
| `command`   | the command ``forces`` |

``python tests/validate.py forces --policies policies/depth --trials 100 [--json]``

Source: Chen, Ke, Wang, "BODex: Scalable and Efficient Robotic Dexterous Grasp Synthesis Using Bilevel Optimization",
2025, and the benchmark JYChen18/DexGraspBench.
"""

from importlib.util import find_spec

from graspbox.errors import MissingExtraError

for _package in ("mujoco", "scipy", "yaml"):
    if find_spec(_package) is None:
        _needs = f"validation.forces needs the package {_package}, from the extra 'dev'"
        raise MissingExtraError(f"{_needs}: pip install 'graspbox[dev]'")
