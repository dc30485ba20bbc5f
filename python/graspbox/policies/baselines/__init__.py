"""Policies without networks: the planner with the mesh or a partial view of it, proposals, oracles, random actions."""
