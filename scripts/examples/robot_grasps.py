"""Grasps for a depth image from a policy server: a robot needs numpy for this, and no graspbox.

    graspbox serve-policy policies/depth                  # on a computer with graspbox
    python robot_grasps.py depth.npy 615 615 320 240      # on the robot; pixels: fx fy cx cy

``depth.npy`` holds metres as floats, or millimetres as integers; 0 where nothing was measured. The camera looks along
z, with x to the right and y down; poses are those of the hand's grasp frame in it. In a loop a WebSocket saves
connections: ``openpi_client.WebsocketClientPolicy(host, port).infer(request)`` takes the same entries as arrays.
"""

import argparse
import base64
import json
import os
import urllib.error
import urllib.request

import numpy as np


def grasps(depth: np.ndarray, intrinsics: np.ndarray, url: str, token: str = "", **more: object) -> dict:
    """Ask for grasps, the best first; `more` are entries such as ``camera_pose``, ``region`` and ``count``."""
    depth = np.asarray(depth, dtype="<u2" if depth.dtype.kind in "iu" else "<f4")
    image = {"data": base64.b64encode(depth.tobytes()).decode(), "dtype": depth.dtype.str, "shape": depth.shape}
    body = json.dumps({"depth": image, "intrinsics": np.asarray(intrinsics).tolist(), **more}).encode()
    headers = {"Content-Type": "application/json", **({"Authorization": f"Bearer {token}"} if token else {})}
    try:
        with urllib.request.urlopen(urllib.request.Request(f"{url}/grasps", body, headers), timeout=30) as answer:
            return json.load(answer)
    except urllib.error.HTTPError as error:
        raise SystemExit(f"{url} answers {error.code}: {error.read().decode().strip()}") from None


def main() -> None:
    """Print the grasps of an image."""
    parser = argparse.ArgumentParser(description="Grasps for a depth image from a policy server.")
    parser.add_argument("depth", help="depth image, made with numpy.save")
    parser.add_argument("pixels", nargs=4, type=float, metavar=("fx", "fy", "cx", "cy"))
    parser.add_argument("--url", default="http://127.0.0.1:8000", help="the server; its token is in GRASPBOX_TOKEN")
    arguments = parser.parse_args()
    fx, fy, cx, cy = arguments.pixels
    lens = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    reply = grasps(np.load(arguments.depth), lens, arguments.url, os.environ.get("GRASPBOX_TOKEN", ""))
    for index, success in enumerate(reply["success"]):
        position, quaternion = np.round(reply["position"][index], 4), np.round(reply["quaternion_wxyz"][index], 4)
        joints = dict(zip(reply["joint_names"], np.round(reply["joint_positions"][index], 3).tolist(), strict=True))
        print(f"success {success:.2f}: position {position} m, wxyz {quaternion}, {reply['hand']} at {joints}")


if __name__ == "__main__":
    main()
