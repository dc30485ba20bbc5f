#!/usr/bin/env bash
# rosbags-image 0.10.4 with rosbags 0.11.9, depth images of ROS (Python 3.11): padded rows are shifted, compressed depth has 8 bits.
#
# message_to_cvimage reads a sensor_msgs/Image without its field `step`: where rows end with padding, the padding becomes depth
# and later rows move, in silence. A CompressedImage of format "16UC1; png compressed " is decoded to uint8: of 1000 mm 3 remain.
# Big-endian images are right.
#
# Seen on 2026-11-29:
#   padded rows: uint16, first row 0 1000 2000 3000, second row 19789 19789 19789 19789
#   16-bit PNG: uint8, first row 0 3 7 11
#   big-endian: uint16, first row 0 1000 2000 3000
#
# So graspbox.captures decodes the messages of a recording itself.
# Exit status: 0 while this is so, 1 if it has changed. Needs Python 3.11 and a package index.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet \
    'rosbags==0.11.9' 'rosbags-image==0.10.4' 'opencv-python-headless==5.0.0.93' 'numpy==2.4.6'
"$folder/venv/bin/python" -W ignore - <<'PYTHON'
import sys

import cv2
import numpy as np
from rosbags.image import message_to_cvimage
from rosbags.typesys import Stores, get_typestore

types = get_typestore(Stores.ROS2_HUMBLE).types
header = types["std_msgs/msg/Header"](stamp=types["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id="camera")
depth = 1000 * np.arange(12, dtype=np.uint16).reshape(3, 4)


def image(data, step, big=0):
    kind = types["sensor_msgs/msg/Image"]
    return kind(header=header, height=3, width=4, encoding="16UC1", is_bigendian=big, step=step, data=data.ravel())


padded = np.pad(depth.view(np.uint8).reshape(3, 8), ((0, 0), (0, 8)), constant_values=77)
png = np.frombuffer(cv2.imencode(".png", depth)[1].tobytes(), np.uint8)
compressed = types["sensor_msgs/msg/CompressedImage"](header=header, format="16UC1; png compressed ", data=png)
rows = message_to_cvimage(image(padded, 16))
small = message_to_cvimage(compressed)
big = message_to_cvimage(image(depth.byteswap().view(np.uint8), 8, 1))


def shown(row):
    return " ".join(str(value) for value in row)


print(f"padded rows: {rows.dtype}, first row {shown(rows[0])}, second row {shown(rows[1])}")
print(f"16-bit PNG: {small.dtype}, first row {shown(small[0])}")
print(f"big-endian: {big.dtype}, first row {shown(big[0])}")
shifted = (rows[0] == depth[0]).all() and (rows[1] == 77 * 257).all()
sys.exit(0 if shifted and small.dtype == np.uint8 and (big == depth).all() else 1)
PYTHON
