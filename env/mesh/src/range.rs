//! Range checks of settings and restored states, for every crate: the error names the field and its value, and prints the range from its bounds.

use nalgebra::Isometry3;
use std::fmt;
use std::ops::{Bound, RangeBounds};

/// A value outside its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("`{field}` is {}, but it must be {expected}", Number(*.value))]
pub struct OutOfRange {
    pub field: &'static str,
    /// The value passed.
    pub value: f64,
    /// The accepted values, with their unit.
    pub expected: String,
}

/// Refuses a value outside its range; NaN is in no range.
///
/// * `unit`: unit of value and range; empty for a number without one.
///
/// # Errors
/// [`OutOfRange`].
///
/// ```
/// use graspbox_mesh::range::in_range;
///
/// assert!(in_range("dt", 0.002, 1e-5..=0.02, "s").is_ok());
/// let error = in_range("dt", 2.0, 1e-5..=0.02, "s").unwrap_err();
/// assert_eq!(error.to_string(), "`dt` is 2, but it must be between 1e-5 and 0.02 s");
/// ```
pub fn in_range(
    field: &'static str,
    value: f64,
    range: impl RangeBounds<f64>,
    unit: &'static str,
) -> Result<(), OutOfRange> {
    if range.contains(&value) { Ok(()) } else { Err(out_of_range(field, value, &range, unit)) }
}

/// Refuses numbers that are farther from 0 than `limit`, or none.
///
/// # Errors
/// [`OutOfRange`] with the first of them.
pub fn all_within(
    field: &'static str,
    numbers: impl IntoIterator<Item = f64>,
    limit: f64,
    unit: &'static str,
) -> Result<(), OutOfRange> {
    numbers.into_iter().try_for_each(|x| in_range(field, x, -limit..=limit, unit))
}

/// Refuses a pose farther from the origin than `limit` metres, or whose quaternion does not have the length 1.
///
/// # Errors
/// [`OutOfRange`].
pub fn is_pose(field: &'static str, pose: &Isometry3<f64>, limit: f64) -> Result<(), OutOfRange> {
    /// Error of many products of rotations.
    const ROUNDING: f64 = 1e-6;
    all_within(field, pose.translation.vector.iter().copied(), limit, "m")?;
    let value = pose.rotation.coords.norm();
    if (value - 1.0).abs() <= ROUNDING {
        return Ok(());
    }
    Err(OutOfRange { field, value, expected: "1, the length of a unit quaternion".to_owned() })
}

#[cold]
fn out_of_range(field: &'static str, value: f64, range: &impl RangeBounds<f64>, unit: &str) -> OutOfRange {
    let mut expected = words(range);
    if !unit.is_empty() {
        expected = format!("{expected} {unit}");
    }
    OutOfRange { field, value, expected }
}

/// The range in words.
fn words(range: &impl RangeBounds<f64>) -> String {
    let low = match range.start_bound() {
        Bound::Included(low) => Some(format!("at least {}", Number(*low))),
        Bound::Excluded(low) => Some(format!("greater than {}", Number(*low))),
        Bound::Unbounded => None,
    };
    let high = match range.end_bound() {
        Bound::Included(high) => Some(format!("at most {}", Number(*high))),
        Bound::Excluded(high) if *high == f64::INFINITY => Some("finite".to_owned()),
        Bound::Excluded(high) => Some(format!("less than {}", Number(*high))),
        Bound::Unbounded => None,
    };
    match (range.start_bound(), range.end_bound()) {
        (Bound::Included(low), Bound::Included(high)) if low == high => Number(*low).to_string(),
        (Bound::Included(low), Bound::Included(high)) => format!("between {} and {}", Number(*low), Number(*high)),
        _ => low.into_iter().chain(high).collect::<Vec<_>>().join(" and "),
    }
}

/// A number, in exponential form unless it is 0 or from 1e-4 to 1e10.
struct Number(f64);

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(x) = self;
        if *x == 0.0 || (1e-4..1e10).contains(&x.abs()) { write!(f, "{x}") } else { write!(f, "{x:e}") }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::{Bound, Isometry3, RangeBounds, all_within, in_range, is_pose};

    fn message(value: f64, range: impl RangeBounds<f64>) -> String {
        in_range("x", value, range, "m").map_or_else(|error| error.to_string(), |()| "fine".to_owned())
    }

    /// Every kind of range in words, its own ends, and values that are no numbers.
    #[test]
    fn ranges_are_written_by_their_bounds() {
        let above = (Bound::Excluded(0.0), Bound::Included(1.0));
        for (range, value, text) in [
            (message(0.0, above), "0", "greater than 0 and at most 1 m"),
            (message(2e-20, 1.0..=2.0), "2e-20", "between 1 and 2 m"),
            (message(2.0, 1.0..2.0), "2", "at least 1 and less than 2 m"),
            (message(1e300, 4.0..=4.0), "1e300", "4 m"),
            (message(f64::INFINITY, 0.0..f64::INFINITY), "inf", "at least 0 and finite m"),
            (message(f64::NAN, 1e-5..), "NaN", "at least 1e-5 m"),
            (message(4_294_967_296.0, ..=65_536.0), "4294967296", "at most 65536 m"),
        ] {
            assert_eq!(range, format!("`x` is {value}, but it must be {text}"));
        }
        let far = all_within("x", [1.0, -2.0, f64::NAN], 1.5, "m").unwrap_err();
        assert_eq!(far.to_string(), "`x` is -2, but it must be between -1.5 and 1.5 m");
        let stretched = Isometry3 {
            rotation: nalgebra::UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(0.0, 0.0, 0.0, 3.0)),
            ..Isometry3::translation(1.0, 2.0, 3.0)
        };
        let refused = is_pose("x", &stretched, 3.0).unwrap_err();
        assert_eq!(refused.to_string(), "`x` is 3, but it must be 1, the length of a unit quaternion");
        assert!(is_pose("x", &Isometry3::translation(1.0, 2.0, 3.0), 3.0).is_ok());
        assert!(is_pose("x", &Isometry3::translation(1.0, 2.0, 3.0), 2.0).is_err());
        assert_eq!([message(1.0, above), message(0.0, 0.0..=0.0), message(1e300, 0.0..f64::INFINITY)], ["fine"; 3]);
    }
}
