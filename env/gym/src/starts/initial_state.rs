//! The initial state of an episode: sampled from the environment's stream, or set by options.
//!
//! Sampled, uniformly unless stated otherwise: the object; its resting pose, with the probability that a dropped object ends in it; its rotation
//! about the vertical, and its position within 5 cm of the table's middle. The hand is open, its grasp frame within 10 cm of the middle and
//! 0.15 to 0.30 m above the table, its palm facing down with a tilt of up to 0.2 rad, at any rotation about the vertical; if it collides with
//! the object, it is raised in steps of 5 cm. Before a decision it waits 0.35 m higher, with the whole pose rotated by 50 degrees to the side
//! about the table's middle: its palm faces the object, and it hides the object neither from the camera in front nor from one overhead.

use crate::EnvError;
use crate::actions::control::Control;
use crate::actions::workspace::{LOST_DISTANCE, LOST_HEIGHT};
use crate::config::Randomization;
use crate::objects::{Need, Prepared, RestingChoice};
use crate::pool::env_spec::EnvSpec;
use crate::starts::arm_start::HandStart;
use crate::starts::clutter::{ClutterSamples, check_options, scene_of};
use crate::starts::goal_samples::{Resting, goal};
use crate::starts::hand_placement::HandPlacement;
use crate::starts::initial_samples::InitialSamples;
use crate::starts::random_stream::RandomStream;
use crate::starts::reset_options::{ObjectChoice, ResetOptions, bad_option, factor, finite, rigid};
use crate::starts::scene_ahead::SceneAhead;
use crate::state::{ClearState, Goal, Mode, Placed, SceneKind, TargetScene};
use graspbox_arm::chain::Positions;
use graspbox_episode::scene::OUT_OF_THE_WAY;
use graspbox_episode::{Episode, Layout, Scene, SuccessCriterion};
use graspbox_mesh::TriMesh;
use graspbox_render::Viewpoint;
use graspbox_render::observer::viewpoint::Variation;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::sync::Arc;

/// Greatest height from which an object is dropped, metres.
const HIGHEST: f64 = 1.0;
/// Greatest depth of a requested object pose in the table, metres.
const SUNK: f64 = 1e-3;

/// The initial state of an episode.
pub struct InitialState {
    pub object: usize,
    /// The objects of the scene, in its order.
    pub prepared: Vec<Arc<Prepared>>,
    /// The mode before the first step.
    pub mode: Mode,
    /// Height of the object's centre of mass at rest, metres, if the object is dropped from a requested pose.
    pub dropped: Option<f64>,
    /// The object at rest.
    pub scene: Arc<Scene>,
    /// Pose of the object.
    pub world_from_object: Isometry3<f64>,
    /// Pose of the hand.
    pub world_from_hand: Isometry3<f64>,
    /// Positions of the joints of the arm that carries it.
    pub joints: Option<Positions>,
    /// Preshape, as one number.
    pub preshape: f64,
    /// Factor on the object's friction.
    pub friction: f64,
    /// Factor on the object's mass.
    pub mass: f64,
    /// The true hand in the arm's estimate of it.
    pub hand_error: Isometry3<f64>,
    /// Cameras and light.
    pub viewpoint: Viewpoint,
    /// The goal, in environments that have one.
    pub goal: Option<Goal>,
}

impl InitialState {
    /// The preparations that the initial state of [`InitialState::sample`] would need; the stream is unchanged.
    ///
    /// # Errors
    /// [`EnvError::UnknownObject`] or [`EnvError::NoSuchObject`].
    pub fn needs(spec: &EnvSpec, stream: &RandomStream, options: &ResetOptions) -> Result<Vec<Need>, EnvError> {
        let samples = InitialSamples::new(&mut stream.clone(), spec.objects.len());
        let model = !spec.observer.specs().is_empty();
        if let Some(layout) = &spec.config.clutter.layout {
            return Ok(ClutterSamples::new(&spec.config.clutter, layout, &samples, spec.objects.len()).needs(model));
        }
        let resting = options.resting.map_or(RestingChoice::Share(samples.resting), RestingChoice::Index);
        Ok(vec![Need { object: object_index(spec, &samples, options)?, resting: Some(resting), model }])
    }

