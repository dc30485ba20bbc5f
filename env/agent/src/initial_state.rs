//! How an episode begins: drawn from the environment's stream, or as asked.
//!
//! Drawn, uniformly unless said otherwise: the object; its resting pose, by the chance that a dropped object ends in it; its turn about
//! the vertical and its place within 5 cm of the table's middle. The hand is open, its grasp frame within 10 cm of the middle and
//! 0.15 to 0.30 m above the table, its palm facing down but for a tilt of up to 0.2 rad, turned about the vertical by any angle; where it
//! would stand in the object it is raised in steps of 5 cm. Before a decision it waits [`WAITING_DISTANCE`] higher and all of that tipped
//! to the side by [`WAITING_ANGLE`] about the table's middle: its palm faces the object, which it hides neither from the camera in front
//! nor from one overhead. Every start takes the same number of draws, so that an option or a randomisation changes nothing but what it
//! names.

use crate::AgentError;
use crate::agent_episode::LOST_HEIGHT;
use crate::env_spec::{EnvSpec, open_hand};
use crate::guard::{WORKSPACE_HIGH, WORKSPACE_LOW};
use crate::objects::Prepared;
use crate::random_stream::RandomStream;
use graspbox_episode::scene::OUT_OF_THE_WAY;
use graspbox_episode::{Episode, Scene, SuccessCriterion};
use graspbox_mesh::TriMesh;
use graspbox_plan::{CollisionScene, OpenHand};
use graspbox_sim::scenery::TABLE_SIDE;
use graspbox_vision::Viewpoint;
use nalgebra::{Isometry3, Matrix3, Matrix4, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::Arc;

/// The object lies within this of the table's middle in x and y, metres.
pub const OBJECT_SPREAD: f64 = 0.05;
/// The hand begins within this of the table's middle in x and y, metres.
pub const HAND_SPREAD: f64 = 0.10;
/// Least and greatest height of the grasp frame at the start, metres.
pub const HAND_HEIGHT: [f64; 2] = [0.15, 0.30];
/// Before a decision the hand waits so much further from the table's middle, metres.
pub const WAITING_DISTANCE: f64 = 0.35;
/// It is tipped by this about the world's x axis then, from above the middle towards +y, radians (50 degrees).
pub const WAITING_ANGLE: f64 = 0.873;
/// An object is let go no higher than this; before a decision the hand waits no further away, along any axis, metres.
const HIGHEST: f64 = 1.0;
/// Greatest angle between the palm's normal and straight down at the start, radians.
pub const HAND_TILT: f64 = 0.2;
/// The hand is raised by this much at a time while it stands in the object, metres.
const RAISE: f64 = 0.05;
/// More raises than this would leave the workspace.
const MOST_RAISES: usize = 10;
/// A rotation may be off by this much in any entry of R^T R.
const ORTHONORMAL: f64 = 1e-5;
/// A given object pose may reach this far into the table, metres.
const SUNK: f64 = 1e-3;

/// Which object.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged, expecting = "give the index or the name of an object")]
pub enum ObjectChoice {
    /// By its place in the list.
    Index(usize),
    /// By its name.
    Name(String),
}

/// What of a start is given; the rest is drawn. Matrices are rows, homogeneous.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ResetOptions {
    /// The object.
    pub object: Option<ObjectChoice>,
    /// Its resting pose: an index, the most probable first.
    pub resting: Option<usize>,
    /// Its place: x, y (m) and turn about the vertical (rad) of the resting pose.
    pub place: Option<[f64; 3]>,
    /// Its pose; it is let go there.
    pub world_from_object: Option<[[f64; 4]; 4]>,
    /// The hand's pose.
    pub world_from_hand: Option<[[f64; 4]; 4]>,
    /// The preshape, radians.
    pub preshape: Option<f64>,
    /// Factor on the object's friction.
    pub friction: Option<f64>,
    /// Factor on the object's mass.
    pub mass: Option<f64>,
    /// Poses of cameras by name, in the frame of what carries them.
    pub cameras: BTreeMap<String, [[f64; 4]; 4]>,
}

/// Where an episode begins.
pub struct InitialState {
    /// Index of the object.
    pub object: usize,
    /// Index of its resting pose.
    pub resting: usize,
    /// The object.
    pub prepared: Arc<Prepared>,
    /// The object was let go where it was asked to be: the height of its centre of mass once it rests, metres.
    pub dropped: Option<f64>,
    /// The object as it rests.
    pub scene: Arc<Scene>,
    /// Where it lies.
    pub world_from_object: Isometry3<f64>,
    /// Where the hand is.
    pub world_from_hand: Isometry3<f64>,
    /// Preshape, radians.
    pub preshape: f64,
    /// Factor on the object's friction.
    pub friction: f64,
    /// Factor on the object's mass.
    pub mass: f64,
    /// The true hand in the hand that the arm knows.
    pub hand_error: Isometry3<f64>,
    /// Cameras and light.
    pub viewpoint: Viewpoint,
}

