//! Triangle meshes, and their geometry for grasping.
//!
//! | module | purpose |
//! |---|---|
//! | [`trimesh`] | the mesh itself: vertices, faces, bounds, area, volume, hash |
//! | [`io`] | STL, PLY, OBJ, OFF, glTF: bounded, with clear errors |
//! | [`clean`](mod@clean) | weld, drop, orient, components, watertight test |
//! | [`decimate`](mod@decimate) | fewer faces, still watertight |
//! | `decimate::cluster` | far fewer faces, in linear time |
//! | [`sample`] | surface samples, uniform by area; evenly spread directions |
//! | [`mass`] | volume, centre of mass, inertia |
//! | [`hull`] | convex hull |
//! | [`distance_grid`] | signed distance on a grid |
//! | [`parts`] | convex parts: the collision geometry |
//! | [`mass::resting`] | stable poses on a table |
//! | [`voxel`] | solid and surface voxels, binvox files |
//! | [`range`] | range checks of settings, for every crate |
//! | `fast_hash` | maps and sets of small keys |
//! | [`cache`] | results on disk: convex parts, levels of detail |
//! | [`checksum`] | bytes with a magic number and a checksum: cache entries, snapshots |
//! | [`error`] | every way an input can be wrong, one sentence each |
//!
//! Units are metres and kilograms; a mesh keeps the frame of its file.
//!
//! ```
//! use graspbox_mesh::{LoadOptions, Mass, MeshFormat, PartsParams, clean, convex_parts, mass_properties, parse};
//!
//! // A tetrahedron, 10 cm along each axis.
//! let obj = b"v 0 0 0\nv 100 0 0\nv 0 100 0\nv 0 0 100\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
//! let millimetres = LoadOptions { scale: 0.001, ..LoadOptions::default() };
//! let mesh = parse(obj, MeshFormat::Obj, &millimetres)?;
//! let (mesh, report) = clean(&mesh, &Default::default())?;
//! assert!(report.watertight);
//!
//! let properties = mass_properties(&mesh, Mass::Density(600.0))?;
//! assert!((properties.mass - 0.1).abs() < 1e-12);
//! let parts = convex_parts(&mesh, &PartsParams::default(), None)?;
//! assert_eq!(parts.parts.len(), 1);
//! # Ok::<(), graspbox_mesh::MeshError>(())
//! ```

pub mod cache;
pub mod checksum;
pub mod clean;
pub mod decimate;
pub mod distance_grid;
pub mod error;
mod fast_hash;
pub mod hull;
pub mod io;
pub mod mass;
pub mod parts;
pub mod range;

pub mod sample;
pub mod trimesh;
pub mod voxel;

pub use clean::{CleanOptions, CleanReport, Defect, check_manifold, check_watertight, clean};
pub use decimate::{Decimated, Hausdorff, decimate, decimate_levels, hausdorff};
pub use distance_grid::DistanceGrid;
pub use error::MeshError;
pub use hull::convex_hull;
pub use io::{LoadOptions, MeshFormat, load, parse, read_bounded, write_atomic, write_obj, write_stl};
pub use mass::plan_view::least_width;
pub use mass::resting::{RestingOptions, RestingPose, default_pose, resting_poses};
pub use mass::{Mass, MassMethod, MassProperties, mass_properties};
pub use parts::{ConvexParts, PartsParams, PartsReport, convex_parts, measure_parts};
pub use range::{OutOfRange, all_within, in_range, is_pose};
pub use sample::{SurfaceSample, fibonacci_sphere, fibonacci_zone, sample_surface};
pub use trimesh::{Aabb, TriMesh};
pub use voxel::{
    FillRule, VoxelFrame, VoxelGrid, VoxelMode, VoxelOptions, load_binvox, parse_binvox, voxelize, voxelize_in,
    write_binvox,
};
