"""``graspbox serve``, ``serve-policy`` and ``mcp``: servers, one module each."""
