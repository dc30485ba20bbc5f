#!/usr/bin/env bash
# rosbags 0.11.9, MCAP files without chunks (Python 3.11): a loop over messages ends early if another topic is read inside it.
#
# ROS 2's storage preset "fastwrite" writes MCAP without chunks and without an index. All iterators of one AnyReader share the
# place in such a file: reading a second topic (a CameraInfo, a transform) inside a loop over the first ends that loop after its
# first message, in silence. With chunks the loop is complete; so it is for SQLite and for bags of ROS 1 (not shown).
#
# Seen on 2026-11-29:
#   with chunks: read 6 of 6 messages
#   without chunks: read 1 of 6 messages
#   without chunks, one topic after the other: read 6 of 6 messages
#
# So graspbox.captures reads CameraInfo and units before it iterates over images.
# Exit status: 0 while this is so, 1 if it has changed. Needs Python 3.11 and a package index.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet 'rosbags==0.11.9' 'mcap==1.3.1' 'numpy==2.4.6'
FOLDER=$folder "$folder/venv/bin/python" -W ignore - <<'PYTHON'
import os
import sys
from pathlib import Path

from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_HUMBLE)
Number = store.types["std_msgs/msg/Int32"]


def recording(name, chunks):
    path = Path(os.environ["FOLDER"]) / f"{name}.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=chunks, compression=CompressionType.NONE)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/Int32", "ros2msg", b"int32 data\n")
        channels = [writer.register_channel(topic, "cdr", schema) for topic in ("/image", "/info")]
        for time in range(6):
            for channel in channels:
                data = bytes(store.serialize_cdr(Number(data=time), "std_msgs/msg/Int32"))
                writer.add_message(channel, log_time=time * 10**9, publish_time=time * 10**9, data=data)
        writer.finish()
    return path


def read(path, nested):
    with AnyReader([path], default_typestore=store) as reader:
        image, info = ([c for c in reader.connections if c.topic == topic] for topic in ("/image", "/info"))
        count = 0
        for _ in reader.messages(image):
            count += 1
            if nested:
                list(reader.messages(info))
        list(reader.messages(info))
        return count


seen = []
for title, chunks, nested in (
    ("with chunks", True, True),
    ("without chunks", False, True),
    ("without chunks, one topic after the other", False, False),
):
    seen.append(read(recording(f"{chunks}{nested}", chunks), nested))
    print(f"{title}: read {seen[-1]} of 6 messages")
sys.exit(0 if seen == [6, 1, 6] else 1)
PYTHON
