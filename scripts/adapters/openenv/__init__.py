"""graspbox as an OpenEnv environment: the client and its models."""

from .client import GraspboxEnv
from .models import ArrayData, GraspAction, GraspObservation, GraspState, decoded

__all__ = ["ArrayData", "GraspAction", "GraspObservation", "GraspState", "GraspboxEnv", "decoded"]
