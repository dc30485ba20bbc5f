"""Training of published policies, from nothing to a folder that ``graspbox evaluate`` runs (extra ``train``).

| module | what it does |
|---|---|
| `settings` | arguments of a training, with time limits and sizes |
| `stages`   | a long run in stages, which an interruption does not lose |
| `depth`    | the stages of a policy that grasps from one depth image |
| `cards`    | the page that a published policy has |
| `feel`     | the stages that teach such a policy to feel before it lifts |
| `felt_trials` | grasps of it, felt and lifted: what it learns from |
| `paired`   | the same trials with and without a second attempt |
| `feel_cards` | page and picture of a policy that feels |

Nothing is imported here: `depth` and `feel` need torch. ``scripts/train_depth_policy.py`` and ``scripts/train_feel.py``
are the commands.
"""
