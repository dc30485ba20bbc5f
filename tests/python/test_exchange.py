"""Grasps in formats of other programs: frames, joints, round trips, foreign readers, sources, the command."""

import doctest
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import datasets_for_tests
import graspbox
from command_line import invoke
from graspbox import errors, object_sets
from graspbox.evaluation.planner_trials import try_set
from graspbox.hands.conventions import convention_of, mechanism_of
from graspbox.tools import exchange
from graspbox.tools.exchange.dexgraspbench import grasps_of
from test_exchange_images import image_result

h5py = pytest.importorskip("h5py", reason="ACRONYM's files need h5py, from the extra 'exchange'")
yaml = pytest.importorskip("yaml", reason="Isaac Grasp files need PyYAML, from the extra 'exchange'")

#: A hand of each kind, with an object that it holds.
CASES = {
    "panda_gripper": "procedural:box:0",
    "reflex": "procedural:mug:3",
    "soft_hand": "procedural:can:3",
    "robotiq_2f_85": "procedural:box:1",
    "leap": "procedural:can:3",
    "inspire": "procedural:can:3",
}
#: Prefix of joints and links, and base link, of hands that other programs name otherwise.
NAMED = {"panda_gripper": ("panda_", "panda_hand"), "robotiq_2f_85": ("robotiq_85_", "robotiq_85_base_link")}
#: Format and suffix of each row of the table.
FILES = [(row.name, row.suffix) for row in exchange.FORMATS]

Made = tuple[graspbox.Mesh, exchange.ExchangeGrasps]


@pytest.fixture(scope="module", params=CASES)
def made(request: pytest.FixtureRequest) -> Made:
    """Plan for an object at rest, and try the best grasps."""
    mesh = object_sets.load(CASES[request.param])[0].load()
    rest = graspbox.Scene(mesh, hand=request.param).world_from_object
    plan = graspbox.plan(mesh, hand=request.param, world_from_object=rest).best(4)
    return mesh, exchange.simulated(exchange.from_plan(plan), mesh)


def test_a_grasp_is_closed_and_squeezed(made: Made) -> None:
    """Pregrasp is the open hand, grasp where the object stops it, and squeeze continues in the direction of closing."""
    _, grasps = made
    assert grasps.closed.all()
    assert grasps.success.any()
    for row in range(len(grasps)):
        np.testing.assert_array_equal(grasps.pregrasp[row], grasps.hand.open(float(grasps.preshape[row])))
    limits = grasps.hand.joint_limits
    assert (grasps.squeeze >= limits[:, 0] - 1e-12).all()
    assert (grasps.squeeze <= limits[:, 1] + 1e-12).all()
    moved = np.abs(grasps.grasp - grasps.pregrasp) > 1e-3
    assert moved.any(axis=1).all()
    inside = (grasps.grasp > limits[:, 0]) & (grasps.grasp < limits[:, 1])
    # Other fingers may push a joint back, which still closes with all its force.
    closed = np.array([grasps.hand.closed(float(preshape), 1.0) for preshape in grasps.preshape])
    ways = (grasps.squeeze - grasps.grasp) * np.sign(closed - grasps.pregrasp)
    assert (ways[inside & moved] > -2e-2).all()
    assert (ways.max(axis=1) > 1e-3).all()


def test_the_squeeze_of_a_tendon_has_the_length_on_its_spool() -> None:
    """A free finger whose tendon is wound by 10 mm closes until its joints take up 10 mm."""
    mechanism = mechanism_of(graspbox.load_hand("reflex"))
    start, actuators = np.zeros((1, 7)), np.zeros((1, 4))
    actuators[0, 1] = 0.010 / 0.0125
    found = mechanism.commanded(start, actuators)[0]
    names = graspbox.load_hand("reflex").joints
    moved = {name: value for name, value in zip(names, found, strict=True) if value != 0.0}
    assert set(moved) == {"proximal_joint_2", "distal_joint_2"}
    assert 0.010 * moved["proximal_joint_2"] + 0.006 * moved["distal_joint_2"] == pytest.approx(0.010)


