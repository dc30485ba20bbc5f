//! The posture of an arm in which an episode begins: the first sampled pose of the hand that the arm reaches, else home. Before a decision the arm
//! waits at home.

use crate::EnvError;
use crate::actions::workspace::{WORKSPACE_HIGH, WORKSPACE_LOW};
use crate::objects::Prepared;
use crate::robot_arm::{ArmSpec, PlacedObstacle};
use crate::starts::hand_placement::HandPlacement;
use crate::starts::initial_samples::InitialSamples;
use crate::starts::random_stream::RandomStream;
use crate::starts::reset_options::{ResetOptions, bad_option};
use graspbox_arm::chain::Positions;
use graspbox_episode::Scene;
use nalgebra::Isometry3;
use std::sync::Arc;

/// Most poses of the hand that are tried.
const MOST_POSES: usize = 16;
/// Greatest angle to the rotation of a requested and of a sampled pose, for an arm with fewer than six axes, rad: it meets few rotations.
const GIVEN_ANGLE: f64 = 0.2;
const SAMPLED_ANGLE: f64 = 1.0;
/// Mixed into the seed of the further poses, so that cameras and light do not follow them.
const FURTHER: u64 = 0x61_72_6d;

/// Where the hand begins, and the posture of the arm that holds it there.
pub struct HandStart {
    pub world_from_hand: Isometry3<f64>,
    pub joints: Option<Positions>,
}

impl HandStart {
    /// The first pose of the hand, on an arm if there is one.
    ///
    /// * `hand_error`: the true hand in the one of forward kinematics.
    /// * `prepared`: the objects of the scene.
    ///
    /// # Errors
    /// As [`HandPlacement::place`] and `OnArm::start`.
    pub fn new(
        placement: &HandPlacement<'_>,
        hand_error: &Isometry3<f64>,
        (prepared, scene): (&[Arc<Prepared>], &Scene),
        (samples, options, preshape): (&InitialSamples, &ResetOptions, f64),
    ) -> Result<Self, EnvError> {
        match &placement.spec.arm {
            None => Ok(Self { world_from_hand: placement.place(samples, options, preshape)?, joints: None }),
            Some(arm) => {
                let objects = start_obstacles(prepared, scene, placement.world_from_object);
                let on_arm = OnArm { placement, arm, hand_error, objects };
                match placement.spec.config.control.decides() {
                    true => on_arm.wait(options),
                    false => on_arm.start(samples, options, preshape),
                }
            }
        }
    }
}

/// The first pose of a hand on an arm.
struct OnArm<'a> {
    placement: &'a HandPlacement<'a>,
    arm: &'a ArmSpec,
    /// The true hand in the one of forward kinematics.
    hand_error: &'a Isometry3<f64>,
    /// The objects of the scene.
    objects: Vec<PlacedObstacle>,
}

/// The objects of a scene with their poses.
fn start_obstacles(
    prepared: &[Arc<Prepared>],
    scene: &Scene,
    world_from_object: &Isometry3<f64>,
) -> Vec<PlacedObstacle> {
    let pose = |index: usize| if index == scene.target() { *world_from_object } else { scene.world_from(index) };
    prepared.iter().enumerate().map(|(index, one)| (Arc::clone(one.body().obstacle()), pose(index))).collect()
}

impl OnArm<'_> {
    /// The first posture: at the requested pose, or at the first sampled one that is reached.
    ///
    /// # Errors
    /// [`EnvError::BadOption`] for a requested pose that the arm does not reach; [`EnvError::NoStart`] if it reaches no sampled one and home is no start;
    /// else as [`HandPlacement::place`].
    fn start(&self, samples: &InitialSamples, options: &ResetOptions, preshape: f64) -> Result<HandStart, EnvError> {
        let mut samples = samples.clone();
        let mut further = RandomStream::new(samples.viewpoint ^ FURTHER);
        let mut why = String::new();
        for _ in 0..MOST_POSES {
            let wanted = self.placement.place(&samples, options, preshape)?;
            let exact = options.world_from_hand.is_some();
            match self.posture(&wanted, preshape, if exact { GIVEN_ANGLE } else { SAMPLED_ANGLE })? {
                Ok(joints) => return Ok(self.at(joints)),
                Err(reason) if exact => {
                    let arm = &self.arm.robot.arm.name;
                    return Err(bad_option("world_from_hand", format!("arm `{arm}` does not reach it: {reason}")));
                }
                Err(reason) => why = reason,
            }
            samples.place_hand(&mut further);
        }
        let home = self.at(self.arm.robot.home());
        let at = home.world_from_hand.translation.vector;
        let inside = (0..3).all(|axis| (WORKSPACE_LOW[axis]..=WORKSPACE_HIGH[axis]).contains(&at[axis]));
        if inside && self.placement.is_free(&home.world_from_hand, preshape) {
            return Ok(home);
        }
        let (arm, object) = (self.arm.robot.arm.name.clone(), self.placement.object.to_owned());
        let base = self.arm.robot.world_from_base.translation.vector.into();
        Err(EnvError::NoStart { arm, object, base, why })
    }

    /// Home, in which the arm waits for a decision; where an object is in its way there, it has no path.
    ///
    /// # Errors
    /// [`EnvError::BadOption`] for a requested pose.
    fn wait(&self, options: &ResetOptions) -> Result<HandStart, EnvError> {
        if options.world_from_hand.is_some() {
            return Err(bad_option("world_from_hand", "an arm waits at home for a decision; leave it out"));
        }
        Ok(self.at(self.arm.robot.home()))
    }

    fn posture(
        &self,
        world_from_hand: &Isometry3<f64>,
        preshape: f64,
        angle: f64,
    ) -> Result<Result<Positions, String>, EnvError> {
        let estimated = world_from_hand * self.hand_error.inverse();
        self.arm.posture(self.placement.spec.hand(), &estimated, preshape, angle, self.objects.clone())
    }

    fn at(&self, joints: Positions) -> HandStart {
        let world_from_hand = self.arm.robot.world_from_hand(&joints) * self.hand_error;
        HandStart { world_from_hand, joints: Some(joints) }
    }
}
