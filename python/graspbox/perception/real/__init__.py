"""What a real depth image needs before it is looked at: where to search, which kind of depth it holds, its table."""

from graspbox.perception.real.images import RealImage
from graspbox.perception.real.rays import DEPTH_KINDS, DepthKind, z_of_distances
from graspbox.perception.real.workspace import FRAMES, Frame, Workspace

__all__ = ["DEPTH_KINDS", "FRAMES", "DepthKind", "Frame", "RealImage", "Workspace", "z_of_distances"]