def test_frames_of_the_franka_hand() -> None:
    """In ACRONYM's frame the fingers close along x, the pads are 0.1034 m ahead; in panda_hand they close along y."""
    hand = graspbox.load_hand("panda_gripper")
    shapes, _, pads, _ = hand.shapes(np.array([0.04]))
    for frame, axis in (("gripper", 0), ("base", 1)):
        centers = (exchange.frame_from_hand(hand, frame) @ shapes)[pads][:, :3, 3]  # type: ignore[arg-type]
        assert sorted(centers[:, axis].round(9)) == [-0.045, 0.045]
        np.testing.assert_allclose(centers[:, 1 - axis], 0.0, atol=1e-12)
        np.testing.assert_allclose(centers[:, 2], 0.1033, atol=1e-9)
    assert convention_of(hand).gripper == "panda"


def test_vgn_places_a_hand_on_its_palm() -> None:
    """Its fingers close along y; 0.065 m in front of the flange of the Franka hand, whose pads are at 0.1033 m."""
    for name, ahead in (("panda_gripper", 0.1033 - 0.065), ("robotiq_2f_85", None)):
        hand = graspbox.load_hand(name)
        vgn_from_hand = exchange.frame_from_hand(hand, "vgn")
        shapes, _, pads, _ = hand.shapes(hand.open(hand.preshape_limits[0]))
        centers = (vgn_from_hand @ shapes)[pads][:, :3, 3]
        assert centers[:, 1].min() < -0.03 < 0.03 < centers[:, 1].max()
        np.testing.assert_allclose(centers[:, 0], 0.0, atol=1e-12)
        assert np.linalg.det(vgn_from_hand) == pytest.approx(1.0)
        if ahead is not None:
            np.testing.assert_allclose(centers[:, 2], ahead, atol=1e-9)


def test_frames_of_the_robotiq_gripper() -> None:
    """All formats have the frame of the base link: the fingers close along x, and the tips are 149 mm ahead."""
    hand = graspbox.load_hand("robotiq_2f_85")
    shapes, halves, pads, _ = hand.shapes(np.array([0.0]))
    for frame in ("gripper", "base"):
        placed = (exchange.frame_from_hand(hand, frame) @ shapes)[pads]
        np.testing.assert_allclose(sorted(placed[:, 0, 3]), [-0.0465, 0.0465], atol=1e-5)
        np.testing.assert_allclose(placed[:, 1, 3], 0.0, atol=1e-12)
        np.testing.assert_allclose(placed[:, 2, 3] + halves[pads][:, 2], 0.1493, atol=1e-4)
    assert convention_of(hand).gripper == "robotiq_2f_85"


def test_docstring_examples_run() -> None:
    result = doctest.testmod(exchange)
    assert result.attempted > 0
    assert result.failed == 0


def test_frames_of_other_hands_are_their_base_links() -> None:
    for name in ("reflex", "soft_hand", "leap", "inspire"):
        hand = graspbox.load_hand(name)
        for frame in ("base", "gripper"):
            found = exchange.frame_from_hand(hand, frame)
            np.testing.assert_array_equal(found, mechanism_of(hand).base_from_hand)
    base_from_hand = exchange.frame_from_hand(graspbox.load_hand("reflex"), "base")
    np.testing.assert_allclose(base_from_hand[:3, 3], [0.015, 0.0, 0.09])
    np.testing.assert_allclose(base_from_hand[:3, :3], np.eye(3))


