//! How an episode starts.
//!
//! | module | purpose |
//! |---|---|
//! | [`reset_options`] | options of a reset |
//! | [`random_stream`] | the random stream of one environment |
//! | [`initial_state`] | the initial state of an episode |
//! | [`clutter`], [`scene_ahead`] | a scene of several objects, made when it is needed or before |
//! | [`goal_samples`] | the goal, in environments that have one |
//! | [`initial_samples`], [`hand_placement`] | its random samples, and the place of the hand |
//! | [`arm_start`] | the posture of the arm that holds it there |

pub mod arm_start;
pub mod clutter;
pub mod goal_samples;
pub mod hand_placement;
pub mod initial_samples;
pub mod initial_state;
pub mod random_stream;
pub mod reset_options;
pub mod scene_ahead;
