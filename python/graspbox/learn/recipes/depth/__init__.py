"""The recipe of a policy of one depth image, from a data set to a published folder: ``graspbox train depth``.

`training` lists the stages, each a function of `context`, which holds what they share.
"""

from graspbox.learn.recipes.depth.training import train

__all__ = ["train"]