@pytest.mark.parametrize(("to", "suffix"), FILES)
def test_round_trips(made: Made, to: str, suffix: str, tmp_path: Path) -> None:
    _, grasps = made
    grasps = grasps[[0]] if to == "dexgraspbench" else grasps
    # Formats without preshapes hold those of one shape alone.
    given = None if to in ("acronym", "graspgen") else float(grasps.preshape[0])
    if given is not None:
        grasps = grasps[grasps.preshape == given]
    exchange.save(grasps, tmp_path / f"file{suffix}", to)
    if to == "dexgraspbench":
        back = grasps_of(_fields(tmp_path / "file.npy"), grasps.hand, given)
    else:
        back = exchange.load(tmp_path / f"file{suffix}", hand=grasps.hand, preshape=given)
    np.testing.assert_allclose(back.poses, grasps.poses, atol=1e-12)
    np.testing.assert_array_equal(back.preshape, grasps.preshape)
    assert back.object_name == grasps.object_name
    if to in ("acronym", "graspgen"):
        np.testing.assert_array_equal(back.success, grasps.success)
    grasps = grasps.within_limits()
    if to == "isaac":
        np.testing.assert_array_equal(back.confidence, grasps.success)
        np.testing.assert_allclose(back.grasp, grasps.grasp, atol=1e-12)
        np.testing.assert_allclose(back.pregrasp, grasps.pregrasp, atol=1e-12)
    if to == "dexgraspbench":
        np.testing.assert_allclose(back.world_from_object, grasps.world_from_object, atol=1e-12)
        for stage in ("pregrasp", "grasp", "squeeze"):
            np.testing.assert_allclose(getattr(back, stage), getattr(grasps, stage), atol=1e-12)


def test_dexgraspbench_holds_the_pinch_of_the_inspire_hand(tmp_path: Path) -> None:
    """The joint of the thumb's yaw, which no grasp moves, stands at 1.3 rad; coupled joints follow the others."""
    mesh = object_sets.load("procedural:mug:3")[0].load()
    rest = graspbox.Scene(mesh, hand="inspire").world_from_object
    plan = graspbox.plan(mesh, hand="inspire", world_from_object=rest)
    pinches = plan[plan.preshape == graspbox.load_hand("inspire").preshapes["pinch"]].best(1)
    grasp = exchange.simulated(exchange.from_plan(pinches), mesh)
    assert grasp.success.all()
    exchange.save(grasp, tmp_path / "it.npy", "dexgraspbench")
    fields = _fields(tmp_path / "it.npy")
    names = mechanism_of(grasp.hand).joints
    assert len(names) == 12
    for stage in ("pregrasp", "grasp", "squeeze"):
        joints = dict(zip(names, fields[f"{stage}_qpos"][7:], strict=True))
        assert joints["thumb_proximal_yaw_joint"] == pytest.approx(1.3, abs=1e-3)
        assert joints["index_intermediate_joint"] == pytest.approx(1.13 * joints["index_proximal_joint"], abs=1e-3)
    assert fields["pregrasp_qpos"][7 + names.index("index_proximal_joint")] == pytest.approx(0.23)
    back = grasps_of(fields, grasp.hand, 1.0)
    np.testing.assert_allclose(back.squeeze, grasp.squeeze, atol=1e-12)
    np.testing.assert_allclose(back.poses, grasp.poses, atol=1e-12)


def test_acronym_is_read_by_h5py_and_json(made: Made, tmp_path: Path) -> None:
    """Entry by entry as ``acronym_tools`` reads them."""
    _, grasps = made
    exchange.save(replace(grasps, mesh_file="meshes/it.obj", scale=0.5), tmp_path / "it.h5", "acronym")
    with h5py.File(tmp_path / "it.h5") as file:
        transforms, success = (
            np.array(file["grasps/transforms"]),
            np.array(file["grasps/qualities/flex/object_in_gripper"]),
        )
        assert file["object/file"][()] == b"meshes/it.obj"
        assert file["object/scale"][()] == 0.5
        assert file["object/mass"][()] == grasps.mass
    np.testing.assert_array_equal(transforms, grasps.object_from("gripper"))
    assert success.dtype.kind == "i"
    np.testing.assert_array_equal(success, grasps.success)
    exchange.save(grasps, tmp_path / "it.json", "acronym")
    document = json.loads((tmp_path / "it.json").read_text())
    np.testing.assert_array_equal(document["transforms"], transforms)
    assert document["object_scale"] == 1.0
    assert len(document["quality_flex_object_in_gripper"]) == len(grasps)


