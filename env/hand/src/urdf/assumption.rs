//! What is assumed where a URDF does not say it, or says what cannot be.

use std::fmt;

/// Something that was assumed at one place of a URDF.
#[derive(Clone, Debug, PartialEq)]
pub struct Assumption {
    /// Name of the file, as passed.
    pub file: String,
    /// Line in it, from 1.
    pub line: usize,
    pub kind: AssumptionKind,
}

impl fmt::Display for Assumption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.file, self.line, self.kind)
    }
}

/// An assumption, as a sentence about the input.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AssumptionKind {
    /// A fixed link without mass.
    #[error("link \"{link}\": {why} and is fixed to \"{parent}\"; it has no mass of its own")]
    Massless {
        link: String,
        /// What is missing.
        why: &'static str,
        parent: String,
    },
    /// A moving link, or the root, whose mass is that of the links fixed to it.
    #[error("link \"{link}\": {why} and no collision shape; its mass is that of the links fixed to it")]
    Carried {
        link: String,
        /// What is missing.
        why: &'static str,
    },
    /// The mass of collision shapes.
    #[error(
        "link \"{link}\": {why}; its mass and inertia are those of its collision shapes at {density} kg/m3, {:.4} kg",
        mass
    )]
    FromShapes {
        link: String,
        /// What is missing.
        why: &'static str,
        density: f64,
        /// Their mass, kg.
        mass: f64,
    },
    /// A link without mass, shapes and fixed links.
    #[error("link \"{link}\": {why} and no collision shape; its mass is {mass} kg, a ball of {density} kg/m3")]
    SmallMass {
        link: String,
        /// What is missing.
        why: &'static str,
        density: f64,
        /// The mass that it gets, kg.
        mass: f64,
    },
    /// A principal moment of inertia that is not positive.
    #[error(
        "link \"{link}\": its least principal moment of inertia is {least:.3e} kg m2; its inertia is that of {of} with its mass"
    )]
    Moments {
        link: String,
        /// The moment, kg m2.
        least: f64,
        /// The body whose inertia it gets.
        of: &'static str,
    },
    /// Principal moments that break the triangle inequality.
    #[error(
        "link \"{link}\": its greatest principal moment of inertia exceeds the sum of the other two by {excess:.1} %; a third of \
         the excess is taken from it and added to each of the others, the least change that makes a body possible"
    )]
    Balanced {
        link: String,
        /// Excess over that sum, per cent of it.
        excess: f64,
    },
    /// A follower whose leader takes it out of its own limits.
    #[error(
        "joint \"{joint}\": follows \"{leader}\" beyond its limits [{:.4}, {:.4}]; they become [{:.4}, {:.4}]",
        limits[0], limits[1], reached[0], reached[1]
    )]
    MimicRange {
        joint: String,
        leader: String,
        /// Its limits in the file.
        limits: [f64; 2],
        /// Its limits, with the positions to which it follows.
        reached: [f64; 2],
    },
    /// A follower without limits of its own.
    #[error(
        "joint \"{joint}\": has no range of its own; its limits are those to which it follows \"{leader}\", [{:.4}, {:.4}]",
        reached[0], reached[1]
    )]
    FollowerRange {
        joint: String,
        leader: String,
        /// The positions to which it follows.
        reached: [f64; 2],
    },
    /// A joint that turns without end.
    #[error("joint \"{joint}\": is continuous; its range is {from}, [{:.4}, {:.4}] rad", limits[0], limits[1])]
    Continuous {
        joint: String,
        /// Where the range comes from.
        from: &'static str,
        limits: [f64; 2],
    },
    /// A shape without size.
    #[error("collider \"{collider}\": all its sizes are 0; it is left out")]
    Point { collider: String },
    /// A link that is no part of an arm.
    #[error(
        "link \"{link}\": joint \"{joint}\" carries it beyond the flange or beside the arm; it is left out, with what it carries"
    )]
    LeftOut { link: String, joint: String },
    /// A fixed joint that follows another one.
    #[error("joint \"{joint}\": is fixed; its <mimic> is ignored")]
    FixedFollower { joint: String },
    /// A floating or planar joint before the palm.
    #[error(
        "joint \"{joint}\": is {found}, and only it leaves the root; it is taken as fixed, since the whole hand moves freely"
    )]
    FreeBase {
        joint: String,
        /// Its type.
        found: String,
    },
    /// An element that occurs more often than once.
    #[error("{item} \"{name}\": has several <{element}>; the first is used")]
    Twice {
        /// Link or joint.
        item: &'static str,
        name: String,
        element: &'static str,
    },
    /// Only shapes for display.
    #[error("no link has a <collision>; the <visual> shapes are the collision shapes")]
    Visuals,
}
