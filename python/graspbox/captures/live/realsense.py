"""RealSense cameras, by the package pyrealsense2."""

import time
from collections.abc import Generator
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from graspbox.captures.cameras import camera_of
from graspbox.captures.capture import Camera, Capture, Found
from graspbox.captures.live.frames import Image, LiveSource, Settings, needed
from graspbox.errors import ConnectionLostError

__all__ = ["RealSenseSource"]

#: Longest wait inside the SDK, during which Ctrl-C has no effect, seconds.
_WAIT = 0.5


class RealSenseSource(LiveSource):
    """The depth stream of a RealSense camera; a frame is the newest one, and older ones are counted as skipped.

    Parameters
    ----------
    serial : str
        Serial number; empty for the only camera.
    settings : Settings
        Settings of every source; by default intrinsics and unit are those of each frame.

    Raises
    ------
    MissingExtraError
        Without pyrealsense2.
    ConnectionLostError
        If there is no such camera, or it does not start.
    """

    def __init__(self, serial: str, settings: Settings) -> None:
        super().__init__(f"realsense:{serial}" if serial else "realsense", settings)
        self._given = settings.camera()
        sdk = needed("pyrealsense2", "a RealSense camera", "pip install pyrealsense2")
        config = sdk.config()
        if serial:
            config.enable_device(serial)
        config.enable_stream(sdk.stream.depth, sdk.format.z16)
        self._pipeline = sdk.pipeline()
        try:
            self._pipeline.start(config)
        except RuntimeError as error:
            raise ConnectionLostError(
                f"{self.name} does not start ({error}); connected cameras: {_serials(sdk)}. Check the cable (USB 3), "
                "the serial number, and that no other program uses the camera"
            ) from None

    def close(self) -> None:
        """Stop the camera."""
        super().close()
        with suppress(RuntimeError):  # it was stopped
            self._pipeline.stop()

    def _images(self) -> Generator[Image, None, None]:
        last: int | None = None
        while (depth := self._next()) is not None:
            number = int(depth.get_frame_number())
            missed = 0 if last is None else max(number - last - 1, 0)
            last = number
            yield Image(depth.get_timestamp() / 1e3, missed, partial(self._read, depth))

    def _next(self) -> Any:
        """Return the next depth frame; None if the time is over."""
        until = time.monotonic() + self._settings.timeout
        while (left := self._left()) > 0.0:
            patience = until - time.monotonic()
            if patience <= 0.0:
                raise ConnectionLostError(
                    f"{self.name} sent no depth within {self._settings.timeout:g} s; check the cable (USB 3) and that "
                    "no other program uses the camera"
                )
            try:
                arrived, frames = self._pipeline.try_wait_for_frames(max(1, int(1e3 * min(left, patience, _WAIT))))
            except RuntimeError as error:
                raise ConnectionLostError(f"{self.name} is lost ({error}); check the cable, then start again") from None
            if arrived and (depth := frames.get_depth_frame()):
                return depth
        return None

    def _read(self, depth: Any) -> Capture:
        lens = depth.profile.as_video_stream_profile().get_intrinsics()
        # The SDK uses its memory again.
        image = np.array(depth.get_data(), dtype=np.uint16)
        scale = float(f"{depth.get_units():.6g}")  # a float32
        found = Found(self.name, image=image, camera=_camera(lens, self.name), scale=scale)
        return self._settings.capture(found, self._given)


def _camera(lens: Any, name: str) -> Camera:
    """Return the camera of the SDK's intrinsics, whose first pixel has its centre at (0, 0)."""
    coefficients = [float(one) for one in lens.coeffs]
    info = {
        "k": [lens.fx, 0.0, lens.ppx, 0.0, lens.fy, lens.ppy, 0.0, 0.0, 1.0],
        "d": coefficients,
        "model": str(lens.model).rpartition(".")[2] if any(coefficients) else "",
        "width": lens.width,
        "height": lens.height,
    }
    return camera_of(info, name)


def _serials(sdk: Any) -> str:
    """List the serial numbers of the connected cameras."""
    with suppress(RuntimeError):
        found = [device.get_info(sdk.camera_info.serial_number) for device in sdk.context().query_devices()]
        return ", ".join(found) or "none"
    return "unknown"
