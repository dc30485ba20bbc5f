"""Pipelines that train published policies, from no data to a folder that ``graspbox evaluate`` runs (extra ``train``).

| module | contents |
|---|---|
| `settings` | options of these trainings, with time limits and sizes |
| `depth`    | the stages of a policy that grasps from one depth image |
| `cards`    | model cards of published policies of any kind |
| `depth_cards` | card contents for policies that use one depth image |
| `feel`     | the stages that add a grasp-stability check to such a policy |
| `stability_trials` | its training data: grasps that are sensed and then lifted |
| `paired`   | the same trials with and without a second attempt |
| `feel_chart` | the chart of a policy with a grasp-stability check |
| `network_cards` | scores and cards of clones, of trained policies, of networks of the study |
| `head`     | heads, trained and evaluated |
| `study`    | the networks of the study, retrained, executed and published |
Nothing is imported here: `depth`, `feel`, `head` and `study` need torch. ``graspbox train`` runs them, and
``scripts/publish_sb3.py`` publishes policies trained with Stable-Baselines3.
"""
