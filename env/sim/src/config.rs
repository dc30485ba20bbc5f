//! Physics settings, and the friction of table and object. The defaults pass the hold and label checks in `tests/` as a set: after a change to one
//! of them, run all of these checks.

use crate::SimError;
use graspbox_mesh::in_range;
pub use graspbox_solver::ImplicitConfig;
use serde::{Deserialize, Serialize};

/// Friction factors of table and object; those of the hand are in its description ([`graspbox_hand::Friction`]). The coefficient of a pair is the
/// product of its two factors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Friction {
    /// Table top and ground.
    pub table: f64,
    /// The object. At 1 the coefficient equals the factor of the other surface; other values scale friction against hand and table alike.
    pub object: f64,
}

impl Default for Friction {
    fn default() -> Self {
        Self { table: 0.5, object: 1.0 }
    }
}

/// The physics engine of a world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EngineKind {
    /// `implicit`: f64, all contacts of a step solved together by Newton's method.
    #[default]
    Implicit,
    /// `rapier`: f32, contacts solved in sub-steps of projected Gauss-Seidel.
    Rapier,
}

/// Settings of the engine `rapier`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RapierConfig {
    /// Distance at which contacts are predicted, metres.
    pub prediction: f64,
    /// The contacts of a pair are searched again once it has moved by this since the last search, metres; 0 searches at every step.
    pub contact_drift: f64,
    /// Solver sub-steps per step. The duration of a sub-step, `dt / solver_iterations`, decides whether a hold is firm: 0.5 ms is robust, 1 ms
    /// suffices.
    pub solver_iterations: usize,
    /// Sub-steps while the hand does not move and touches nothing and the object does not tumble: at most an object on the table is left.
    pub idle_iterations: usize,
    /// Natural frequency of contacts, Hz. With rapier's default (30 Hz) fingers penetrate by millimetres.
    pub contact_frequency: f64,
    pub contact_damping_ratio: f64,
    /// Natural frequency of contacts with the hand's base and the table, Hz.
    pub static_contact_frequency: f64,
    /// Penetration that is not corrected, metres.
    pub allowed_penetration: f64,
}

impl Default for RapierConfig {
    fn default() -> Self {
        Self {
            prediction: 0.002,
            contact_drift: 5e-5,
            solver_iterations: 4,
            idle_iterations: 1,
            contact_frequency: 240.0,
            contact_damping_ratio: 2.0,
            static_contact_frequency: 480.0,
            allowed_penetration: 0.0005,
        }
    }
}

/// Physics settings: common ones, and those of each engine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PhysicsConfig {
    pub engine: EngineKind,
    /// Time step, seconds.
    pub dt: f64,
    /// Gravity, m/s2, along -z of the world.
    pub gravity: f64,
    /// Friction factors of table and object.
    pub friction: Friction,
    /// Settings of the engine `implicit`; other engines ignore them.
    pub implicit: ImplicitConfig,
    /// Settings of the engine `rapier`; other engines ignore them.
    pub rapier: RapierConfig,
}

impl Default for PhysicsConfig {
    fn default() -> Self {
        Self {
            engine: EngineKind::default(),
            dt: 0.002,
            gravity: 9.81,
            friction: Friction::default(),
            implicit: ImplicitConfig::default(),
            rapier: RapierConfig::default(),
        }
    }
}

impl PhysicsConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`SimError::OutOfRange`], naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), SimError> {
        let (f, n, r) = (&self.friction, &self.implicit, &self.rapier);
        in_range("dt", self.dt, 1e-5..=0.02, "s")?;
        in_range("gravity", self.gravity, 0.0..=100.0, "m/s2")?;
        in_range("friction.table", f.table, 0.0..=5.0, "")?;
        in_range("friction.object", f.object, 0.0..=5.0, "")?;
        in_range("implicit.prediction", n.prediction, 1e-4..=0.05, "m")?;
        in_range("implicit.contact_drift", n.contact_drift, 0.0..=1e-3, "m")?;
        in_range("implicit.contact_stiffness", n.contact_stiffness, 1e3..=1e7, "N/m")?;
        in_range("implicit.contact_relaxation", n.contact_relaxation, 0.0..=0.1, "s")?;
        in_range("implicit.support_stiffness", n.support_stiffness, 0.0..=1e7, "N/(m kg)")?;
        in_range("implicit.penetration_cap", n.penetration_cap, 1e-5..=0.01, "m")?;
        in_range("implicit.stick_speed", n.stick_speed, 1e-7..=0.01, "m/s")?;
        in_range("implicit.tolerance", n.tolerance, 1e-12..=1e-3, "m/s")?;
        in_range("implicit.max_iterations", n.max_iterations as f64, 1.0..=1000.0, "")?;
        in_range("rapier.prediction", r.prediction, 1e-4..=0.05, "m")?;
        in_range("rapier.contact_drift", r.contact_drift, 0.0..=1e-3, "m")?;
        in_range("rapier.solver_iterations", r.solver_iterations as f64, 1.0..=64.0, "")?;
        in_range("rapier.idle_iterations", r.idle_iterations as f64, 1.0..=64.0, "")?;
        in_range("rapier.contact_frequency", r.contact_frequency, 1.0..=1e4, "Hz")?;
        in_range("rapier.contact_damping_ratio", r.contact_damping_ratio, 0.01..=100.0, "")?;
        in_range("rapier.static_contact_frequency", r.static_contact_frequency, 1.0..=1e4, "Hz")?;
        in_range("rapier.allowed_penetration", r.allowed_penetration, 0.0..=0.005, "m")?;
        Ok(())
    }
}
