"""Messages of client and server: an action, observations as arrays in JSON, the state of a session."""

import base64
import io
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel, Field

from openenv.core.env_server.types import Action, Observation, State

__all__ = ["ArrayData", "GraspAction", "GraspObservation", "GraspState", "decoded", "encoded"]


class ArrayData(BaseModel):
    """An array in JSON; `decoded` makes it a numpy array again, bit for bit."""

    encoding: Literal["list", "png", "raw"] = Field(
        description="list: numbers in C order; png: an image in base64; raw: little-endian bytes in C order, in base64"
    )
    dtype: str = Field(description="numpy's name: float32, uint8, ...")
    shape: list[int] = Field(description="Lengths of the axes; an image is (rows, columns, channels)")
    data: str | list[float] = Field(description="The numbers, or base64")


class GraspAction(Action):
    """An action of the environment: see the table of actions in the docstring of ``graspbox.envs``."""

    values: list[float] = Field(description="One number in [-1, 1] per entry of the action; numbers beyond are clipped")


class GraspObservation(Observation):
    """Result of a reset or a step; ``metadata`` is the info of the environment: ``is_success`` and others."""

    arrays: dict[str, ArrayData] = Field(default_factory=dict, description="Observations by name: proprio, rgb, ...")
    truncated: bool = Field(default=False, description="Whether the episode ended by its number of steps")


class GraspState(State):
    """The episode of a session."""

    env_id: str = Field(default="", description="Id of the Gymnasium environment")
    seed: int | None = Field(default=None, description="Seed of the last reset that gave one")
    is_success: bool = Field(default=False, description="Whether the grasp has succeeded")
    action_size: int = Field(default=0, description="Numbers in an action")
    done: bool = Field(default=True, description="Whether the next call must be a reset")


def encoded(array: NDArray[Any], images: Literal["png", "raw"] = "png") -> ArrayData:
    """Write an array for JSON.

    Parameters
    ----------
    array : array
        A vector is written as a list. An image of uint8 with 1 or 3 channels is written as PNG or raw, as `images`
        says; every other array is raw.
    images : {"png", "raw"}
        PNG takes less space, raw less time.
    """
    shape, dtype = list(array.shape), array.dtype.name
    if array.ndim == 1:
        return ArrayData(encoding="list", dtype=dtype, shape=shape, data=array.tolist())
    is_image = array.ndim == 3 and dtype == "uint8" and shape[2] in (1, 3)
    if images == "png" and is_image:
        file = io.BytesIO()
        Image.fromarray(array[..., 0] if shape[2] == 1 else array).save(file, format="PNG")
        return ArrayData(encoding="png", dtype=dtype, shape=shape, data=_base64(file.getvalue()))
    little = array.astype(array.dtype.newbyteorder("<"), copy=False)
    return ArrayData(encoding="raw", dtype=dtype, shape=shape, data=_base64(little.tobytes()))


def _base64(raw: bytes) -> str:
    return base64.b64encode(raw).decode("ascii")


def decoded(array: ArrayData) -> NDArray[Any]:
    """Read the output of `encoded`.

    Raises
    ------
    ValueError
        If the data do not fit encoding, dtype and shape.
    """
    dtype = np.dtype(array.dtype)
    if isinstance(array.data, list):
        return np.array(array.data, dtype=dtype).reshape(array.shape)
    raw = base64.b64decode(array.data, validate=True)
    if array.encoding == "png":
        return np.asarray(Image.open(io.BytesIO(raw))).reshape(array.shape)
    return np.frombuffer(raw, dtype=dtype.newbyteorder("<")).astype(dtype).reshape(array.shape)
