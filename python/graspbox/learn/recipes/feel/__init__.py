"""The recipe that adds a grasp-stability check to a policy of one depth image: ``graspbox train feel``.

`training` lists the stages, each a function of `context`, which holds what they share.
"""

from graspbox.learn.recipes.feel.training import train

__all__ = ["train"]
