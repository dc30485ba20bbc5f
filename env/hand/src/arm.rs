//! An arm: what carries a hand, read from a URDF and an `arm.toml`.
//!
//! | module | purpose |
//! |---|---|
//! | `assemble` | checks the two files against each other: the axes from base to flange, their limits, home, mounts |
//! | `table` | the tables of `arm.toml` |
//! | [`assets`] | the arms that come with the project, embedded |
//!
//! The flange frame is the frame of the link `flange`: its origin is on the face that a hand is screwed to, its z axis leaves this face.
//! Links and joints are those of a hand's URDF, and the same reader reads them.

mod assemble;
pub mod assets;
pub mod carrier;
mod table;

use std::path::Path;

use nalgebra::Isometry3;

use crate::error::{HandError, Problems, Report};
use crate::kinematics::link_poses;
use crate::load::{read_files, read_table, read_tree, sorted};
use crate::model::{Hand, Joint, Link};
use crate::urdf::assumption::{Assumption, AssumptionKind};
use assemble::assemble;
use table::ArmTable;

/// One axis of an arm: a joint that moves the flange, with what limits it besides its range ([`Joint::limits`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Index of the joint.
    pub joint: usize,
    /// Greatest speed, rad/s or m/s.
    pub speed: f64,
    /// Greatest acceleration, rad/s2 or m/s2; `None` where none is known.
    pub acceleration: Option<f64>,
    /// Greatest jerk, rad/s3 or m/s3; `None` where none is known.
    pub jerk: Option<f64>,
    /// Lower speeds near the ends of its range, if the arm has them.
    pub slowing: Option<Slowing>,
    /// Position at home, rad or m.
    pub home: f64,
}

/// Lower speeds of a joint near the ends of its range: at a distance d from an end it moves towards it by at most sqrt(`rate` d) - `offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slowing {
    /// Least and greatest position, rad or m.
    pub ends: [f64; 2],
    /// rad/s2 or m/s2.
    pub rate: f64,
    /// rad/s or m/s.
    pub offset: f64,
}

impl Slowing {
    /// Least speed, rad/s or m/s, that a joint must be able to have: nearer to an end it could not brake in time.
    const LEAST: f64 = 0.05;

    /// The part of a range in which the joint may move by the least speed at least.
    fn usable(&self, [lower, upper]: [f64; 2]) -> [f64; 2] {
        let least = (self.offset + Self::LEAST).powi(2) / self.rate;
        [lower.max(self.ends[0] + least), upper.min(self.ends[1] - least)]
    }
}

/// Where a hand is mounted on an arm.
#[derive(Clone, Debug, PartialEq)]
pub struct Mount {
    /// Name of the hand.
    pub hand: String,
    /// Pose of the hand's mounting frame in the flange frame.
    pub flange_from_mount: Isometry3<f64>,
}

/// A whole arm. Link 0 is the base, which does not move.
#[derive(Clone, Debug, PartialEq)]
pub struct Arm {
    pub name: String,
    /// Links, the base first, parents before children; none beyond the flange.
    pub links: Vec<Link>,
    /// Joint `i` moves link `i + 1`.
    pub joints: Vec<Joint>,
    /// The axes, from the base to the flange.
    pub axes: Vec<Axis>,
    /// Index of the link whose frame is the flange.
    pub flange: usize,
    /// Greatest mass at the flange, kg.
    pub payload: f64,
    /// Mounts of hands, by name; other hands are mounted by their own mounting frame.
    pub mounts: Vec<Mount>,
    /// What its URDF does not say and was assumed.
    pub assumptions: Vec<Assumption>,
}

impl Arm {
    /// Reads an arm from a URDF and an `arm.toml`.
    ///
    /// # Errors
    /// [`HandError::Io`] for a file that cannot be read, else as [`Arm::from_strs`].
    pub fn load(urdf: &Path, toml: &Path) -> Result<Self, HandError> {
        let [u, t] = Self::read_files(urdf, toml)?;
        Self::from_strs(&u, &t, [&urdf.display().to_string(), &toml.display().to_string()])
    }

