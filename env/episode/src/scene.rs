//! An object at rest on the table, alone or among others, from which episodes are cloned.

use crate::{Body, EpisodeError, layout_cache};
use graspbox_hand::{ActuatorCommand, GraspPose, Hand};
use graspbox_mesh::in_range;
use graspbox_plan::{
    CollisionScene, Feasibility, Neighbour, Obstacle, Plan, PlanError, PlanObject, PlanParams, check_grasps,
};
use graspbox_sim::{ObjectModel, PhysicsConfig, SimError, Template, Wall, World};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::path::Path;
use std::sync::Arc;

/// Greatest linear speed of an object at rest, m/s: a tenth of a millimetre in 0.1 s.
const REST_SPEED: f64 = 1e-3;
/// Greatest angular speed of an object at rest, rad/s: [`REST_SPEED`] at 5 cm.
const REST_SPIN: f64 = 2e-2;
/// Consecutive steps for which an object at rest stays below both speeds: 0.1 s at the default time step.
const REST_STEPS: usize = 50;
/// Longest time to settle, seconds. A ball that still rolls is then stopped.
pub(crate) const SETTLE_TIME: f64 = 3.0;
/// Height of the hand above the table while the object settles, metres: beyond any object.
pub const OUT_OF_THE_WAY: f64 = 2.0;

/// Objects at rest on the table, with the data that their episodes share. One of them is the target, "the object" of the methods.
pub struct Scene {
    template: Arc<Template>,
    /// At least one.
    objects: Vec<Placed>,
    target: usize,
    /// The hand chooses its target: [`Scene::is_any_target`].
    any_target: bool,
    /// For the collision filter; `None` for an object without a mesh.
    obstacles: Option<CollisionScene>,
}

/// An object at rest.
struct Placed {
    name: String,
    world_from_object: Isometry3<f64>,
    center_of_mass: Point3<f64>,
    /// See [`Scene::base_point`].
    base_point: Point3<f64>,
}

impl Scene {
    /// Lets `body` settle on the table from `world_from_object` (default: +z of the mesh file up, centred over the table's origin).
    ///
    /// # Errors
    /// As [`Body::check_fits`], [`Scene::placed`] and [`Scene::settle`].
    pub fn new(
        body: &Body,
        hand: Arc<Hand>,
        physics: PhysicsConfig,
        world_from_object: Option<&Isometry3<f64>>,
    ) -> Result<Self, EpisodeError> {
        Self::at_rest(body, &Self::template_of(body, hand, physics)?, world_from_object, None)
    }

    /// What the scenes of one object in any pose share.
    ///
    /// # Errors
    /// As [`Body::check_fits`], or [`EpisodeError::Sim`] for an invalid object or setting.
    pub fn template_of(body: &Body, hand: Arc<Hand>, physics: PhysicsConfig) -> Result<Arc<Template>, EpisodeError> {
        body.check_fits(&hand)?;
        let made = Template::new(hand, body.model(), physics);
        Ok(Arc::new(made.map_err(|source| EpisodeError::Sim { object: body.name().to_owned(), source })?))
    }

    /// As [`Scene::new`], on a template of [`Scene::template_of`].
    ///
    /// * `cache`: folder in which the pose at rest is kept, if there is one; it changes no bit.
    ///
    /// # Errors
    /// As [`Scene::settle`].
    pub fn at_rest(
        body: &Body,
        template: &Arc<Template>,
        world_from_object: Option<&Isometry3<f64>>,
        cache: Option<&Path>,
    ) -> Result<Self, EpisodeError> {
        let start = world_from_object.copied().unwrap_or_else(|| graspbox_mesh::default_pose(body.mesh()));
        let center = body.model().center_of_mass();
        let mut scene = Self::on(Arc::clone(template), body.name(), center, &start, base_at(body, &start));
        // An arrangement of one body, whose surface does not matter.
        let bits = start.to_homogeneous().map(f64::to_bits);
        let entry = cache.map(|folder| layout_cache::entry(folder, template, &[], &format!("one from {bits:?}")));
        match entry.as_ref().and_then(|entry| layout_cache::read(entry, 1)).as_ref().map(|(_, poses)| poses.as_slice())
        {
            Some([pose]) => scene.objects[0].world_from_object = *pose,
            _ => {
                scene = scene.settle()?;
                if let Some(entry) = entry {
                    layout_cache::write(&entry, &[0], std::slice::from_ref(scene.world_from_object()));
                }
            }
        }
        scene.obstacles = Some(CollisionScene::new(Arc::clone(body.obstacle()), scene.world_from_object()));
        Ok(scene)
    }

