//! A step of closed-loop control.

use crate::EnvError;
use crate::actions::action::{OPEN_SHARE, actuator_commands};
use crate::actions::control::{CONTROL_PERIOD, Timing};
use crate::actions::workspace::{LOST_DISTANCE, LOST_HEIGHT};
use crate::pool::env_spec::EnvSpec;
use crate::pool::episode_body::EpisodeBody;
use crate::rewards::potentials::Potentials;
use crate::rewards::reward::{Transition, effort};
use crate::state::GraspState;

impl GraspState {
    /// Advances by one control period.
    ///
    /// # Errors
    /// [`EnvError::Episode`] for an actuator command that is not finite, which no finite action causes.
    pub(crate) fn step(
        &mut self,
        body: &mut EpisodeBody,
        action: &[f32],
        spec: &EnvSpec,
    ) -> Result<Transition, EnvError> {
        let Timing { period, substeps, .. } = spec.timing;
        let motion = body.arm.begin(&self.control.goal(action, body.arm.estimated_pose(), period), period);
        let (entries, open) = (&action[spec.config.control.hand_size(spec.hand())..], hand_is_open(body));
        let commands = actuator_commands(spec.hand(), spec.config.fingers, entries, open, &mut body.record.preshape);
        let time = period / CONTROL_PERIOD;
        let mut transition = Transition { before: body.record.potentials, time, ..Transition::default() };
        let dt = body.episode.world().dt();
        let (mut done, at_once) = (0, body.episode.world().free_steps().min(substeps).max(1));
        while done < substeps {
            let (time, next) = (f64::from(done) * dt, at_once.min(substeps - done));
            if done % at_once == 0 && body.advance_freely((&motion, time), &commands, next, spec)? {
                done += next;
                continue;
            }
            let load = body.episode.world().hand_load();
            transition.table |= load.scenery;
            // Among others it may be another object that presses.
            body.record.touched |= load.object && (body.prepared.len() == 1 || body.touches());
            let hand = body.move_arm(&motion, time, spec, &load);
            transition.stop |= body.arm.stop.active;
            match body.episode.advance(&hand, &commands) {
                Ok(()) => self.watch_lift(body),
                // The action is finite, so the world has diverged: tendon tensions are NaN.
                Err(_) if body.episode.world().has_diverged() => break,
                Err(error) => return Err(error.into()),
            }
            if body.record.goal.is_none() && body.episode.judge().success(body.episode.world()) {
                transition.success = true;
                break;
            }
            done += 1;
        }
        let diverged = body.episode.world().has_diverged();
        transition.success &= !diverged;
        transition.secure = transition.success && body.episode.verdict().secure;
        // With a goal, an episode goes on when the object is lost: to end it would be better than -1 in every further step.
        transition.lost = !transition.success && (diverged || (body.record.goal.is_none() && is_lost(body)));
        transition.effort = effort(&body.arm, body.episode.world());
        self.stopped |= transition.stop;
        if let Some(goal) = &spec.config.goal {
            body.record.success = !diverged && body.reached(goal);
            transition.success = goal.ends && body.record.success;
        } else {
            body.record.success = transition.success;
        }
        body.record.touched |= body.touches();
        transition.after = Potentials::of(&body.episode, body.target(), &body.record.first_center);
        body.record.potentials = transition.after;
        Ok(transition)
    }

    /// Begins the lift for the judge when the object first leaves the table while the hand touches it.
    fn watch_lift(&mut self, body: &mut EpisodeBody) {
        if !self.lifting && !body.episode.judge().on_scenery() && body.touches() {
            self.lifting = true;
            body.record.touched = true;
            body.episode.begin_lift();
        }
    }
}

/// True while no actuator has closed so far that the preshape must not change.
fn hand_is_open(body: &EpisodeBody) -> bool {
    let world = body.episode.world();
    let hand = world.hand();
    hand.grasp_actuators().all(|index| {
        let [open, closed] = hand.actuators[index].travel;
        world.actuators()[index].position <= open + OPEN_SHARE * (closed - open)
    })
}

/// True if the object is off the table or out of the workspace.
fn is_lost(body: &EpisodeBody) -> bool {
    let center = body.episode.world().object_center();
    center.z < LOST_HEIGHT || center.coords.xy().norm() > LOST_DISTANCE
}
