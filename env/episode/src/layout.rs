//! Layouts: several objects at rest on the table, packed, in a pile or in a bin.
//!
//! Packed scenes and piles are those of VGN (Breyer et al., "Volumetric Grasping Network", 2020; `ethz-asl/vgn`, `simulation.py`):
//!
//! | number | packed | pile |
//! |---|---|---|
//! | scale of an object, uniform (the caller draws it) | 0.7 to 0.9 | 0.8 to 1.0 |
//! | orientation | upright, turned about z | any |
//! | place along x and y, uniform about the middle | ±0.07 m | ±0.05 m, the middle third |
//! | height of the start | 2 mm over the table | 0.2 m over the table |
//! | attempts | 12 in the whole scene, each with an object of its own; one that touches something fails | 1 per object |
//! | box | none | 0.26 m wide, removed at the end |
//! | rest after an object, at most | 2 s; then what is outside is removed, until all are inside | 1 s |
//! | rest at the end, at most | | 2 s without the box; then as in packed scenes |
//!
//! Objects rest once the norm of each one's velocities, linear (m/s) and angular (rad/s) together, is at most 0.01 at the end of a quarter of a
//! second. An object is outside if its centre of mass leaves a cube of 0.3 m over the middle of the table, whose floor is 5 cm below the table's
//! top. Places are those of the centre of mass too.
//!
//! Differences: an object that would be dropped into others is raised above them, where VGN lets them overlap. One that still moves when the
//! next is added starts again from rest. VGN's repository has no mesh of its box: the width follows from the place of its corner, 2 cm inside
//! the workspace, and the height is our choice. [`Layout::Bin`] is ours: a pile in a bin, which stays; objects are dropped over the middle
//! third of its floor, and may lie at any height in it. [`Draw::spread`] multiplies the ranges of places: below 1 objects lie closer together.

use crate::scene::OUT_OF_THE_WAY;
use crate::{Body, EpisodeError, layout_cache};
use graspbox_hand::Hand;
use graspbox_mesh::in_range;
use graspbox_sim::{ObjectModel, PhysicsConfig, Template, Wall, World, bin};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::Arc;

/// Side of the workspace, metres.
pub const WORKSPACE: f64 = 0.3;
/// Depth of its floor below the table's top, metres.
const FLOOR: f64 = 0.05;
/// Height from which objects are dropped, metres.
const DROP_HEIGHT: f64 = 0.2;
/// Objects are dropped over this share of the workspace, dimensionless.
const DROP_SHARE: f64 = 1.0 / 3.0;
/// Attempts to place objects in a packed scene.
pub const PACKED_ATTEMPTS: usize = 12;
/// Packed objects stand within this distance of the middle along x and y, metres.
const PACKED_REACH: f64 = 0.07;
/// Height over the table at which a packed object is placed, metres.
const OVER: f64 = 0.002;
/// Velocity at rest, m/s and rad/s.
const REST_VELOCITY: f64 = 0.01;
/// Seconds between two checks of the velocities.
const REST_PERIOD: f64 = 0.25;
/// Most periods after an object was dropped, and after any other change.
const DROP_PERIODS: usize = 4;
const REST_PERIODS: usize = 8;
/// The box of a pile: inside, and thickness of its walls, metres.
const PILE_BOX: [f64; 3] = [0.26, 0.26, 0.3];
const WALL: f64 = 0.02;

/// Range of [`Draw::spread`]: at its end packed objects stand within 14 cm of the middle of the workspace, whose half side is 15 cm.
pub const SPREADS: RangeInclusive<f64> = 0.25..=2.0;

/// Random parts of an arrangement, and their ranges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Draw {
    /// Number of objects wanted. The bodies, drawn at random for a scene of this number ([`Layout::draws`]), are taken in order, one attempt
    /// each, until this many are placed. `None`: all of them are wanted, and packed ones have 12 attempts each.
    pub most: Option<usize>,
    /// Factor on VGN's greatest distance of objects from the middle, dimensionless, in [`SPREADS`].
    pub spread: f64,
    /// Seed of places and orientations.
    pub seed: u64,
}

impl Draw {
    /// All bodies, at VGN's distances.
    pub fn seeded(seed: u64) -> Self {
        Self { most: None, spread: 1.0, seed }
    }
}

