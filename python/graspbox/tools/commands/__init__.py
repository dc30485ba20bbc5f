"""Commands of the tools: entry points of the group ``graspbox.commands``."""
