//! Tendon statics: one spool, two joints.
//!
//! With the proximal and distal angles `q_p`, `q_d`, the joints take up `l = r_p q_p + r_d q_d` of tendon; the spool
//! takes up `r_s s`. The difference is the stretch of the tendon.

use crate::model::{Flexure, Tendon};

impl Tendon {
    /// Tendon length that the joints take up, metres.
    #[must_use]
    pub fn take_up(&self, proximal: f64, distal: f64) -> f64 {
        self.proximal_arm * proximal + self.distal_arm * distal
    }

    /// Stretch of the tendon, metres; negative where it is slack.
    #[must_use]
    pub fn stretch(&self, spool: f64, proximal: f64, distal: f64) -> f64 {
        self.spool_radius * spool - self.take_up(proximal, distal)
    }

    /// Tension, N: 0 where slack, never negative, at most `max_tension`.
    ///
    /// * `stretch`: metres.
    /// * `stretch_rate`: m/s; a pulling spool adds to it, closing joints take from it.
    #[must_use]
    pub fn tension(&self, stretch: f64, stretch_rate: f64) -> f64 {
        if stretch <= 0.0 {
            return 0.0;
        }
        (self.stiffness * stretch + self.damping * stretch_rate).clamp(0.0, self.max_tension)
    }

    /// Torques on the proximal and the distal joint, N m: `r_p T` and `r_d T`, each less its spring `k (q - rest)`.
    ///
    /// Each is the torque of its own joint coordinate (virtual work of that angle alone).
    #[must_use]
    pub fn torques(&self, tension: f64, flexure: &Flexure, proximal: f64, distal: f64) -> [f64; 2] {
        [
            self.proximal_arm * tension - flexure.proximal_stiffness * (proximal - flexure.proximal_rest),
            self.distal_arm * tension - flexure.stiffness * (distal - flexure.rest),
        ]
    }
}