def test_graspgen_selects_rows_by_outcome(made: Made, tmp_path: Path) -> None:
    """As its documentation reads a file: a mask of true and false selects the positive grasps."""
    _, grasps = made
    grasps = replace(grasps, success=np.array([1.0, 0.0, 1.0, 1.0]))
    exchange.save(grasps, tmp_path / "it.json", "graspgen")
    document = json.loads((tmp_path / "it.json").read_text())
    poses, mask = np.array(document["grasps"]["transforms"]), np.array(document["grasps"]["object_in_gripper"])
    np.testing.assert_array_equal(poses[mask], grasps.object_from("gripper")[[0, 2, 3]])
    np.testing.assert_array_equal(poses[~mask], grasps.object_from("gripper")[[1]])
    assert document["object"] == {"file": grasps.object_name, "scale": 1.0}


def test_isaac_is_read_by_yaml(made: Made, tmp_path: Path) -> None:
    """As GraspGen and Isaac Sim read a file; the Franka Hand has the names of Isaac Sim's manual."""
    grasps = made[1].within_limits()
    exchange.save(grasps, tmp_path / "it.yaml", "isaac")
    document = yaml.safe_load((tmp_path / "it.yaml").read_text())
    assert (document["format"], document["format_version"]) == ("isaac_grasp", 1.0)
    entry = document["grasps"]["grasp_1"]
    w, (x, y, z) = entry["orientation"]["w"], entry["orientation"]["xyz"]
    turned = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    base = grasps.object_from("base")[1]
    np.testing.assert_allclose(turned, base[:3, :3], atol=1e-9)
    np.testing.assert_allclose(entry["position"], base[:3, 3], atol=1e-9)
    prefix, base_link = NAMED.get(grasps.hand.name, ("", None))
    assert list(entry["cspace_position"]) == [prefix + name for name in grasps.hand.joints]
    np.testing.assert_allclose(list(entry["cspace_position"].values()), grasps.grasp[1])
    np.testing.assert_allclose(list(entry["pregrasp_cspace_position"].values()), grasps.pregrasp[1])
    if base_link is not None:
        assert document["gripper_frame_link"] == base_link


def _fields(path: Path) -> dict[str, Any]:
    """Read a file as the benchmark does."""
    found: dict[str, Any] = np.load(path, allow_pickle=True).item()
    return found


@pytest.mark.parametrize("stage", ["pregrasp", "grasp", "squeeze"])
def test_dexgraspbench_places_the_hand_in_mujoco(made: Made, stage: str, tmp_path: Path) -> None:
    """MuJoCo reads the hand's URDF, gets a free base and the file's qpos, and has all joints and shapes in place."""
    mujoco = pytest.importorskip("mujoco", reason="qpos is checked with mujoco, from the extra 'dev'")
    grasps = made[1].within_limits()
    exchange.save(grasps[[0]], tmp_path / "0.npy", "dexgraspbench")
    qpos = _fields(tmp_path / "0.npy")[f"{stage}_qpos"]
    spec = mujoco.MjSpec.from_string(grasps.hand.files[0].replace("</robot>", _MUJOCO + "</robot>"))
    spec.worldbody.first_body().add_freejoint()
    model = spec.compile()
    assert model.nq == len(qpos)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    base = grasps.world_from_object[0] @ grasps.object_from("base")[0]
    np.testing.assert_allclose(data.xpos[1], base[:3, 3], atol=1e-9)
    np.testing.assert_allclose(data.xmat[1].reshape(3, 3), base[:3, :3], atol=1e-9)
    world_from_hand = grasps.world_from_object[0] @ grasps.poses[0]
    positions = getattr(grasps, stage)[0]
    joints, _, _ = grasps.hand.joint_frames(positions)
    ours = world_from_hand @ joints
    _same_joints(ours[:, :3, 0], ours[:, :3, 3], data.xaxis[1:], data.xanchor[1:])
    shapes = world_from_hand @ grasps.hand.shapes(positions)[0]
    np.testing.assert_allclose(_sorted(shapes[:, :3, 3]), _sorted(data.geom_xpos), atol=1e-6)


