//! Errors in the two files of a hand; each names its file and line.

use std::fmt;
use std::path::PathBuf;

use crate::urdf::assumption::{Assumption, AssumptionKind};

/// Why a hand could not be loaded or used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HandError {
    /// A file could not be opened or read.
    #[error("cannot read {path}: {source}")]
    Io {
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// The two files do not describe a hand.
    #[error("the hand is not valid:\n{0}")]
    Invalid(Problems),
    /// The two files do not describe an arm.
    #[error("the arm is not valid:\n{0}")]
    InvalidArm(Problems),
    /// No arm of that name comes with the project.
    #[error("there is no arm \"{name}\"; known: {known}; for another arm give the paths of its URDF and its arm.toml")]
    UnknownArm {
        name: String,
        /// Those that exist.
        known: String,
    },
    /// No hand of that name comes with the project.
    #[error(
        "there is no hand \"{name}\"; known: {known}; for another hand give the paths of its URDF and its hand.toml"
    )]
    UnknownName {
        name: String,
        /// Those that exist.
        known: String,
    },
    /// A configuration does not fit the hand.
    #[error(
        "the configuration has {found} positions, but the hand has {expected} independent joints; give one position each"
    )]
    CoordinateCount {
        /// Number of positions passed.
        found: usize,
        /// Number of independent joints.
        expected: usize,
    },
    /// A time step that is not positive.
    #[error("the time step is {0} s; give a finite one greater than 0")]
    TimeStep(f64),
    /// A position, command or load is NaN or infinite.
    #[error("the {what} is {value}; give a finite number")]
    NotFinite { what: &'static str, value: f64 },
}

/// Collects the problems of one file, and what is assumed about it.
#[derive(Default)]
pub(crate) struct Report<'a> {
    pub file: &'a str,
    /// Problems so far.
    pub problems: Vec<Problem>,
    /// Assumptions so far.
    pub assumptions: Vec<Assumption>,
}

impl<'a> Report<'a> {
    /// An empty report about a file.
    pub fn new(file: &'a str) -> Self {
        Self { file, ..Self::default() }
    }

    /// Records a problem at a line.
    pub fn add(&mut self, line: usize, kind: ProblemKind) {
        self.problems.push(Problem { file: self.file.to_owned(), line, kind });
    }

    /// Records an assumption at a line.
    pub fn assume(&mut self, line: usize, kind: AssumptionKind) {
        self.assumptions.push(Assumption { file: self.file.to_owned(), line, kind });
    }
}

/// Every problem, in the order of the files' lines; never empty.
#[derive(Clone, Debug, PartialEq)]
pub struct Problems(pub Vec<Problem>);

/// One problem at one place.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// Name of the file, as passed.
    pub file: String,
    /// Line in it, from 1.
    pub line: usize,
    pub kind: ProblemKind,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.file, self.line, self.kind)
    }
}

impl fmt::Display for Problems {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.0.iter().enumerate() {
            let separator = if i == 0 { "" } else { "\n" };
            write!(f, "{separator}{problem}")?;
        }
        Ok(())
    }
}

