"""Completion of an object's occupancy from one depth image."""