    /// The text of both files.
    ///
    /// # Errors
    /// As [`Hand::read_files`].
    pub fn read_files(urdf: &Path, toml: &Path) -> Result<[String; 2], HandError> {
        read_files(urdf, toml).map_err(of_arm)
    }

    /// Reads an arm from the text of a URDF and of an `arm.toml`.
    ///
    /// * `names`: names of the two files in errors.
    ///
    /// # Errors
    /// [`HandError::InvalidArm`] with every problem, each with its file and line.
    pub fn from_strs(urdf: &str, toml: &str, names: [&str; 2]) -> Result<Self, HandError> {
        let mut links = Report::new(names[0]);
        let mut tables = Report::new(names[1]);
        let tree = read_tree(urdf, &mut links);
        let table = read_table::<ArmTable>(toml, &mut tables);
        let mut arm = None;
        if let (Some(tree), Some(table)) = (tree, table) {
            arm = assemble(tree, &table, toml, &mut links, &mut tables);
        }
        links.problems.sort_by_key(|p| p.line);
        tables.problems.sort_by_key(|p| p.line);
        links.problems.append(&mut tables.problems);
        match arm.filter(|_| links.problems.is_empty()) {
            Some(arm) => {
                // Most links that only mark a frame, as of a flange, have no mass.
                let frame = |told: &Assumption| {
                    matches!(told.kind, AssumptionKind::Massless { .. } | AssumptionKind::Carried { .. })
                };
                let assumptions = links.assumptions.into_iter().filter(|told| !frame(told)).collect();
                Ok(Self { assumptions: sorted(assumptions), ..arm })
            }
            None => Err(HandError::InvalidArm(Problems(links.problems))),
        }
    }

    /// The joints of the axes, from the base to the flange.
    pub fn axis_joints(&self) -> impl ExactSizeIterator<Item = &Joint> + '_ {
        self.axes.iter().map(|axis| &self.joints[axis.joint])
    }

    /// Positions of the axes at home, rad or m.
    #[must_use]
    pub fn home(&self) -> Vec<f64> {
        self.axes.iter().map(|axis| axis.home).collect()
    }

    /// Pose of every link (`base_from_link`), in the order of `links`. Limits are not enforced.
    ///
    /// * `positions`: of the axes, from the base to the flange, rad or m.
    ///
    /// # Errors
    /// [`HandError::CoordinateCount`] unless there is one position per axis; [`HandError::NotFinite`] for NaN and infinities.
    pub fn forward_kinematics(&self, positions: &[f64]) -> Result<Vec<Isometry3<f64>>, HandError> {
        let (found, expected) = (positions.len(), self.axes.len());
        if found != expected {
            return Err(HandError::CoordinateCount { found, expected });
        }
        if let Some(&value) = positions.iter().find(|position| !position.is_finite()) {
            return Err(HandError::NotFinite { what: "joint position", value });
        }
        let mut all = vec![0.0; self.joints.len()];
        for (axis, &position) in self.axes.iter().zip(positions) {
            all[axis.joint] = position;
        }
        Ok(link_poses(self.links.len(), &self.joints, &all))
    }

    /// Pose of the base of a hand in the flange frame: the arm's own mount of this hand, else the hand's mounting frame on the flange.
    #[must_use]
    pub fn flange_from_base_of(&self, hand: &Hand) -> Isometry3<f64> {
        let named = self.mounts.iter().find(|mount| mount.hand == hand.name);
        let flange_from_mount = named.map_or_else(Isometry3::identity, |mount| mount.flange_from_mount);
        flange_from_mount * hand.base_from_mount().inverse()
    }

    /// The link that a link is fixed to and that a joint moves, or the base: the first link of a rigid body.
    #[must_use]
    pub fn carrier(&self, link: usize) -> usize {
        crate::chains::carrier(&self.joints, link)
    }
}

/// An error in the files of a hand as that of an arm.
fn of_arm(error: HandError) -> HandError {
    match error {
        HandError::Invalid(problems) => HandError::InvalidArm(problems),
        other => other,
    }
}
