"""Learning to grasp from images and voxels: the reference study's networks, reimplemented (extra ``[train]``).

``graspbox train study`` runs all of it. No module imports torch before it is used.
"""
