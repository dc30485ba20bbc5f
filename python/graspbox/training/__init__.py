"""Shared by all trainings, which ``graspbox train`` runs.

| module | contents | needs torch |
|---|---|---|
| `runs`    | run directories: settings, lock, clock, log, rows, stages; the refusal of changed settings | no |
| `configs` | how a network is trained: optimizer and schedule by name, limits, device | no |
| `trainer` | the loop, with early stopping, checkpoints and bit-exact continuation | yes |
| `array_files` | tables of arrays made part by part | no |
| `options` | options that the commands share, and their results | no |
"""
