"""Depth data of real cameras: images, clouds, recordings and live cameras, all read into one `Capture`.

Units, sizes and frames are checked here, once; `Capture.warnings` says what was assumed.

>>> import numpy as np, tempfile, pathlib
>>> from graspbox.captures import read_capture
>>> file = pathlib.Path(tempfile.mkdtemp()) / "depth.npy"
>>> np.save(file, np.full((48, 64), 600, dtype=np.uint16))
>>> seen = read_capture(file, intrinsics=[[60.0, 0, 32], [0, 60.0, 24], [0, 0, 1]])
>>> float(seen.depth[0, 0]), seen.points().shape, seen.warnings
(0.6, (3072, 3), ())
"""

from graspbox.captures.averaging import average
from graspbox.captures.capture import Capture
from graspbox.captures.live import Frame, LiveSource, open_camera
from graspbox.captures.reading import read_capture

__all__ = ["Capture", "Frame", "LiveSource", "average", "open_camera", "read_capture"]