    /// The samples of the scene of several objects with which the state of [`InitialState::sample`] would begin; the stream is unchanged.
    pub fn scene(spec: &EnvSpec, stream: &RandomStream) -> Option<(Layout, ClutterSamples)> {
        let layout = spec.config.clutter.layout?;
        let samples = InitialSamples::new(&mut stream.clone(), spec.objects.len());
        Some((layout, ClutterSamples::new(&spec.config.clutter, &layout, &samples, spec.objects.len())))
    }

    /// Samples an initial state; `options` replace sampled values.
    ///
    /// * `ahead`: a scene made in the background; it changes nothing.
    ///
    /// # Errors
    /// [`EnvError::BadOption`], or an error of an object that cannot be prepared.
    pub fn sample(
        spec: &EnvSpec,
        stream: &mut RandomStream,
        options: &ResetOptions,
        ahead: Option<&SceneAhead>,
    ) -> Result<Self, EnvError> {
        let vary = &spec.config.randomization;
        let samples = InitialSamples::new(stream, spec.objects.len());
        let mut start = match &spec.config.clutter.layout {
            Some(layout) => Start::of_many(spec, layout, &samples, options, ahead)?,
            None => Start::of_one(spec, &samples, options)?,
        };
        let preshape = checked_preshape(spec, options)?;
        let between = |[low, high]: [f64; 2], share: f64| low + (high - low) * share;
        let friction = factor(options.friction, between(vary.friction, samples.friction), "friction")?;
        let mass = factor(options.mass, between(vary.mass, samples.mass), "mass")?;
        let mut world_from_object = match spec.config.clutter.layout {
            Some(_) => *start.scene.world_from_object(),
            None => place_object(spec, &start.prepared[0], &start.scene, &samples, options)?,
        };
        let mut dropped = None;
        if options.world_from_object.is_some() {
            let (rests, height) = settled(&start.scene, &world_from_object, [friction, mass])?;
            dropped = Some(height);
            if spec.config.control.decides() {
                world_from_object = rests;
            }
        }
        if spec.config.control == Control::Clear {
            start.clear(spec, world_from_object)?;
        }
        let Start { object, scene, prepared, objects } = start;
        let resting = resting(&prepared[scene.target()], &scene, &world_from_object, dropped);
        let goal = goal(spec.config.goal.as_ref(), samples.viewpoint, &resting, options)?;
        let placement = HandPlacement {
            spec,
            object: scene.name(),
            obstacles: scene.obstacles_at(&world_from_object),
            world_from_object: &world_from_object,
        };
        let hand_error = hand_error(vary, &samples);
        let HandStart { world_from_hand, joints } =
            HandStart::new(&placement, &hand_error, (&prepared, &scene), (&samples, options, preshape))?;
        let scene_kind = |kind| Mode::of_one(spec.config.control, kind);
        let mode = match objects {
            StartObjects::Single { resting } => scene_kind(SceneKind::Single { resting, dropped: dropped.is_some() }),
            StartObjects::Target(target) => scene_kind(SceneKind::Target(target)),
            StartObjects::Cleared(objects) => Mode::Clear(ClearState::new(objects, world_from_hand)),
        };
        let viewpoint = sample_viewpoint(spec, options, samples.viewpoint)?;
        Ok(Self {
            object,
            prepared,
            mode,
            dropped,
            scene,
            world_from_object,
            world_from_hand,
            joints,
            preshape,
            friction,
            mass,
            hand_error,
            viewpoint,
            goal,
        })
    }
}

/// The true hand in the arm's estimate of it.
fn hand_error(vary: &Randomization, samples: &InitialSamples) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(samples.turn * vary.hand_rotation);
    Isometry3::from_parts(Translation3::from(samples.shift * vary.hand_position), turn)
}

/// A scene and its objects, with which an episode starts.
struct Start {
    object: usize,
    scene: Arc<Scene>,
    prepared: Vec<Arc<Prepared>>,
    objects: StartObjects,
}

/// Objects on the table at the start.
enum StartObjects {
    /// One object, in its resting pose.
    Single { resting: usize },
    /// A target among others.
    Target(TargetScene),
    /// Objects to be cleared.
    Cleared(Vec<Placed>),
}

impl Start {
    fn of_one(spec: &EnvSpec, samples: &InitialSamples, options: &ResetOptions) -> Result<Self, EnvError> {
        let (object, prepared) = choose_object(spec, samples, options)?;
        let (resting, scene) = choose_resting(spec, &prepared, samples, options)?;
        Ok(Self { object, scene, prepared: vec![prepared], objects: StartObjects::Single { resting } })
    }

