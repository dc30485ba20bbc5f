//! Settings of contact and friction, with the reason for each number.

use serde::{Deserialize, Serialize};

/// Settings of the solver.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SolverConfig {
    /// Stiffness of a contact point, N/m. A pad that presses with 10 N on four points sinks in by 0.04 mm; contacts that are ten times
    /// stiffer make friction's fixed point diverge.
    pub contact_stiffness: f64,
    /// Relaxation time of a contact, seconds: damping is stiffness times this.
    pub contact_relaxation: f64,
    /// Least stiffness of a contact that carries the object on table or palm, per kg of the object, N/(m kg): it sets the natural frequency
    /// of what rests (50 Hz), so that heavy objects do not sink in.
    pub support_stiffness: f64,
    /// Penetration that pushes back at most, metres: a scene that starts overlapped does not throw its object.
    pub penetration_cap: f64,
    /// Sliding speed at which friction reaches its bound, m/s: what a fully loaded contact creeps.
    pub stick_speed: f64,
    /// Newton step at which the iteration ends, m/s.
    pub tolerance: f64,
    /// Newton iterations per step at most.
    pub max_iterations: usize,
}

impl Default for SolverConfig {
    fn default() -> Self {
        Self {
            contact_stiffness: 6e4,
            contact_relaxation: 0.008,
            support_stiffness: 1e5,
            penetration_cap: 5e-4,
            stick_speed: 2e-5,
            tolerance: 2e-6,
            max_iterations: 50,
        }
    }
}

/// What the search for contacts needs, from the settings that both engines share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchConfig {
    /// Distance within which contacts count, beside what is covered in a step, metres.
    pub prediction: f64,
    /// A pair is searched anew once it has moved by this, metres.
    pub drift: f64,
}
