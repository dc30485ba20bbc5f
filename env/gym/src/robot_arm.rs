//! The arm that carries the hand: at its place, with what it must keep away from, and its models for images.

use crate::EnvError;
use crate::actions::arm_controller::{ANGULAR_ACCELERATION, LINEAR_ACCELERATION, Limits};
use crate::actions::workspace::BASE_DISTANCE;
use crate::pool::env_spec::EnvSpec;
use graspbox_arm::chain::{Frames, MAX_AXES, Positions};
use graspbox_arm::path::Phase;
use graspbox_arm::reach::Reacher;
use graspbox_arm::{
    ArmBodies, Carried, Follower, Inverse, Path, PathParams, ReachParams, Robot, Room, Scene, Task, Thing,
};
use graspbox_arm::{carrier, check_payload, path, reach};
use graspbox_episode::trial::TrialConfig;
use graspbox_hand::{Arm, Hand, Shape};
use graspbox_mesh::TriMesh;
use graspbox_mesh::range::is_pose;
use graspbox_plan::Obstacle;
use graspbox_render::labels::arm_label;
use graspbox_render::{Model, ObjectPose, RenderError, shapes};
use graspbox_sim::Wall;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::PI;
use std::sync::Arc;

/// Distance that links keep from each other, the table and walls, metres.
pub const LINK_CLEARANCE: f64 = 0.005;
/// Distance that they keep in the posture in which an episode begins, metres.
const START_CLEARANCE: f64 = 0.01;
/// Farthest base from the table's middle, metres.
const FARTHEST: f64 = 10.0;
/// Distance from an axis at which its acceleration counts as one of the hand, metres: rather too short, so that the hand brakes early.
const LEVER: f64 = 0.3;
/// Sides of a cylinder or ball of a link in images.
const COLUMNS: usize = 32;
/// Colour of the links, and of the base.
pub const LINK_COLOR: [f32; 3] = [0.88, 0.88, 0.86];
pub const BASE_COLOR: [f32; 3] = [0.40, 0.42, 0.45];

/// An object's shape and its pose in the world.
pub type PlacedObstacle = (Arc<Obstacle>, Isometry3<f64>);

/// The end of a path: the posture at the grasp, and those of the lift after it.
pub struct Way {
    pub grasp: Positions,
    lift: Vec<Positions>,
}

impl Way {
    /// The posture of the lift at which the hand is at a height, metres, or the nearest to it.
    ///
    /// Between two postures the hand moves straight, if the axes do.
    pub fn at(&self, height: f64, robot: &RobotArm) -> Positions {
        let z = |positions: &Positions| robot.world_from_hand(positions).translation.z;
        let mut before = &self.grasp;
        for after in &self.lift {
            let [low, high] = [z(before), z(after)];
            if height <= high {
                let share = ((height - low) / (high - low).max(f64::EPSILON)).clamp(0.0, 1.0);
                return std::array::from_fn(|axis| before[axis] + share * (after[axis] - before[axis]));
            }
            before = after;
        }
        *before
    }
}

/// An arm at its place, with the hand on it.
pub struct RobotArm {
    pub arm: Arc<Arm>,
    pub inverse: Inverse,
    pub bodies: ArmBodies,
    pub world_from_base: Isometry3<f64>,
    /// The hand's base on the flange.
    flange_from_base: Isometry3<f64>,
    /// The grasp frame on the flange.
    pub flange_from_hand: Isometry3<f64>,
}

impl std::fmt::Debug for RobotArm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "RobotArm({:?})", self.arm.name)
    }
}

impl RobotArm {
    /// Puts a hand on an arm; returns also the hand as the simulation sees it.
    ///
    /// * `world_from_base`: by default behind the table's middle, facing it ([`BASE_DISTANCE`]).
    ///
    /// # Errors
    /// [`EnvError::Arm`] for a hand that is too heavy or mounted in the arm, and for a base under the table; [`EnvError::OutOfRange`] for one too far.
    pub fn new(
        arm: Arc<Arm>,
        hand: &Hand,
        world_from_base: Option<Isometry3<f64>>,
    ) -> Result<(Self, Arc<Hand>), EnvError> {
        check_payload(&arm, hand)?;
        let inverse = Inverse::new(&arm);
        let bodies = ArmBodies::new(&arm, inverse.chain());
        let behind = Translation3::new(BASE_DISTANCE * inverse.chain().length(), 0.0, 0.0);
        let facing = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
        let world_from_base = world_from_base.unwrap_or_else(|| Isometry3::from_parts(behind, facing));
        is_pose("base", &world_from_base, FARTHEST)?;
        // Checks the height of the base.
        Scene::new(world_from_base, &[], Vec::new(), LINK_CLEARANCE, 0.0)?;
        let flange_from_base = arm.flange_from_base_of(hand);
        let own = carrier(&arm, inverse.chain(), &bodies, hand, &flange_from_base);
        let flange_from_hand = flange_from_base * hand.base_from_hand;
        let carried = Arc::new(Hand { carrier: Some(Arc::new(own)), ..hand.clone() });
        Ok((Self { arm, inverse, bodies, world_from_base, flange_from_base, flange_from_hand }, carried))
    }

