"""Look at results and carry them to other programs. Tools use the core of graspbox, which knows none of them.

| package | purpose |
|---|---|
| `viewer`, `rerun` | 3D views in a browser; recordings for rerun's viewer |
| `reports` | evaluations, trials and trainings as one HTML file |
| `exchange`, `scene_export`, `demonstrations` | grasps, scenes and demonstrations in other programs' formats |
| `remote`, `mcp` | servers of environments, of policies, and of tools for agents |
"""
