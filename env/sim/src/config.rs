//! Physics settings and the friction of table and object. Every default passes the hold and label checks in `tests/`; change them
//! together or not at all.

use crate::SimError;
use graspbox_mesh::in_range;
pub use graspbox_solver::SolverConfig;
use serde::{Deserialize, Serialize};

/// Friction factors of the surfaces that the hand meets; the hand's own are in its description ([`graspbox_hand::Friction`]).
/// The coefficient of a pair is the product of its two factors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Friction {
    /// Table top and ground.
    pub table: f64,
    /// The object: 1 leaves the other surface's factor as the coefficient; another value scales its grip in hand and on table alike.
    pub object: f64,
}

impl Default for Friction {
    fn default() -> Self {
        Self { table: 0.5, object: 1.0 }
    }
}

/// The physics engine that moves a world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EngineKind {
    /// Our own solver: f64, all contacts of a step together, by Newton's method.
    #[default]
    Graspbox,
    /// rapier: f32, contacts by sub-steps of projected Gauss-Seidel.
    Rapier,
}

/// Settings that rapier alone has.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RapierConfig {
    /// Distance at which contacts are predicted, metres.
    pub prediction: f64,
    /// A pair is searched for contacts again once it has moved by this since the last search, metres; 0 searches at every step.
    pub contact_drift: f64,
    /// Solver sub-steps per step. What matters for a firm hold is `dt / solver_iterations`: 0.5 ms is robust, 1 ms fine.
    pub solver_iterations: usize,
    /// The same while nothing in the hand moves, it is in contact with nothing and the object does not tumble: what remains then is
    /// an object on the table.
    pub idle_iterations: usize,
    /// Natural frequency of contacts, Hz. Stock values of the engine (30 Hz) let fingers sink in by millimetres.
    pub contact_frequency: f64,
    /// Damping ratio of contacts.
    pub contact_damping_ratio: f64,
    /// Natural frequency of contacts with the hand's root and the table, Hz.
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

/// Settings of the engine: those that every engine has, and those of each.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PhysicsConfig {
    /// The engine.
    pub engine: EngineKind,
    /// Time step, seconds.
    pub dt: f64,
    /// Gravity, m/s2, along -z of the world.
    pub gravity: f64,
    /// Friction factors of table and object.
    pub friction: Friction,
    /// Settings of our own solver; other engines ignore them.
    pub solver: SolverConfig,
    /// Settings of rapier; other engines ignore them.
    pub rapier: RapierConfig,
}

impl Default for PhysicsConfig {
    fn default() -> Self {
        Self {
            engine: EngineKind::default(),
            dt: 0.002,
            gravity: 9.81,
            friction: Friction::default(),
            solver: SolverConfig::default(),
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
        let (f, r) = (&self.friction, &self.rapier);
        in_range("dt", self.dt, 1e-5..=0.02, "s")?;
        in_range("gravity", self.gravity, 0.0..=100.0, "m/s2")?;
        in_range("friction.table", f.table, 0.0..=5.0, "")?;
        in_range("friction.object", f.object, 0.0..=5.0, "")?;
        let s = &self.solver;
        in_range("solver.prediction", s.prediction, 1e-4..=0.05, "m")?;
        in_range("solver.contact_drift", s.contact_drift, 0.0..=1e-3, "m")?;
        in_range("solver.contact_stiffness", s.contact_stiffness, 1e3..=1e7, "N/m")?;
        in_range("solver.contact_relaxation", s.contact_relaxation, 0.0..=0.1, "s")?;
        in_range("solver.support_stiffness", s.support_stiffness, 0.0..=1e7, "N/(m kg)")?;
        in_range("solver.penetration_cap", s.penetration_cap, 1e-5..=0.01, "m")?;
        in_range("solver.stick_speed", s.stick_speed, 1e-7..=0.01, "m/s")?;
        in_range("solver.tolerance", s.tolerance, 1e-12..=1e-3, "m/s")?;
        in_range("solver.max_iterations", s.max_iterations as f64, 1.0..=1000.0, "")?;
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
