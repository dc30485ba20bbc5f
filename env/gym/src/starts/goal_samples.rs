//! The goal of an episode: sampled, or set by an option.
//!
//! Its random numbers come from a stream of its own, whose seed is that of cameras and light, so that it changes no other sample of an initial
//! state.

use crate::EnvError;
use crate::actions::workspace::{WORKSPACE_HIGH, WORKSPACE_LOW};
use crate::starts::random_stream::RandomStream;
use crate::starts::reset_options::{ResetOptions, bad_option};
use crate::state::{Goal, GoalConfig, GoalTask};

/// Greatest distance of a goal from the table's middle in x and in y, metres.
pub const GOAL_SPREAD: f64 = 0.15;
/// Least and greatest height of the grasp centre above the object's top, metres.
pub const ABOVE_TOP: [f64; 2] = [0.05, 0.30];
/// Greatest height of a goal of the grasp centre above the table, metres: the hand above it stays in the workspace.
pub const HIGHEST_REACH: f64 = 0.5;
/// Probability of a goal on the table.
pub const ON_TABLE: f64 = 0.5;
/// Greatest rise of a goal above the object at rest, metres.
pub const RISE: f64 = 0.25;
/// Distinguishes the stream of the goal from that of cameras and light.
const STREAM: u64 = 0x676f_616c_5f67_6f61;

/// The object at rest as the episode begins.
pub struct Resting {
    /// Height of its centre of mass, metres.
    pub center: f64,
    /// Height of its highest point, metres.
    pub top: f64,
}

/// The goal of an episode.
///
/// * `seed`: of cameras and light.
///
/// # Errors
/// [`EnvError::BadOption`] for a goal outside the workspace, or in an environment without goals.
pub fn goal(
    config: Option<&GoalConfig>,
    seed: u64,
    resting: &Resting,
    options: &ResetOptions,
) -> Result<Option<Goal>, EnvError> {
    let Some(config) = config else {
        return match options.goal {
            Some(_) => Err(bad_option("goal", "this environment has no goals; leave it out")),
            None => Ok(None),
        };
    };
    let desired = match options.goal {
        Some(given) => inside(given)?,
        None => sampled(config.task, seed, resting),
    };
    Ok(Some(Goal::new(config.task, desired)))
}

fn inside(goal: [f64; 3]) -> Result<[f64; 3], EnvError> {
    if (0..3).all(|i| (WORKSPACE_LOW[i]..=WORKSPACE_HIGH[i]).contains(&goal[i])) {
        return Ok(goal);
    }
    let why = format!("it is at {goal:?} m; keep it between {WORKSPACE_LOW:?} and {WORKSPACE_HIGH:?} m");
    Err(bad_option("goal", why))
}

fn sampled(task: GoalTask, seed: u64, resting: &Resting) -> [f64; 3] {
    let mut stream = RandomStream::new(seed ^ STREAM);
    let [x, y] = [stream.sample_within(GOAL_SPREAD), stream.sample_within(GOAL_SPREAD)];
    let (on_table, height) = (stream.sample_unit() < ON_TABLE, stream.sample_unit());
    let z = match task {
        GoalTask::Reach => (resting.top + ABOVE_TOP[0] + height * (ABOVE_TOP[1] - ABOVE_TOP[0])).min(HIGHEST_REACH),
        GoalTask::Place if on_table => resting.center,
        GoalTask::Place => resting.center + height * RISE,
    };
    [x, y, z]
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::config::EnvConfig;
    use crate::{Control, Layout};

    const RESTING: Resting = Resting { center: 0.04, top: 0.09 };

    fn config(task: GoalTask) -> GoalConfig {
        GoalConfig { task, threshold: 0.02, ends: false }
    }

    fn goals(task: GoalTask, resting: &Resting) -> Vec<[f32; 3]> {
        let one = |seed| goal(Some(&config(task)), seed, resting, &ResetOptions::default()).unwrap().unwrap().desired;
        (0..500).map(one).collect()
    }

    /// A goal of the hand is above the object, but no higher than the hand gets.
    #[test]
    fn goals_of_the_hand_are_above_the_object() {
        let all = goals(GoalTask::Reach, &RESTING);
        let within = |z: f32| (0.14..0.3901).contains(&z);
        assert!(all.iter().all(|[x, y, z]| x.abs() <= 0.15 && y.abs() <= 0.15 && within(*z)));
        assert!(all.iter().any(|goal| goal[2] > 0.37) && all.iter().any(|goal| goal[2] < 0.16));
        let tall = goals(GoalTask::Reach, &Resting { center: 0.2, top: 0.45 });
        assert!(tall.iter().all(|goal| goal[2] == 0.5));
    }

    #[test]
    fn half_of_the_goals_of_the_object_are_on_the_table() {
        let all = goals(GoalTask::Place, &RESTING);
        let on_table = all.iter().filter(|goal| goal[2] == 0.04).count();
        assert!((200..300).contains(&on_table), "{on_table} of 500");
        assert!(all.iter().all(|goal| (0.04..0.2901).contains(&goal[2])));
        assert!(all.iter().any(|goal| goal[2] > 0.27));
    }

    #[test]
    fn a_given_goal_is_in_the_workspace_of_an_environment_with_goals() {
        let given = |at, config: Option<&GoalConfig>| {
            let options = ResetOptions { goal: Some(at), ..ResetOptions::default() };
            goal(config, 1, &RESTING, &options).map_err(|error| error.to_string())
        };
        let reach = config(GoalTask::Reach);
        assert_eq!(given([0.1, 0.2, 0.3], Some(&reach)).unwrap().unwrap().desired, [0.1, 0.2, 0.3]);
        for at in [[0.4, 0.0, 0.3], [0.0, 0.0, -0.1], [0.0, f64::NAN, 0.3]] {
            assert!(given(at, Some(&reach)).unwrap_err().contains("keep it between"));
        }
        assert!(given([0.1, 0.2, 0.3], None).unwrap_err().contains("no goals"));
    }

    #[test]
    fn goals_need_closed_loop_control_of_one_object() {
        let refused = |change: fn(&mut EnvConfig)| {
            let mut checked = EnvConfig { goal: Some(config(GoalTask::Place)), ..EnvConfig::default() };
            checked.validate().unwrap();
            change(&mut checked);
            checked.validate().unwrap_err().to_string()
        };
        assert!(refused(|c| c.control = Control::GraspPose).contains("goals need closed-loop control"));
        assert!(refused(|c| c.clutter.layout = Some(Layout::Pile)).contains("goals need closed-loop control"));
        assert!(refused(|c| c.goal.as_mut().unwrap().threshold = 0.0).contains("threshold"));
    }
}
