//! Observers: measurements in addition to those of the trial itself.

use crate::episode::Episode;

/// Watches a trial from its first step to the end of the hold; a shake is not observed. Observers read the episode and change nothing, so a
/// trial has the same outcome with any observer, except where it waits for one ([`crate::TrialConfig::await_observer`]).
pub trait Observer {
    /// Called once, when the hand begins to lift.
    fn begin_lift(&mut self, episode: &Episode);

    /// Called after every step.
    fn observe(&mut self, episode: &Episode);

    /// True while an early stop of the trial would cut off a measurement.
    fn pending(&self) -> bool;
}

/// No observer.
impl Observer for () {
    fn begin_lift(&mut self, _: &Episode) {}

    fn observe(&mut self, _: &Episode) {}

    fn pending(&self) -> bool {
        false
    }
}
