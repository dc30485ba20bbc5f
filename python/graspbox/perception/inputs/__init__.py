"""Inputs of scorers as arrays."""