/// All numbers that a start draws, in order.
struct Drawn {
    object: usize,
    resting: f64,
    place: [f64; 3],
    hand: [f64; 3],
    yaw: f64,
    tilt: [f64; 2],
    friction: f64,
    mass: f64,
    moved: [f64; 2],
    shift: Vector3<f64>,
    turn: Vector3<f64>,
    viewpoint: u64,
}

impl Drawn {
    fn new(stream: &mut RandomStream, count: usize) -> Self {
        let three = |stream: &mut RandomStream| {
            Vector3::new(stream.sample_within(1.0), stream.sample_within(1.0), stream.sample_within(1.0))
        };
        Self {
            object: stream.sample_index(count),
            resting: stream.sample_unit(),
            place: [stream.sample_within(OBJECT_SPREAD), stream.sample_within(OBJECT_SPREAD), stream.sample_within(PI)],
            hand: [
                stream.sample_within(HAND_SPREAD),
                stream.sample_within(HAND_SPREAD),
                stream.sample_range(HAND_HEIGHT[0], HAND_HEIGHT[1]),
            ],
            yaw: stream.sample_within(PI),
            tilt: [stream.sample_within(PI), stream.sample_range(0.0, HAND_TILT)],
            friction: stream.sample_unit(),
            mass: stream.sample_unit(),
            moved: [stream.sample_within(1.0), stream.sample_within(1.0)],
            shift: three(stream),
            turn: three(stream),
            viewpoint: stream.sample_seed(),
        }
    }
}

/// Draws a start; what `options` gives is taken from there.
///
/// # Errors
/// An option that cannot be, or an object that cannot be prepared.
pub fn start(spec: &EnvSpec, stream: &mut RandomStream, options: &ResetOptions) -> Result<InitialState, AgentError> {
    let vary = &spec.config.randomization;
    let drawn = Drawn::new(stream, spec.objects.len());
    let (object, prepared) = choose_object(spec, &drawn, options)?;
    let (resting, scene) = choose_resting(spec, &prepared, &drawn, options)?;
    let preshape = checked_preshape(spec, options)?;
    let between = |[low, high]: [f64; 2], share: f64| low + (high - low) * share;
    let friction = factor(options.friction, between(vary.friction, drawn.friction), "friction")?;
    let mass = factor(options.mass, between(vary.mass, drawn.mass), "mass")?;
    let mut world_from_object = place_object(spec, &prepared, &scene, &drawn, options)?;
    let mut dropped = None;
    if options.world_from_object.is_some() {
        let (rests, height) = settled(&scene, &world_from_object, [friction, mass])?;
        dropped = Some(height);
        if spec.config.control.decides() {
            world_from_object = rests;
        }
    }
    let room = Room {
        spec,
        name: scene.name(),
        obstacles: scene.obstacles_at(&world_from_object),
        world_from_object: &world_from_object,
    };
    let world_from_hand = room.place_hand(&drawn, options, preshape)?;
    let hand_error = Isometry3::from_parts(
        Translation3::from(drawn.shift * vary.hand_position),
        UnitQuaternion::from_scaled_axis(drawn.turn * vary.hand_rotation),
    );
    Ok(InitialState {
        object,
        resting,
        prepared,
        dropped,
        scene,
        world_from_object,
        world_from_hand,
        preshape,
        friction,
        mass,
        hand_error,
        viewpoint: sample_viewpoint(spec, options, drawn.viewpoint)?,
    })
}

/// Cameras and light: poses that the options give are taken as they are, the rest varies.
fn sample_viewpoint(spec: &EnvSpec, options: &ResetOptions, seed: u64) -> Result<Viewpoint, AgentError> {
    let vary = &spec.config.randomization;
    let variation = graspbox_vision::viewpoint::Variation {
        camera_position: vary.camera_position,
        camera_rotation: vary.camera_rotation,
        light: vary.light,
    };
    let given = options.cameras.iter().map(|(name, rows)| {
        let known = spec.config.cameras.cameras.iter().position(|camera| camera.name == *name);
        let why = || AgentError::BadOption { option: "cameras", why: format!("there is no camera {name:?}") };
        Ok((known.ok_or_else(why)?, rigid(rows, "cameras")?))
    });
    let given = given.collect::<Result<Vec<_>, AgentError>>()?;
    let mut stream = RandomStream::new(seed);
    Ok({
        let (cameras, light) = (spec.observer.mounted_cameras(), spec.observer.light());
        Viewpoint::sample(cameras, light, &variation, &given, || stream.sample_within(1.0))
    })
}

