"""Cut the meshes that `compare_parts` wrote into convex parts by CoACD: ``python compare_parts_coacd.py FOLDER``.

Needs ``pip install coacd``; nothing else in the repository does. CoACD takes minutes per object: rows that are there
already are kept. A second run of `compare_parts` prints them.
"""

import json
import sys
import time
from pathlib import Path

import coacd
import numpy as np


def read(path: Path) -> coacd.Mesh:
    """Read an OBJ file of triangles."""
    rows = [line.split() for line in path.read_text().splitlines()]
    vertices = [[float(x) for x in row[1:]] for row in rows if row[0] == "v"]
    faces = [[int(x) - 1 for x in row[1:]] for row in rows if row[0] == "f"]
    return coacd.Mesh(np.array(vertices), np.array(faces))


def main() -> None:
    """Write ``NAME.coacd.json`` beside every ``NAME.obj`` of the folder."""
    coacd.set_log_level("error")
    settings = {
        "CoACD, its defaults": {},
        "CoACD, threshold 0.02, at most 48 parts": {"threshold": 0.02, "max_convex_hull": 48},
    }
    for label, options in settings.items():
        for path in sorted(Path(sys.argv[1]).glob("*.obj")):
            out = path.with_suffix(".coacd.json")
            rows = json.loads(out.read_text()) if out.exists() else []
            if any(row["label"] == label for row in rows):
                continue
            started = time.perf_counter()
            parts = coacd.run_coacd(read(path), **options)
            seconds = time.perf_counter() - started
            print(path.stem, label, len(parts), f"{seconds:.1f} s", flush=True)
            rows.append({"label": label, "seconds": seconds, "parts": [vertices.tolist() for vertices, _ in parts]})
            out.write_text(json.dumps(rows))


if __name__ == "__main__":
    main()
