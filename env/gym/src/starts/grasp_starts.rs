//! Starts at a grasp: a share of episodes begins with the open hand at a planned pose around the object, so that chance closes it on the object.
//!
//! Their random numbers come from a stream of their own, whose seed is that of cameras and light, so that they change no other sample of an
//! initial state.

use crate::EnvError;
use crate::actions::workspace::{WORKSPACE_HIGH, WORKSPACE_LOW};
use crate::objects::Prepared;
use crate::pool::env_spec::EnvSpec;
use crate::starts::initial_samples::InitialSamples;
use crate::starts::random_stream::RandomStream;
use nalgebra::Isometry3;

/// The best poses of a plan, among which a start is drawn.
pub const BEST: usize = 32;
/// Distinguishes the stream of these starts from that of cameras and light.
const STREAM: u64 = 0x6772_6173_705f_6174;

/// The hand at the start of an episode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandStart {
    pub world_from_hand: Isometry3<f64>,
    /// Preshape, as one number.
    pub preshape: f64,
}

/// The hand at a planned grasp, in a share of episodes; `None` in the others, and for an object without a feasible pose in the workspace.
///
/// * `at_rest`: a single object and its resting pose, by index; `None` if the hand starts elsewhere.
///
/// # Errors
/// As [`crate::objects::Objects::grasps`].
pub fn at_grasp(
    spec: &EnvSpec,
    samples: &InitialSamples,
    at_rest: Option<(&Prepared, usize)>,
    world_from_object: &Isometry3<f64>,
) -> Result<Option<HandStart>, EnvError> {
    let (share, mut stream) = (spec.config.grasp_starts, RandomStream::new(samples.viewpoint ^ STREAM));
    let Some((prepared, resting)) = at_rest.filter(|_| share > 0.0 && stream.sample_unit() < share) else {
        return Ok(None);
    };
    let starts: Vec<HandStart> = spec
        .objects
        .grasps(prepared, resting)?
        .iter()
        .map(|grasp| HandStart {
            world_from_hand: world_from_object * grasp.object_from_hand,
            preshape: grasp.preshape,
        })
        .filter(|start| {
            let at = &start.world_from_hand.translation.vector;
            (0..3).all(|i| (WORKSPACE_LOW[i]..=WORKSPACE_HIGH[i]).contains(&at[i]))
        })
        .collect();
    Ok(starts.get(stream.sample_index(starts.len())).copied())
}
