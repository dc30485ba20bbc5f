"""Collect real depth images from public repositories, for ``graspbox benchmark captures FOLDER``.

    python scripts/collect_captures.py --out captures
    python scripts/collect_captures.py --out captures --mirror repositories --only mosd

Each capture is a folder with ``depth.png`` (16 bits, millimetres) or ``depth.npy`` (metres), ``labels.png`` (0, or the
number of a thing) and ``capture.json``. It states intrinsics (centres of pixels at integers), camera, source, commit,
licence, how the things were labelled and, where the image shows a flat support, ``plane``: ``normal @ x = offset`` in
the camera's frame (x right, y down, z forward; metres), whose unit normal points towards the camera.

Labels are those of the source, or polygons drawn by hand, without the points that are too near to the plane. The plane
is fitted to a region given by hand (``captures/sources.py``), or to the source's own table, without the things.

Captures that are already there are skipped. The exit status is 1 if one could not be written.
Needs numpy, scipy, Pillow and git.
"""

import argparse
import json
import pickle
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.ndimage import binary_dilation

from captures.readers import Box, CaptureError, Depth, Item, Labels, Lens, Mask, Polygon, Repository, Seen, opened
from captures.sources import SOURCES, Source

#: Points of a plane are within this distance, metres; from 1 m on it grows with the square of the distance.
NEAR_PLANE = 0.004
#: A support is doubtful if the median distance from it is larger, or if a smaller share of the region is near.
LARGEST_MEDIAN, LEAST_SHARE = 0.004, 0.5
#: Things of fewer pixels are left out; a drawn one reaches so far from its median depth, metres.
LEAST_PIXELS, LARGEST_REACH = 50, 0.3


def points_of(depth: Depth, lens: Lens) -> Depth:
    """Return the points (H, W, 3) of an image."""
    rows, columns = np.indices(depth.shape)
    fx, fy, cx, cy = lens
    return np.stack([(columns - cx) / fx * depth, (rows - cy) / fy * depth, depth], axis=-1)


def drawn(things: tuple[Polygon, ...], depth: Depth) -> Labels:
    """Give the pixels of polygons numbers from 1."""
    picture = Image.new("L", (depth.shape[1], depth.shape[0]))
    for number, corners in enumerate(things, 1):
        ImageDraw.Draw(picture).polygon(corners, fill=number, outline=number)
    labels = np.asarray(picture, dtype=np.int64)
    for number in range(1, len(things) + 1):
        pixels = (labels == number) & (depth > 0)
        labels = np.where(pixels & (np.abs(depth - np.median(depth[pixels])) > LARGEST_REACH), 0, labels)
    return labels


