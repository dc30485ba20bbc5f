"""The notebooks run from top to bottom, with small parameters, and are committed without outputs."""

import json
from pathlib import Path
from typing import Any

import pytest

nbformat = pytest.importorskip("nbformat", reason="notebooks need nbclient and ipykernel, from the extra 'dev'")
nbclient = pytest.importorskip("nbclient", reason="notebooks need nbclient and ipykernel, from the extra 'dev'")
pytest.importorskip("ipykernel", reason="notebooks need nbclient and ipykernel, from the extra 'dev'")

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
#: Names of the notebooks.
NAMES = ("depth_image", "mesh_to_grasps", "train_policy")


def cells_of(notebook: Any, kind: str) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == kind]


def run(name: str, changed: str) -> Any:
    """Run a notebook in its folder; `changed` is code that follows its parameters."""
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    at = next(i for i, cell in enumerate(notebook.cells) if "parameters" in cell.metadata.get("tags", []))
    notebook.cells.insert(at + 1, nbformat.v4.new_code_cell(changed))
    place = {"metadata": {"path": str(FOLDER)}}
    # A cell that raises ends the run with its traceback.
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3", resources=place).execute()
    return notebook


def text_of(notebook: Any) -> str:
    outputs = [one for cell in cells_of(notebook, "code") for one in cell.outputs]
    return "".join(one.text for one in outputs if one.output_type == "stream" and one.name == "stdout")


def pictures_of(notebook: Any) -> int:
    outputs = [one for cell in cells_of(notebook, "code") for one in cell.outputs]
    return sum("image/png" in one.get("data", {}) for one in outputs)


def test_every_notebook_is_tested() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.ipynb")) == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_notebooks_are_committed_without_outputs(name: str) -> None:
    text = (FOLDER / f"{name}.ipynb").read_text()
    notebook = nbformat.reads(text, as_version=4)
    nbformat.validate(notebook)
    for cell in cells_of(notebook, "code"):
        assert (cell.outputs, cell.execution_count) == ([], None)
    assert sum("parameters" in cell.metadata.get("tags", []) for cell in notebook.cells) == 1
    assert set(json.loads(text)["metadata"]) == {"kernelspec", "language_info"}
    assert notebook.cells[0].source.startswith("# ")


def test_a_mesh_becomes_grasps() -> None:
    notebook = run("mesh_to_grasps", 'OBJECT, COUNT = "procedural:mug:3", 4')
    assert "4 of 4 succeed, 4 are secure" in text_of(notebook)
    assert pictures_of(notebook) == 4


def test_a_depth_image_becomes_grasps() -> None:
    notebook = run("depth_image", 'OBJECT, IMAGE_SIZE, COUNT = "procedural:mug:3", (240, 320), 2')
    printed = text_of(notebook)
    assert "above the table and looks down by" in printed
    assert "2: success" in printed
    assert pictures_of(notebook) == 3


def test_a_depth_image_of_ones_own(tmp_path: Path) -> None:
    """A file replaces the rendered image; nothing can be simulated."""
    import numpy as np

    from graspbox import object_sets
    from graspbox.meshes.views import ViewPlan, views

    plan = ViewPlan("random", axis=(-1.0, 0.0, 1.2), cap=0.0, distance=(0.6, 0.6), shift=0.0)
    mesh = object_sets.load("procedural:mug:3")[0].load()
    seen = views(mesh, plan=plan, count=1, image_size=(240, 320), images="depth")
    np.save(tmp_path / "depth.npy", seen.depth[0])
    lens = tuple(seen.intrinsics[[0, 1, 0, 1], [0, 1, 2, 2]].tolist())
    given = f"DEPTH, INTRINSICS, COUNT = {str(tmp_path / 'depth.npy')!r}, {lens}, 1"
    notebook = run("depth_image", given)
    assert "1: success" in text_of(notebook)
    assert pictures_of(notebook) == 2


@pytest.mark.train
def test_a_policy_is_trained() -> None:
    pytest.importorskip("stable_baselines3")
    notebook = run("train_policy", 'STEPS, NUM_ENVS, TRIALS, TEST_OBJECTS = 32, 2, 4, "procedural:can:1000"')
    printed = text_of(notebook)
    for name in ("untrained", "trained", "planner"):
        assert f"\n{name} " in printed
    assert pictures_of(notebook) == 2