    /// Makes a single object, at rest at its pose, a scene to be cleared.
    fn clear(&mut self, spec: &EnvSpec, world_from_object: Isometry3<f64>) -> Result<(), EnvError> {
        if let StartObjects::Single { .. } = self.objects {
            let placed = vec![Placed { slot: 0, object: self.object, scale: 1.0, world_from_object }];
            self.scene = scene_of(spec, &self.prepared, &placed, None)?;
            self.objects = StartObjects::Cleared(placed);
        }
        Ok(())
    }

    fn of_many(
        spec: &EnvSpec,
        layout: &Layout,
        samples: &InitialSamples,
        options: &ResetOptions,
        ahead: Option<&SceneAhead>,
    ) -> Result<Self, EnvError> {
        check_options(options)?;
        let sampled = ClutterSamples::new(&spec.config.clutter, layout, samples, spec.objects.len());
        let (prepared, placed) = SceneAhead::take(ahead, &spec.objects, layout, &sampled)?;
        if !spec.config.has_target() {
            let scene = scene_of(spec, &prepared, &placed, None)?;
            let object = placed[scene.target()].object;
            return Ok(Self { object, scene, prepared, objects: StartObjects::Cleared(placed) });
        }
        let found = sampled.target_among(placed);
        let scene = scene_of(spec, &prepared, &found.objects, Some(found.target as usize))?;
        let object = found.objects[scene.target()].object;
        Ok(Self { object, scene, prepared, objects: StartObjects::Target(found) })
    }
}

/// The heights of the object at rest.
fn resting(prepared: &Prepared, scene: &Scene, world_from_object: &Isometry3<f64>, dropped: Option<f64>) -> Resting {
    let vertices = prepared.body().mesh().vertices().iter();
    let top = vertices.map(|v| (world_from_object * v).z).fold(0.0, f64::max);
    Resting { center: dropped.unwrap_or_else(|| (world_from_object * scene.center_of_mass()).z), top }
}

/// Cameras and light: poses from the options are not varied, the others are.
fn sample_viewpoint(spec: &EnvSpec, options: &ResetOptions, seed: u64) -> Result<Viewpoint, EnvError> {
    let vary = &spec.config.randomization;
    let variation =
        Variation { camera_position: vary.camera_position, camera_rotation: vary.camera_rotation, light: vary.light };
    let given = options.cameras.iter().map(|(name, rows)| {
        let known = spec.config.cameras.cameras.iter().position(|camera| camera.name == *name);
        let unknown = || bad_option("cameras", format!("there is no camera {name:?}"));
        Ok((known.ok_or_else(unknown)?, rigid(rows, "cameras")?))
    });
    let given = given.collect::<Result<Vec<_>, EnvError>>()?;
    let mut stream = RandomStream::new(seed);
    let (cameras, light) = (spec.observer.mounted_cameras(), spec.observer.light());
    Ok(Viewpoint::sample(cameras, light, &variation, &given, || stream.sample_within(1.0)))
}

fn choose_object(
    spec: &EnvSpec,
    samples: &InitialSamples,
    options: &ResetOptions,
) -> Result<(usize, Arc<Prepared>), EnvError> {
    let object = object_index(spec, samples, options)?;
    Ok((object, spec.objects.prepared(object)?))
}

fn object_index(spec: &EnvSpec, samples: &InitialSamples, options: &ResetOptions) -> Result<usize, EnvError> {
    match &options.object {
        None => Ok(samples.object),
        Some(ObjectChoice::Index(index)) => Ok(*index),
        Some(ObjectChoice::Name(name)) => {
            let found = spec.objects.names().position(|n| n == name);
            found.ok_or_else(|| EnvError::UnknownObject { name: name.clone() })
        }
    }
}

fn choose_resting(
    spec: &EnvSpec,
    prepared: &Prepared,
    samples: &InitialSamples,
    options: &ResetOptions,
) -> Result<(usize, Arc<Scene>), EnvError> {
    let (name, count) = (prepared.body().name(), prepared.probabilities().len());
    let wanted = match options.resting {
        Some(resting) if resting >= count => {
            let why = format!(
                "there is no resting pose {resting}: object `{name}` has {count} resting poses, counted from 0"
            );
            return Err(bad_option("resting", why));
        }
        Some(resting) => resting,
        None => prepared.resting(RestingChoice::Share(samples.resting)),
    };
    let (resting, scene) = spec.objects.scene(prepared, wanted)?;
    if options.resting.is_some() && resting != wanted {
        return Err(bad_option("resting", format!("object `{name}` does not come to rest in pose {wanted}")));
    }
    Ok((resting, scene))
}

