"""The kinds of views, one module each; `graspbox.tools.viewer.sources` chooses among them."""
