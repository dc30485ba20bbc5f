//! From a depth image to candidate grasps, and to the inputs of networks that score them. No dynamics here, and no learning.
//!
//! | module | purpose |
//! |---|---|
//! | [`noise`] | noise of a depth camera: axial, lateral, dropouts, 16-bit millimetres |
//! | [`crop`] | the object above the table, and a frame on the table below it that rotates with the camera |
//! | [`channels`] | voxels of the crop: surface, unseen, table |
//! | [`solid`](mod@solid) | the true occupancy of these voxels |
//! | [`surface`](mod@surface) | points and normals of an occupancy's surface |
//! | [`proposals`] | candidate grasps of an occupancy, filtered and diverse |
//! | [`hand_grid`] | the grid of a hand: its swept volume, and collision look-ups |
//! | [`hand_crops`](mod@hand_crops) | voxels around the hand at many poses |
//! | [`levers`](mod@levers) | how far the hand is from the middle of the object that it grasps |
//! | `lookup` | cells in the hand frame |
//! | [`error`] | errors, one sentence each |
//!
//! Units are metres and radians; the table is the plane z = 0 of the world and of a crop.
//!
//! All proposals for a ball on the table approach from above:
//!
//! ```
//! use graspbox_hand::Hand;
//! use graspbox_perception::{CropConfig, HandGrid, HandGridConfig, ProposalConfig, propose};
//! use nalgebra::{Point3, Vector3};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let (hand, grid) = (HandGrid::new(Hand::reflex()?, &HandGridConfig::default())?, CropConfig::default().grid()?);
//! let ball = |p: Point3<f64>| (p - Point3::new(0.0, 0.0, 0.04)).norm() <= 0.04;
//! let at = |flat: usize| grid.center([flat / 48 / 48, flat / 48 % 48, flat % 48]);
//! let occupancy: Vec<u8> = (0..grid.len()).map(|flat| if ball(at(flat)) { 255 } else { 0 }).collect();
//! let found = propose(&hand, &grid, &occupancy, &[], &ProposalConfig::default())?;
//! assert!(found.len() == 128);
//! assert!(found.iter().all(|candidate| (candidate.pose.rotation * Vector3::z()).z < 0.5));
//! # Ok(())
//! # }
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod channels;
pub mod crop;
pub mod error;
pub mod hand_crops;
pub mod hand_grid;
pub mod levers;
pub mod lookup;
pub mod noise;
pub mod proposals;
pub mod solid;
pub mod surface;

pub use channels::{CHANNEL_NAMES, CHANNELS, fill_channels};
pub use crop::{CropConfig, Observed, groups, heights, observe};
pub use error::PerceptionError;
pub use hand_crops::{CropVolume, HAND_CHANNEL_NAMES, HAND_CHANNELS, hand_crops};
pub use hand_grid::{GraspContact, HandGrid, HandGridConfig};
pub use levers::levers;
pub use lookup::CellBox;
pub use noise::{DepthNoise, add_depth_noise};
pub use proposals::{Candidate, ProposalConfig, Source, obstacle_points, propose};
pub use solid::solid;
pub use surface::{OCCUPIED, SurfacePoint, surface};