/// A problem, as a sentence about the input.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ProblemKind {
    /// The file is larger than a description may be.
    #[error("the file has {bytes} bytes; a description has at most {limit}")]
    TooLarge {
        /// Size of the file.
        bytes: u64,
        /// Largest size accepted.
        limit: u64,
    },
    /// The bytes are not UTF-8.
    #[error("the file is not UTF-8 text")]
    NotText,
    /// The TOML reader refused the text.
    #[error("{0}")]
    Toml(String),
    /// The XML reader refused the text.
    #[error("{0}")]
    Xml(String),
    /// A file of another format.
    #[error("{what}; {remedy}")]
    OtherFormat {
        /// What the file is.
        what: String,
        /// What reads it.
        remedy: &'static str,
    },
    /// A document type declaration.
    #[error("a document type declaration is not allowed; remove it")]
    Doctype,
    /// Elements nested too deeply.
    #[error("elements are nested deeper than {0}")]
    TooDeep(usize),
    /// More parts than a hand may have.
    #[error("there are {count} {what}; at most {limit} are allowed")]
    TooMany {
        /// Kind of part.
        what: &'static str,
        count: usize,
        /// Largest number allowed.
        limit: usize,
    },
    /// A list that needs more names.
    #[error("a list of `no_contact` has {0} name(s); give at least two, which do not touch each other")]
    TooFewApart(usize),
    /// Fewer parts than a hand needs.
    #[error("there are no {0}; at least one is needed")]
    Empty(&'static str),
    /// An attribute is not a list of the expected number of numbers.
    #[error("attribute {attribute} is \"{text}\"; give {count} finite number(s) within +-{limit}")]
    Attribute {
        attribute: String,
        text: String,
        /// Expected number of numbers.
        count: usize,
        /// Bound on each.
        limit: f64,
    },
    /// A required element or attribute is missing.
    #[error("{item} \"{name}\" has no {missing}")]
    Missing {
        /// Link or joint.
        item: &'static str,
        name: String,
        missing: &'static str,
    },
    /// A preshape of a hand with a preshape coordinate has positions of other actuators too.
    #[error(
        "preshape \"{preshape}\" has positions of several actuators; with `[grasp.coordinate]` a preshape has only that \
         of \"{coordinate}\""
    )]
    OtherActuators {
        preshape: String,
        /// The actuator of the coordinate.
        coordinate: String,
    },
    /// A duplicate name.
    #[error("the {what} name \"{name}\" is used twice; names must be unique")]
    Duplicate { what: &'static str, name: String },
    /// An unknown name.
    #[error("there is no {what} \"{name}\"{}", hint(known))]
    Unknown {
        /// Kind of the named item.
        what: &'static str,
        name: String,
        /// The names that exist.
        known: Vec<String>,
    },
    /// Two joints move the same link.
    #[error("link \"{0}\" is the child of more than one joint")]
    TwoParents(String),
    /// The links do not form a single tree.
    #[error("link \"{0}\" cannot be reached from the base: the joints form a cycle or a second tree")]
    Unreachable(String),
    /// Every link has a parent.
    #[error("no link is a root: the joints form a cycle")]
    NoRoot,
    /// An unsupported joint type.
    #[error("joint \"{name}\" is {found}; {remedy}")]
    JointType {
        name: String,
        found: String,
        /// What to use instead.
        remedy: &'static str,
    },
    /// A joint that is fixed, or follows another one, where an independent one is needed.
    #[error("joint \"{name}\" {is}; name an independent joint instead")]
    NotIndependent { name: String, is: String },
    /// A joint that nothing holds.
    #[error(
        "joint \"{0}\" moves, but no tendon, actuator or spring holds it; make it fixed, or name it in [joints], [tendons] or \
         [[actuators]]"
    )]
    Undriven(String),
    /// A name that occurs more often than allowed.
    #[error("{what} \"{name}\" is named more than once by {by}")]
    UsedTwice {
        what: &'static str,
        name: String,
        /// The item that names it.
        by: &'static str,
    },
    /// A joint that is driven rigidly, and has a spring or a tendon that could not move it.
    #[error(
        "joint \"{name}\" is driven rigidly by actuator \"{actuator}\", so {what} has no effect on it; leave it out"
    )]
    Rigid {
        name: String,
        actuator: String,
        /// The setting without effect.
        what: &'static str,
    },
    /// Joints of several kinds where one kind is needed.
    #[error("{item} \"{name}\" names revolute and prismatic joints; give each kind a table of its own")]
    MixedKinds {
        /// The item that names them.
        item: &'static str,
        name: String,
    },
    /// A joint that follows one that it cannot follow.
    #[error("joint \"{name}\" mimics \"{leader}\", which {why}")]
    BadMimic {
        name: String,
        /// The joint that it names.
        leader: String,
        /// Reason.
        why: &'static str,
    },
    /// Not exactly one of several tables.
    #[error("{item} \"{name}\" has {count} of {tables}; give exactly one of them")]
    OneOf {
        item: &'static str,
        name: String,
        /// Number of these tables.
        count: usize,
        tables: &'static str,
    },
    /// A tendon with not exactly one spool.
    #[error("tendon \"{name}\" is wound by {count} actuators; it needs exactly one")]
    SpoolCount {
        name: String,
        /// Number of actuators that wind it.
        count: usize,
    },
    /// A flange that the base does not carry.
    #[error("link \"{flange}\" is not carried by \"{base}\"; base and flange must be on one chain of joints")]
    NotBeyond { flange: String, base: String },
    /// A joint of an arm that follows another one.
    #[error(
        "joint \"{name}\" is between base and flange and follows another joint; an arm's joints move independently"
    )]
    AxisFollows { name: String },
    /// A joint of an arm without a greatest speed.
    #[error("joint \"{name}\" has no velocity in its <limit>; state it there, or as `speed` in [limits.{name}]")]
    NoSpeed { name: String },
    /// A position at home that the joint cannot take.
    #[error("joint \"{name}\": home is {home}; it must be within its limits [{lower}, {upper}]")]
    HomeBeyond { name: String, home: f64, lower: f64, upper: f64 },
    /// A mass, inertia or length that is physically impossible.
    #[error("{item} \"{name}\": {quantity} is {value}; it must be {must}")]
    Value {
        /// Link, joint, ...
        item: &'static str,
        name: String,
        quantity: &'static str,
        value: f64,
        /// The required value.
        must: &'static str,
    },
    /// An interval with its ends swapped, or a value outside of it.
    #[error("{item} \"{name}\": {quantity} is [{lower}, {upper}]; {must}")]
    Interval {
        /// Joint, actuator, ...
        item: &'static str,
        name: String,
        /// Which interval.
        quantity: &'static str,
        lower: f64,
        upper: f64,
        /// The required value.
        must: &'static str,
    },
    /// A collision mesh.
    #[error(
        "collider \"{name}\" is the mesh \"{file}\"; replace it by boxes, cylinders and spheres: `graspbox.hands.fitted_urdf` does so"
    )]
    CollisionMesh { name: String, file: String },
    /// A unit other than that of the quantity.
    #[error("{quantity} is in \"{found}\"; give it in \"{expected}\"")]
    Unit {
        quantity: &'static str,
        /// The unit in the file.
        found: String,
        /// The unit that it must have.
        expected: &'static str,
    },
    /// A source left blank.
    #[error("{0} has an empty source; say where the number comes from")]
    NoSource(&'static str),
    /// A number that is not finite or far too large.
    #[error("{quantity} is not a finite number within +-{limit:e}")]
    TooBig {
        quantity: &'static str,
        /// Bound on it.
        limit: f64,
    },
}

/// Names to choose from, when there are few.
fn hint(known: &[String]) -> String {
    match known.len() {
        0 => String::new(),
        1..=12 => format!("; known: {}", known.join(", ")),
        n => format!("; {n} others are known"),
    }
}
