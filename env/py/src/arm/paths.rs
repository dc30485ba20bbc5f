//! `graspbox._core.arm_path`: the path of an arm to a grasp.

use crate::arm::{Arm, Prepared, asked, prepared};
use crate::convert::{Array, Floats, array, isometry, points, read_config};
use crate::errors::CoreError;
use crate::gil::detached;
use crate::hand::Hand;
use crate::mesh::Mesh;
use crate::plan::Obstacles;
use graspbox_arm::path::{Cause, Failure, Phase, Piece};
use graspbox_arm::{ArmBodies, Mover, Path, PathParams, Robot, Scene, Task, Thing, Touched, With, path};
use graspbox_hand::Arm as Core;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::Arc;

/// Names of the phases, in their order.
const PHASES: [(Phase, &str); 6] = [
    (Phase::Reach, "reach"),
    (Phase::Approach, "approach"),
    (Phase::Lift, "lift"),
    (Phase::Carry, "carry"),
    (Phase::Lower, "lower"),
    (Phase::Retreat, "retreat"),
];

/// What was found for a grasp: the pieces of its path, or why there is none.
type Found = Result<Vec<Piece>, Failure>;

/// Plans the path to the first of some grasps that has one.
///
/// * `objects`: other objects; `thing`: what is grasped.
///
/// Returns the index of the grasp, -1 if none has a path; the pieces as tuples of phase, postures (m, k) and, for straight lines of the hand, the
/// distances (m,) of the postures; and for each grasp before it what is in the way: phase, code and sentence.
#[pyfunction]
#[pyo3(signature = (arm, poses, preshapes, hand, start, accelerations, world_from_base, mount, points, objects, walls, thing, place, params, cache, num_threads))]
#[allow(clippy::too_many_arguments)]
pub fn arm_path<'py>(
    py: Python<'py>,
    arm: &Arm,
    poses: Floats<'py>,
    preshapes: Floats<'py>,
    hand: &Hand,
    start: Floats<'py>,
    accelerations: Floats<'py>,
    world_from_base: Floats<'py>,
    mount: Option<Floats<'py>>,
    points: Floats<'py>,
    objects: Vec<(PyRef<'py, Mesh>, Floats<'py>)>,
    walls: Vec<(Floats<'py>, [f64; 3])>,
    thing: Option<(PyRef<'py, Mesh>, Floats<'py>)>,
    place: Option<Floats<'py>>,
    params: &Bound<'py, PyAny>,
    cache: Option<PathBuf>,
    #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
) -> PyResult<Bound<'py, PyDict>> {
    let around = Obstacles::new(&objects, &walls)?;
    let params: PathParams = read_config(params, "PathConfig")?;
    let asked = asked(&poses, &preshapes)?;
    let [start, accelerations] = [arm.positions(&start, "start")?, arm.positions(&accelerations, "accelerations")?];
    let world_from_base = isometry(&world_from_base, "world_from_base")?;
    let mount = mount.map(|m| isometry(&m, "mount")).transpose()?;
    let cloud = self::points(&points, "points")?;
    let place = place.map(|m| isometry(&m, "place")).transpose()?;
    let thing =
        thing.map(|(mesh, pose)| Ok::<_, CoreError>((Arc::clone(&mesh.0), isometry(&pose, "target")?))).transpose()?;
    let (core, cell, hand) = (Arc::clone(&arm.core), Arc::clone(&arm.prepared), Arc::clone(&hand.0));
    let (found, names) = detached(py, num_threads, move || {
        let Prepared { inverse, bodies } = prepared(&cell, &core);
        let (mut names, obstacles) = around.named(cache.as_deref())?.into_iter().unzip::<String, _, Vec<_>, Vec<_>>();
        let obstacles = obstacles.into_iter().map(|other| (other.obstacle, other.world_from_obstacle)).collect();
        let reach = &params.reach;
        let scene = Scene::new(world_from_base, &cloud, obstacles, reach.clearance, reach.point_radius)?;
        let flange_from_base = mount.unwrap_or_else(|| core.flange_from_base_of(&hand));
        let robot = Robot { arm: &core, inverse, bodies, hand: &hand, flange_from_base, accelerations };
        let thing = thing
            .map(|(mesh, world_from_thing)| {
                let body = mesh.body(cache.as_deref())?;
                // The thing is the last of the objects, before the grasp and after it is placed.
                names.push(body.name().to_owned());
                Ok::<_, CoreError>(Thing { obstacle: Arc::clone(body.obstacle()), world_from_thing, place })
            })
            .transpose()?;
        let (mut found, mut params): (Vec<Found>, _) = (Vec::new(), params);
        for (world_from_hand, preshape) in asked {
            let task = Task { start, world_from_hand, preshape, thing: thing.clone() };
            found.push(path(&robot, &scene, &task, &params)?.map(|Path { pieces }| pieces));
            // Where one grasp is cut off, others most often are too: all searches together take at most twice the samples of the first.
            if found.last().is_some_and(|one| matches!(one, Err(Failure { cause: Cause::NoWay(_), .. }))) {
                params.iterations /= 2;
            }
            // A bad start or place is the same for all grasps.
            if found.last().is_some_and(|one| one.as_ref().map_or_else(is_final, |_| true)) {
                break;
            }
        }
        Ok::<_, CoreError>((found, names))
    })?;
    answers(py, arm, &found, &names)
}