fn choose_object(spec: &EnvSpec, drawn: &Drawn, options: &ResetOptions) -> Result<(usize, Arc<Prepared>), AgentError> {
    let objects = &spec.objects;
    let object = match &options.object {
        None => drawn.object,
        Some(ObjectChoice::Index(index)) => *index,
        Some(ObjectChoice::Name(name)) => {
            objects.names().position(|n| n == name).ok_or_else(|| AgentError::UnknownObject { name: name.clone() })?
        }
    };
    Ok((object, objects.prepared(object)?))
}

fn choose_resting(
    spec: &EnvSpec,
    prepared: &Prepared,
    drawn: &Drawn,
    options: &ResetOptions,
) -> Result<(usize, Arc<Scene>), AgentError> {
    let (name, resting_poses) = (prepared.body().name(), prepared.probabilities().len());
    let wanted = match options.resting {
        Some(resting) if resting >= resting_poses => {
            let why = format!("object `{name}` has {resting_poses} resting poses, counted from 0");
            return Err(bad_option("resting", &why));
        }
        Some(resting) => resting,
        None => weighted(drawn.resting, prepared.probabilities()),
    };
    let (resting, scene) = spec.objects.scene(prepared, wanted)?;
    if options.resting.is_some() && resting != wanted {
        let why = format!("object `{name}` does not come to rest in pose {wanted}");
        return Err(bad_option("resting", &why));
    }
    Ok((resting, scene))
}

fn checked_preshape(spec: &EnvSpec, options: &ResetOptions) -> Result<f64, AgentError> {
    let [low, high] = spec.hand().preshape_limits;
    let preshape = options.preshape.unwrap_or(low);
    if (low..=high).contains(&preshape) {
        Ok(preshape)
    } else {
        Err(bad_option("preshape", &format!("the hand takes {low} to {high} rad")))
    }
}

/// Where the object lies, or is let go.
fn place_object(
    spec: &EnvSpec,
    prepared: &Prepared,
    scene: &Scene,
    drawn: &Drawn,
    options: &ResetOptions,
) -> Result<Isometry3<f64>, AgentError> {
    let vary = &spec.config.randomization;
    let moved = |i: usize| drawn.place[i] + drawn.moved[i] * vary.object_position;
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
        (None, None) => return Ok(planar(moved(0), moved(1), drawn.place[2]) * scene.world_from_object()),
    };
    let center = pose * scene.center_of_mass();
    let edge = TABLE_SIDE / 2.0;
    if center.x.abs() > edge || center.y.abs() > edge || center.z > HIGHEST {
        let [x, y, z] = [center.x, center.y, center.z];
        let why = format!(
            "the object's centre of mass would be at {x:.3}, {y:.3}, {z:.3} m; keep it over the table, which ends {edge} m from its middle, \
             and within {HIGHEST} m above it"
        );
        return Err(bad_option(option, &why));
    }
    Ok(pose)
}

/// Where an object that is let go at `world_from_object` comes to rest, were there no hand, and how high its centre of mass is then, metres.
fn settled(
    scene: &Arc<Scene>,
    world_from_object: &Isometry3<f64>,
    factors: [f64; 2],
) -> Result<(Isometry3<f64>, f64), AgentError> {
    let away = Isometry3::translation(0.0, 0.0, OUT_OF_THE_WAY);
    let mut alone = Episode::reset_at(scene, &away, world_from_object, 0.0, factors, SuccessCriterion::default());
    alone.rest()?;
    let world = alone.world();
    if !world.is_finite() || world.object_center().z < LOST_HEIGHT {
        return Err(bad_option("world_from_object", "let go there, the object falls off the table"));
    }
    Ok((world.world_from_object(), world.object_center().z))
}

fn bad_option(option: &'static str, why: &str) -> AgentError {
    AgentError::BadOption { option, why: why.to_owned() }
}

fn finite(value: f64, option: &'static str) -> Result<f64, AgentError> {
    if value.is_finite() { Ok(value) } else { Err(bad_option(option, "give finite numbers")) }
}

fn factor(given: Option<f64>, drawn: f64, option: &'static str) -> Result<f64, AgentError> {
    let factor = given.unwrap_or(drawn);
    if (0.01..=100.0).contains(&factor) {
        Ok(factor)
    } else {
        Err(bad_option(option, "give a factor between 0.01 and 100"))
    }
}

/// The index at `share` of the summed weights.
fn weighted(share: f64, weights: impl ExactSizeIterator<Item = f64> + Clone) -> usize {
    let last = weights.len().saturating_sub(1);
    let mut left = share * weights.clone().sum::<f64>();
    for (index, weight) in weights.enumerate() {
        if left < weight {
            return index;
        }
        left -= weight;
    }
    last
}

