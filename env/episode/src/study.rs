//! The measures of the reference study: an observer of trials. Success, labels and rewards do not depend on them.

use crate::episode::Episode;
use crate::observer::Observer;
use crate::sample::{PERIOD, distance};
use nalgebra::Point3;

/// The study reads its measures this long after closing begins, seconds.
pub const READ_TIME: f64 = 2.5;
/// Success in the study: the object rose within this of the hand, metres.
const FOLLOWED: f64 = 0.10;
/// Success in the study: a kindness below this counts as no motion, m/s.
const UNMOVED: f64 = 1e-4;

/// The study's verdict after [`READ_TIME`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// The object followed the hand, or did not move in it at all.
    pub success: bool,
    /// Sum over samples (every 10 ms since closing began) of |change of distance| / 10 ms between hand frame and object frame, m/s.
    pub kindness: f64,
}

/// The study's measures of one trial. The default is that of a trial in which nothing moved.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measures {
    /// Mean of |d distance/dt| since lifting began, m/s; 0 if it did not begin.
    pub kindness_rate: f64,
    /// The verdict; `None` if the trial ended before [`READ_TIME`].
    pub reading: Option<Reading>,
}

/// Observes the distance between the hand frame and the study's object frame, step by step.
#[derive(Clone, Debug)]
pub struct Study {
    /// Origin of the study's object frame: middle of the base, object frame.
    base_point: Point3<f64>,
    /// Distance after the last step, metres.
    distance: f64,
    /// World time after the last step, seconds.
    time: f64,
    /// World time when lifting began, seconds, and the sum of |change of distance| since, metres.
    lifting: Option<(f64, f64)>,
    /// Distance at the last sample, and the number of samples.
    sampled: (f64, u64),
    kindness: f64,
    /// Steps observed, and the step of the reading.
    steps: u64,
    read_at: u64,
    reading: Option<Reading>,
}

impl Study {
    /// Begins to observe an episode in which no step was taken yet.
    pub fn new(episode: &Episode) -> Self {
        let (world, base_point) = (episode.world(), episode.scene().base_point());
        let distance = distance(world, &base_point);
        Self {
            base_point,
            distance,
            time: world.time(),
            lifting: None,
            sampled: (distance, 0),
            kindness: 0.0,
            steps: 0,
            read_at: (READ_TIME / world.dt()).round() as u64,
            reading: None,
        }
    }

    /// The measures so far.
    pub fn measures(&self) -> Measures {
        let kindness_rate = match self.lifting {
            Some((start, travelled)) if self.time > start => travelled / (self.time - start),
            _ => 0.0,
        };
        Measures { kindness_rate, reading: self.reading }
    }

    fn read(&self, episode: &Episode) -> Reading {
        let verdict = episode.verdict();
        let followed = verdict.hand_lift - verdict.lift <= FOLLOWED;
        Reading { success: followed || self.kindness < UNMOVED, kindness: self.kindness }
    }
}

impl Observer for Study {
    fn begin_lift(&mut self, episode: &Episode) {
        self.lifting = Some((episode.world().time(), 0.0));
    }

    fn observe(&mut self, episode: &Episode) {
        let world = episode.world();
        let distance = distance(world, &self.base_point);
        if let Some((_, travelled)) = &mut self.lifting {
            *travelled += (distance - self.distance).abs();
        }
        (self.distance, self.time) = (distance, world.time());
        let (last, samples) = self.sampled;
        // The small allowance keeps rounding from moving a sample to the next step.
        if world.time() + 1e-9 >= (samples + 1) as f64 * PERIOD {
            self.kindness += (distance - last).abs() / PERIOD;
            self.sampled = (distance, samples + 1);
        }
        self.steps += 1;
        if self.steps == self.read_at {
            self.reading = Some(self.read(episode));
        }
    }

    fn pending(&self) -> bool {
        self.reading.is_none()
    }
}
