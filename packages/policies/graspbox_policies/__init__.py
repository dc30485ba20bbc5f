"""The published policies of graspbox: data alone, a folder per policy.

``graspbox.policies.load("depth")`` and ``graspbox evaluate depth`` find them by their names.
"""
