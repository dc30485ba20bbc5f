"""Trainings with Stable-Baselines3.

| module | purpose |
|---|---|
| `training` | reinforcement learning runs, with demonstrations of the scripted expert |
| `cloning` | behaviour cloning of recorded demonstrations, and fine-tuning of a clone |
| `student` | rounds of recording and cloning: a student that sees and feels |
| `running` | environments, models, evaluation on held-out objects, checkpoints |
| `settings` | options of these trainings, and their file of parameters |
| `checks` | checks of these parameters |
| `runs`, `run_policy` | the folder of a run as a policy |
| `export`, `action_graphs` | a policy as a folder that runs without torch; its computation as one graph |
| `histories` | the history of a run's policy, with commands that reproduce it |
| `ppo` | PPO with its own learning rate for the value function |
"""
