"""Helpers below all other modules."""
