//! The approach to a grasp among other objects: where the open hand touches them on its way, it pushes them aside.
//!
//! The collision filter refuses every grasp whose straight approach touches something. That is right for a single object, which a push would
//! move away from the grasp. In a heap it refuses grasps that a real hand can make, so their approach is simulated.

use crate::{Episode, EpisodeError, Scene, SuccessCriterion};
use graspbox_hand::GraspPose;
use nalgebra::{Isometry3, Translation3, Vector3};
use std::sync::Arc;

/// Speed of the hand, m/s.
pub const SPEED: f64 = 0.2;
/// Net contact force at which a hand stops moving against it, N: a heavy object weighs 15 N, and collaborative arms stop at 60 to 140 N.
pub const STOP_FORCE: f64 = 60.0;
/// Time constant of the force sensor's filter, seconds: a brief impact does no harm.
pub const FORCE_TIME: f64 = 0.02;

/// How an approach ends.
pub enum Approach {
    /// The hand is at its pose.
    Arrived(Episode),
    /// Something stopped the hand. The objects may have moved.
    Stopped(Episode),
    /// The hand has no room where its approach begins; nothing moved.
    NoRoom,
}

/// Moves the open hand to its pose, from `standoff` metres behind it.
///
/// * `world_from_object`: pose of the scene's object.
/// * `factors`: as for [`Episode::reset_at`].
///
/// # Errors
/// [`EpisodeError::Plan`] for a preshape beyond the hand's limits, and as [`Episode::advance`].
pub fn approach(
    scene: &Arc<Scene>,
    pose: &GraspPose,
    world_from_object: &Isometry3<f64>,
    factors: [f64; 2],
    criterion: SuccessCriterion,
    standoff: f64,
) -> Result<Approach, EpisodeError> {
    let goal = world_from_object * pose.object_from_hand;
    let behind = |distance: f64| goal * Translation3::new(0.0, 0.0, -distance);
    let first = GraspPose { object_from_hand: world_from_object.inverse() * behind(standoff), ..*pose };
    if !scene.reachable_at(&first, 0.0, world_from_object)? {
        return Ok(Approach::NoRoom);
    }
    let mut episode = Episode::reset_at(scene, &behind(standoff), world_from_object, pose.preshape, factors, criterion);
    let dt = episode.world().dt();
    let steps = (standoff / SPEED / dt).ceil().max(1.0) as u32;
    let (share, mut force) = (dt / (FORCE_TIME + dt), Vector3::zeros());
    for step in 1..=steps {
        let left = standoff * (1.0 - f64::from(step) / f64::from(steps));
        episode.advance(&behind(left), &[])?;
        force += (episode.world().hand_load().force - force) * share;
        // A world that diverged has no finite force.
        if force.norm() > STOP_FORCE || !force.norm().is_finite() {
            return Ok(Approach::Stopped(episode));
        }
    }
    Ok(Approach::Arrived(episode))
}
