//! Geometry to render, at several levels of detail.

use crate::error::RenderError;
use crate::normals::corner_normals;
use graspbox_mesh::clean::components;
use graspbox_mesh::{TriMesh, check_watertight, decimate_levels, in_range};
use nalgebra::{Point3, Vector3};
use std::path::Path;

/// Number of faces up to which a mesh gets no levels of detail.
const FEW_FACES: usize = 12;
/// Numbers of faces of the levels below the full mesh.
const LEVELS: [usize; 10] = [8192, 4096, 2048, 1024, 512, 256, 128, 64, 28, 12];
/// Error that [`Detail::Auto`] allows, in pixel footprints at the nearest point of the model's bounds.
pub(crate) const PIXEL_SHARE: f64 = 0.5;

/// The level of detail of a model to render.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Detail {
    /// The coarsest level whose error is at most half a pixel: half of z / f, with z the least depth of the model's bounding box.
    #[default]
    Auto,
    /// The full mesh.
    Full,
}

/// A mesh prepared for rendering; built once, shared by any number of renderers and threads.
///
/// A level's error is its Hausdorff distance from the full mesh, measured by [`graspbox_mesh::decimate_levels`] with 10,000 samples on either
/// surface: every point of one surface is within that distance of the other. The error of the depth is larger by 1 / cos of the angle of
/// incidence, and unbounded only at silhouettes, which move by less than a pixel.
#[derive(Clone, Debug)]
pub struct Model {
    /// From the full mesh to the coarsest.
    levels: Vec<Level>,
    center: Point3<f64>,
    half_extents: Vector3<f64>,
    radius: f64,
    closed: bool,
}

/// One level of detail.
#[derive(Clone, Debug)]
pub(crate) struct Level {
    pub(crate) mesh: TriMesh,
    /// Unit normals that corners share.
    pub(crate) normals: Vec<Vector3<f32>>,
    /// For each face, the normals of its corners.
    pub(crate) corners: Vec<[u32; 3]>,
    /// Distance from the full mesh, metres.
    error: f64,
}

impl Model {
    /// Prepares a mesh (metres, any frame) and its levels of detail: about 0.2 s for 16,000 faces.
    ///
    /// Back faces of a closed mesh are culled; an open mesh, or one with an inverted part, is rendered two-sided.
    ///
    /// # Errors
    /// [`RenderError::OutOfRange`] for a mesh that reaches farther than 10 km from its origin.
    pub fn new(mesh: &TriMesh) -> Result<Self, RenderError> {
        Self::cached(mesh, None)
    }

    /// As [`Model::new`], with the levels of detail cached in the folder `cache`, if there is one: see [`graspbox_mesh::cache`].
    ///
    /// # Errors
    /// Those of [`Model::new`].
    pub fn cached(mesh: &TriMesh, cache: Option<&Path>) -> Result<Self, RenderError> {
        let mut model = Self::without_levels(mesh)?;
        if mesh.faces().len() > FEW_FACES {
            let coarser = decimate_levels(mesh, &LEVELS, cache)?;
            let coarser = coarser.iter().map(|c| Level::new(&c.mesh, c.hausdorff.max));
            model.levels.extend(coarser);
        }
        Ok(model)
    }

    /// As [`Model::new`], with only the full mesh.
    ///
    /// # Errors
    /// Those of [`Model::new`].
    pub fn without_levels(mesh: &TriMesh) -> Result<Self, RenderError> {
        let aabb = mesh.aabb();
        let reach = aabb.min.coords.amax().max(aabb.max.coords.amax());
        in_range("reach of the mesh", reach, 0.0..=1e4, "m")?;
        let center = nalgebra::center(&aabb.min, &aabb.max);
        let distances = mesh.vertices().iter().map(|p| (p - center).norm());
        Ok(Self {
            levels: vec![Level::new(mesh, 0.0)],
            center,
            half_extents: (aabb.max - aabb.min) * 0.5,
            radius: distances.fold(0.0, f64::max),
            closed: is_solid(mesh),
        })
    }

    /// The model with every length times `scale`, which is positive: a new one of the scaled mesh, without new levels of detail.
    #[must_use]
    pub fn scaled(&self, scale: f64) -> Self {
        let mut model = self.clone();
        for level in &mut model.levels {
            level.mesh = level.mesh.scaled(scale);
            level.error *= scale;
        }
        model.center *= scale;
        model.half_extents *= scale;
        model.radius *= scale;
        model
    }

    /// Faces and error (metres) of each level, from the full mesh to the coarsest.
    pub fn levels(&self) -> impl ExactSizeIterator<Item = (usize, f64)> + '_ {
        self.levels.iter().map(|level| (level.mesh.faces().len(), level.error))
    }

    /// Whether its faces enclose a volume and face outward.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// Bounding sphere of the full mesh: centre (that of the bounding box) and radius.
    pub(crate) fn ball(&self) -> (Point3<f64>, f64) {
        (self.center, self.radius)
    }

    /// Corners of the full mesh's bounds.
    pub(crate) fn bounds(&self) -> impl Iterator<Item = Point3<f64>> + '_ {
        (0..8_u8).map(|i| {
            let sign = |bit: u8| if i & bit == 0 { -1.0 } else { 1.0 };
            self.center + Vector3::new(sign(1), sign(2), sign(4)).component_mul(&self.half_extents)
        })
    }

    /// The coarsest level with an error of at most `error` metres.
    pub(crate) fn level(&self, error: f64) -> &Level {
        let good = self.levels.iter().rev().find(|level| level.error <= error);
        good.unwrap_or(&self.levels[0])
    }
}

impl Level {
    fn new(mesh: &TriMesh, error: f64) -> Self {
        let (normals, corners) = corner_normals(mesh);
        Self { mesh: mesh.clone(), normals, corners, error }
    }
}

/// True if the mesh is closed and every connected part faces outward: then only front faces are visible from outside.
fn is_solid(mesh: &TriMesh) -> bool {
    if check_watertight(mesh).is_err() {
        return false;
    }
    let (labels, count) = components(mesh.faces());
    let reference = mesh.vertices()[0];
    let mut volumes = vec![0.0; count];
    for (face, &label) in labels.iter().enumerate() {
        let [a, b, c] = mesh.triangle(face).map(|p| p - reference);
        volumes[label] += a.dot(&b.cross(&c));
    }
    volumes.iter().all(|v| *v > 0.0)
}
