//! The scene of an environment's next episode, made by the background thread during the present one.
//!
//! After a reset the stream of an environment holds the samples of the next reset without a seed. A reset that needs others, or that comes before
//! the scene is ready, makes its own: results are the same.

use crate::EnvError;
use crate::ahead::Work;
use crate::objects::Objects;
use crate::starts::clutter::{AtRest, ClutterSamples};
use graspbox_episode::Layout;
use std::sync::{Arc, OnceLock};

/// The next scene of one environment.
pub struct SceneAhead {
    samples: ClutterSamples,
    made: OnceLock<AtRest>,
}

impl SceneAhead {
    /// Queues a scene. It is not made if the environment has dropped it by then.
    pub fn queue(objects: &Arc<Objects>, layout: Layout, samples: ClutterSamples) -> Arc<Self> {
        let scene = Arc::new(Self { samples, made: OnceLock::new() });
        let (owner, wanted) = (Arc::downgrade(objects), Arc::downgrade(&scene));
        objects.spawn_ahead(Work::Scene(scene.samples.seed), move || {
            let (Some(objects), Some(scene)) = (owner.upgrade(), wanted.upgrade()) else { return };
            // An error occurs again, and is reported, in the reset that needs the scene.
            if let Ok(made) = scene.samples.at_rest(&layout, &objects) {
                scene.made.get_or_init(|| made);
            }
        });
        scene
    }

    /// The scene of `samples`: that of `ahead`, if it is the same one and is ready or being made, else made now.
    ///
    /// # Errors
    /// As [`ClutterSamples::at_rest`].
    pub fn take(
        ahead: Option<&Self>,
        objects: &Objects,
        layout: &Layout,
        samples: &ClutterSamples,
    ) -> Result<AtRest, EnvError> {
        let Some(ahead) = ahead.filter(|ahead| ahead.samples == *samples) else {
            return samples.at_rest(layout, objects);
        };
        let _claim = objects.claim(Work::Scene(samples.seed));
        ahead.made.get().map_or_else(|| samples.at_rest(layout, objects), |made| Ok(made.clone()))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::config::{Autoreset, ClutterConfig, EnvConfig};
    use crate::objects::Need;
    use crate::pool::env_pool::EnvPool;
    use crate::source::Source;
    use crate::starts::reset_options::ResetOptions;
    use graspbox_hand::Hand;
    use graspbox_objects::Family;
    use graspbox_sim::PhysicsConfig;
    use std::sync::mpsc::channel;

    fn pool(autoreset: Autoreset) -> EnvPool {
        let source = |family: &Family| Source::Procedural {
            name: family.name().into(),
            family: *family,
            seed: 0,
            scale: 1.0,
            mass: None,
        };
        let (sources, hand) =
            ([Family::Box, Family::Ball].iter().map(source).collect(), Hand::reflex().unwrap().clone());
        let objects = Arc::new(Objects::new(sources, Arc::new(hand), PhysicsConfig::default(), None).unwrap());
        let clutter = ClutterConfig {
            layout: Some(Layout::Pile),
            objects_per_scene: [2, 2],
            scale: [0.8, 1.0],
            ..ClutterConfig::default()
        };
        EnvPool::new(objects, EnvConfig { autoreset, clutter, ..EnvConfig::default() }, 1).unwrap()
    }

    fn reset(pool: &EnvPool, seed: Option<u64>) {
        pool.reset(&[seed], None, &ResetOptions::default()).unwrap();
    }

    fn scene(pool: &EnvPool) -> Option<Arc<SceneAhead>> {
        pool.env(0).unwrap().next_scene().cloned()
    }

    /// The next episode begins with the very objects that the background thread prepared.
    #[test]
    fn the_next_reset_takes_the_scene_that_was_made_ahead() {
        let pool = pool(Autoreset::NextStep);
        reset(&pool, Some(1));
        let ahead = scene(&pool).unwrap();
        while ahead.made.get().is_none() {
            std::thread::yield_now();
        }
        reset(&pool, None);
        let env = pool.env(0).unwrap();
        let used: Vec<_> = env.episode().unwrap().objects().map(|object| std::ptr::from_ref(object.prepared)).collect();
        let made: Vec<_> = ahead.made.get().unwrap().0.iter().map(Arc::as_ptr).collect();
        assert_eq!(used, made);
    }

    /// Where every episode has a seed of its own, the stream does not determine the next scene, and none is made.
    #[test]
    fn nothing_is_made_for_episodes_with_seeds_of_their_own() {
        let pool = pool(Autoreset::Disabled);
        reset(&pool, Some(1));
        assert!(scene(&pool).is_none());
        reset(&pool, None);
        assert!(scene(&pool).is_some());
    }

    fn samples(object: usize, seed: u64) -> ClutterSamples {
        ClutterSamples { objects: vec![(object, 1.0)], wanted: 1, spread: 1.0, seed, target: 0.0 }
    }

    /// A reset that needs another scene than the one that was made gets its own.
    #[test]
    fn a_scene_of_other_samples_is_not_taken() {
        let (pool, layout) = (pool(Autoreset::NextStep), Layout::Pile);
        let objects = &pool.spec().objects;
        let ahead = SceneAhead::queue(objects, layout, samples(0, 7));
        let placed = |samples: &ClutterSamples| SceneAhead::take(Some(&ahead), objects, &layout, samples).unwrap().1;
        for samples in [samples(0, 7), samples(0, 8), samples(1, 7)] {
            assert_eq!(placed(&samples), samples.at_rest(&layout, objects).unwrap().1);
        }
        assert_ne!(placed(&samples(0, 7)), placed(&samples(0, 8)));
    }

    /// Scenes in the queue of an environment that is gone, or was reset with a seed, are not made.
    #[test]
    fn a_scene_that_is_not_needed_is_left_out() {
        let pool = pool(Autoreset::NextStep);
        let objects = &pool.spec().objects;
        let (go, wait) = channel::<()>();
        objects.spawn_ahead(Work::Scene(0), move || wait.recv().unwrap());
        drop(SceneAhead::queue(objects, Layout::Pile, samples(0, 1)));
        let wanted = SceneAhead::queue(objects, Layout::Pile, samples(1, 2));
        go.send(()).unwrap();
        while wanted.made.get().is_none() {
            std::thread::yield_now();
        }
        let is_ready = |object| objects.is_ready(&Need { object, resting: None, model: false });
        assert_eq!((is_ready(0), is_ready(1)), (false, true));
    }
}
