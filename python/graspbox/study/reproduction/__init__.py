"""``graspbox train study``: the networks of the study retrained, executed, compared with the study and published."""
