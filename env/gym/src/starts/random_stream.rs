//! The random stream of one environment: a ChaCha stream that a seeded reset restarts and every other sample continues.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};

/// A seeded stream of random numbers.
#[derive(Clone, Debug)]
pub struct RandomStream(ChaCha8Rng);

/// The position of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RandomStreamState {
    seed: [u8; 32],
    /// Number of words used so far, as two halves.
    position: [u64; 2],
}

impl RandomStream {
    /// The stream of `seed`.
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// The position of the stream.
    pub fn state(&self) -> RandomStreamState {
        let position = self.0.get_word_pos();
        RandomStreamState { seed: self.0.get_seed(), position: [position as u64, (position >> 64) as u64] }
    }

    /// The stream at a saved position; a position beyond its end, after 2^68 words, wraps around.
    pub fn resume(state: &RandomStreamState) -> Self {
        let mut stream = ChaCha8Rng::from_seed(state.seed);
        stream.set_word_pos(u128::from(state.position[0]) | u128::from(state.position[1]) << 64);
        Self(stream)
    }

    /// The seed of another stream.
    pub fn sample_seed(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Uniform in [0, 1), from the upper 53 bits.
    pub fn sample_unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (-53f64).exp2()
    }

    /// Uniform in [low, high).
    pub fn sample_range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.sample_unit()
    }

    /// Uniform in [-size, size).
    pub fn sample_within(&mut self, size: f64) -> f64 {
        self.sample_range(-size, size)
    }

    /// A uniform index below `count`; 0 for a count of 0.
    pub fn sample_index(&mut self, count: usize) -> usize {
        ((self.sample_unit() * count as f64) as usize).min(count.saturating_sub(1))
    }
}
