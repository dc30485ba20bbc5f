//! Joint forces: springs, damping, stops, tendons and servos, written into rapier's implicit joint springs.

use super::build::{Handles, JointHandle};
use super::frames;
use crate::engine::{JointState, StepInput};
use graspbox_hand::{ActuatorState, Drive, Hand, Joint, JointKind, Tendon, Transmission};
use rapier3d::prelude::PhysicsWorld;

/// Share of its damping that a tendon keeps while its force is at the limit, dimensionless: friction between tendon and sheath still brakes the
/// joints, but the actuator no longer resists.
const SATURATED_DAMPING: f64 = 0.2;

/// Index of a joint's coordinate in rapier's spatial layout: angular x or linear x.
fn axis(kind: JointKind) -> usize {
    match kind {
        JointKind::Prismatic => 0,
        JointKind::Fixed | JointKind::Revolute => 3,
    }
}

/// Rapier's units of position, and of force per position, of a joint's coordinate.
fn units(kind: JointKind) -> (f64, f64) {
    match kind {
        // Rapier's forces scale with the unit of length, and so do its positions: their ratio does not.
        JointKind::Prismatic => (frames::UNIT, 1.0),
        JointKind::Fixed | JointKind::Revolute => (1.0, frames::TORQUE_UNIT),
    }
}

pub(crate) fn joint_state(world: &PhysicsWorld, joint: &JointHandle) -> JointState {
    let (length, _) = units(joint.kind);
    let state = world.multibody_joints.get(joint.handle).and_then(|(multibody, link)| {
        let link = multibody.link(link)?;
        Some(JointState {
            position: link.joint().coords()[axis(joint.kind)] as f64 / length,
            speed: multibody.generalized_velocity()[link.assembly_id()] as f64 / length,
        })
    });
    // A handle of this world always resolves; the checks of every step would report the NaN.
    state.unwrap_or(JointState { position: f64::NAN, speed: f64::NAN })
}

/// A joint force `stiffness * (rest - position) - damping * speed`, integrated implicitly.
#[derive(Clone, Copy, Debug, Default)]
struct Spring {
    stiffness: f64,
    /// `stiffness * rest`, which can be summed like the stiffness.
    force_at_zero: f64,
    damping: f64,
}

impl Spring {
    /// Spring, damping and stops of a joint.
    fn of(joint: &Joint, position: f64) -> Self {
        let mut spring = Self { damping: joint.damping, ..Self::default() };
        spring.add(joint.stiffness, joint.spring_reference);
        let bounded = joint.within_limits(position);
        if bounded != position {
            spring.add(joint.stop_stiffness, bounded);
        }
        spring
    }

    fn add(&mut self, stiffness: f64, rest: f64) {
        self.stiffness += stiffness;
        self.force_at_zero += stiffness * rest;
    }

    /// Adds a constant force.
    fn push(&mut self, force: f64) {
        self.force_at_zero += force;
    }

    /// Adds a taut tendon with a nonzero moment arm.
    ///
    /// * `stretch`, `rate`: stretch of the tendon and its rate, m and m/s.
    fn pull(&mut self, tendon: &Tendon, arm: f64, state: JointState, stretch: f64, rate: f64, dt: f64) {
        let own_damping = tendon.damping * arm * arm;
        if tendon.stiffness * stretch >= tendon.max_tension {
            self.push(tendon.max_tension * arm);
            self.damping += SATURATED_DAMPING * own_damping;
            return;
        }
        // The joint's own contribution to stretch and rate is implicit. That of the other joints and of the spool is extrapolated to the middle of
        // the step: with its value at the beginning, a moving tendon would pull the joints unequally.
        let others = rate + arm * state.speed;
        self.add(tendon.stiffness * arm * arm, state.position + (stretch + 0.5 * dt * others) / arm);
        self.push(tendon.damping * arm * others);
        self.damping += own_damping;
    }

    /// Adds a servo that drives the joint to `goal`; its force is limited in both directions.
    fn lead(&mut self, [stiffness, damping, limit]: [f64; 3], goal: f64, position: f64) {
        let force = stiffness * (goal - position);
        if force.abs() >= limit {
            self.push(limit.copysign(force));
            self.damping += SATURATED_DAMPING * damping;
        } else {
            self.add(stiffness, goal);
            self.damping += damping;
        }
    }

