//! Worlds with one object, posed and driven for a test.

use graspbox_hand::{Hand, MotorCommand, MotorKind};
use graspbox_sim::{Geometry, ObjectModel, PhysicsConfig, Template, World};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::sync::Arc;

/// The ReFlex, to be shared or changed.
pub fn reflex() -> Hand {
    Hand::reflex().unwrap().clone()
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

/// Commands that close every finger and hold the preshape (rad).
pub fn closing(hand: &Hand, preshape: f64) -> Vec<MotorCommand> {
    let target = |m: &graspbox_hand::Motor| match m.kind {
        MotorKind::Finger(_) => m.travel[1],
        MotorKind::Preshape => preshape,
    };
    let command = |m| MotorCommand::Position { target: target(m), speed: None };
    hand.motors.iter().map(command).collect()
}

/// Steps with a hand that stays at `hand` for `seconds`; the motors follow `commands`.
pub fn run(world: &mut World, hand: &Isometry3<f64>, commands: &[MotorCommand], seconds: f64) {
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
    for i in 0..world.hand().fingers.len() {
        let f = world.finger(i);
        numbers.extend([f.proximal, f.distal, f.proximal_speed, f.distal_speed, f.spool, f.tension]);
    }
    numbers.extend(world.tactile().force);
    numbers.push(world.time());
    numbers.iter().map(|x| x.to_bits()).collect()
}