    /// The grasp frame in the world at positions of the axes, by forward kinematics.
    #[must_use]
    pub fn world_from_hand(&self, positions: &Positions) -> Isometry3<f64> {
        self.world_from_hand_at(&self.inverse.chain().frames(positions))
    }

    /// The same from the frames of the axes.
    #[must_use]
    pub fn world_from_hand_at(&self, frames: &Frames) -> Isometry3<f64> {
        self.world_from_base * frames.flange.isometry() * self.flange_from_hand
    }

    /// Positions at home.
    #[must_use]
    pub fn home(&self) -> Positions {
        self.inverse.positions_of(&self.arm.home())
    }
}

/// What all environments of a pool share about their arm.
pub struct ArmSpec {
    pub robot: Arc<RobotArm>,
    pub follower: Follower,
    pub room: Room,
    /// Limits of the hand's motion in space, from those of the axes.
    pub limits: Limits,
    walls: Vec<Wall>,
    /// For each body, base first, its render model, if it has shapes.
    pub models: Vec<Option<Model>>,
}

impl ArmSpec {
    /// * `walls`: of every scene.
    ///
    /// # Errors
    /// [`EnvError::Arm`] for a hand mounted in the arm; [`EnvError::ArmInTheWay`] if the arm touches something at home; [`EnvError::Render`] for a
    /// link that cannot be rendered.
    pub fn new(robot: &Arc<RobotArm>, hand: &Hand, walls: &[Wall]) -> Result<Self, EnvError> {
        let RobotArm { arm, inverse, bodies, world_from_base, flange_from_base, .. } = &**robot;
        let chain = inverse.chain();
        let preshape = hand.preshape_limits()[0];
        let carried = Carried::new(arm, chain, bodies, hand, preshape, flange_from_base)?;
        let boxes: Vec<_> = walls.iter().map(|wall| (wall.half, wall.world_from_wall)).collect();
        let room = Room::new(chain, bodies, carried, *world_from_base, &boxes);
        let follower = Follower::new(arm, chain.clone());
        let least = (0..chain.len()).map(|axis| follower.acceleration(axis)).fold(f64::INFINITY, f64::min);
        let limits =
            Limits { linear: LINEAR_ACCELERATION.min(LEVER * least), angular: ANGULAR_ACCELERATION.min(least) };
        let models = (0..bodies.count()).map(|body| model(&bodies.shapes(body))).collect::<Result<_, _>>();
        let object = || format!("the arm {}", arm.name);
        let models = models.map_err(|source: RenderError| EnvError::NotRenderable { object: object(), source })?;
        let made = Self { robot: Arc::clone(robot), follower, room, limits, walls: walls.to_vec(), models };
        if made.room.measure(&chain.frames(&robot.home())) < LINK_CLEARANCE {
            return Err(EnvError::ArmInTheWay {
                arm: arm.name.clone(),
                base: robot.world_from_base.translation.vector.into(),
            });
        }
        Ok(made)
    }

    /// A posture in which the open hand is at a pose and the arm touches nothing; else the reason in words.
    ///
    /// * `world_from_hand`: as forward kinematics has it.
    /// * `max_angle`: greatest angle to the rotation for an arm with fewer than six axes, rad.
    /// * `objects`: with their poses in the world.
    ///
    /// # Errors
    /// As [`reach()`].
    pub fn posture(
        &self,
        hand: &Hand,
        world_from_hand: &Isometry3<f64>,
        preshape: f64,
        max_angle: f64,
        objects: Vec<PlacedObstacle>,
    ) -> Result<Result<Positions, String>, EnvError> {
        let RobotArm { arm, inverse, bodies, flange_from_base, .. } = &*self.robot;
        let params = ReachParams { clearance: START_CLEARANCE, max_angle, ..ReachParams::default() };
        let scene = self.scene(objects, params.clearance)?;
        let reacher = Reacher { arm, inverse, bodies, scene: &scene, params };
        let answers = reach(&reacher, hand, flange_from_base, &[(*world_from_hand, preshape)])?;
        let Some(answer) = answers.into_iter().next() else { return Ok(Err(String::new())) };
        let roomy = |positions: &Positions| self.room.measure(&inverse.chain().frames(positions)) >= START_CLEARANCE;
        let found = answer.solutions.iter().map(|solution| solution.positions).find(roomy);
        Ok(found.ok_or_else(|| match answer.solutions.is_empty() {
            true => answer.reason.sentence(arm, bodies, &[]),
            false => "the arm would be too near itself, the table or a wall".to_owned(),
        }))
    }

