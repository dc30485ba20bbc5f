//! An object at rest on the table, from which episodes are cloned.

use crate::{Body, EpisodeError};
use graspbox_hand::{ActuatorCommand, GraspPose, Hand};
use graspbox_mesh::in_range;
use graspbox_plan::{CollisionScene, Feasibility, Plan, PlanError, PlanObject, PlanParams, check_grasps};
use graspbox_sim::{ObjectModel, PhysicsConfig, Template, World};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
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

/// An object at rest on the table, with the data that its episodes share.
pub struct Scene {
    name: String,
    template: Template,
    world_from_object: Isometry3<f64>,
    center_of_mass: Point3<f64>,
    base_point: Point3<f64>,
    /// For the collision filter; `None` for an object without a mesh.
    obstacles: Option<CollisionScene>,
}

impl Scene {
    /// Lets `body` settle on the table from `world_from_object` (default: +z of the mesh file up, centred over the table's origin).
    ///
    /// # Errors
    /// As [`Body::check_fits`] and [`Scene::settle`].
    pub fn new(
        body: &Body,
        hand: Arc<Hand>,
        physics: PhysicsConfig,
        world_from_object: Option<&Isometry3<f64>>,
    ) -> Result<Self, EpisodeError> {
        body.check_fits(&hand)?;
        let start = world_from_object.copied().unwrap_or_else(|| graspbox_mesh::default_pose(body.mesh()));
        let bounds = body.mesh().transformed(&start).aabb();
        let base = Point3::new((bounds.min.x + bounds.max.x) / 2.0, (bounds.min.y + bounds.max.y) / 2.0, bounds.min.z);
        let mut scene = Self::settle(body.name(), hand, body.model(), physics, &start, start.inverse() * base)?;
        scene.obstacles = Some(CollisionScene::new(Arc::clone(body.obstacle()), &scene.world_from_object));
        Ok(scene)
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
        Ok(Self {
            name: name.to_owned(),
            template,
            world_from_object: *world_from_object,
            center_of_mass: object.center_of_mass(),
            base_point,
            obstacles: None,
        })
    }

    /// Lets `object` settle on the table from `world_from_object`.
    ///
    /// * `base_point`: see [`Scene::base_point`].
    ///
    /// # Errors
    /// [`EpisodeError::Sim`] for an invalid object or setting, [`EpisodeError::NoRest`] for an object that leaves the table.
    pub fn settle(
        name: &str,
        hand: Arc<Hand>,
        object: &ObjectModel,
        physics: PhysicsConfig,
        world_from_object: &Isometry3<f64>,
        base_point: Point3<f64>,
    ) -> Result<Self, EpisodeError> {
        let mut scene = Self::placed(name, hand, object, physics, world_from_object, base_point)?;
        let lowest = scene.template.lowest_point(world_from_object);
        let start = Translation3::new(0.0, 0.0, -lowest) * world_from_object;
        let away = Isometry3::from_parts(Translation3::new(0.0, 0.0, OUT_OF_THE_WAY), UnitQuaternion::identity());
        let mut world = scene.template.spawn(&away, &start, scene.template.hand().preshape_limits()[0]);
        let no_rest = |why| EpisodeError::NoRest { object: name.to_owned(), why };
        let mut stillness = Stillness::default();
        for _ in 0..(SETTLE_TIME / physics.dt) as usize {
            let idle: &[ActuatorCommand] = &[];
            world.step(&away, idle).map_err(|source| EpisodeError::Sim { object: name.to_owned(), source })?;
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
        scene.world_from_object = recentered(&world, &(start * scene.center_of_mass));
        Ok(scene)
    }

    /// True if the open hand reaches `pose` from `standoff` metres behind it without touching object or table.
    ///
    /// Without a mesh (a primitive of [`Scene::settle`]) every pose passes.
    ///
    /// # Errors
    /// [`EpisodeError::Plan`] for a preshape beyond the hand's limits.
    pub fn reachable(&self, pose: &GraspPose, standoff: f64) -> Result<bool, EpisodeError> {
        self.reachable_at(pose, standoff, &self.world_from_object)
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

    /// Table and object as obstacles, the object at `world_from_object`; `None` for an object without a mesh.
    pub fn obstacles_at(&self, world_from_object: &Isometry3<f64>) -> Option<CollisionScene> {
        Some(self.obstacles.as_ref()?.at(world_from_object))
    }

    fn plan_error(&self, source: PlanError) -> EpisodeError {
        EpisodeError::Plan { object: self.name.clone(), source }
    }

    /// Plans grasps of `body` at its resting pose in this scene.
    ///
    /// # Errors
    /// [`EpisodeError::Plan`] for planner settings out of range, or a mesh that cannot be decomposed into boxes.
    pub fn plan(&self, body: &Body, params: &PlanParams) -> Result<Plan, EpisodeError> {
        let object = PlanObject {
            mesh: body.mesh(),
            obstacle: body.obstacle(),
            center_of_mass: self.center_of_mass,
            world_from_object: self.world_from_object,
        };
        graspbox_plan::plan(&object, self.template.hand(), params).map_err(|source| self.plan_error(source))
    }

    /// Name of the object.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The template of the episodes' worlds.
    pub fn template(&self) -> &Template {
        &self.template
    }

    /// Pose of the object at rest.
    pub fn world_from_object(&self) -> &Isometry3<f64> {
        &self.world_from_object
    }

    /// Centre of mass, object frame, metres.
    pub fn center_of_mass(&self) -> Point3<f64> {
        self.center_of_mass
    }

    /// Middle of the object's base: the centre of the underside of its bounds at the pose that it settled from, object frame, metres.
    pub fn base_point(&self) -> Point3<f64> {
        self.base_point
    }
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
