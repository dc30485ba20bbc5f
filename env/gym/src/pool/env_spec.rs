//! Immutable data shared by all environments of a pool.

use crate::EnvError;
use crate::actions::control::{Control, Timing};
use crate::actions::guard::Guard;
use crate::config::EnvConfig;
use crate::objects::Objects;
use crate::observations::observation::ObservationSpec;
use crate::robot_arm::ArmSpec;
use crate::scenery::{fixed_boxes, goal_marker};
use crate::state::bounds::StateBounds;
use graspbox_hand::{Hand, JointKind, Shape};
use graspbox_plan::OpenHand;
use graspbox_render::{FixedBox, Model, Observer};
use nalgebra::Vector3;
use std::sync::Arc;

/// Clearance around the open hand when an episode begins, metres.
const START_CLEARANCE: f64 = 0.01;

/// Immutable data shared by all environments of a pool.
pub struct EnvSpec {
    /// The settings.
    pub config: EnvConfig,
    pub objects: Arc<Objects>,
    /// Limits of commands, which keep the hand off the table.
    pub guard: Guard,
    /// The observations of the config, in its order.
    pub observations: Vec<ObservationSpec>,
    /// Renders the images.
    pub observer: Observer,
    /// Render models of walls, table and ground of every scene.
    pub fixed_boxes: Vec<FixedBox>,
    /// Render model of a goal in pictures, in environments that have one.
    pub goal_marker: Option<Model>,
    /// Timing of a step.
    pub timing: Timing,
    /// Number of entries of an action.
    pub action: usize,
    /// The open hand at its least preshape, with which episodes begin by default.
    pub open: OpenHand,
    /// The arm that carries the hand.
    pub arm: Option<ArmSpec>,
    /// Greatest distance of any part of the hand from the grasp frame, metres.
    pub reach: f64,
    /// For each link, the index of its contact flag: the links of [`Hand::touch_links`], then the palm.
    pub flags: Vec<usize>,
}

impl EnvSpec {
    /// Checks a config against objects and hand.
    ///
    /// # Errors
    /// [`EnvError`] for a setting out of range, a time step that does not divide the control period, an observation of sensors that the hand does
    /// not have, or a hand whose kinematics fail.
    pub fn new(objects: Arc<Objects>, config: EnvConfig) -> Result<Self, EnvError> {
        config.validate()?;
        if config.control.decides() {
            config.trial().check_time_step(objects.physics().dt)?;
        }
        let hand = Arc::clone(objects.hand());
        if let Some(observation) = config.observations.iter().find(|o| !o.exists(&hand, config.action())) {
            return Err(EnvError::NothingToObserve { name: observation.name(), hand: hand.name.clone() });
        }
        let action = config.action().size(&hand);
        let control = config.control.name();
        if objects.arm().is_none() && config.control == Control::JointVelocity {
            return Err(EnvError::NoArm { control });
        }
        let walls = config.clutter.walls()?;
        let observations =
            config.observations.iter().map(|o| ObservationSpec::new(*o, &hand, config.action())).collect();
        Ok(Self {
            reach: reach(&hand)?,
            open: open_hand(&hand, hand.preshape_limits()[0])?,
            guard: Guard::new(&hand)?,
            timing: match config.control.decides() {
                true => Timing::DECISION,
                false => Timing::new(config.control_freq, objects.physics().dt)?,
            },
            flags: flags(&hand),
            arm: objects.arm().map(|robot| ArmSpec::new(robot, &hand, &walls)).transpose()?,
            observer: Observer::new(
                Arc::clone(&hand),
                config.cameras.clone(),
                objects.hand_model(),
                config.clutter.most_objects(),
            )?,
            fixed_boxes: fixed_boxes(&walls, true)?,
            goal_marker: config.goal.map(|_| goal_marker()).transpose()?,
            observations,
            action,
            objects,
            config,
        })
    }

    /// Bounds of the numbers of a saved state.
    pub(crate) fn state_bounds(&self) -> StateBounds {
        StateBounds {
            preshape: self.hand().preshape_limits(),
            preshape_unit: self.hand().preshape_unit(),
            objects: self.config.clutter.most_objects(),
            scales: self.config.clutter.scales(),
        }
    }

    pub fn hand(&self) -> &Arc<Hand> {
        self.objects.hand()
    }
}

/// Upper bound of the distance of any part of a hand from the grasp frame in any configuration, metres: the sum of the distances from joint to
/// joint, the travels of prismatic joints, and the size of the farthest shape.
///
/// # Errors
/// [`EnvError::BadHand`] for a hand whose kinematics fail.
fn reach(hand: &Hand) -> Result<f64, EnvError> {
    let bad = |source| EnvError::BadHand { source };
    let open = hand.open_configuration(hand.preshape_limits()[0]);
    let links = hand.hand_from_links(&open).map_err(bad)?;
    let shapes = hand.shapes_at(&open).map_err(bad)?;
    let mut most = 0.0_f64;
    for shape in &shapes {
        let size = match shape.collider.shape {
            Shape::Cuboid(half) => half.norm(),
            Shape::Cylinder { radius, half_length } => radius.hypot(half_length),
            Shape::Sphere { radius } => radius,
        };
        let at = shape.hand_from_shape.translation.vector;
        let (mut from, mut length) = (Vector3::zeros(), 0.0);
        for link in carriers(hand, shape.link) {
            let origin = links[link].translation.vector;
            let joint = &hand.joints[link - 1];
            let slide = if joint.kind == JointKind::Prismatic { joint.limits[1] - joint.limits[0] } else { 0.0 };
            length += (origin - from).norm() + slide;
            from = origin;
        }
        most = most.max(length + (at - from).norm() + size);
    }
    Ok(most)
}

/// The open hand at `preshape`, with its clearance at the beginning of an episode.
///
/// # Errors
/// [`EnvError::Unusable`] for a preshape beyond the hand's limits.
pub fn open_hand(hand: &Hand, preshape: f64) -> Result<OpenHand, EnvError> {
    OpenHand::new(hand, preshape, START_CLEARANCE, 0.0).map_err(|source| EnvError::Unusable { source })
}

/// Moving links between the base and `link`, from the root.
fn carriers(hand: &Hand, link: usize) -> Vec<usize> {
    let mut found = Vec::new();
    let mut at = hand.carrier(link);
    while let Some(joint) = at.checked_sub(1) {
        found.push(at);
        at = hand.carrier(hand.joints[joint].parent);
    }
    found.reverse();
    found
}

/// Index of every link's contact flag; links without their own flag have no collision shapes.
fn flags(hand: &Hand) -> Vec<usize> {
    let own = hand.touch_links();
    let palm = own.len();
    let place = |link: usize| own.iter().position(|first| *first == hand.carrier(link)).unwrap_or(palm);
    (0..hand.links.len()).map(place).collect()
}
