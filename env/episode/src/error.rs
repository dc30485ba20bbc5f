//! Errors of scenes, trials and batches; each variant is a sentence about the input.

use graspbox_mesh::OutOfRange;

/// An error of a scene, a trial or a batch.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EpisodeError {
    /// The simulation refused an object, a setting or a command.
    #[error("object `{object}`: {source}")]
    Sim { object: String, source: graspbox_sim::SimError },
    /// The mesh cannot be used.
    #[error("object `{object}`: {source}")]
    Mesh { object: String, source: graspbox_mesh::MeshError },
    /// The planner refused a mesh, a pose or a setting.
    #[error("object `{object}`: {source}")]
    Plan { object: String, source: graspbox_plan::PlanError },
    /// The hand's kinematics are not defined at its open configuration.
    #[error("hand `{hand}`: {source}")]
    Hand { hand: String, source: graspbox_hand::HandError },
    /// A setting is out of range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// A preshape beyond the hand's limits.
    #[error(
        "preshape[{index}] is {value} {unit}, but the hand's range is {low} to {high} {unit}{}",
        in_degrees(*.value, *.low, *.high, .unit)
    )]
    BadPreshape {
        /// Index in the list of poses.
        index: usize,
        value: f64,
        low: f64,
        high: f64,
        /// Unit of a preshape of this hand.
        unit: &'static str,
    },
    /// A pose that is not finite, or far from the object.
    #[error("poses[{index}] is {distance} m from the object's origin; give finite poses in metres, within {limit} m")]
    BadPose {
        /// Index in the list of poses.
        index: usize,
        /// Distance of the hand frame from the object's origin, metres.
        distance: f64,
        /// Greatest distance, metres.
        limit: f64,
    },
    /// An object that is too large or too small for table and hand.
    #[error(
        "object `{object}` measures {} m, but {why}; {}",
        sides(.size), likely_scale(.size)
    )]
    BadSize {
        object: String,
        /// Sides of its bounds, metres.
        size: [f64; 3],
        /// The bound that it exceeds.
        why: String,
    },
    /// A mass out of range for table and hand.
    #[error("object `{object}` weighs {} kg, but {why}; give `mass=` in kilograms", digits(*.mass))]
    BadMass {
        object: String,
        mass: f64,
        /// The bound that it exceeds.
        why: String,
    },
    /// The object does not come to rest on the table.
    #[error("object `{object}` does not come to rest on the table: {why}; give another world_from_object")]
    NoRest { object: String, why: &'static str },
    /// The batch was cancelled.
    #[error("stopped after {done} of {total}")]
    Cancelled {
        /// Number of finished trials or steps.
        done: usize,
        /// Number of requested trials or steps.
        total: usize,
    },
}

impl EpisodeError {
    /// Name of the object that cannot be used, if another one might.
    pub fn object(&self) -> Option<&str> {
        match self {
            // An invalid physics setting concerns every object.
            Self::Sim { source: graspbox_sim::SimError::OutOfRange(_), .. } => None,
            Self::Sim { object, .. }
            | Self::Mesh { object, .. }
            | Self::Plan { object, .. }
            | Self::BadSize { object, .. }
            | Self::BadMass { object, .. }
            | Self::NoRest { object, .. } => Some(object),
            _ => None,
        }
    }
}

/// Advice for an angle that is probably in degrees.
fn in_degrees(value: f64, low: f64, high: f64, unit: &str) -> String {
    /// Smaller values may be radians.
    const CLEAR: f64 = 2.0;
    let radians = value.to_radians();
    // 90 degrees exceed a limit of pi/2 that is written with few digits.
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

/// Advice on the scale, from the probable unit of the file.
fn likely_scale(size: &[f64; 3]) -> String {
    /// Usual range of the longest side of graspable objects, metres.
    const USUAL: [f64; 2] = [0.03, 0.5];
    /// Factors and their meanings, the most probable first.
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
        None => "give a `scale=` that brings it to the size of a hand".to_owned(),
    }
}
