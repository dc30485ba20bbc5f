//! The shake at the end of a trial: the hand oscillates along each of its axes, then about each of them.
//!
//! On every axis the displacement is `A e(u) sin(2 pi u)` with `u` in cycles. The envelope `e` rises over `RAMP` cycles as
//! `sin^2(pi u / (2 RAMP))`, is 1 for [`ShakeConfig::cycles`], and falls over `RAMP` cycles. Position, velocity and acceleration are
//! continuous, and the hand is at its first pose when the next axis begins.

use crate::EpisodeError;
use graspbox_mesh::in_range;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Cycles over which the motion rises, and over which it falls. With two, the peak acceleration exceeds that at full amplitude by at most
/// 0.1 %; with one, by 5 %.
const RAMP: f64 = 2.0;
/// Number of axes: along x, y, z, then about them.
const AXES: f64 = 6.0;
/// Greatest amplitude as a share of the height to which the trial lifts: the hand stays clear of the table.
const STROKE_SHARE: f64 = 0.5;
/// Greatest angle, radians (29 degrees): an object that extends from the hand stays clear of the table.
const MAX_ANGLE: f64 = 0.5;
/// Least number of time steps per cycle: with fewer, finite differences miss the peaks of the acceleration.
const STEPS_PER_CYCLE: f64 = 20.0;

/// Settings of the shake: along and about the axes of the hand frame, one after the other. Rotations are about the grasp centre.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ShakeConfig {
    /// Amplitude of the acceleration along each axis, m/s2.
    pub acceleration: f64,
    /// Distance from the axis of rotation at which points have the same amplitude of acceleration, metres: that of the angular acceleration is
    /// `acceleration / lever`.
    pub lever: f64,
    /// Frequency, Hz.
    pub frequency: f64,
    /// Cycles at full amplitude on each axis; the motion rises over two cycles before them and falls over two after them.
    pub cycles: u32,
}

/// The default is 2 g (standard gravity, 9.80665 m/s2) with amplitudes of 20 mm and 0.2 rad: motion within the reach of a robot arm.
impl Default for ShakeConfig {
    fn default() -> Self {
        Self { acceleration: 2.0 * 9.80665, lever: 0.1, frequency: 5.0, cycles: 2 }
    }
}

impl ShakeConfig {
    /// Checks every setting.
    ///
    /// * `lift_height`: height of the hand above its grasp pose, metres.
    ///
    /// # Errors
    /// [`EpisodeError::OutOfRange`], naming the first setting that is out of range. The lower bounds of frequency and lever keep the hand clear
    /// of the table.
    pub fn validate(&self, lift_height: f64) -> Result<(), EpisodeError> {
        in_range("shake.acceleration", self.acceleration, 0.1..=100.0, "m/s2")?;
        let slowest = (self.acceleration / (STROKE_SHARE * lift_height)).sqrt() / TAU;
        in_range("shake.frequency", self.frequency, slowest..=50.0, "Hz")?;
        in_range("shake.lever", self.lever, self.stroke() / MAX_ANGLE..=1.0, "m")?;
        Ok(in_range("shake.cycles", f64::from(self.cycles), 1.0..=1000.0, "")?)
    }

    /// Checks that time steps of `dt` seconds resolve the motion.
    ///
    /// # Errors
    /// [`EpisodeError::OutOfRange`] for a frequency that is too high.
    pub fn check_time_step(&self, dt: f64) -> Result<(), EpisodeError> {
        Ok(in_range("shake.frequency", self.frequency, 0.0..=1.0 / (STEPS_PER_CYCLE * dt), "Hz")?)
    }

    /// Duration of all axes, seconds.
    pub fn time(&self) -> f64 {
        AXES * self.cycles_per_axis() / self.frequency
    }

    /// Amplitude of the displacement along an axis, metres.
    pub fn stroke(&self) -> f64 {
        self.acceleration / (TAU * self.frequency).powi(2)
    }

    /// Pose of the hand `time` seconds after the shake began, relative to the hand frame at its beginning.
    ///
    /// * `center`: the grasp centre, hand frame, metres.
    pub fn offset(&self, time: f64, center: &Point3<f64>) -> Isometry3<f64> {
        let (total, cycle) = (self.cycles_per_axis(), time.max(0.0) * self.frequency);
        let axis = (cycle / total).floor();
        if axis >= AXES {
            return Isometry3::identity();
        }
        let (axis, share) = (axis as usize, wave(cycle - axis * total, total));
        let along = Vector3::ith(axis % 3, self.stroke() * share);
        if axis < 3 {
            return Translation3::from(along).into();
        }
        let turn = UnitQuaternion::from_scaled_axis(along / self.lever);
        Isometry3::from_parts(Translation3::from(center.coords - turn * center.coords), turn)
    }

