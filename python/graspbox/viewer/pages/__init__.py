"""The kinds of views, one module each; `graspbox.viewer.kinds` chooses among them."""