    /// Several objects among walls, all of them at rest: nothing is simulated.
    ///
    /// * `world_from_objects`: one pose for each of `bodies`.
    /// * `target`: index of "the object" of the methods; `None` for the one that reaches highest, until a hand chooses another:
    ///   [`Scene::is_any_target`].
    ///
    /// # Errors
    /// [`EpisodeError::Sim`] for no object, too many, or not one pose for each; [`EpisodeError::OutOfRange`] for another target;
    /// [`EpisodeError::Plan`] for a wall without volume. An object may be too large for the hand.
    pub fn of_objects(
        bodies: &[&Body],
        world_from_objects: &[Isometry3<f64>],
        walls: &[Wall],
        target: Option<usize>,
        hand: Arc<Hand>,
        physics: PhysicsConfig,
    ) -> Result<Self, EpisodeError> {
        let names = || bodies.iter().map(|body| body.name()).collect::<Vec<_>>().join(", ");
        let sim_error = |source| EpisodeError::Sim { object: names(), source };
        let models: Vec<ObjectModel> = bodies.iter().map(|body| body.model().clone()).collect();
        let template = Arc::new(Template::of_objects(hand, &models, walls, physics).map_err(sim_error)?);
        let (poses, objects) = (world_from_objects.len(), bodies.len());
        if poses != objects {
            return Err(sim_error(SimError::WrongPoses { poses, objects }));
        }
        let any_target = target.is_none();
        let target = target.unwrap_or_else(|| highest(bodies, world_from_objects));
        in_range("target", target as f64, 0.0..=(objects - 1) as f64, "")?;
        let neighbours = neighbours(bodies, world_from_objects, walls, target)
            .map_err(|source| EpisodeError::Plan { object: names(), source })?;
        let obstacle = Arc::clone(bodies[target].obstacle());
        let obstacles = Some(CollisionScene::among(obstacle, &world_from_objects[target], neighbours));
        let placed = |(body, pose): (&&Body, &Isometry3<f64>)| Placed {
            name: body.name().to_owned(),
            world_from_object: *pose,
            center_of_mass: body.model().center_of_mass(),
            base_point: base_at(body, pose),
        };
        let objects = bodies.iter().zip(world_from_objects).map(placed).collect();
        Ok(Self { template, objects, target, any_target, obstacles })
    }

    /// A new world: the hand open at `world_from_hand` with its preshape, the object at `world_from_object`, the others at rest, the friction
    /// and mass of every object multiplied by `factors`.
    pub(crate) fn spawn(
        &self,
        world_from_hand: &Isometry3<f64>,
        world_from_object: &Isometry3<f64>,
        preshape: f64,
        factors: [f64; 2],
    ) -> World {
        let mut poses: Vec<_> = self.objects.iter().map(|object| object.world_from_object).collect();
        poses[self.target] = *world_from_object;
        let mut world = self.template.place(world_from_hand, &poses, preshape);
        world.scale_objects(factors[0], factors[1]);
        world.set_target(self.target);
        world
    }

    /// An object at `world_from_object`, assumed to be at rest: nothing is simulated.
    ///
    /// * `base_point`: see [`Scene::base_point`].
    ///
    /// # Errors
    /// [`EpisodeError::Sim`] for an invalid object or setting.
    pub fn placed(
        name: &str,
        hand: Arc<Hand>,
        object: &ObjectModel,
        physics: PhysicsConfig,
        world_from_object: &Isometry3<f64>,
        base_point: Point3<f64>,
    ) -> Result<Self, EpisodeError> {
        let template = Template::new(hand, object, physics)
            .map_err(|source| EpisodeError::Sim { object: name.to_owned(), source })?;
        Ok(Self::on(Arc::new(template), name, object.center_of_mass(), world_from_object, base_point))
    }

    fn on(
        template: Arc<Template>,
        name: &str,
        center_of_mass: Point3<f64>,
        world_from_object: &Isometry3<f64>,
        base_point: Point3<f64>,
    ) -> Self {
        let placed =
            Placed { name: name.to_owned(), world_from_object: *world_from_object, center_of_mass, base_point };
        Self { template, objects: vec![placed], target: 0, any_target: false, obstacles: None }
    }