    fn write(&self, world: &mut PhysicsWorld, joint: &JointHandle) {
        let (length, force) = units(joint.kind);
        // A small stiffness represents a pure force as a spring with a distant rest position.
        let stiffness = self.stiffness.max(1e-4);
        if let Some((multibody, link)) = world.multibody_joints.get_mut(joint.handle)
            && let Some(link) = multibody.link_mut(link)
        {
            link.joint.set_spring(
                axis(joint.kind),
                (stiffness * force) as f32,
                (self.force_at_zero / stiffness * length) as f32,
            );
            let id = link.assembly_id();
            multibody.damping_mut()[id] = (self.damping * force) as f32;
        }
    }
}

/// Writes all joint forces for the next step, and the tension of every tendon, N.
pub(crate) fn actuate(
    world: &mut PhysicsWorld,
    hand: &Hand,
    handles: &Handles,
    input: &StepInput,
    dt: f64,
    tensions: &mut [f64],
) {
    let states: Vec<JointState> = handles.joints.iter().map(|joint| state_of(world, joint.as_ref())).collect();
    let mut springs: Vec<Spring> =
        hand.joints.iter().zip(&states).map(|(joint, state)| Spring::of(joint, state.position)).collect();
    for (actuator, now) in hand.actuators.iter().zip(input.actuators) {
        match &actuator.transmission {
            Transmission::Spool { tendon, radius } => {
                let pulled = &hand.tendons[*tendon];
                let (stretch, rate) = stretch(pulled, *radius, now, &states);
                let arms = pulled.arms.iter().filter(|(_, arm)| *arm != 0.0 && stretch > 0.0);
                for &(joint, arm) in arms {
                    springs[joint].pull(pulled, arm, states[joint], stretch, rate, dt);
                }
                tensions[*tendon] = pulled.tension(stretch, rate);
            }
            Transmission::Joints { joints, drive: Drive::Servo { stiffness, damping } } => {
                for driven in joints {
                    let goal = hand.led(driven, now.position);
                    let servo = [*stiffness, *damping, actuator.load_limit];
                    springs[driven.joint].lead(servo, goal, states[driven.joint].position);
                }
            }
            Transmission::Joints { drive: Drive::Rigid, .. } => {}
        }
    }
    for &joint in &handles.free {
        if let Some(handle) = &handles.joints[joint] {
            springs[joint].write(world, handle);
        }
    }
}

fn state_of(world: &PhysicsWorld, joint: Option<&JointHandle>) -> JointState {
    joint.map_or(JointState { position: 0.0, speed: 0.0 }, |joint| joint_state(world, joint))
}

/// Stretch (m) and stretch rate (m/s) of a tendon on a spool.
fn stretch(tendon: &Tendon, radius: f64, spool: &ActuatorState, states: &[JointState]) -> (f64, f64) {
    let wound = (radius * spool.position, radius * spool.velocity);
    tendon.arms.iter().fold(wound, |(stretch, rate), &(joint, arm)| {
        (stretch - arm * states[joint].position, rate - arm * states[joint].speed)
    })
}

/// Gives rigidly driven joints the speed that brings them to the positions of their actuators by the end of the step.
pub(crate) fn drive_rigid(world: &mut PhysicsWorld, hand: &Hand, handles: &Handles, input: &StepInput, dt: f64) {
    for &joint in &handles.rigid {
        let goal = hand.rigid_position(joint, |actuator| input.actuators[actuator].position);
        let (Some(goal), Some(handle)) = (goal, &handles.joints[joint]) else { continue };
        let speed = (goal - joint_state(world, handle).position) / dt;
        let (length, _) = units(handle.kind);
        if let Some((multibody, link)) = world.multibody_joints.get_mut(handle.handle)
            && let Some(id) = multibody.link(link).map(|l| l.assembly_id())
        {
            multibody.generalized_velocity_mut()[id] = (speed * length) as f32;
        }
    }
}

/// Moves the joints of a new world to `positions` (one per joint, rad or m); [`super::build::place_links`] then places the links.
pub(crate) fn set_positions(world: &mut PhysicsWorld, handles: &Handles, positions: &[f64]) {
    for (joint, position) in handles.joints.iter().zip(positions) {
        let Some(joint) = joint.as_ref().filter(|_| *position != 0.0) else { continue };
        let (length, _) = units(joint.kind);
        let Some((multibody, link)) = world.multibody_joints.get_mut(joint.handle) else { continue };
        let mut displacement = vec![0.0; multibody.ndofs()];
        if let Some(link) = multibody.link(link) {
            displacement[link.assembly_id()] = (position * length) as f32;
        }
        multibody.apply_displacements(&displacement);
    }
}
