//! Layouts: several objects at rest on the table, packed, in a pile or in a bin.
//!
//! Piles and packed scenes follow those of VGN (Breyer et al., "Volumetric Grasping Network", 2020; `ethz-asl/vgn`, `simulation.py`), in a
//! workspace of 0.3 m about the middle of the table; the sizes of the box and of the packed area are our choice:
//!
//! | layout | how it is made |
//! |---|---|
//! | [`Layout::Packed`] | upright, turned about z, one by one at random places where nothing is touched; after 12 attempts an object is left out |
//! | [`Layout::Pile`] | dropped one by one, in any orientation, from 0.2 m over the middle third, into a box that is then removed |
//! | [`Layout::Bin`] | the same into a bin, which stays |
//!
//! Each object has a second to come to rest. Objects that end outside the workspace, or the bin, are left out.

use crate::scene::OUT_OF_THE_WAY;
use crate::{Body, EpisodeError};
use graspbox_hand::Hand;
use graspbox_mesh::in_range;
use graspbox_sim::{ObjectModel, PhysicsConfig, Template, Wall, World, bin};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Side of the workspace, and its height, metres.
pub const WORKSPACE: f64 = 0.3;
/// Height from which objects are dropped, metres.
const DROP_HEIGHT: f64 = 0.2;
/// Objects are dropped over this share of the workspace, dimensionless.
const DROP_SHARE: f64 = 1.0 / 3.0;
/// Seconds for which an object that was added comes to rest.
const REST_TIME: f64 = 1.0;
/// Attempts to place an object of a packed scene.
const ATTEMPTS: usize = 12;
/// Packed objects stand within this distance of the middle along x and y, metres.
const PACKED_REACH: f64 = 0.07;
/// The box of a pile: inside, and thickness of its walls, metres.
const PILE_BOX: [f64; 3] = [0.26, 0.26, 0.3];
const WALL: f64 = 0.02;

/// How several objects lie on the table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Layout {
    /// Upright, side by side.
    Packed,
    /// A pile.
    Pile,
    /// A pile in a bin.
    Bin {
        /// Sides of its floor along x and y, and height of its walls, metres.
        inside: [f64; 3],
    },
}

/// Objects at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Arrangement {
    /// Indices of the objects that stayed, ascending.
    pub objects: Vec<usize>,
    /// Their poses.
    pub world_from_objects: Vec<Isometry3<f64>>,
    /// Walls of the bin.
    pub walls: Vec<Wall>,
}

impl Layout {
    /// Lets `bodies` come to rest; equal seeds give equal bits.
    ///
    /// # Errors
    /// [`EpisodeError::Sim`] for no object, too many, or a setting out of range; [`EpisodeError::OutOfRange`] for the sides of a bin;
    /// [`EpisodeError::NoRest`] if the simulation diverges.
    pub fn arrange(
        &self,
        bodies: &[&Body],
        hand: &Arc<Hand>,
        physics: PhysicsConfig,
        seed: u64,
    ) -> Result<Arrangement, EpisodeError> {
        let mut heap = Heap { bodies, hand, physics, walls: self.walls()?, objects: Vec::new(), poses: Vec::new() };
        // For no object, or too many of them.
        heap.template(&(0..bodies.len()).collect::<Vec<_>>())?;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        match *self {
            Self::Packed => heap.pack(&mut random)?,
            Self::Pile => {
                heap.walls = bin(Vector3::from(PILE_BOX), WALL);
                heap.drop_all(WORKSPACE, &mut random)?;
                heap.walls.clear();
                heap.rest()?;
            }
            Self::Bin { inside } => heap.drop_all(inside[0].min(inside[1]), &mut random)?,
        }
        Ok(heap.within(&self.half()))
    }

    /// Lets `bodies` come to rest from `poses` without a hand, as after some of them were taken away.
    ///
    /// * `poses`: one for each of `bodies`.
    ///
    /// # Errors
    /// As [`Layout::arrange`].
    pub fn settle(
        &self,
        bodies: &[&Body],
        poses: Vec<Isometry3<f64>>,
        hand: &Arc<Hand>,
        physics: PhysicsConfig,
    ) -> Result<Arrangement, EpisodeError> {
        let objects = (0..bodies.len()).collect();
        let mut heap = Heap { bodies, hand, physics, walls: self.walls()?, objects, poses };
        heap.rest()?;
        Ok(heap.within(&self.half()))
    }

    /// Walls that stay: those of the bin.
    ///
    /// # Errors
    /// [`EpisodeError::OutOfRange`] for the sides of a bin.
    pub fn walls(&self) -> Result<Vec<Wall>, EpisodeError> {
        let Self::Bin { inside } = *self else { return Ok(Vec::new()) };
        inside.iter().try_for_each(|side| in_range("inside", *side, 0.02..=1.0, "m"))?;
        Ok(bin(Vector3::from(inside), WALL))
    }

    /// Half the sides of the space in which objects count as present, and its height.
    fn half(&self) -> Vector3<f64> {
        match *self {
            Self::Bin { inside } => Vector3::new(inside[0] / 2.0, inside[1] / 2.0, f64::INFINITY),
            _ => Vector3::new(WORKSPACE / 2.0, WORKSPACE / 2.0, WORKSPACE),
        }
    }
}

/// A layout in the making: the objects that were added, at rest at their poses.
struct Heap<'a> {
    bodies: &'a [&'a Body],
    hand: &'a Arc<Hand>,
    physics: PhysicsConfig,
    walls: Vec<Wall>,
    objects: Vec<usize>,
    poses: Vec<Isometry3<f64>>,
}

