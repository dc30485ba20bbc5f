//! The reference study's own measures, watched beside the judge by those trials that are asked for them.
//!
//! Closed-loop environments never pay for them, and no success depends on them.

use crate::episode::Episode;
use graspbox_sim::World;
use nalgebra::Point3;

/// The study reads its measures this long after closing begins, seconds.
pub const READ_TIME: f64 = 2.5;
/// Sampling period of kindness, seconds.
pub const SAMPLE_PERIOD: f64 = 0.01;
/// The study's success: the object rose within this of the hand, metres.
const FOLLOWED: f64 = 0.10;
/// The study's success: less kindness than this is none at all, m/s.
const UNMOVED: f64 = 1e-4;

/// The study's verdict.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// The object followed the hand, or did not move in it at all.
    pub success: bool,
    /// |change of distance| per second between hand frame and object frame, summed over samples of [`SAMPLE_PERIOD`], m/s.
    pub kindness: f64,
}

/// Watches the distance between the hand's frame and the study's object frame, step by step.
#[derive(Clone, Debug)]
pub struct Study {
    /// Origin of the study's object frame: middle of the base, object frame.
    base_point: Point3<f64>,
    distance: f64,
    /// When lifting began, seconds, and the sum of |change of distance| since, metres.
    lifting: Option<(f64, f64)>,
    /// Distance at the last sample, and how many there were.
    sampled: (f64, u64),
    kindness: f64,
}

impl Study {
    /// Begins to watch an episode.
    pub fn new(episode: &Episode) -> Self {
        let base_point = episode.scene().base_point();
        let distance = distance(episode.world(), &base_point);
        Self { base_point, distance, lifting: None, sampled: (distance, 0), kindness: 0.0 }
    }

    /// To be called once, when the hand begins to lift.
    pub fn begin_lift(&mut self, world: &World) {
        self.lifting = Some((world.time(), 0.0));
    }

    /// Looks at the world after a step.
    pub fn observe(&mut self, world: &World) {
        let distance = distance(world, &self.base_point);
        if let Some((_, travelled)) = &mut self.lifting {
            *travelled += (distance - self.distance).abs();
        }
        self.distance = distance;
        let (last, samples) = self.sampled;
        // The small allowance keeps a sample from slipping to the next step by rounding.
        if world.time() + 1e-9 >= (samples + 1) as f64 * SAMPLE_PERIOD {
            self.kindness += (distance - last).abs() / SAMPLE_PERIOD;
            self.sampled = (distance, samples + 1);
        }
    }

    /// Mean of |d distance/dt| since lifting began, m/s; 0 before.
    pub fn kindness_rate(&self, world: &World) -> f64 {
        match self.lifting {
            Some((start, travelled)) if world.time() > start => travelled / (world.time() - start),
            _ => 0.0,
        }
    }

    /// The study's verdict, read now.
    pub fn read(&self, episode: &Episode) -> Reading {
        let verdict = episode.verdict();
        let followed = verdict.hand_lift - verdict.lift <= FOLLOWED;
        Reading { success: followed || self.kindness < UNMOVED, kindness: self.kindness }
    }
}

/// Distance between the hand's frame and the point `base_point` of the object, metres.
pub(crate) fn distance(world: &World, base_point: &Point3<f64>) -> f64 {
    (world.hand_from_object() * base_point).coords.norm()
}
