//! The state machine that all drivers share: reset, advance, verdict.

use crate::EpisodeError;
use crate::judge::{Judge, SuccessCriterion, Verdict};
use crate::scene::{SETTLE_TIME, Scene, Stillness};
use graspbox_hand::ActuatorCommand;
use graspbox_sim::World;
use nalgebra::Isometry3;
use std::sync::Arc;

/// One attempt to grasp: a world and its judge.
#[derive(Clone)]
pub struct Episode {
    scene: Arc<Scene>,
    world: World,
    judge: Judge,
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

    /// A new episode with the object at rest at `world_from_object`, its friction and mass multiplied by `factors`.
    pub fn reset_at(
        scene: &Arc<Scene>,
        world_from_hand: &Isometry3<f64>,
        world_from_object: &Isometry3<f64>,
        preshape: f64,
        factors: [f64; 2],
        criterion: SuccessCriterion,
    ) -> Self {
        let mut world = scene.template().spawn(world_from_hand, world_from_object, preshape);
        world.scale_object(factors[0], factors[1]);
        let judge = Judge::new(&world, scene.center_of_mass(), criterion);
        Self { scene: Arc::clone(scene), world, judge }
    }

    /// An episode from a saved state: a snapshot of its world, and its judge.
    ///
    /// # Errors
    /// [`EpisodeError`] for a snapshot of another object, hand or setting, or an impossible state of world or judge.
    pub fn resume(scene: &Arc<Scene>, snapshot: &[u8], judge: Judge) -> Result<Self, EpisodeError> {
        judge.check(&scene.center_of_mass())?;
        let world = scene
            .template()
            .restore(snapshot)
            .map_err(|source| EpisodeError::Sim { object: scene.name().to_owned(), source })?;
        Ok(Self { scene: Arc::clone(scene), world, judge })
    }

    /// Advances by one time step: the hand reaches `world_from_hand`, the actuators follow their commands, the judge observes the result.
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
        self.judge.observe(&self.world);
        Ok(())
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

    /// Notifies the judge that the object is dropped; its centre of mass will rest at `resting_height`, metres.
    pub fn dropped(&mut self, resting_height: f64) {
        self.judge.dropped(&self.world, resting_height);
    }

    /// Notifies the judge that lifting begins.
    pub fn begin_lift(&mut self) {
        self.judge.begin_lift(&self.world);
    }

    /// The present verdict of the judge.
    pub fn verdict(&self) -> Verdict {
        self.judge.verdict(&self.world)
    }

    /// The scene of this episode.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The present world.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The judge.
    pub fn judge(&self) -> &Judge {
        &self.judge
    }
}