    /// Plans a path from `start` to a grasp of an object, and up with it; `None` without one.
    ///
    /// * `world_from_hand`, `preshape`: the grasp, as forward kinematics has it.
    /// * `objects`: with their poses in the world; `object` is the index of the one that is grasped.
    ///
    /// # Errors
    /// As [`path()`].
    pub fn way(
        &self,
        hand: &Hand,
        start: &Positions,
        (world_from_hand, preshape): (&Isometry3<f64>, f64),
        (mut objects, object): (Vec<PlacedObstacle>, usize),
        trial: &TrialConfig,
    ) -> Result<Option<Way>, EnvError> {
        let RobotArm { arm, inverse, bodies, flange_from_base, .. } = &*self.robot;
        let [standoff, lift] = [trial.standoff, trial.lift_height].map(|length| length.clamp(0.001, 1.0));
        let params = PathParams { standoff, lift, ..PathParams::default() };
        let (obstacle, world_from_thing) = objects.swap_remove(object);
        let scene = self.scene(objects, params.reach.clearance)?;
        let mut accelerations = [0.0; MAX_AXES];
        let all = accelerations.iter_mut().enumerate().take(inverse.chain().len());
        all.for_each(|(axis, own)| *own = self.follower.acceleration(axis));
        let flange_from_base = *flange_from_base;
        let robot = Robot { arm, inverse, bodies, hand, flange_from_base, accelerations };
        let thing = Some(Thing { obstacle, world_from_thing, place: None });
        let task = Task { start: *start, world_from_hand: *world_from_hand, preshape, thing };
        let Ok(Path { pieces }) = path(&robot, &scene, &task, &params)? else { return Ok(None) };
        let lift = pieces.into_iter().find(|piece| piece.phase == Phase::Lift);
        let parts = lift.as_ref().and_then(|piece| piece.postures.split_first());
        Ok(parts.map(|(grasp, lift)| Way { grasp: *grasp, lift: lift.to_vec() }))
    }

    /// Objects, walls and table, which the arm keeps away from.
    fn scene(&self, mut objects: Vec<PlacedObstacle>, clearance: f64) -> Result<Scene, EnvError> {
        for wall in &self.walls {
            let solid = Obstacle::cuboid(&wall.half).map_err(|source| EnvError::Unusable { source })?;
            objects.push((Arc::new(solid), wall.world_from_wall));
        }
        Ok(Scene::new(self.robot.world_from_base, &[], objects, clearance, 0.0)?)
    }

    /// The bodies at their poses, for rendering.
    pub fn posed(&self, positions: &[f64], spec: &EnvSpec) -> impl Iterator<Item = ObjectPose<'_>> {
        let chain = self.robot.inverse.chain();
        let frames =
            (positions.len() >= chain.len()).then(|| chain.frames(&self.robot.inverse.positions_of(positions)));
        let label = arm_label(spec.hand().links.len(), spec.config.clutter.most_objects());
        let world_from_base = self.robot.world_from_base;
        let all = self.models.iter().enumerate().filter_map(|(body, model)| Some((body, model.as_ref()?)));
        all.filter_map(move |(body, model)| {
            let base_from_body = match body.checked_sub(1) {
                Some(axis) => frames.as_ref()?.axes[axis].isometry(),
                None => Isometry3::identity(),
            };
            let color = if body == 0 { BASE_COLOR } else { LINK_COLOR };
            Some(ObjectPose { model, color, label, world_from_object: world_from_base * base_from_body })
        })
    }
}

/// One model of all shapes of a body; `None` without shapes.
fn model(of: &[(Shape, Isometry3<f64>)]) -> Result<Option<Model>, RenderError> {
    surface(of)?.map(|mesh| Model::new(&mesh)).transpose()
}

/// One surface of shapes in a frame; `None` without shapes.
///
/// # Errors
/// [`RenderError`] for a shape out of range.
pub fn surface(of: &[(Shape, Isometry3<f64>)]) -> Result<Option<TriMesh>, RenderError> {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for (shape, body_from_shape) in of {
        let mesh = match *shape {
            Shape::Cuboid(half) => shapes::cuboid(half, 0.0),
            Shape::Cylinder { radius, half_length } => shapes::cylinder(radius, half_length, COLUMNS),
            Shape::Sphere { radius } => shapes::sphere(radius, COLUMNS),
        }?;
        let first = vertices.len() as u32;
        vertices.extend(mesh.vertices().iter().map(|v| body_from_shape * v));
        faces.extend(mesh.faces().iter().map(|face| face.map(|vertex| vertex + first)));
    }
    if faces.is_empty() { Ok(None) } else { Ok(Some(TriMesh::new(vertices, faces)?)) }
}
