"""Training of published policies, from nothing to a folder that ``graspbox evaluate`` runs (extra ``train``).

| module | what it does |
|---|---|
| `settings` | arguments of a training, with time limits and sizes |
| `stages`   | a long run in stages, which an interruption does not lose |
| `depth`    | the stages of a policy that grasps from one depth image |
| `cards`    | the page that a published policy has |

Nothing is imported here: `depth` needs torch. ``scripts/train_depth_policy.py`` is the command.
"""