    fn cycles_per_axis(&self) -> f64 {
        f64::from(self.cycles) + 2.0 * RAMP
    }
}

/// Displacement after `u` of `total` cycles on an axis, as a share of the amplitude.
fn wave(u: f64, total: f64) -> f64 {
    let ramp = (u.min(total - u) / RAMP).clamp(0.0, 1.0);
    (FRAC_PI_2 * ramp).sin().powi(2) * (TAU * u).sin()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bug here: a jump of position or velocity, a peak acceleration other than the setting, a missing axis, a rotation about another point,
    /// or a hand that does not return.
    #[test]
    fn the_hand_moves_smoothly_and_as_hard_as_it_says() {
        let (shake, dt, center) = (ShakeConfig::default(), 1e-4, Point3::new(0.01, -0.02, 0.05));
        let steps = (shake.time() / dt).round() as usize;
        let path: Vec<_> = (0..=steps + 2).map(|i| shake.offset(i as f64 * dt, &center)).collect();
        // Six numbers per sample: the grasp centre, and the turn.
        let numbers = |pose: &Isometry3<f64>| {
            let moved = pose * center - center;
            let turn = pose.rotation.scaled_axis();
            [moved.x, moved.y, moved.z, turn.x, turn.y, turn.z]
        };
        let samples: Vec<_> = path.iter().map(numbers).collect();
        let (linear, angular) = (shake.acceleration, shake.acceleration / shake.lever);
        for (axis, limit) in [linear, linear, linear, angular, angular, angular].into_iter().enumerate() {
            let at = |i: usize| samples[i][axis];
            let accelerations: Vec<f64> =
                (1..=steps).map(|i| (at(i + 1) - 2.0 * at(i) + at(i - 1)) / (dt * dt)).collect();
            let most = accelerations.iter().copied().map(f64::abs).fold(0.0, f64::max);
            assert!((most / limit - 1.0).abs() < 2e-3, "axis {axis}: {most} of {limit}");
            let jump = accelerations.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
            assert!(jump < 0.01 * limit, "axis {axis}: the acceleration jumps by {jump}");
            let moving: Vec<usize> = (0..=steps).filter(|i| at(*i).abs() > 1e-9).collect();
            let share = steps / 6;
            assert!(
                moving[0] >= axis * share && moving[moving.len() - 1] <= (axis + 1) * share,
                "axis {axis} moves at {} to {}",
                moving[0],
                moving[moving.len() - 1]
            );
        }
        assert_eq!(shake.offset(shake.time() + 1e-9, &center), Isometry3::identity());
        assert!((shake.stroke() - 0.01987).abs() < 1e-5);
    }

    /// A bug here: settings out of range that are accepted, or errors that do not name them.
    #[test]
    fn settings_are_checked() {
        let fine = ShakeConfig::default();
        assert!(fine.validate(0.2).is_ok());
        let message = |shake: ShakeConfig, lift: f64| {
            shake.validate(lift).and_then(|()| shake.check_time_step(0.002)).err().map(|error| error.to_string())
        };
        let says = |shake: ShakeConfig, lift: f64, what: &str| {
            let message = message(shake, lift);
            assert!(message.as_deref().is_some_and(|text| text.starts_with(what)), "{message:?}, not {what}");
        };
        says(ShakeConfig { acceleration: 0.0, ..fine }, 0.2, "`shake.acceleration` is 0, but it must be between 0.1");
        says(ShakeConfig { frequency: 1.0, ..fine }, 0.2, "`shake.frequency` is 1, but it must be between 2.22");
        says(fine, 0.03, "`shake.frequency` is 5, but it must be between 5.75");
        says(ShakeConfig { frequency: 26.0, ..fine }, 0.2, "`shake.frequency` is 26, but it must be between 0 and 25");
        says(ShakeConfig { lever: 0.01, ..fine }, 0.2, "`shake.lever` is 0.01, but it must be between 0.039");
        says(ShakeConfig { cycles: 0, ..fine }, 0.2, "`shake.cycles` is 0, but it must be between 1 and 1000");
        says(ShakeConfig { frequency: f64::NAN, ..fine }, 0.2, "`shake.frequency` is NaN");
    }
}
