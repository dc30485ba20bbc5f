"""Pools of environments: of this process, and on servers. Both have the same methods."""
