//! The engine `implicit`: simulates free objects, a hand of any kinematic tree on a moving base, and a table.
//!
//! | module | purpose |
//! |---|---|
//! | [`tree`] | the hand: bodies, joints, coordinates, cables |
//! | [`object`], [`scenery`] | an object; table, ground and walls |
//! | [`config`] | settings, with the reason for each number |
//! | [`model`] | data shared by all worlds of one template |
//! | [`solver`] | the state of a world, and one time step; sleep of what rests |
//! | `contact` | contact points as they are reported |
//! | `kinematics`, `dynamics` | poses and Jacobians; mass matrix and bias forces |
//! | `search` | contact candidates between bodies |
//! | `rows`, `laws`, `problem`, `newton` | the equations of a step, and Newton's method for them |
//! | `islands`, `objects`, `ordering` | sets of bodies that touch each other; the objects among the unknowns, and their order |
//! | `sides`, `stiffness` | what moves the bodies of a contact; its part of the derivative |
//! | `matrix`, `units` | dense matrices; parry's unit of length |
//! | [`dispatch`] | a faster contact search for convex parts |
//!
//! All quantities are f64, in SI units, and in the frame of the hand's base. In that frame the base is at rest and the table moves; gravity
//! includes the fictitious accelerations.
//!
//! A ball falls on the table and comes to rest:
//!
//! ```
//! use graspbox_solver::{Body, FrameMotion, Model, Object, ObjectPart, Primitive, Scenery, Solver, StepInput, Tree};
//! use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
//!
//! let base = Body { center: Point3::origin(), inertia: Matrix3::zeros(), mass: 0.0, parent: 0, joint: None, shapes: vec![] };
//! let hand = Tree { bodies: vec![base], ..Tree::default() };
//! let ball = Object {
//!     parts: vec![ObjectPart::Primitive(Primitive::Sphere { radius: 0.03 })],
//!     mass: 0.2,
//!     center: Point3::origin(),
//!     inertia: Matrix3::identity() * (0.4 * 0.2 * 0.03 * 0.03),
//!     friction: 1.0,
//! };
//! let table = Scenery { table_side: 1.2, table_thickness: 0.1, table_height: 0.75, walls: vec![], friction: 0.5 };
//! let mut solver = Solver::new(Model::new(hand, vec![ball], table, Default::default())?.into());
//! let world = Isometry3::translation(0.0, 0.0, -1.0); // the base is 1 m above the table
//! solver.state_mut().objects[0].base_from_object = Isometry3::translation(0.0, 0.0, -0.9);
//! let frame = FrameMotion { gravity: Vector3::new(0.0, 0.0, -9.81), omega: Vector3::zeros(), alpha: Vector3::zeros() };
//! for _ in 0..500 {
//!     let (base_from_world, base_from_world_after) = (world, world);
//!     let forces = &[];
//!     solver.step(&StepInput { dt: 0.002, base_from_world, base_from_world_after, frame, forces, driven: &[], cables: &[], idle: 0 });
//! }
//! assert!((solver.object_center(0).z + 0.97).abs() < 5e-4);
//! # Ok::<(), graspbox_solver::ModelError>(())
//! ```
//!
//! Why not a library: general engines iterate over contacts one by one (rapier) or solve worlds of any size (MuJoCo). This world has 6
//! unknowns for each object and about 6 to 20 for the hand, however many contacts there are. Newton's method with a dense matrix therefore
//! solves those of bodies that touch each other together, to rounding, in about three iterations. `docs/decisions/0003-implicit-solver.md` has the
//! measurements.

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod config;
mod contact;
pub mod dispatch;
mod dynamics;
mod error;
mod kinematics;
mod laws;
mod limits;
pub mod model;
pub mod object;
mod problem;
pub mod scenery;
mod search;
pub mod solver;
pub mod tree;
mod units;

pub use config::ImplicitConfig;
pub use contact::{Contact, Side};
pub use dynamics::FrameMotion;
pub use error::{ModelError, StateError};
pub use limits::{MAX_OBJECTS, MAX_WALLS};
pub use model::{BodyIndex, BodyKind, Model};
pub use object::{Object, ObjectPart};
pub use scenery::{Scenery, Surface, Wall};
pub use solver::saved::SavedState;
pub use solver::{CableCommand, ObjectState, Solver, State, StepInput};
pub use tree::{Body, BodyShape, Cable, Coordinate, Joint, JointKind, Primitive, Tree};
