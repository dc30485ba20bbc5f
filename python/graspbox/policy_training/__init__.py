"""Training of published policies, from nothing to a folder that ``graspbox evaluate`` runs (extra ``train``).

| module | what it does |
|---|---|
| `settings` | arguments of a training, with time limits and sizes |
| `stages`   | a long run in stages, which an interruption does not lose |
| `depth`    | the stages of a policy that grasps from one depth image |
| `learned`  | the object sets from which a policy learned, as its folder names them |
| `cards`    | the page that a published policy has |
| `feel`     | the stages that teach such a policy to feel before it lifts |
| `felt_trials` | grasps of it, felt and lifted: what it learns from |
| `paired`   | the same trials with and without a second attempt |
| `feel_cards` | page and picture of a policy that feels |
| `network_cards` | scores and page of a clone, of a trained policy, of a network of the study |
| `study` | the best small network of a reproduction of the study as a published policy |

Nothing is imported here: `depth`, `feel` and `study` need torch. ``scripts/train_depth_policy.py`` and
``scripts/train_feel.py`` are the commands; ``scripts/publish_sb3.py`` and ``scripts/reproduce_study.py`` publish too.
"""