/// Arrangement of several objects on the table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Layout {
    /// Upright, side by side.
    Packed,
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
    /// * `cache`: folder in which arrangements are kept, if there is one; it changes no bit.
    ///
    /// # Errors
    /// [`EpisodeError::Sim`] for no object, too many, or a setting out of range; [`EpisodeError::OutOfRange`] for the sides of a bin or the spread;
    /// [`EpisodeError::NoRest`] if the simulation diverges.
    pub fn arrange(
        &self,
        bodies: &[&Body],
        draw: &Draw,
        hand: &Arc<Hand>,
        physics: PhysicsConfig,
        cache: Option<&Path>,
    ) -> Result<Arrangement, EpisodeError> {
        let walls = self.walls()?;
        in_range("spread", draw.spread, SPREADS, "")?;
        let arranger = Arranger {
            bodies,
            hand,
            physics,
            factors: [1.0; 2],
            walls: Vec::new(),
            objects: Vec::new(),
            poses: Vec::new(),
        };
        // For no object, or too many of them.
        let template = arranger.template(&(0..bodies.len()).collect::<Vec<_>>())?;
        // The debug format writes every number exactly.
        let settings = format!("{self:?} {draw:?}");
        let entry = cache.map(|folder| layout_cache::entry(folder, &template, bodies, &settings));
        let cached = entry.as_ref().and_then(|entry| layout_cache::read(entry, bodies.len()));
        if let Some((objects, world_from_objects)) = cached {
            return Ok(Arrangement { objects, world_from_objects, walls });
        }
        let made = self.make(Arranger { walls, ..arranger }, draw)?;
        if let Some(entry) = &entry {
            layout_cache::write(entry, &made.objects, &made.world_from_objects);
        }
        Ok(made)
    }

    /// Adds the bodies to `arranger`, which has the walls that stay.
    fn make(&self, mut arranger: Arranger, draw: &Draw) -> Result<Arrangement, EpisodeError> {
        let random = &mut ChaCha8Rng::seed_from_u64(draw.seed);
        let space = self.space();
        let dropped = draw.most.unwrap_or(arranger.bodies.len()).min(arranger.bodies.len());
        match *self {
            Self::Packed => arranger.pack(draw, &space, random)?,
            Self::Pile => {
                arranger.walls = bin(Vector3::from(PILE_BOX), WALL);
                arranger.drop_all(dropped, draw.spread * WORKSPACE, random)?;
                arranger.walls.clear();
                arranger.rest_inside(&space)?;
            }
            Self::Bin { inside } => {
                arranger.drop_all(dropped, draw.spread * inside[0].min(inside[1]), random)?;
                arranger.rest_inside(&space)?;
            }
        }
        Ok(arranger.done())
    }

    /// Number of objects to draw for a scene of `most`: packed scenes have 12 attempts.
    pub fn draws(&self, most: usize) -> usize {
        if *self == Self::Packed { PACKED_ATTEMPTS } else { most }
    }

    /// Lets `bodies` come to rest from `poses` without a hand, as after some of them were taken away.
    ///
    /// * `poses`: one for each of `bodies`.
    /// * `factors`: on the friction and the mass of every object.
    ///
    /// # Errors
    /// As [`Layout::arrange`].
    pub fn settle(
        &self,
        bodies: &[&Body],
        poses: Vec<Isometry3<f64>>,
        factors: [f64; 2],
        hand: &Arc<Hand>,
        physics: PhysicsConfig,
    ) -> Result<Arrangement, EpisodeError> {
        let objects = (0..bodies.len()).collect();
        let mut arranger = Arranger { bodies, hand, physics, factors, walls: self.walls()?, objects, poses };
        arranger.rest_inside(&self.space())?;
        Ok(arranger.done())
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

    /// The space in which objects count as present, world frame, metres.
    fn space(&self) -> [Vector3<f64>; 2] {
        let (x, y, top) = match *self {
            Self::Bin { inside } => (inside[0] / 2.0, inside[1] / 2.0, f64::INFINITY),
            _ => (WORKSPACE / 2.0, WORKSPACE / 2.0, WORKSPACE - FLOOR),
        };
        [Vector3::new(-x, -y, -FLOOR), Vector3::new(x, y, top)]
    }
}

/// A layout in the making: the objects that were added, at rest at their poses.
struct Arranger<'a> {
    bodies: &'a [&'a Body],
    hand: &'a Arc<Hand>,
    physics: PhysicsConfig,
    /// Factors on the friction and the mass of every object.
    factors: [f64; 2],
    walls: Vec<Wall>,
    objects: Vec<usize>,
    poses: Vec<Isometry3<f64>>,
}

