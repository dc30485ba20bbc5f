"""The recipe of one scorer, trained on the trials of many hands: ``graspbox train any-hand``.

`training` lists the stages, each a function of `context`, which holds what they share.
"""

from graspbox.learn.recipes.any_hand.training import train

__all__ = ["train"]