    /// Lets the only object settle on the table from its pose.
    ///
    /// # Errors
    /// [`EpisodeError::Sim`] for a step that fails, [`EpisodeError::NoRest`] for an object that leaves the table.
    pub fn settle(mut self) -> Result<Self, EpisodeError> {
        let lowest = self.template.lowest_point(self.world_from_object());
        let start = Translation3::new(0.0, 0.0, -lowest) * self.world_from_object();
        let away = Isometry3::from_parts(Translation3::new(0.0, 0.0, OUT_OF_THE_WAY), UnitQuaternion::identity());
        let mut world = self.template.spawn(&away, &start, self.template.hand().preshape_limits()[0]);
        let no_rest = |why| EpisodeError::NoRest { object: self.name().to_owned(), why };
        let mut stillness = Stillness::default();
        for _ in 0..(SETTLE_TIME / self.template.config().dt) as usize {
            let idle: &[ActuatorCommand] = &[];
            world.step(&away, idle).map_err(|source| EpisodeError::Sim { object: self.name().to_owned(), source })?;
            if stillness.lasts(&world) {
                break;
            }
        }
        if !world.is_finite() {
            return Err(no_rest("the simulation diverged"));
        }
        if world.object_center().z < 0.0 {
            return Err(no_rest("it falls off the table"));
        }
        self.objects[0].world_from_object = recentered(&world, &(start * self.center_of_mass()));
        Ok(self)
    }

    /// True if the open hand reaches `pose` from `standoff` metres behind it without touching an object, a wall or the table.
    ///
    /// Without a mesh (a primitive of [`Scene::placed`]) every pose passes.
    ///
    /// # Errors
    /// [`EpisodeError::Plan`] for a preshape beyond the hand's limits.
    pub fn reachable(&self, pose: &GraspPose, standoff: f64) -> Result<bool, EpisodeError> {
        self.reachable_at(pose, standoff, self.world_from_object())
    }

    /// As [`Scene::reachable`], for the object at `world_from_object`.
    ///
    /// # Errors
    /// As [`Scene::reachable`].
    pub fn reachable_at(
        &self,
        pose: &GraspPose,
        standoff: f64,
        world_from_object: &Isometry3<f64>,
    ) -> Result<bool, EpisodeError> {
        let Some(obstacles) = self.obstacles_at(world_from_object) else {
            return Ok(true);
        };
        let found = obstacles.check_pose(self.template.hand(), pose, 0.0, standoff);
        Ok(found.map_err(|source| self.plan_error(source))? == Feasibility::Feasible)
    }

    /// Passes `grasps` through the planner's collision filter, in parallel on the current rayon pool; without a mesh all pass.
    ///
    /// * `clearance`: least distance of the open hand from object and table, metres.
    /// * `standoff`: length of the approach, metres.
    ///
    /// # Errors
    /// [`EpisodeError::Plan`] for a preshape beyond the hand's limits, [`EpisodeError::OutOfRange`] for a distance out of range.
    pub fn check(&self, grasps: &[GraspPose], clearance: f64, standoff: f64) -> Result<Vec<Feasibility>, EpisodeError> {
        in_range("clearance", clearance, 0.0..=0.05, "m")?;
        in_range("standoff", standoff, 0.0..=1.0, "m")?;
        let Some(obstacles) = &self.obstacles else {
            return Ok(vec![Feasibility::Feasible; grasps.len()]);
        };
        let found = check_grasps(obstacles, self.template.hand(), grasps, clearance, standoff);
        found.map_err(|source| self.plan_error(source))
    }

    /// Table, object and its neighbours as obstacles, the object at `world_from_object`; `None` for an object without a mesh.
    pub fn obstacles_at(&self, world_from_object: &Isometry3<f64>) -> Option<CollisionScene> {
        Some(self.obstacles.as_ref()?.at(world_from_object))
    }

    fn plan_error(&self, source: PlanError) -> EpisodeError {
        EpisodeError::Plan { object: self.name().to_owned(), source }
    }

    /// Plans grasps of `body` at its resting pose in this scene.
    ///
    /// # Errors
    /// [`EpisodeError::Plan`] for planner settings out of range, or a mesh that cannot be decomposed into boxes.
    pub fn plan(&self, body: &Body, params: &PlanParams) -> Result<Plan, EpisodeError> {
        let object = PlanObject {
            mesh: body.mesh(),
            obstacle: body.obstacle(),
            center_of_mass: self.center_of_mass(),
            world_from_object: *self.world_from_object(),
            neighbours: self.obstacles.as_ref().map(CollisionScene::neighbours).unwrap_or_default(),
        };
        graspbox_plan::plan(&object, self.template.hand(), params).map_err(|source| self.plan_error(source))
    }

