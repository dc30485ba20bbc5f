"""Grasp stability: whether a closed hand will hold the object during the lift."""
