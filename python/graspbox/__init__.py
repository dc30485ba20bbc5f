"""From a mesh to simulated grasps.

Importing the package registers its Gymnasium environments.
"""

from graspbox._core import __version__
from graspbox.errors import GraspboxError

__all__ = ["GraspboxError", "__version__"]