    pub fn name(&self) -> &str {
        &self.objects[self.target].name
    }

    pub fn template(&self) -> &Template {
        &self.template
    }

    /// Pose of the object at rest.
    pub fn world_from_object(&self) -> &Isometry3<f64> {
        &self.objects[self.target].world_from_object
    }

    /// Centre of mass, object frame, metres.
    pub fn center_of_mass(&self) -> Point3<f64> {
        self.center_of(self.target)
    }

    /// Centre of mass of an object, by its index, in its frame, metres.
    pub fn center_of(&self, object: usize) -> Point3<f64> {
        self.objects[object].center_of_mass
    }

    /// Centres of mass of all objects, each in its frame, metres.
    pub fn centers_of_mass(&self) -> impl ExactSizeIterator<Item = Point3<f64>> {
        self.objects.iter().map(|object| object.center_of_mass)
    }

    /// Pose of an object at rest, by its index.
    pub fn world_from(&self, object: usize) -> Isometry3<f64> {
        self.objects[object].world_from_object
    }

    pub fn target(&self) -> usize {
        self.target
    }

    /// True if any object may be grasped: a trial is about the one on which the closed hand presses most, and succeeds with any.
    pub fn is_any_target(&self) -> bool {
        self.any_target
    }

    /// Middle of the object's base: the centre of the underside of its bounds at the pose that it settled from, object frame, metres.
    pub fn base_point(&self) -> Point3<f64> {
        self.objects[self.target].base_point
    }
}

/// The centre of the underside of a body's bounds at a pose, object frame, metres.
fn base_at(body: &Body, world_from_object: &Isometry3<f64>) -> Point3<f64> {
    let bounds = body.mesh().transformed(world_from_object).aabb();
    let base = Point3::new((bounds.min.x + bounds.max.x) / 2.0, (bounds.min.y + bounds.max.y) / 2.0, bounds.min.z);
    world_from_object.inverse() * base
}

/// The object that reaches highest.
fn highest(bodies: &[&Body], world_from_objects: &[Isometry3<f64>]) -> usize {
    let top = |(body, pose): (&&Body, &Isometry3<f64>)| {
        body.mesh().vertices().iter().map(|vertex| (pose * vertex).z).fold(f64::NEG_INFINITY, f64::max)
    };
    let tops: Vec<f64> = bodies.iter().zip(world_from_objects).map(top).collect();
    (0..tops.len()).max_by(|a, b| tops[*a].total_cmp(&tops[*b])).unwrap_or(0)
}

/// Everything except the target.
fn neighbours(
    bodies: &[&Body],
    world_from_objects: &[Isometry3<f64>],
    walls: &[Wall],
    target: usize,
) -> Result<Arc<[Neighbour]>, PlanError> {
    let others = bodies.iter().zip(world_from_objects).enumerate().filter(|(index, _)| *index != target);
    let others = others.map(|(_, (body, pose))| {
        Ok(Neighbour {
            obstacle: Arc::clone(body.obstacle()),
            world_from_obstacle: *pose,
            mass: Some(body.mass_properties().mass),
        })
    });
    let walls = walls.iter().map(|wall| {
        let obstacle = Arc::new(Obstacle::cuboid(&wall.half)?);
        Ok(Neighbour { obstacle, world_from_obstacle: wall.world_from_wall, mass: None })
    });
    others.chain(walls).collect()
}

/// Detects that an object has come to rest on the table while the hand does not move.
#[derive(Default)]
pub(crate) struct Stillness {
    quiet: usize,
}

impl Stillness {
    /// Observes the world after a step; true once the object has been at rest for long enough.
    pub fn lasts(&mut self, world: &World) -> bool {
        let (speed, spin) = world.object_velocity_in_hand();
        let still = speed.norm() < REST_SPEED && spin.norm() < REST_SPIN;
        self.quiet = if still { self.quiet + 1 } else { 0 };
        self.quiet >= REST_STEPS
    }
}

/// The settled pose, moved back horizontally, so a rolling object stays in the middle of the table.
fn recentered(world: &World, start: &Point3<f64>) -> Isometry3<f64> {
    let drift: Vector3<f64> = start - world.object_center();
    Translation3::new(drift.x, drift.y, 0.0) * world.world_from_object()
}
