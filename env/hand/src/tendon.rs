//! Statics of tendons and springs.
//!
//! With joint positions `q_i` and moment arms `r_i`, the joints take up `l = sum of r_i q_i` of tendon; the stretch is the length
//! that the spool has wound, less this length.

use crate::model::{Joint, Tendon};

impl Tendon {
    /// Length that the joints take up, metres.
    ///
    /// * `position`: position of a joint by its index, rad or m.
    pub fn take_up(&self, position: impl Fn(usize) -> f64) -> f64 {
        self.arms.iter().map(|&(joint, arm)| arm * position(joint)).sum()
    }

    /// Tension, N: 0 where slack, never negative, at most `max_tension`.
    ///
    /// * `stretch`: metres; negative where the tendon is slack.
    /// * `stretch_rate`: m/s; a pulling spool adds to it, closing joints take from it.
    #[must_use]
    pub fn tension(&self, stretch: f64, stretch_rate: f64) -> f64 {
        if stretch <= 0.0 {
            return 0.0;
        }
        (self.stiffness * stretch + self.damping * stretch_rate).clamp(0.0, self.max_tension)
    }

    /// Moment arm at a joint; 0 for joints that it does not span.
    #[must_use]
    pub fn arm(&self, joint: usize) -> f64 {
        self.arms.iter().find(|(spanned, _)| *spanned == joint).map_or(0.0, |(_, arm)| *arm)
    }
}

impl Joint {
    /// Force of its spring at a position, N m or N.
    #[must_use]
    pub fn spring_force(&self, position: f64) -> f64 {
        -self.stiffness * (position - self.spring_reference)
    }

    /// Position at which its spring balances a force, N m or N, rad or m; limits are ignored; the stiffness must not be 0.
    #[must_use]
    pub fn balanced(&self, force: f64) -> f64 {
        self.spring_reference + force / self.stiffness
    }
}