def test_dexgraspbench_fits_the_model_of_the_validation(made: Made, tmp_path: Path) -> None:
    """Its joints have the order of the file, and its links stand where graspbox's kinematics has them.

    The model has no joint where a preshape holds one, such as the yaw of a thumb: the file's position places the link.
    """
    pytest.importorskip("mujoco", reason="qpos is checked with mujoco, from the extra 'dev'")
    import mujoco

    from graspbox.hands.description import describe, joint_motion
    from graspbox.tools.scene_export.contents import quaternion
    from validation import mujoco as judge

    mesh, grasps = made[0], made[1].within_limits()
    exchange.save(grasps[[0]], tmp_path / "0.npy", "dexgraspbench")
    qpos = _fields(tmp_path / "0.npy")["grasp_qpos"]
    item = judge.object_data(graspbox.Scene(mesh, hand=grasps.hand, world_from_object=grasps.world_from_object[0]))
    scene = judge.build(describe(grasps.hand), item)
    model, data = scene.model, mujoco.MjData(scene.model)
    model.body_pos[scene.base_body], model.body_quat[scene.base_body] = qpos[:3], qpos[3:7]
    at = dict(zip(mechanism_of(grasps.hand).joints, qpos[7:], strict=True))
    moving = {scene.hand.links[link].joint: address for link, (address, _) in scene.joints.items()}
    assert list(moving) == [name for name in at if name in moving]
    data.qpos[list(moving.values())] = [at[name] for name in moving]
    for link in scene.hand.links:
        if link.joint in at.keys() - moving.keys():
            body, frame = model.body(link.name).id, link.parent_from_link @ joint_motion(link, at[link.joint])
            model.body_pos[body], model.body_quat[body] = frame[:3, 3], quaternion(frame[:3, :3])
    mujoco.mj_forward(model, data)
    shapes = grasps.world_from_object[0] @ grasps.poses[0] @ grasps.hand.shapes(grasps.grasp[0])[0]
    np.testing.assert_allclose(_sorted(shapes[:, :3, 3]), _sorted(data.geom_xpos[scene.is_hand]), atol=1e-6)


#: Keeps the base link a body, and collision shapes geoms.
_MUJOCO = '<mujoco><compiler fusestatic="false" discardvisual="false" balanceinertia="true"/></mujoco>'


