//! What can be wrong with a scene, a trial or a batch; each variant is a sentence about the input.

use graspbox_mesh::OutOfRange;

/// What can be wrong with a scene, a trial or a batch.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EpisodeError {
    /// The world could not be built.
    #[error("object `{object}`: {source}")]
    Sim {
        /// Name of the object.
        object: String,
        /// What the simulation said.
        source: graspbox_sim::SimError,
    },
    /// The mesh could not be used.
    #[error("object `{object}`: {source}")]
    Mesh {
        /// Name of the object.
        object: String,
        /// What the mesh code said.
        source: graspbox_mesh::MeshError,
    },
    /// The planner refused.
    #[error("object `{object}`: {source}")]
    Plan {
        /// Name of the object.
        object: String,
        /// What the planner said.
        source: graspbox_plan::PlanError,
    },
    /// The hand's kinematics refuse a configuration of its own.
    #[error("hand `{hand}`: {source}")]
    Hand {
        /// Name of the hand.
        hand: String,
        /// What the hand said.
        source: graspbox_hand::HandError,
    },
    /// A setting is out of its range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// A preshape that the hand cannot take.
    #[error(
        "preshape[{index}] is {value} {unit}, but the hand takes {low} to {high} {unit}{}",
        in_degrees(*.value, *.low, *.high, .unit)
    )]
    BadPreshape {
        /// Which of the poses.
        index: usize,
        /// What was given.
        value: f64,
        /// Least preshape.
        low: f64,
        /// Greatest preshape.
        high: f64,
        /// Unit of a preshape of this hand.
        unit: &'static str,
    },
    /// A pose that is no pose near the object.
    #[error(
        "poses[{index}] puts the hand {distance} m from the object's origin; give finite poses in metres, within {limit} m"
    )]
    BadPose {
        /// Which of the poses.
        index: usize,
        /// How far away it is, metres.
        distance: f64,
        /// What is accepted, metres.
        limit: f64,
    },
    /// An object that is too large, or too small, for table and hand.
    #[error(
        "object `{object}` is {} m large, but {why}; {}",
        sides(.size), likely_scale(.size)
    )]
    BadSize {
        /// Name of the object.
        object: String,
        /// Sides of its bounds, metres.
        size: [f64; 3],
        /// What it does not fit.
        why: String,
    },
    /// A mass that no object for a hand has.
    #[error("object `{object}` weighs {} kg, but {why}; give `mass=` in kilograms", digits(*.mass))]
    BadMass {
        /// Name of the object.
        object: String,
        /// Mass, kg.
        mass: f64,
        /// What is wrong with it.
        why: String,
    },
    /// The object does not come to rest on the table.
    #[error("object `{object}` does not come to rest on the table: {why}; choose another world_from_object")]
    NoRest {
        /// Name of the object.
        object: String,
        /// What happened instead.
        why: &'static str,
    },
    /// The batch was told to stop.
    #[error("stopped after {done} of {total}")]
    Cancelled {
        /// Trials, or steps, that were finished.
        done: usize,
        /// Those that were asked for.
        total: usize,
    },
}

/// What to say of an angle that looks like one in degrees.
fn in_degrees(value: f64, low: f64, high: f64, unit: &str) -> String {
    /// Fewer degrees than this could as well be radians.
    const CLEAR: f64 = 2.0;
    let radians = value.to_radians();
    // 90 degrees are a little more than a limit of pi/2 that was written with few digits.
    if unit == "rad" && value.abs() >= CLEAR && (low - 0.01..=high + 0.01).contains(&radians) {
        format!("; {value} looks like degrees: give {:.4} rad", radians.clamp(low, high))
    } else {
        String::new()
    }
}

fn sides(size: &[f64; 3]) -> String {
    let [x, y, z] = size.map(digits);
    format!("{x} x {y} x {z}")
}

/// `value` rounded to 4 significant digits.
fn digits(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// Which unit the file was probably in.
fn likely_scale(size: &[f64; 3]) -> String {
    /// Longest side of things that a hand grasps, metres.
    const USUAL: [f64; 2] = [0.03, 0.5];
    /// Factors, the likeliest first, and what they mean.
    const UNITS: [(f64, &str); 7] = [
        (0.001, "a file in millimetres that was read as metres"),
        (0.01, "a file in centimetres that was read as metres"),
        (0.0254, "a file in inches that was read as metres"),
        (1000.0, "a file in metres that was read as millimetres"),
        (100.0, "a file in metres that was read as centimetres"),
        (0.1, "a decimal place"),
        (10.0, "a decimal place"),
    ];
    let longest = size.iter().copied().fold(0.0, f64::max);
    let fits = |(factor, _): &&(f64, &str)| (USUAL[0]..=USUAL[1]).contains(&(longest * factor));
    match UNITS.iter().find(fits) {
        Some((factor, why)) => format!("multiply `scale=` by {factor} ({why})"),
        None => "give a `scale=` that makes it a thing that a hand can hold".to_owned(),
    }
}
