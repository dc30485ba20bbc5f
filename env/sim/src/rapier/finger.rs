//! The tendon law: one unilateral, compliant tendon over two joints, written into the engine's implicit joint springs.

use super::build::FingerHandles;
use super::frames;
use crate::engine::JointState;
use graspbox_hand::{Finger, Hand, Joint};
use rapier3d::prelude::{MultibodyJointHandle, PhysicsWorld};

/// While the tendon is saturated its damping is this share of the full one: friction of tendon and sheath still brakes the
/// joints, but the motor no longer resists.
const SATURATED_DAMPING: f64 = 0.2;
/// Index of a revolute joint's coordinate in the engine's spatial layout: angular x.
const ANGLE: usize = 3;

pub(crate) fn joint_state(world: &PhysicsWorld, handle: MultibodyJointHandle) -> JointState {
    let state = world.multibody_joints.get(handle).and_then(|(multibody, link)| {
        let link = multibody.link(link)?;
        Some(JointState {
            angle: link.joint().coords()[ANGLE] as f64,
            speed: multibody.generalized_velocity()[link.assembly_id()] as f64,
        })
    });
    // A handle of this world always resolves; NaN would be caught by the finiteness check of every step.
    state.unwrap_or(JointState { angle: f64::NAN, speed: f64::NAN })
}

/// A joint torque `stiffness * (rest - angle) - damping * speed`, integrated implicitly.
#[derive(Clone, Copy, Debug, Default)]
struct Drive {
    stiffness: f64,
    /// `stiffness * rest`: stays meaningful as stiffnesses are added up.
    torque_at_zero: f64,
    damping: f64,
}

impl Drive {
    fn spring(&mut self, stiffness: f64, rest: f64) {
        self.stiffness += stiffness;
        self.torque_at_zero += stiffness * rest;
    }

    /// A torque that does not depend on the angle.
    fn torque(&mut self, torque: f64) {
        self.torque_at_zero += torque;
    }

    /// A stop that pushes back only beyond the joint's limits.
    fn stop(&mut self, joint: &Joint, angle: f64, stiffness: f64) {
        let bounded = angle.clamp(joint.limits[0], joint.limits[1]);
        if bounded != angle {
            self.spring(stiffness, bounded);
        }
    }

    fn write(&self, world: &mut PhysicsWorld, handle: MultibodyJointHandle) {
        // A little stiffness keeps a pure torque expressible as a spring with a far rest angle.
        let stiffness = self.stiffness.max(1e-4);
        if let Some((multibody, link)) = world.multibody_joints.get_mut(handle)
            && let Some(link) = multibody.link_mut(link)
        {
            link.joint.set_spring(
                ANGLE,
                (stiffness * frames::TORQUE_UNIT) as f32,
                (self.torque_at_zero / stiffness) as f32,
            );
            let id = link.assembly_id();
            multibody.damping_mut()[id] = (self.damping * frames::TORQUE_UNIT) as f32;
        }
    }
}

/// Stretch (m) and stretch rate (m/s) of the tendon for a spool angle and speed and the two joints' states.
pub(crate) fn stretch(finger: &Finger, spool: JointState, proximal: JointState, distal: JointState) -> (f64, f64) {
    let t = &finger.tendon;
    (
        t.spool_radius * spool.angle - t.proximal_arm * proximal.angle - t.distal_arm * distal.angle,
        t.spool_radius * spool.speed - t.proximal_arm * proximal.speed - t.distal_arm * distal.speed,
    )
}

/// Writes tendon, flexure, losses and stops of one finger into its two joints for the coming step; returns the tension, N.
pub(crate) fn actuate(
    world: &mut PhysicsWorld,
    finger: &Finger,
    joints: [&Joint; 2],
    handles: &FingerHandles,
    spool: JointState,
    dt: f64,
) -> f64 {
    let (proximal, distal) = (joint_state(world, handles.proximal), joint_state(world, handles.distal));
    let (stretch, rate) = stretch(finger, spool, proximal, distal);
    let (t, flexure) = (&finger.tendon, &finger.flexure);
    let mut drives = [
        Drive { damping: flexure.proximal_damping, ..Drive::default() },
        Drive { damping: flexure.distal_damping, ..Drive::default() },
    ];
    drives[0].spring(flexure.proximal_stiffness, flexure.proximal_rest);
    drives[1].spring(flexure.stiffness, flexure.rest);
    let states = [proximal, distal];
    for (i, arm) in [t.proximal_arm, t.distal_arm].into_iter().enumerate() {
        drives[i].stop(joints[i], states[i].angle, flexure.stop_stiffness);
        if stretch <= 0.0 {
            continue;
        }
        let own_damping = t.damping * arm * arm;
        if t.stiffness * stretch >= t.max_tension {
            drives[i].torque(t.max_tension * arm);
            drives[i].damping += SATURATED_DAMPING * own_damping;
        } else {
            // The joint's own share of stretch and rate is implicit; the other joint's and the spool's is taken as it will be in
            // the middle of the step: as it stands at its beginning, a moving tendon would pull the two joints unequally.
            let others = rate + arm * states[i].speed;
            drives[i].spring(t.stiffness * arm * arm, states[i].angle + (stretch + 0.5 * dt * others) / arm);
            drives[i].torque(t.damping * arm * others);
            drives[i].damping += own_damping;
        }
    }
    drives[0].write(world, handles.proximal);
    drives[1].write(world, handles.distal);
    t.tension(stretch, rate)
}

/// Turns the swivels of all fingers to `preshape`, rad; the links are placed by [`super::build::place_links`].
pub(crate) fn set_swivels(physics: &mut PhysicsWorld, hand: &Hand, fingers: &[FingerHandles], preshape: f64) {
    for (finger, handles) in hand.fingers.iter().zip(fingers) {
        let (Some((_, sign)), Some(handle)) = (finger.swivel, handles.swivel) else {
            continue;
        };
        let Some((multibody, link)) = physics.multibody_joints.get_mut(handle) else {
            continue;
        };
        let mut displacement = vec![0.0; multibody.ndofs()];
        if let Some(link) = multibody.link(link) {
            displacement[link.assembly_id()] = (sign * preshape) as f32;
        }
        multibody.apply_displacements(&displacement);
    }
}
