//! Settings of the engine, with the unit of each number and the reason for its default.

use serde::{Deserialize, Serialize};

/// Settings of the contact search, of contact and friction, and of the iteration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImplicitConfig {
    /// Gap up to which a point counts as a contact, beyond the distance that the bodies cover in a step at their present velocities, metres. It
    /// allows for the speed that a finger gains within a step under full tendon force.
    pub prediction: f64,
    /// The contacts of a pair are searched again once it has moved by this since the last search, metres; 0 searches at every step. The
    /// default is a tenth of `penetration_cap`.
    pub contact_drift: f64,
    /// Stiffness of a contact point, N/m: a pad that presses with 10 N on four points penetrates by 0.02 mm. At half this stiffness perturbed
    /// grasps succeed that fail in MuJoCo; at five times it, the iteration for friction diverged.
    pub contact_stiffness: f64,
    /// Relaxation time of a contact that penetrates, seconds: its damping is its stiffness times this. A mass `m` on one point of stiffness `k`
    /// has the damping ratio `relaxation sqrt(k / m) / 2`: by default at least 1.26 for an object on table or palm, which does not bounce.
    pub contact_relaxation: f64,
    /// Least stiffness of a point that supports the object on table or palm, per mass of the object, N/(m kg). The default keeps the natural
    /// frequency on one point at 50 Hz or more, so heavy objects do not sink in; it exceeds `contact_stiffness` above 1.2 kg.
    pub support_stiffness: f64,
    /// Penetration up to which the whole depth pushes back, metres. Beyond it only a fifth of the excess does, so objects that overlap at the
    /// start are not thrown. The default is about 25 times the depth under a grasp of 10 N on four points.
    pub penetration_cap: f64,
    /// Sliding speed at which friction reaches its Coulomb bound, m/s. A contact creeps at this speed under full load: 0.02 mm in a second
    /// at the default.
    pub stick_speed: f64,
    /// The iteration ends once a Newton step changes no velocity by more than this, m/s: a tenth of `stick_speed`, so that friction that
    /// sticks is resolved.
    pub tolerance: f64,
    /// Most Newton iterations per step and attempt; typical steps take about three.
    pub max_iterations: usize,
}

impl Default for ImplicitConfig {
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