impl Heap<'_> {
    fn template(&self, objects: &[usize]) -> Result<Template, EpisodeError> {
        let models: Vec<ObjectModel> = objects.iter().map(|index| self.bodies[*index].model().clone()).collect();
        Template::of_objects(Arc::clone(self.hand), &models, &self.walls, self.physics)
            .map_err(|source| EpisodeError::Sim { object: self.names(objects), source })
    }

    fn names(&self, objects: &[usize]) -> String {
        let names: Vec<&str> = objects.iter().map(|index| self.bodies[*index].name()).collect();
        names.join(", ")
    }

    /// The world of these objects, the hand out of the way.
    fn world(&self, objects: &[usize], poses: &[Isometry3<f64>]) -> Result<World, EpisodeError> {
        let template = self.template(objects)?;
        let preshape = template.hand().preshape_limits()[0];
        template
            .spawn_objects(&away(), poses, preshape)
            .map_err(|source| EpisodeError::Sim { object: self.names(objects), source })
    }

    fn run(&self, world: &mut World, seconds: f64) -> Result<(), EpisodeError> {
        let failed = |source| EpisodeError::Sim { object: self.names(&self.objects), source };
        for _ in 0..(seconds / self.physics.dt).ceil() as usize {
            world.step(&away(), &[]).map_err(failed)?;
        }
        if world.is_finite() {
            return Ok(());
        }
        Err(EpisodeError::NoRest { object: self.names(&self.objects), why: "the simulation diverged" })
    }

    /// Lets all objects come to rest.
    fn rest(&mut self) -> Result<(), EpisodeError> {
        let mut world = self.world(&self.objects, &self.poses)?;
        self.run(&mut world, REST_TIME)?;
        self.poses = world.world_from_objects().collect();
        Ok(())
    }

    /// Drops every object over the middle of an area of side `side`.
    fn drop_all(&mut self, side: f64, random: &mut ChaCha8Rng) -> Result<(), EpisodeError> {
        for index in 0..self.bodies.len() {
            let turn = any_rotation(random);
            let reach = side * DROP_SHARE / 2.0;
            let [x, y] = [random.random_range(-reach..=reach), random.random_range(-reach..=reach)];
            self.objects.push(index);
            self.poses.push(Isometry3::from_parts(Translation3::new(x, y, DROP_HEIGHT), turn));
            self.lift_above_others()?;
            self.rest()?;
        }
        Ok(())
    }

    /// Raises the last object until it touches no other, as where a heap is higher than the drop.
    fn lift_above_others(&mut self) -> Result<(), EpisodeError> {
        /// Height of one attempt, metres.
        const RISE: f64 = 0.05;
        let last = self.objects.len() - 1;
        for _ in 0..ATTEMPTS {
            if self.touches_nothing(&self.objects, &self.poses)? {
                break;
            }
            self.poses[last].translation.vector.z += RISE;
        }
        Ok(())
    }

    /// Whether the last object touches nothing within the first step.
    fn touches_nothing(&self, objects: &[usize], poses: &[Isometry3<f64>]) -> Result<bool, EpisodeError> {
        let mut world = self.world(objects, poses)?;
        world.set_target(objects.len() - 1);
        self.run(&mut world, self.physics.dt)?;
        let found = world.contacts();
        Ok(found.objects.is_empty() && !found.scenery)
    }

    /// Stands every object up where it touches no other, if there is such a place.
    fn pack(&mut self, random: &mut ChaCha8Rng) -> Result<(), EpisodeError> {
        /// Height over the table at which contacts are tested, metres: beyond the contact with the table.
        const OVER: f64 = 0.002;
        for index in 0..self.bodies.len() {
            for _ in 0..ATTEMPTS {
                let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), random.random_range(0.0..TAU));
                let [x, y] = [0; 2].map(|_| random.random_range(-PACKED_REACH..=PACKED_REACH));
                let body = &self.bodies[index];
                let upright =
                    Isometry3::from_parts(Translation3::identity(), turn) * graspbox_mesh::default_pose(body.mesh());
                let bounds = body.mesh().transformed(&upright).aabb();
                let pose = Translation3::new(x, y, OVER - bounds.min.z) * upright;
                let (mut objects, mut poses) = (self.objects.clone(), self.poses.clone());
                objects.push(index);
                poses.push(pose);
                if self.touches_nothing(&objects, &poses)? {
                    (self.objects, self.poses) = (objects, poses);
                    self.rest()?;
                    break;
                }
            }
        }
        Ok(())
    }

    /// The objects whose centre of mass is within `half` of the middle of the table, and above it.
    fn within(self, half: &Vector3<f64>) -> Arrangement {
        let mut found = Arrangement { objects: Vec::new(), world_from_objects: Vec::new(), walls: self.walls };
        for (object, pose) in self.objects.into_iter().zip(self.poses) {
            let center = pose * self.bodies[object].model().center_of_mass();
            if center.x.abs() <= half.x && center.y.abs() <= half.y && (0.0..=half.z).contains(&center.z) {
                found.objects.push(object);
                found.world_from_objects.push(pose);
            }
        }
        found
    }
}

/// Pose of the hand while objects come to rest.
fn away() -> Isometry3<f64> {
    Isometry3::translation(0.0, 0.0, OUT_OF_THE_WAY)
}

/// A rotation from the uniform distribution (Shoemake, "Uniform random rotations", 1992).
fn any_rotation(random: &mut ChaCha8Rng) -> UnitQuaternion<f64> {
    let [share, a, b]: [f64; 3] =
        [random.random_range(0.0..1.0), random.random_range(0.0..TAU), random.random_range(0.0..TAU)];
    let (one, two) = ((1.0 - share).sqrt(), share.sqrt());
    UnitQuaternion::from_quaternion(Quaternion::new(two * b.cos(), one * a.sin(), one * a.cos(), two * b.sin()))
}
