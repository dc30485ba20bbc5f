"""``graspbox benchmark``: protocols of the field, for any policy."""