def _sorted(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(points[np.lexsort(points.round(5).T)])


def _same_joints(axes: Any, anchors: Any, their_axes: Any, their_anchors: Any) -> None:
    """Compare joints up to their order, as lines in space: direction and moment."""

    def lines(ways: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.hstack([ways, np.cross(points, ways)])

    np.testing.assert_allclose(_sorted(lines(axes, anchors)), _sorted(lines(their_axes, their_anchors)), atol=1e-6)


def test_plans_give_their_feasible_grasps(tmp_path: Path) -> None:
    mesh = object_sets.load("procedural:box:0")[0].load()
    plan = graspbox.plan(mesh, hand="panda_gripper")
    plan.save(tmp_path / "plan.json")
    (read,) = exchange.read(tmp_path / "plan.json")
    assert read == exchange.from_plan(plan)
    np.testing.assert_array_equal(read.poses, plan.poses[plan.feasible])
    assert np.isnan(read.success).all()
    assert read.object_name == mesh.name
    outcomes = graspbox.simulate(mesh, plan, hand="panda_gripper")
    np.testing.assert_array_equal(exchange.from_plan(plan, outcomes).success, outcomes.success[plan.feasible])
    with pytest.raises(errors.ConfigError, match="3 outcomes for"):
        exchange.from_plan(plan, outcomes[:3])
    with pytest.raises(errors.ConfigError, match="hand 'panda_gripper', not 'reflex'"):
        exchange.from_plan(plan, hand="reflex")


def test_tables_of_grasp_give_their_outcomes(tmp_path: Path) -> None:
    result = try_set(object_sets.load("procedural:box:0-1"), poses=3, hand="panda_gripper")
    (tmp_path / "grasps.json").write_text(json.dumps(result.table(details=True)))
    read = exchange.read(tmp_path / "grasps.json")
    assert [one.object_name for one in read] == ["box-000000", "box-000001"]
    for one, row in zip(read, result.objects, strict=True):
        assert row.plan is not None
        assert row.outcomes is not None
        np.testing.assert_array_equal(one.poses, row.plan.poses)
        np.testing.assert_array_equal(one.success, row.outcomes.success)
        np.testing.assert_array_equal(one.world_from_object[0], row.plan.world_from_object)
    (tmp_path / "counts.json").write_text(json.dumps(result.table()))
    with pytest.raises(errors.ConfigError, match="has no grasps of its objects"):
        exchange.read(tmp_path / "counts.json")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("pyarrow", reason="data sets need pyarrow, from the extra 'data'")
    pytest.importorskip("pydantic", reason="data sets need pydantic, from the extra 'data'")
    from graspbox.data import trials as dataset

    made = tmp_path_factory.mktemp("data") / "set"
    config = datasets_for_tests.config(poses=6, views=1)
    dataset.generate(["procedural:can:0", "procedural:box:1"], made, config=config, runner=dataset.local(1))
    return made


def test_data_sets_give_what_was_tried(folder: Path) -> None:
    from graspbox.data import trials as dataset

    table = dataset.load(folder)
    read = exchange.read(folder)
    assert sorted(one.object_name for one in read) == ["box-000001", "can-000000"]
    for one in read:
        rows = dataset.column(table, "object") == one.object_name
        np.testing.assert_array_equal(one.poses, dataset.matrices(table, "executed_object_from_hand")[rows])
        np.testing.assert_array_equal(one.success, dataset.column(table, "success")[rows])
        source = str(dataset.column(table, "source")[rows][0])
        assert one.mass == pytest.approx(object_sets.load(source)[0].load().mass)


def test_imported_grasps_are_tried(made: Made, tmp_path: Path) -> None:
    """A file comes back with the poses that succeeded before, and the mesh that lies beside it."""
    mesh, grasps = made
    named = exchange.with_mesh(grasps, mesh, tmp_path)
    for name, to in (("it.h5", "acronym"), ("it.json", "graspgen")):
        exchange.save(named, tmp_path / name, to)
        found = exchange.load(tmp_path / name, hand=grasps.hand)
        beside = graspbox.load_mesh(tmp_path / found.mesh_file, scale=found.scale, mass=mesh.mass)
        np.testing.assert_allclose(beside.vertices, mesh.vertices, atol=1e-8)
        rest = grasps.world_from_object[0]
        outcomes = graspbox.simulate(beside, found.poses, found.preshape, hand=found.hand, world_from_object=rest)
        np.testing.assert_array_equal(outcomes.success, grasps.success)


def test_preshapes_have_to_be_given_where_a_hand_has_several(made: Made, tmp_path: Path) -> None:
    _, grasps = made
    exchange.save(grasps, tmp_path / "it.yaml", "isaac")
    name = grasps.hand.name
    if name in ("reflex", "robotiq_2f_85", "inspire"):
        with pytest.raises(errors.ConfigError, match=f"preshape is missing, and '{name}' has several"):
            exchange.load(tmp_path / "it.yaml", hand=name)
    else:
        assert (exchange.load(tmp_path / "it.yaml", hand=grasps.hand).preshape == 0).all()


def test_another_mesh_is_refused() -> None:
    mesh, other = (object_sets.load(f"procedural:box:{seed}")[0].load() for seed in (0, 1))
    grasps = exchange.from_plan(graspbox.plan(mesh, hand="panda_gripper").best(1))
    with pytest.raises(errors.ConfigError, match="for another mesh, 'box-000000', than 'box-000001'"):
        exchange.simulated(grasps, other)


def test_a_hand_of_your_own_needs_no_row(tmp_path: Path) -> None:
    """Its frames follow from its two files, which have to be given, since files of graspbox hold its name alone."""
    urdf, toml = graspbox.load_hand("panda_gripper").files
    (tmp_path / "mine.urdf").write_text(urdf)
    (tmp_path / "mine.toml").write_text(toml.replace('name = "panda_gripper"', 'name = "mine"'))
    files = (tmp_path / "mine.urdf", tmp_path / "mine.toml")
    hand = graspbox.load_hand(files)
    np.testing.assert_array_equal(exchange.frame_from_hand(hand, "gripper"), exchange.frame_from_hand(hand, "base"))
    mesh = object_sets.load("procedural:box:0")[0].load()
    graspbox.plan(mesh, hand=hand).best(2).save(tmp_path / "plan.json")
    with pytest.raises(errors.ConfigError, match="of the hand 'mine', which is not one of the package"):
        exchange.read(tmp_path / "plan.json")
    (read,) = exchange.read(tmp_path / "plan.json", hand=files)
    tried = exchange.simulated(read, mesh)
    exchange.save(tried, tmp_path / "it.h5", "acronym")
    with pytest.raises(errors.ConfigError, match="of the gripper 'mine', not 'panda'"):
        exchange.load(tmp_path / "it.h5")
    np.testing.assert_allclose(exchange.load(tmp_path / "it.h5", hand=hand).poses, read.poses, atol=1e-12)
    words = [str(tmp_path / "plan.json"), "--to", "isaac", "--out", str(tmp_path / "it.yaml")]
    result = _run(*words, "--objects", "procedural:box:0", "--hand", ",".join(map(str, files)))
    assert result.exit_code == 0, result.output
    document = yaml.safe_load((tmp_path / "it.yaml").read_text())
    assert document["gripper_frame_link"] == "hand"
    assert list(document["grasps"]["grasp_0"]["cspace_position"]) == ["finger_joint1"]


def test_a_grasp_that_collides_stays_open() -> None:
    """It has an outcome, a failure, and no positions of the closed hand; DexGraspBench's format refuses it."""
    mesh = object_sets.load("procedural:box:0")[0].load()
    inside = np.eye(4)[None]
    found = exchange.simulated(exchange.ExchangeGrasps.of(inside, hand="panda_gripper"), mesh)
    assert found.success[0] == 0
    assert not found.closed[0]
    with pytest.raises(errors.ConfigError, match="has no joint positions"):
        exchange.save(found, "it.npy", "dexgraspbench")


def _run(*words: str) -> Any:
    return invoke(["export-grasps", *words])


@pytest.fixture
def table(tmp_path: Path) -> str:
    result = try_set(object_sets.load("procedural:box:0-1"), poses=3, hand="panda_gripper")
    (tmp_path / "grasps.json").write_text(json.dumps(result.table(details=True)))
    return str(tmp_path / "grasps.json")


def test_the_command_writes_every_format(table: str, tmp_path: Path) -> None:
    objects = ["--objects", "procedural:box:0-1"]
    for to, files in (
        ("acronym", ["box-000000.h5", "box-000001.h5"]),
        ("graspgen", ["box-000000.json", "box-000001.json", "train.txt", "valid.txt"]),
        ("isaac", ["box-000000.yaml", "box-000001.yaml"]),
        ("dexgraspbench", ["box-000000/0.npy", "box-000000/1.npy", "box-000001/0.npy", "box-000001/1.npy"]),
    ):
        out = tmp_path / to
        result = _run(table, "--to", to, "--out", str(out), *objects, "--count", "2", "--json")
        assert result.exit_code == 0, result.output
        report = json.loads(result.stdout)
        assert report["files"] == [str(out / file) for file in files]
        assert all((out / file).is_file() for file in files)
        assert [row["grasps"] for row in report["objects"]] == [2, 2]
        assert (out / "meshes/box-000000.obj").is_file()
        assert report["objects"][0]["with_joints"] == (2 if to in ("isaac", "dexgraspbench") else 0)
    lists = [(tmp_path / "graspgen" / name).read_text().split() for name in ("train.txt", "valid.txt")]
    assert sorted(lists[0] + lists[1]) == ["meshes/box-000000.obj", "meshes/box-000001.obj"]


def test_the_command_selects_and_writes_one_file(table: str, tmp_path: Path) -> None:
    out = tmp_path / "one.h5"
    result = _run(table, "--to", "acronym", "--out", str(out), "--only", "box-000000", "--successful")
    assert result.exit_code == 0, result.output
    assert exchange.load(out).success.all()
    assert (tmp_path / "meshes/box-000000.obj").is_file()
    words = [table, "--to", "dexgraspbench", "--out", str(tmp_path / "0.npy"), "--only", "box-000000", "--count", "1"]
    assert _run(*words).exit_code == 0


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--to", "acronym", "--out", "it.h5"], "has grasps of 2 objects, and 'it.h5' holds one"),
        (["--to", "acronym", "--out", "it.yaml"], "files of acronym end in .h5 or .json"),
        (["--to", "grasps", "--out", "it.h5"], "there is no format 'grasps'; choose from acronym, graspgen, isaac"),
        (["--to", "isaac", "--out", "it", "--only", "mug"], "no grasps of 'mug'; choose from box-000000, box-000001"),
        (["--to", "isaac", "--out", "it", "--objects", "procedural:mug:0"], "has no object 'box-000000'"),
        (["--to", "isaac", "--out", "it", "--hand", "a.urdf,b.toml"], "a.urdf"),
    ],
)
def test_the_command_refuses(
    table: str, words: list[str], why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = _run(table, *words)
    assert isinstance(result.exception, errors.GraspboxError)
    assert why in str(result.exception)


def test_the_command_reads_data_sets_and_images(folder: Path, tmp_path: Path) -> None:
    """A data set names its objects, so that nothing else is needed; an image needs a threshold for outcomes."""
    result = _run(
        str(folder), "--to", "dexgraspbench", "--out", str(tmp_path / "d"), "--successful", "--count", "1", "--json"
    )
    report = json.loads(result.stdout)
    assert report["objects"], report
    assert result.exit_code == (1 if report["refused"] else 0)
    for row in report["objects"]:
        fields = _fields(tmp_path / "d" / row["name"] / "0.npy")
        assert fields["obj_path"] == f"meshes/{row['name']}.obj"
        assert len(fields["grasp_qpos"]) == 7 + 8
    (tmp_path / "image.json").write_text(json.dumps(image_result()))
    words = [str(tmp_path / "image.json"), "--to", "graspgen", "--out", str(tmp_path / "i.json")]
    assert "have no outcome" in str(_run(*words).exception)
    assert _run(*words, "--threshold", "0.5").exit_code == 0
    np.testing.assert_array_equal(exchange.load(tmp_path / "i.json", hand="reflex").success, [1.0, 0.0])
    nothing = _run(str(folder), "--to", "acronym", "--out", str(tmp_path / "a"), "--only", "can-000000", "--no-meshes")
    assert nothing.exit_code == 0
    assert not (tmp_path / "a" / "meshes").exists()