def fit_plane(points: Depth, rounds: int = 400) -> tuple[NDArray[np.float64] | None, float, float]:
    """Fit the plane of most points by random triples, then by least squares; None if it is doubtful.

    Returns
    -------
    plane : (4,) array, optional
        Unit normal towards the camera, and d, of ``normal @ x + d = 0``.
    median, share : float
        Median distance of all points, metres; share of those that are near.
    """
    if len(points) < 500:
        return None, np.inf, 0.0
    rng = np.random.default_rng(0)
    some = points[rng.choice(len(points), min(len(points), 20_000), replace=False)]
    near = NEAR_PLANE * np.maximum(1.0, some[:, 2] ** 2)
    best, plane = -1, np.zeros(4)
    for _ in range(rounds):
        a, b, c = some[rng.choice(len(some), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        if (size := float(np.linalg.norm(normal))) < 1e-6:
            continue
        trial = np.append(normal / size, -float(normal @ a) / size)
        if (count := int((np.abs(some @ trial[:3] + trial[3]) < near).sum())) > best:
            best, plane = count, trial
    near = NEAR_PLANE * np.maximum(1.0, points[:, 2] ** 2)
    for _ in range(10):
        inside = points[np.abs(points @ plane[:3] + plane[3]) < near]
        center = inside.mean(axis=0)
        normal = np.linalg.svd(inside[:: max(1, len(inside) // 50_000)] - center, full_matrices=False)[2][2]
        plane = np.append(normal, -normal @ center)
    plane *= 1.0 if plane[3] > 0 else -1.0  # the camera, at zero, is on its upper side
    distances = np.abs(points @ plane[:3] + plane[3])
    median, share = float(np.median(distances)), float((distances < near).mean())
    bound = LARGEST_MEDIAN * max(1.0, float(np.median(points[:, 2])) ** 2)
    return (plane if median <= bound and share >= LEAST_SHARE else None), median, share


def support_of(seen: Seen, labels: Labels, region: Box | None) -> Mask:
    """Return the pixels of the support: without things, and without their edges if the region is given by hand."""
    if seen.support is not None:
        return seen.support & (seen.depth > 0)
    inside = np.zeros(seen.depth.shape, dtype=bool)
    if region is not None:
        left, top, right, bottom = region
        inside[top:bottom, left:right] = True
    around: Mask = binary_dilation(labels > 0, np.ones((9, 9)))
    return inside & (seen.depth > 0) & ~around


def numbered(labels: Labels, depth: Depth) -> NDArray[np.uint8]:
    """Give the things of enough measured pixels numbers from 1."""
    numbers, counts = np.unique(labels[(labels > 0) & (depth > 0)], return_counts=True)
    kept = numbers[counts >= LEAST_PIXELS]
    if len(kept) > 255:
        raise CaptureError(f"there are {len(kept)} things")
    out = np.zeros(labels.shape, dtype=np.uint8)
    for number, one in enumerate(kept, 1):
        out[(labels == one) & (depth > 0)] = number
    return out


def collect(repository: Repository, source: Source, item: Item, out: Path) -> str:
    """Write a capture and return a line about it."""
    seen = source.read(repository, item)
    known = seen.depth[seen.depth > 0]
    if len(known) < 1000 or not 0.2 < np.median(known) < 5.0:
        raise CaptureError(f"{item.path} has {len(known)} pixels with a depth")
    labels = drawn(item.things, seen.depth) if seen.labels is None else seen.labels
    region = item.region or source.region
    points = points_of(seen.depth, seen.lens)
    plane, median, share = fit_plane(points[support_of(seen, labels, region)])
    if source.height and plane is not None:
        labels = np.where(points @ plane[:3] + plane[3] > source.height, labels, 0)
    things = numbered(labels, seen.depth)
    if not things.any():
        raise CaptureError(f"{item.path} shows no thing")
    described: dict[str, Any] = {
        "camera": source.camera,
        "intrinsics": {key: round(float(one), 5) for key, one in zip(("fx", "fy", "cx", "cy"), seen.lens, strict=True)},
        "source": f"{source.repository} {item.path}",
        "commit": repository.commit,
        "license": source.license,
        "labels": "by hand" if seen.labels is None else source.labels,
    }
    if plane is not None:
        normal = [round(float(one), 6) for one in plane[:3]]
        described["plane"] = {"normal": normal, "offset": round(-float(plane[3]), 6), "kind": source.support}
    write(out / item.name, seen.depth, things, described)
    flat = f"median {1e3 * median:.1f} mm, {share:.0%} near" if np.isfinite(median) else "none"
    return f"{things.max()} things, {'plane' if plane is not None else 'no plane'} ({flat})"


def write(folder: Path, depth: Depth, labels: NDArray[np.uint8], described: dict[str, Any]) -> None:
    """Write the files of a capture, all or none."""
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        millimetres = np.rint(depth * 1000.0)
        if np.abs(depth * 1000.0 - millimetres).max() < 1e-3 and millimetres.max() < 1 << 16:
            Image.fromarray(millimetres.astype(np.uint16)).save(temporary / "depth.png")
        else:
            np.save(temporary / "depth.npy", depth.astype(np.float32))
        Image.fromarray(labels).save(temporary / "labels.png")
        (temporary / "capture.json").write_text(json.dumps(described, indent=1) + "\n", encoding="utf-8")
        temporary.chmod(0o755)
        temporary.rename(folder)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def collect_all(out: Path, mirror: Path | None, prefix: str) -> int:
    """Write the captures that are not there, and return the number of those that could not be written."""
    wanted: dict[str, list[tuple[Source, Item]]] = {}
    present = 0
    for source in SOURCES:
        for item in source.items:
            if item.name.startswith(prefix):
                if (out / item.name).exists():
                    present += 1
                else:
                    wanted.setdefault(source.repository, []).append((source, item))
    written = failed = 0
    for name, items in wanted.items():
        print(f"{name}: {len(items)} captures", flush=True)
        try:
            with opened(name, mirror) as repository:
                for source, item in items:
                    try:
                        print(f"  {item.name}: {collect(repository, source, item, out)}", flush=True)
                        written += 1
                    except (CaptureError, OSError, ValueError, LookupError, pickle.PickleError) as error:
                        print(f"  {item.name}: {error}", file=sys.stderr, flush=True)
                        failed += 1
        except (CaptureError, OSError) as error:
            print(f"{name}: {error}", file=sys.stderr, flush=True)
            failed += len(items)
    print(f"{written} captures written, {present} were there, {failed} failed")
    return failed


def main() -> int:
    """Collect the captures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of the captures; made if missing")
    parser.add_argument("--mirror", type=Path, help="folder of local git directories owner+name, instead of GitHub")
    parser.add_argument("--only", default="", metavar="PREFIX", help="captures whose names begin so")
    args = parser.parse_args()
    if not any(item.name.startswith(args.only) for source in SOURCES for item in source.items):
        parser.error(f"no capture has a name that begins with {args.only!r}")
    args.out.mkdir(parents=True, exist_ok=True)
    return 1 if collect_all(args.out, args.mirror, args.only) else 0


if __name__ == "__main__":
    sys.exit(main())
