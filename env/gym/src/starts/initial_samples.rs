//! The random numbers of an initial state. Every initial state takes the same number of samples, so an option or a randomization changes no other
//! value.

use crate::starts::random_stream::RandomStream;
use nalgebra::Vector3;
use std::f64::consts::PI;

/// Greatest distance of the object from the table's middle in x and in y, metres.
pub const OBJECT_SPREAD: f64 = 0.05;
/// Greatest initial distance of the hand from the table's middle in x and in y, metres.
pub const HAND_SPREAD: f64 = 0.10;
/// Least and greatest height of the grasp frame at the beginning, metres.
pub const HAND_HEIGHT: [f64; 2] = [0.15, 0.30];
/// Greatest angle between the palm's normal and straight down at the beginning, radians.
pub const HAND_TILT: f64 = 0.2;

/// All random numbers of an initial state.
#[derive(Clone)]
pub struct InitialSamples {
    pub object: usize,
    /// Uniform in [0, 1): the resting pose.
    pub resting: f64,
    /// x, y (m) and rotation about the vertical (rad) of the object.
    pub place: [f64; 3],
    /// x, y, z of the hand, metres.
    pub hand: [f64; 3],
    /// Rotation of the hand about the vertical, radians.
    pub yaw: f64,
    /// Direction and angle of its tilt, radians.
    pub tilt: [f64; 2],
    /// Uniform in [0, 1): factor on the friction.
    pub friction: f64,
    /// Uniform in [0, 1): factor on the mass.
    pub mass: f64,
    /// Uniform in [-1, 1): additional x and y of the object.
    pub moved: [f64; 2],
    /// Uniform in [-1, 1): error of the hand's position.
    pub shift: Vector3<f64>,
    /// Uniform in [-1, 1): error of the hand's rotation.
    pub turn: Vector3<f64>,
    /// Seed of cameras and light.
    pub viewpoint: u64,
}

impl InitialSamples {
    /// Samples from a stream.
    ///
    /// * `count`: number of objects.
    pub fn new(stream: &mut RandomStream, count: usize) -> Self {
        let three = |stream: &mut RandomStream| {
            Vector3::new(stream.sample_within(1.0), stream.sample_within(1.0), stream.sample_within(1.0))
        };
        Self {
            object: stream.sample_index(count),
            resting: stream.sample_unit(),
            place: [stream.sample_within(OBJECT_SPREAD), stream.sample_within(OBJECT_SPREAD), stream.sample_within(PI)],
            hand: hand(stream),
            yaw: stream.sample_within(PI),
            tilt: tilt(stream),
            friction: stream.sample_unit(),
            mass: stream.sample_unit(),
            moved: [stream.sample_within(1.0), stream.sample_within(1.0)],
            shift: three(stream),
            turn: three(stream),
            viewpoint: stream.sample_seed(),
        }
    }

    /// Samples another pose of the hand.
    pub fn place_hand(&mut self, stream: &mut RandomStream) {
        self.hand = hand(stream);
        self.yaw = stream.sample_within(PI);
        self.tilt = tilt(stream);
    }
}

fn hand(stream: &mut RandomStream) -> [f64; 3] {
    [
        stream.sample_within(HAND_SPREAD),
        stream.sample_within(HAND_SPREAD),
        stream.sample_range(HAND_HEIGHT[0], HAND_HEIGHT[1]),
    ]
}

fn tilt(stream: &mut RandomStream) -> [f64; 2] {
    [stream.sample_within(PI), stream.sample_range(0.0, HAND_TILT)]
}
