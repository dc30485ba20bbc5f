"""Options of the commands of ``graspbox train`` that are recipes, one module for each.

| module | command |
|---|---|
| `depth` | ``graspbox train depth`` |
| `any_hand` | ``graspbox train any-hand`` |
| `feel` | ``graspbox train feel`` |
| `own_hand` | ``graspbox hand train`` |
| `head` | ``graspbox train head`` |
"""