/// A move on the table: x, y (m), turn about the vertical (rad).
fn planar(x: f64, y: f64, turn: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::new(x, y, 0.0), UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn))
}

fn given_object(prepared: &Prepared, rows: &[[f64; 4]; 4]) -> Result<Isometry3<f64>, AgentError> {
    let pose = rigid(rows, "world_from_object")?;
    let mesh: &TriMesh = prepared.body().mesh();
    let lowest = mesh.vertices().iter().map(|v| (pose * v).z).fold(f64::INFINITY, f64::min);
    if lowest < -SUNK {
        return Err(bad_option(
            "world_from_object",
            &format!("the object would reach {:.4} m into the table", -lowest),
        ));
    }
    Ok(pose)
}

/// Where the hand may stand.
struct Room<'a> {
    spec: &'a EnvSpec,
    /// Of the object.
    name: &'a str,
    /// Object and table; none where nothing is in the resting.
    obstacles: Option<CollisionScene>,
    world_from_object: &'a Isometry3<f64>,
}

impl Room<'_> {
    /// The hand where it was asked to be, or where it was drawn, raised out of the object.
    fn place_hand(&self, drawn: &Drawn, options: &ResetOptions, preshape: f64) -> Result<Isometry3<f64>, AgentError> {
        let hand = self.spec.hand();
        let other;
        let open = if preshape == hand.preshape_limits[0] {
            &self.spec.open
        } else {
            other = open_hand(hand, preshape)?;
            &other
        };
        if let Some(rows) = &options.world_from_hand {
            return self.given_hand(rows, open);
        }
        let mut hand = self.drawn_hand(drawn);
        for _ in 0..MOST_RAISES {
            if !self.collides(open, &hand) {
                return Ok(hand);
            }
            hand.translation.vector.z += RAISE;
        }
        Err(AgentError::NoStart { object: self.name.to_owned() })
    }

    fn collides(&self, open: &OpenHand, world_from_hand: &Isometry3<f64>) -> bool {
        let object_from_hand = self.world_from_object.inverse() * world_from_hand;
        self.obstacles.as_ref().is_some_and(|o| o.collides(open, &object_from_hand))
    }

    fn given_hand(&self, rows: &[[f64; 4]; 4], open: &OpenHand) -> Result<Isometry3<f64>, AgentError> {
        let hand = rigid(rows, "world_from_hand")?;
        let [low, high] = if self.spec.config.control.decides() {
            [[-HIGHEST, -HIGHEST, 0.0], [HIGHEST; 3]]
        } else {
            [WORKSPACE_LOW, WORKSPACE_HIGH]
        };
        let place = &hand.translation.vector;
        if (0..3).any(|i| !(low[i]..=high[i]).contains(&place[i])) {
            let why = format!("the hand has to be between {low:?} and {high:?} m");
            return Err(bad_option("world_from_hand", &why));
        }
        if self.collides(open, &hand) {
            let why = format!("the open hand would stand within 1 cm of the table or of object `{}`", self.name);
            return Err(bad_option("world_from_hand", &why));
        }
        Ok(hand)
    }

    fn drawn_hand(&self, drawn: &Drawn) -> Isometry3<f64> {
        let axis = Unit::new_unchecked(Vector3::new(drawn.tilt[0].cos(), drawn.tilt[0].sin(), 0.0));
        let rotation = UnitQuaternion::from_axis_angle(&axis, drawn.tilt[1])
            * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), drawn.yaw)
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
        let above = Isometry3::from_parts(Translation3::from(Vector3::from(drawn.hand)), rotation);
        if self.spec.config.control.decides() {
            let aside = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -WAITING_ANGLE);
            aside * Translation3::new(0.0, 0.0, WAITING_DISTANCE) * above
        } else {
            above
        }
    }
}

/// The rigid motion of a homogeneous matrix.
pub(crate) fn rigid(rows: &[[f64; 4]; 4], option: &'static str) -> Result<Isometry3<f64>, AgentError> {
    let matrix = Matrix4::from_fn(|i, j| rows[i][j]);
    let rotation: Matrix3<f64> = matrix.fixed_view::<3, 3>(0, 0).into();
    let skew = (rotation.tr_mul(&rotation) - Matrix3::identity()).amax();
    let bottom = (0..4).any(|j| (rows[3][j] - if j == 3 { 1.0 } else { 0.0 }).abs() > ORTHONORMAL);
    let finite = rows.iter().flatten().all(|x| x.is_finite());
    if !finite || bottom || skew > ORTHONORMAL || rotation.determinant() < 0.0 {
        return Err(bad_option(
            option,
            "give a homogeneous matrix: a rotation, a translation column, the last row 0 0 0 1",
        ));
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Ok(Isometry3::from_parts(Translation3::new(rows[0][3], rows[1][3], rows[2][3]), rotation))
}