fn checked_preshape(spec: &EnvSpec, options: &ResetOptions) -> Result<f64, EnvError> {
    let [low, high] = spec.hand().preshape_limits();
    let preshape = options.preshape.unwrap_or(low);
    if (low..=high).contains(&preshape) {
        Ok(preshape)
    } else {
        let unit = spec.hand().preshape_unit();
        Err(bad_option("preshape", format!("{preshape} is out of range; the hand takes {low} to {high} {unit}")))
    }
}

/// The pose at which the object rests, or from which it is dropped.
fn place_object(
    spec: &EnvSpec,
    prepared: &Prepared,
    scene: &Scene,
    samples: &InitialSamples,
    options: &ResetOptions,
) -> Result<Isometry3<f64>, EnvError> {
    let vary = &spec.config.randomization;
    let moved = |i: usize| samples.place[i] + samples.moved[i] * vary.object_position;
    let (option, pose) = match (&options.world_from_object, &options.place) {
        (Some(_), Some(_)) => return Err(bad_option("place", "give it or world_from_object, not both")),
        (Some(_), None) if options.resting.is_some() => {
            return Err(bad_option("resting", "give it or world_from_object, not both"));
        }
        (Some(rows), None) => ("world_from_object", given_object(prepared, rows)?),
        (None, Some([x, y, turn])) => {
            let [x, y, turn] = [finite(*x, "place")?, finite(*y, "place")?, finite(*turn, "place")?];
            ("place", planar(x, y, turn) * scene.world_from_object())
        }
        (None, None) => return Ok(planar(moved(0), moved(1), samples.place[2]) * scene.world_from_object()),
    };
    let center = pose * scene.center_of_mass();
    if center.coords.xy().norm() > LOST_DISTANCE || center.z > HIGHEST {
        let [x, y, z] = [center.x, center.y, center.z];
        let why = format!(
            "the object's centre of mass would be at {x:.3}, {y:.3}, {z:.3} m; keep it within {LOST_DISTANCE} m of the table's middle \
             and {HIGHEST} m above the table"
        );
        return Err(bad_option(option, why));
    }
    Ok(pose)
}

/// The scene of an object dropped from `world_from_object` without a hand, and the height of its centre of mass at rest, metres.
fn settled(
    scene: &Arc<Scene>,
    world_from_object: &Isometry3<f64>,
    factors: [f64; 2],
) -> Result<(Isometry3<f64>, f64), EnvError> {
    let away = Isometry3::translation(0.0, 0.0, OUT_OF_THE_WAY);
    let preshape = scene.template().hand().preshape_limits()[0];
    let mut alone = Episode::reset_at(scene, &away, world_from_object, preshape, factors, SuccessCriterion::default());
    alone.rest()?;
    let (world, option) = (alone.world(), "world_from_object");
    let center = world.object_center();
    if !world.is_finite() || center.z < LOST_HEIGHT {
        return Err(bad_option(option, "dropped there, the object falls off the table"));
    }
    if center.coords.xy().norm() > LOST_DISTANCE {
        return Err(bad_option(option, format!("dropped there, the object leaves the workspace of {LOST_DISTANCE} m")));
    }
    Ok((world.world_from_object(), center.z))
}

/// A motion on the table: x, y (m), rotation about the vertical (rad).
fn planar(x: f64, y: f64, turn: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::new(x, y, 0.0), UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn))
}

fn given_object(prepared: &Prepared, rows: &[[f64; 4]; 4]) -> Result<Isometry3<f64>, EnvError> {
    let pose = rigid(rows, "world_from_object")?;
    let mesh: &TriMesh = prepared.body().mesh();
    let lowest = mesh.vertices().iter().map(|v| (pose * v).z).fold(f64::INFINITY, f64::min);
    if lowest < -SUNK {
        return Err(bad_option("world_from_object", format!("the object would reach {:.4} m into the table", -lowest)));
    }
    Ok(pose)
}