impl Arranger<'_> {
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
        let mut world = template
            .spawn_objects(&away(), poses, preshape)
            .map_err(|source| EpisodeError::Sim { object: self.names(objects), source })?;
        world.scale_objects(self.factors[0], self.factors[1]);
        Ok(world)
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

    /// Simulates until all objects rest, or `periods` have passed.
    fn rest(&mut self, periods: usize) -> Result<(), EpisodeError> {
        let mut world = self.world(&self.objects, &self.poses)?;
        for _ in 0..periods {
            self.run(&mut world, REST_PERIOD)?;
            if at_rest(&world) {
                break;
            }
        }
        self.poses = world.world_from_objects().collect();
        Ok(())
    }

    /// Lets all objects come to rest and removes those outside of `space`, until none is.
    fn rest_inside(&mut self, space: &[Vector3<f64>; 2]) -> Result<(), EpisodeError> {
        while !self.objects.is_empty() {
            self.rest(REST_PERIODS)?;
            let inside: Vec<usize> = (0..self.objects.len()).filter(|at| self.is_inside(*at, space)).collect();
            if inside.len() == self.objects.len() {
                break;
            }
            self.objects = inside.iter().map(|at| self.objects[*at]).collect();
            self.poses = inside.iter().map(|at| self.poses[*at]).collect();
        }
        Ok(())
    }

    /// Whether the centre of mass of an object, by its place among those that were added, is inside of `space`.
    fn is_inside(&self, at: usize, [low, high]: &[Vector3<f64>; 2]) -> bool {
        let center = self.poses[at] * self.bodies[self.objects[at]].model().center_of_mass();
        (0..3).all(|axis| (low[axis]..=high[axis]).contains(&center[axis]))
    }

    /// Drops the first `count` objects over the middle third of an area of side `side`.
    fn drop_all(&mut self, count: usize, side: f64, random: &mut ChaCha8Rng) -> Result<(), EpisodeError> {
        for index in 0..count {
            let turn = any_rotation(random);
            let reach = side * DROP_SHARE / 2.0;
            let [x, y] = [0; 2].map(|_| random.random_range(-reach..=reach));
            self.objects.push(index);
            self.poses.push(Translation3::new(x, y, DROP_HEIGHT) * self.about_center(index, turn));
            self.lift_above_others()?;
            self.rest(DROP_PERIODS)?;
        }
        Ok(())
    }

    /// A turned object whose centre of mass is at the origin.
    fn about_center(&self, index: usize, turn: UnitQuaternion<f64>) -> Isometry3<f64> {
        let center = self.bodies[index].model().center_of_mass();
        Isometry3::from_parts(Translation3::from(-(turn * center.coords)), turn)
    }

    /// Raises the last object until it touches no other, as where a pile is higher than the drop.
    fn lift_above_others(&mut self) -> Result<(), EpisodeError> {
        /// Height of a rise, metres, and most rises.
        const RISE: f64 = 0.05;
        const RISES: usize = 12;
        let last = self.objects.len() - 1;
        for _ in 0..RISES {
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

    /// Stands objects up where they touch no others: each has one attempt until `most` stand, or 12 attempts.
    fn pack(&mut self, draw: &Draw, space: &[Vector3<f64>; 2], random: &mut ChaCha8Rng) -> Result<(), EpisodeError> {
        let (most, reach) = (draw.most, draw.spread * PACKED_REACH);
        let attempts = if most.is_some() { 1 } else { PACKED_ATTEMPTS };
        for index in 0..self.bodies.len() {
            if most.is_some_and(|most| self.objects.len() == most || index == PACKED_ATTEMPTS) {
                break;
            }
            for _ in 0..attempts {
                if self.stand(index, reach, random)? {
                    self.rest_inside(space)?;
                    break;
                }
            }
        }
        Ok(())
    }

    /// Places an object upright at random within `reach` of the middle, unless it touches something there.
    fn stand(&mut self, index: usize, reach: f64, random: &mut ChaCha8Rng) -> Result<bool, EpisodeError> {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), random.random_range(0.0..TAU));
        let [x, y] = [0; 2].map(|_| random.random_range(-reach..=reach));
        let body = self.bodies[index];
        let upright = self.about_center(index, turn * graspbox_mesh::default_pose(body.mesh()).rotation);
        let bounds = body.mesh().transformed(&upright).aabb();
        let (mut objects, mut poses) = (self.objects.clone(), self.poses.clone());
        objects.push(index);
        poses.push(Translation3::new(x, y, OVER - bounds.min.z) * upright);
        let free = self.touches_nothing(&objects, &poses)?;
        if free {
            (self.objects, self.poses) = (objects, poses);
        }
        Ok(free)
    }

    fn done(self) -> Arrangement {
        Arrangement { objects: self.objects, world_from_objects: self.poses, walls: self.walls }
    }
}

/// Whether no object moves faster than [`REST_VELOCITY`]; the hand is at rest, so its frame is the world's.
fn at_rest(world: &World) -> bool {
    (0..world.object_count()).all(|object| {
        let (linear, angular) = world.velocity_in_hand(object);
        linear.norm_squared() + angular.norm_squared() <= REST_VELOCITY * REST_VELOCITY
    })
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
