//! The present state of an episode, from which observations and infos are read.

use crate::actions::arm_controller::ArmController;
use crate::objects::Prepared;
use crate::state::{LastAttempt, Mode, Record};
use graspbox_episode::{Episode, Judge, Verdict};
use graspbox_sim::World;
use nalgebra::{Isometry3, Point3, UnitQuaternion};

/// The present state of an episode; quantities that several readers need are computed once.
pub struct View<'a> {
    /// The state machine.
    pub episode: &'a Episode,
    /// The object.
    pub prepared: &'a Prepared,
    pub arm: &'a ArmController,
    /// The state that every episode has.
    pub record: &'a Record,
    /// The mode, with its state.
    pub mode: &'a Mode,
    /// Index of the contact flag of each link.
    pub flags: &'a [usize],
    /// The present verdict of the judge.
    pub verdict: Verdict,
    /// Links of the hand that touch the object, ascending, without duplicates.
    pub touching: Vec<usize>,
}

impl<'a> View<'a> {
    /// A view of an episode.
    pub fn new(
        episode: &'a Episode,
        prepared: &'a Prepared,
        arm: &'a ArmController,
        record: &'a Record,
        mode: &'a Mode,
        flags: &'a [usize],
    ) -> Self {
        let (verdict, touching) = (episode.verdict(), episode.world().contacts().links);
        Self { episode, prepared, arm, record, mode, flags, verdict, touching }
    }

    pub fn world(&self) -> &'a World {
        self.episode.world()
    }

    pub fn judge(&self) -> &'a Judge {
        self.episode.judge()
    }

    /// The last attempt on a scene of several objects, which the present scene no longer shows; `None` for a single object.
    pub fn last_attempt(&self) -> Option<&'a LastAttempt> {
        self.mode.clearing().map(|clearing| &clearing.last)
    }

    /// True if the hand touches the object.
    pub fn touches(&self) -> bool {
        !self.touching.is_empty()
    }

    /// Centre of mass of the object in a frame, metres.
    pub fn center_of_mass(&self, frame_from_object: &Isometry3<f64>) -> [f64; 3] {
        point(frame_from_object, &self.episode.scene().center_of_mass())
    }

    /// Middle of the object's bounds in a frame, metres.
    pub fn bounds_center(&self, frame_from_object: &Isometry3<f64>) -> [f64; 3] {
        point(frame_from_object, &self.prepared.bounds_center())
    }
}

/// The first two columns of the rotation matrix.
pub fn rotation_columns(rotation: &UnitQuaternion<f64>) -> [f64; 6] {
    let m = rotation.to_rotation_matrix();
    std::array::from_fn(|i| m[(i % 3, i / 3)])
}

/// The translation.
pub fn position(pose: &Isometry3<f64>) -> [f64; 3] {
    pose.translation.vector.into()
}

fn point(pose: &Isometry3<f64>, p: &Point3<f64>) -> [f64; 3] {
    (pose * p).coords.into()
}
