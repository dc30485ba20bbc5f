"""Hands: loaded by name or from their two files, their geometry, and collision meshes as primitives."""

from graspbox._common.rotations import euler_from_rotation
from graspbox._core import Hand
from graspbox.hands.caching import cache_folder
from graspbox.hands.geometry import asymmetries_of, corners_of, reach_of, symmetries_of
from graspbox.hands.loading import HandLike, load_hand
from graspbox.hands.loop_fits import LoopFit
from graspbox.hands.mesh_fits import MeshFit, Primitive, fit_mesh
from graspbox.hands.mjcf import urdf_of_mjcf
from graspbox.hands.reading import fitted_urdf
from graspbox.hands.urdf_meshes import FittedUrdf

__all__ = [
    "FittedUrdf",
    "Hand",
    "HandLike",
    "LoopFit",
    "MeshFit",
    "Primitive",
    "asymmetries_of",
    "cache_folder",
    "corners_of",
    "euler_from_rotation",
    "fit_mesh",
    "fitted_urdf",
    "load_hand",
    "reach_of",
    "symmetries_of",
    "urdf_of_mjcf",
]
