//! The state machine that all drivers share: reset, advance, verdict.

use crate::EpisodeError;
use crate::judge::{Judge, SuccessCriterion, Verdict};
use crate::scene::{SETTLE_TIME, Scene, Stillness};
use graspbox_hand::ActuatorCommand;
use graspbox_mesh::in_range;
use graspbox_sim::World;
use nalgebra::Isometry3;
use std::sync::Arc;

/// One attempt to grasp: a world, and a judge of each of its objects.
#[derive(Clone)]
pub struct Episode {
    scene: Arc<Scene>,
    world: World,
    judges: Vec<Judge>,
}

impl Episode {
    /// A new episode: the hand open at `world_from_hand` with `preshape`, the object at rest.
    pub fn reset(
        scene: &Arc<Scene>,
        world_from_hand: &Isometry3<f64>,
        preshape: f64,
        criterion: SuccessCriterion,
    ) -> Self {
        Self::reset_at(scene, world_from_hand, scene.world_from_object(), preshape, [1.0, 1.0], criterion)
    }

    /// A new episode with the object at rest at `world_from_object` and the others at their places, the friction and mass of all of them
    /// multiplied by `factors`.
    pub fn reset_at(
        scene: &Arc<Scene>,
        world_from_hand: &Isometry3<f64>,
        world_from_object: &Isometry3<f64>,
        preshape: f64,
        factors: [f64; 2],
        criterion: SuccessCriterion,
    ) -> Self {
        let world = scene.spawn(world_from_hand, world_from_object, preshape, factors);
        let judge = |(object, center)| Judge::new(&world, object, center, criterion);
        let judges = scene.centers_of_mass().enumerate().map(judge).collect();
        Self { scene: Arc::clone(scene), world, judges }
    }

    /// An episode from a saved state: a snapshot of its world, and its judges.
    ///
    /// # Errors
    /// [`EpisodeError`] for a snapshot of another object, hand or setting, or an impossible state of world or judges.
    pub fn resume(scene: &Arc<Scene>, snapshot: &[u8], judges: Vec<Judge>) -> Result<Self, EpisodeError> {
        let (count, objects) = (judges.len() as f64, scene.centers_of_mass().len() as f64);
        in_range("number of judges", count, objects..=objects, "")?;
        judges.iter().zip(scene.centers_of_mass()).enumerate().try_for_each(|(i, (judge, c))| judge.check(i, &c))?;
        let world = scene
            .template()
            .restore(snapshot)
            .map_err(|source| EpisodeError::Sim { object: scene.name().to_owned(), source })?;
        Ok(Self { scene: Arc::clone(scene), world, judges })
    }

    /// Advances by one time step: the hand reaches `world_from_hand`, the actuators follow their commands, the judges observe the result.
    ///
    /// # Errors
    /// [`EpisodeError::Sim`] for an actuator command that is not finite.
    pub fn advance(
        &mut self,
        world_from_hand: &Isometry3<f64>,
        commands: &[ActuatorCommand],
    ) -> Result<(), EpisodeError> {
        let sim = |source| EpisodeError::Sim { object: self.scene.name().to_owned(), source };
        self.world.step(world_from_hand, commands).map_err(sim)?;
        self.observe(1);
        Ok(())
    }

    /// Lets the judges observe the result of this number of steps.
    #[inline]
    fn observe(&mut self, steps: u32) {
        match self.judges.as_mut_slice() {
            [judge] => judge.observe(&self.world, self.world.object_on_scenery(), steps),
            judges => {
                let carried = self.world.carried_by_scenery();
                judges.iter_mut().zip(carried).for_each(|(judge, carried)| judge.observe(&self.world, carried, steps));
            }
        }
    }

    /// As [`World::expect_rest`].
    pub fn expect_rest(&mut self) {
        self.world.expect_rest();
    }

    /// As [`Episode::advance`], for several time steps at once where nothing is in reach: [`World::step_freely`]. Returns whether it did; if not,
    /// the episode is as before.
    ///
    /// * `world_from_hand`: at the end of the last of them.
    ///
    /// # Errors
    /// As [`Episode::advance`].
    pub fn advance_freely(
        &mut self,
        world_from_hand: &Isometry3<f64>,
        commands: &[ActuatorCommand],
        steps: u32,
    ) -> Result<bool, EpisodeError> {
        let sim = |source| EpisodeError::Sim { object: self.scene.name().to_owned(), source };
        let stepped = self.world.step_freely(world_from_hand, commands, steps).map_err(sim)?;
        if stepped {
            self.observe(steps);
        }
        Ok(stepped)
    }

    /// As [`World::place_arm`].
    pub fn place_arm(&mut self, hand_error: &Isometry3<f64>, positions: &[f64]) {
        self.world.place_arm(hand_error, positions);
    }

    /// As [`World::drive_arm`].
    pub fn drive_arm(&mut self, positions: &[f64], is_far: bool) {
        self.world.drive_arm(positions, is_far);
    }

    /// Makes the object on which the hand presses most the target; if it presses on none, the target stays the same.
    pub fn target_most_pressed(&mut self) {
        if let Some(object) = self.world.most_pressed() {
            self.world.set_target(object);
        }
    }

    /// Lets the object come to rest while the hand does not move, for at most 3 s.
    ///
    /// # Errors
    /// As [`Episode::advance`]; without commands there are none.
    pub fn rest(&mut self) -> Result<(), EpisodeError> {
        let hand = self.world.world_from_hand();
        let mut stillness = Stillness::default();
        for _ in 0..(SETTLE_TIME / self.world.dt()) as usize {
            self.advance(&hand, &[])?;
            if stillness.lasts(&self.world) {
                break;
            }
        }
        Ok(())
    }

    /// Multiplies the mass of every object by a positive factor.
    pub(crate) fn scale_masses(&mut self, factor: f64) {
        self.world.scale_objects(1.0, factor);
    }

    /// Notifies the judge that the object is dropped; its centre of mass will rest at `resting_height`, metres.
    pub fn dropped(&mut self, resting_height: f64) {
        let target = self.world.target();
        self.judges[target].dropped(&self.world, resting_height);
    }

    /// Notifies the judge that lifting begins.
    pub fn begin_lift(&mut self) {
        self.judges.iter_mut().for_each(|judge| judge.begin_lift(&self.world));
    }

    /// The present verdict on the target.
    pub fn verdict(&self) -> Verdict {
        self.judge().verdict(&self.world)
    }

    /// Makes an object whose grasp is a success the target, unless the target is one, or there is none.
    pub fn target_held(&mut self) {
        let target = self.world.target();
        let held: Vec<usize> = self.held_objects().collect();
        if let Some(first) = held.first().filter(|_| !held.contains(&target)) {
            self.world.set_target(*first);
        }
    }

    /// The objects, by their indices, whose grasp is a success at present.
    pub fn held_objects(&self) -> impl Iterator<Item = usize> {
        let held = self.judges.iter().enumerate().filter(|(_, judge)| judge.success(&self.world));
        held.map(|(object, _)| object)
    }

    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    pub fn world(&self) -> &World {
        &self.world
    }

    /// The judge of the target.
    pub fn judge(&self) -> &Judge {
        &self.judges[self.world.target()]
    }

    /// The judges of all objects, in order.
    pub fn judges(&self) -> &[Judge] {
        &self.judges
    }
}
