"""``graspbox serve`` and ``graspbox serve-policy``: servers."""
