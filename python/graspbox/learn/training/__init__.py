"""Shared by all trainings, which ``graspbox train`` runs; only `trainer` and `norms` need torch."""
