//! The tables of `hand.toml`: every number with unit and source.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde::de::DeserializeOwned;
use toml::Spanned;

use crate::error::{ProblemKind, Report};
use crate::grasp::QuarterTurn;

/// A number (or a list of them), its unit, and where it comes from.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table { value = ..., unit = \"...\", source = \"...\" }")]
pub(crate) struct Quantity<T> {
    value: T,
    unit: String,
    source: String,
}

/// A quantity with its position in the file.
pub(crate) type Number<T> = Spanned<Quantity<T>>;

/// Tables by name; the name keeps its position in the file.
pub(crate) type Named<T> = BTreeMap<Spanned<String>, T>;

/// Declares tables of the file; unknown fields are errors.
macro_rules! tables {
    ($($table:item)*) => { $(#[derive(Debug, Clone, Deserialize)] #[serde(deny_unknown_fields)] $table)* };
}

tables! {
    /// The whole file.
    pub(crate) struct HandTable {
        pub name: Spanned<String>,
        #[serde(default)]
        pub pads: Vec<Spanned<String>>,
        /// Lists of links or shapes that do not touch each other.
        #[serde(default)]
        pub no_contact: Vec<Spanned<Vec<Spanned<String>>>>,
        pub friction: FrictionTable,
        #[serde(default)]
        pub joints: Named<JointTable>,
        #[serde(default)]
        pub tendons: Named<TendonTable>,
        pub actuators: Vec<ActuatorTable>,
        pub grasp: GraspTable,
        pub mount: Option<MountTable>,
        #[serde(default)]
        pub sensors: Vec<SensorTable>,
    }

    /// A mounting frame: that of a hand in its base's frame, or on an arm in the flange's.
    pub(crate) struct MountTable {
        pub xyz: Number<[f64; 3]>,
        pub rpy: Number<[f64; 3]>,
    }

    pub(crate) struct FrictionTable {
        pub pad: Number<f64>,
        pub bare: Number<f64>,
    }

    /// Joints with the same numbers; without `names`, the joint of the table's own name.
    pub(crate) struct JointTable {
        pub names: Option<Vec<Spanned<String>>>,
        #[serde(default)]
        pub encoder: bool,
        pub stiffness: Option<Number<f64>>,
        pub spring_reference: Option<Number<f64>>,
        pub damping: Number<f64>,
        pub armature: Number<f64>,
        pub stop_stiffness: Number<f64>,
    }

    pub(crate) struct TendonTable {
        /// Moment arms, by the name of the joint.
        pub arms: Named<Number<f64>>,
        pub stiffness: Number<f64>,
        pub damping: Number<f64>,
        pub max_tension: Number<f64>,
    }

    pub(crate) struct ActuatorTable {
        pub name: Spanned<String>,
        pub spool: Option<SpoolTable>,
        pub rigid: Option<RigidTable>,
        pub servo: Option<ServoTable>,
        pub travel: Number<[f64; 2]>,
        pub default_speed: Number<f64>,
        pub max_speed: Number<f64>,
        pub ratio: Number<f64>,
        pub load_limit: Number<f64>,
        pub force_gain: Number<f64>,
    }

    /// Winds a tendon.
    pub(crate) struct SpoolTable {
        pub tendon: Spanned<String>,
        pub radius: Number<f64>,
    }

    /// Drives joints by a self-locking gear.
    pub(crate) struct RigidTable {
        pub joints: Named<DrivenTable>,
    }

    /// Drives joints by a spring and a damper of limited force.
    pub(crate) struct ServoTable {
        pub joints: Named<DrivenTable>,
        pub stiffness: Number<f64>,
        pub damping: Number<f64>,
    }

    pub(crate) struct DrivenTable {
        pub ratio: Number<f64>,
        pub offset: Option<Number<f64>>,
    }

    /// The grasp frame in the base's frame, and how the hand grasps.
    pub(crate) struct GraspTable {
        pub xyz: Number<[f64; 3]>,
        pub rpy: Number<[f64; 3]>,
        pub center: Number<[f64; 3]>,
        /// Names of the actuators that close the hand.
        pub closing: Vec<Spanned<String>>,
        /// Where an object may lie along hand x, from the centre.
        pub closing_range: Option<Number<[f64; 2]>>,
        /// The same along hand y.
        pub side_range: Option<Number<[f64; 2]>>,
        /// Greatest turn about hand z that is tried.
        pub max_roll: Option<Number<f64>>,
        /// Greatest turn about hand x that is tried.
        pub max_lean: Option<Number<f64>>,
        pub coordinate: Option<CoordinateTable>,
        #[serde(default)]
        pub preshapes: Vec<PreshapeTable>,
        /// Weights of the planner's ranking, by the name of the term.
        #[serde(default)]
        pub ranking: Named<Number<f64>>,
    }

    /// The actuator whose position is the preshape.
    pub(crate) struct CoordinateTable {
        pub actuator: Spanned<String>,
        pub limits: Number<[f64; 2]>,
    }

    pub(crate) struct PreshapeTable {
        pub name: Spanned<String>,
        /// Positions of actuators, by name.
        #[serde(default)]
        pub positions: Named<Number<f64>>,
        pub length: Option<Number<[f64; 2]>>,
        pub width: Option<Number<[f64; 2]>>,
        pub max_ratio: Option<Number<f64>>,
        pub any_ratio_below: Option<Number<f64>>,
        #[serde(default)]
        pub quarter: QuarterTurn,
        pub preference: Option<Number<f64>>,
    }

    pub(crate) struct SensorTable {
        pub links: Vec<Spanned<String>>,
        pub position: Number<[f64; 3]>,
        pub normal: Number<[f64; 3]>,
    }
}

/// Checks of the numbers of a quantity.
pub(crate) trait Numbers: Copy {
    /// True when every number is finite and no larger than `limit`.
    fn within(&self, limit: f64) -> bool;
}

impl Numbers for f64 {
    fn within(&self, limit: f64) -> bool {
        self.abs() <= limit
    }
}

impl<const N: usize> Numbers for [f64; N] {
    fn within(&self, limit: f64) -> bool {
        self.iter().all(|x| x.abs() <= limit)
    }
}

/// Largest number of any kind in `hand.toml`; the largest real one is a tendon's stiffness (5e4 N/m).
const MAX_NUMBER: f64 = 1e7;

/// Hint for a missing field; the reader stops at the first one.
const MISSING: &str = " in the table that begins here; docs/reference/hands.md lists the fields of every table";

/// A `hand.toml` and its problems.
pub(crate) struct Reader<'a, 'r> {
    text: &'a str,
    /// Problems so far.
    pub report: &'r mut Report<'a>,
}

impl<'a, 'r> Reader<'a, 'r> {
    /// Starts reading a text.
    pub fn new(text: &'a str, report: &'r mut Report<'a>) -> Self {
        Self { text, report }
    }

    /// The tables, or a problem at the line of the first syntax error.
    pub fn parse<T: DeserializeOwned>(&mut self) -> Option<T> {
        match toml::from_str(self.text) {
            Ok(table) => Some(table),
            Err(error) => {
                let line = self.line(error.span().map_or(0, |s| s.start));
                let said = error.message();
                let hint = if said.starts_with("missing field") { MISSING } else { "" };
                self.report.add(line, ProblemKind::Toml(format!("{said}{hint}")));
                None
            }
        }
    }

    /// Line of a byte of the text, from 1.
    fn line(&self, byte: usize) -> usize {
        let end = byte.min(self.text.len());
        1 + self.text.as_bytes()[..end].iter().filter(|b| **b == b'\n').count()
    }

    /// Line of a value.
    pub fn line_of<T>(&self, spanned: &Spanned<T>) -> usize {
        self.line(spanned.span().start)
    }

    /// Records a problem at a value.
    pub fn add<T>(&mut self, at: &Spanned<T>, kind: ProblemKind) {
        let line = self.line_of(at);
        self.report.add(line, kind);
    }

    /// The value of a quantity, after a check of its unit, source and size.
    pub fn value<T: Numbers>(&mut self, quantity: Literal, number: &Number<T>, unit: Literal) -> T {
        let Quantity { value, unit: found, source } = number.get_ref();
        if found != unit {
            self.add(number, ProblemKind::Unit { quantity, found: found.clone(), expected: unit });
        }
        if source.trim().is_empty() {
            self.add(number, ProblemKind::NoSource(quantity));
        }
        if !value.within(MAX_NUMBER) {
            self.add(number, ProblemKind::TooBig { quantity, limit: MAX_NUMBER });
        }
        *value
    }

    /// A number that must be greater than 0.
    pub fn positive(&mut self, item: Item<'_>, quantity: Literal, number: &Number<f64>, unit: Literal) -> f64 {
        self.at_least(item, quantity, number, unit, f64::MIN_POSITIVE, "greater than 0")
    }

    /// A number that must not be negative.
    pub fn not_negative(&mut self, item: Item<'_>, quantity: Literal, number: &Number<f64>, unit: Literal) -> f64 {
        self.at_least(item, quantity, number, unit, 0.0, "0 or greater")
    }

    fn at_least(
        &mut self,
        item: Item<'_>,
        quantity: Literal,
        number: &Number<f64>,
        unit: Literal,
        least: f64,
        must: Literal,
    ) -> f64 {
        let value = self.value(quantity, number, unit);
        if value < least {
            let kind = ProblemKind::Value { item: item.0, name: item.1.to_owned(), quantity, value, must };
            self.add(number, kind);
        }
        value
    }

    /// An interval whose upper end must be the greater one.
    pub fn interval(
        &mut self,
        item: Item<'_>,
        quantity: Literal,
        number: &Number<[f64; 2]>,
        unit: Literal,
    ) -> [f64; 2] {
        let [lower, upper] = self.value(quantity, number, unit);
        if lower >= upper {
            let must = "the upper end must be greater";
            let name = item.1.to_owned();
            self.add(number, ProblemKind::Interval { item: item.0, name, quantity, lower, upper, must });
        }
        [lower, upper]
    }
}

/// Owner of a number: kind and name.
pub(crate) type Item<'a> = (Literal, &'a str);

/// A name or a unit from the code, not from the file.
type Literal = &'static str;