/// True for what no other grasp changes.
fn is_final(failure: &Failure) -> bool {
    match failure.cause {
        Cause::Beyond(_) => true,
        Cause::Touches((mover, _)) => {
            failure.phase == Phase::Reach || (mover == Mover::Thing && failure.phase == Phase::Lower && failure.at_end)
        }
        _ => false,
    }
}

fn answers<'py>(py: Python<'py>, arm: &Arm, found: &[Found], names: &[String]) -> PyResult<Bound<'py, PyDict>> {
    let axes = arm.core.axes.len();
    let dict = PyDict::new(py);
    let pieces = found.last().and_then(|last| last.as_ref().ok());
    let index = if pieces.is_some() { found.len() as i64 - 1 } else { -1 };
    dict.set_item("grasp", index)?;
    let row = |piece: &Piece| {
        let postures = piece.postures.iter().flat_map(|posture| posture[..axes].to_vec()).collect();
        let postures: Array<'py, f64> = array(py, postures, &[piece.postures.len(), axes])?;
        let lengths = piece.lengths.clone().map(|lengths| {
            let count = lengths.len();
            array(py, lengths, &[count])
        });
        Ok((phase(piece.phase), postures, lengths.transpose()?))
    };
    let pieces = pieces.map_or(Ok(Vec::new()), |pieces| pieces.iter().map(row).collect::<PyResult<Vec<_>>>())?;
    dict.set_item("pieces", pieces)?;
    let bodies = &prepared(&arm.prepared, &arm.core).bodies;
    let failures = found.iter().filter_map(|one| one.as_ref().err());
    let failures: Vec<(&str, &str, String)> = failures
        .map(|failure| (phase(failure.phase), code(&failure.cause), sentence(failure, &arm.core, bodies, names)))
        .collect();
    dict.set_item("failures", failures)?;
    Ok(dict)
}

fn phase(phase: Phase) -> &'static str {
    PHASES.iter().find(|(other, _)| *other == phase).map_or("", |(_, name)| name)
}

fn code(cause: &Cause) -> &'static str {
    match cause {
        Cause::Beyond(_) => "start_beyond_limit",
        Cause::Touches(_) => "touches",
        Cause::Unreached(_) => "not_reached",
        Cause::AtLimit(_) => "at_limit",
        Cause::Jumps => "singular",
        Cause::NoWay(_) => "no_way",
    }
}

/// A failure in words.
fn sentence(failure: &Failure, arm: &Core, bodies: &ArmBodies, names: &[String]) -> String {
    let joint = |axis: usize| arm.joints[arm.axes[axis].joint].name.as_str();
    let mover = |mover: Mover| match mover {
        Mover::Arm(body) => bodies.name(body).to_owned(),
        Mover::Hand => "the hand".to_owned(),
        Mover::Thing => "the carried object".to_owned(),
    };
    let place = match (failure.phase, failure.at_end, failure.cause) {
        (Phase::Reach, _, Cause::NoWay(_)) => "between start and approach",
        (Phase::Reach, ..) => "at the start",
        (Phase::Approach, true, _) => "at the grasp",
        (Phase::Approach, ..) => "on the approach",
        (Phase::Lift, ..) => "on the lift",
        (Phase::Carry, ..) => "between lift and place",
        (Phase::Lower, true, _) => "at the place",
        (Phase::Lower, ..) => "on the way down to the place",
        (Phase::Retreat, ..) => "on the retreat",
    };
    let cause = match failure.cause {
        Cause::Beyond(axis) => format!("{} is beyond its limits", joint(axis)),
        Cause::Touches((one, With::Itself(other))) => format!("{} touches {}", mover(one), mover(other)),
        Cause::Touches((one, With::World(Touched::Table))) => format!("{} touches the table", mover(one)),
        Cause::Touches((one, With::World(Touched::Points))) => format!("{} touches what is seen", mover(one)),
        Cause::Touches((one, With::World(Touched::Obstacle(index)))) => {
            format!("{} touches {}", mover(one), names.get(index).map_or("an object", String::as_str))
        }
        Cause::Unreached(reason) => reason.sentence(arm, bodies, names),
        Cause::AtLimit(axis) => format!("{} is at its limit", joint(axis)),
        Cause::Jumps => "the arm passes a singularity".to_owned(),
        Cause::NoWay(count) => format!("no way was found with {count} samples"),
    };
    format!("{place} {cause}")
}
