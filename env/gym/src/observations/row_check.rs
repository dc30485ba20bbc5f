//! Reads every observation once when environments are made, to report rows of a wrong size early.

use crate::EnvError;
use crate::objects::Prepared;
use crate::pool::env_episode::EnvEpisode;
use crate::pool::env_spec::EnvSpec;
use crate::starts::initial_state::InitialState;
use crate::state::{Goal, Mode, SceneKind};
use graspbox_episode::scene::OUT_OF_THE_WAY;
use graspbox_episode::{EpisodeError, ObjectSpec, Scene};
use graspbox_mesh::convex_hull;
use graspbox_render::Viewpoint;
use nalgebra::{Isometry3, Point3};
use std::sync::Arc;

/// Half side of the observed cube, metres.
const HALF: f64 = 0.025;
/// Its mass, kg.
const MASS: f64 = 0.1;

/// Reads every observation of `spec` for a cube on the table under the open hand, before any object of the pool is prepared.
///
/// # Errors
/// [`EnvError::WrongSize`] for a reader whose number of entries differs from its row; other errors for a hand or a physics setting that cannot
/// be simulated.
pub(crate) fn check_rows(spec: &EnvSpec) -> Result<(), EnvError> {
    let episode = EnvEpisode::new(&cube(spec)?, spec);
    let view = episode.view(spec);
    let mut out = Vec::new();
    spec.observations.iter().try_for_each(|observation| observation.read(&view, &mut out))
}

/// A cube on the table with the hand high above it; nothing is simulated.
fn cube(spec: &EnvSpec) -> Result<InitialState, EnvError> {
    let name = "the cube for the first observation";
    let side = |i: usize, axis: usize| if i >> axis & 1 == 0 { -HALF } else { HALF };
    let corners: Vec<_> = (0..8).map(|i| Point3::new(side(i, 0), side(i, 1), side(i, 2))).collect();
    let mesh = convex_hull(&corners).map_err(|source| EpisodeError::Mesh { object: name.to_owned(), source })?;
    let object = ObjectSpec { name: name.to_owned(), mesh, mass: Some(MASS), parts: Some(vec![corners]) };
    let prepared = Arc::new(Prepared::new(&object, None)?);
    let world_from_object = Isometry3::translation(0.0, 0.0, HALF);
    let (hand, physics, base) = (Arc::clone(spec.hand()), *spec.objects.physics(), Point3::new(0.0, 0.0, -HALF));
    let scene = Scene::placed(name, hand, prepared.body().model(), physics, &world_from_object, base)?;
    let cameras = spec.observer.mounted_cameras().iter().map(|camera| *camera.world_from_camera());
    let joints = spec.arm.as_ref().map(|arm| arm.robot.home());
    let away = Isometry3::translation(0.0, 0.0, OUT_OF_THE_WAY);
    Ok(InitialState {
        object: 0,
        prepared: vec![prepared],
        mode: Mode::of_one(spec.config.control, SceneKind::Single { resting: 0, dropped: false }),
        dropped: None,
        scene: Arc::new(scene),
        world_from_object,
        world_from_hand: spec.arm.as_ref().map_or(away, |arm| arm.robot.world_from_hand(&arm.robot.home())),
        joints,
        preshape: spec.hand().preshape_limits()[0],
        friction: 1.0,
        mass: 1.0,
        hand_error: Isometry3::identity(),
        viewpoint: Viewpoint { parent_from_camera: cameras.collect(), light: spec.observer.light() },
        goal: spec.config.goal.map(|goal| Goal::new(goal.task, [0.0; 3])),
    })
}
