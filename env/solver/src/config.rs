//! Settings of contact and friction, with the reason for each number.

use serde::{Deserialize, Serialize};

/// Settings of the solver: those of the search for contacts, of contact and friction, and of the iteration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SolverConfig {
    /// Distance within which contacts count, beside what the bodies cover in a step, metres: what a finger gains in a step under its full tendon.
    pub prediction: f64,
    /// A pair is searched for contacts again once it has moved by this since the last search, metres; 0 searches at every step.
    pub contact_drift: f64,
    /// Stiffness of a contact point, N/m. A pad that presses with 10 N on four points sinks in by 0.02 mm. Half of this
    /// lets perturbed grasps succeed that MuJoCo loses; contacts that are five times stiffer make friction's fixed point diverge.
    pub contact_stiffness: f64,
    /// Relaxation time of a contact, seconds: damping is stiffness times this.
    pub contact_relaxation: f64,
    /// Least stiffness of a contact that carries the object on table or palm, per kg of the object, N/(m kg): it sets the natural frequency
    /// of what rests (50 Hz), so that heavy objects do not sink in.
    pub support_stiffness: f64,
    /// Penetration beyond which a contact is softer, metres: a scene that starts overlapped does not throw its object.
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
            prediction: 0.001,
            contact_drift: 5e-5,
            contact_stiffness: 1.2e5,
            contact_relaxation: 0.008,
            support_stiffness: 1e5,
            penetration_cap: 5e-4,
            stick_speed: 2e-5,
            tolerance: 2e-6,
            max_iterations: 50,
        }
    }
}
