//! Worlds with one object, posed and driven for a test.

use graspbox_hand::assets::asset;
use graspbox_hand::{ActuatorCommand, Hand};
use graspbox_sim::{Geometry, ObjectModel, PhysicsConfig, Template, World};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::sync::Arc;

/// The ReFlex, to be shared or changed.
pub fn reflex() -> Hand {
    Hand::reflex().unwrap().clone()
}

/// The shipped gripper with a servo for each finger, which any engine can simulate.
pub fn two_servos() -> Hand {
    let panda = asset("panda_gripper").unwrap();
    let urdf = panda.urdf.replace("<mimic joint=\"finger_joint1\"/>", "");
    let from = panda.toml.find("[[actuators]]").unwrap();
    let to = panda.toml.find("# The grasp frame").unwrap();
    let second = panda.toml[from..to].replace("finger_joint1", "finger_joint2").replace("\"fingers\"", "\"second\"");
    let toml = format!("{}{second}{}", &panda.toml[..to], &panda.toml[to..]);
    let toml = toml
        .replace("closing = [\"fingers\"]", "closing = [\"fingers\", \"second\"]")
        .replace("[joints.finger_joint1]", "[joints.fingers]\nnames = [\"finger_joint1\", \"finger_joint2\"]");
    Hand::from_strs(&urdf, &toml, ["gripper.urdf", "hand.toml"]).unwrap()
}

/// A pose without rotation, metres.
pub fn at(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    Isometry3::translation(x, y, z)
}

/// A hand with its palm facing down, its grasp frame at (x, y, z), metres.
pub fn palm_down(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    Isometry3::from_parts(Translation3::new(x, y, z), down)
}

/// Pose of a hand out of the way, 1.5 m above the table.
pub fn away() -> Isometry3<f64> {
    at(0.0, 0.0, 1.5)
}

/// A template with a solid primitive of `mass` kilograms.
pub fn template(hand: Hand, geometry: &Geometry, mass: f64, config: PhysicsConfig) -> Template {
    let object = ObjectModel::solid(geometry, mass).unwrap();
    Template::new(Arc::new(hand), &object, config).unwrap()
}

/// Commands that close the hand and hold the preshape.
pub fn closing(hand: &Hand, preshape: f64) -> Vec<ActuatorCommand> {
    let command = |target| ActuatorCommand::Position { target, speed: None };
    hand.closed_positions(preshape).into_iter().map(command).collect()
}

/// The last two joints of finger `index`: proximal, distal.
pub fn bending(hand: &Hand, index: usize) -> [usize; 2] {
    let joints = &hand.chains()[index].joints;
    [joints[joints.len() - 2], joints[joints.len() - 1]]
}

/// Steps with a hand that stays at `hand` for `seconds`; the actuators follow `commands`.
pub fn run(world: &mut World, hand: &Isometry3<f64>, commands: &[ActuatorCommand], seconds: f64) {
    for _ in 0..(seconds / world.dt()).round() as usize {
        world.step(hand, commands).unwrap();
    }
}

/// Angular velocity (rad/s, world axes) that takes `before` to `after` in `dt` seconds.
pub fn turn_rate(before: &Isometry3<f64>, after: &Isometry3<f64>, dt: f64) -> Vector3<f64> {
    (after.rotation * before.rotation.inverse()).scaled_axis() / dt
}

/// Every number of a world that a step changes, as bits: poses, velocities, joints, tendons.
///
/// Two worlds with equal bits here have gone the same way; a change in any last digit shows.
pub fn bits(world: &World) -> Vec<u64> {
    let mut numbers: Vec<f64> = Vec::new();
    for pose in [world.world_from_object(), world.world_from_hand(), world.hand_from_object()] {
        numbers.extend(pose.translation.vector.iter());
        numbers.extend(pose.rotation.coords.iter());
    }
    let (linear, angular) = world.object_velocity_in_hand();
    numbers.extend(linear.iter().chain(angular.iter()));
    for joint in 0..world.hand().joints.len() {
        let state = world.joint(joint);
        numbers.extend([state.position, state.speed]);
    }
    numbers.extend(world.actuators().iter().map(|actuator| actuator.position));
    numbers.extend((0..world.hand().tendons.len()).map(|tendon| world.tension(tendon)));
    numbers.extend(world.tactile().force);
    numbers.push(world.time());
    numbers.iter().map(|x| x.to_bits()).collect()
}

/// Runs `work` on a pool of threads of its own.
pub fn in_pool<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(work)
}
