//! Projects instances onto a raster: chooses the level, transforms, culls, clips at the near plane.

use crate::model::{Level, PIXEL_SHARE};
use crate::renderer::raster::{Corner, Gradient, Raster, twice_area};
use crate::{Camera, Detail, Instance, Intrinsics, Model};
use nalgebra::{Isometry3, Point3};

/// A view of the scene, from a camera or the lamp.
pub(crate) struct View {
    pub(crate) view_from_world: Isometry3<f64>,
    pub(crate) projection: Projection,
    pub(crate) detail: Detail,
}

/// Projection from the view's frame (z forward, x right, y down) onto the raster.
pub(crate) enum Projection {
    Pinhole { intrinsics: Intrinsics, near: f64, far: f64 },
    Parallel { pixels_per_metre: f64, origin: [f64; 2] },
}

impl Projection {
    #[inline]
    pub(crate) fn project(&self, p: &Point3<f64>) -> Corner {
        match self {
            Self::Pinhole { intrinsics: k, .. } => {
                let nearness = 1.0 / p.z;
                [k.fx * p.x * nearness + k.cx, k.fy * p.y * nearness + k.cy, nearness]
            }
            Self::Parallel { pixels_per_metre, origin } => {
                [(p.x - origin[0]) * pixels_per_metre, (p.y - origin[1]) * pixels_per_metre, -p.z]
            }
        }
    }

    fn near(&self) -> f64 {
        match self {
            Self::Pinhole { near, .. } => *near,
            Self::Parallel { .. } => f64::NEG_INFINITY,
        }
    }

    /// Whether a ball in the view's frame may be visible.
    fn sees(&self, center: &Point3<f64>, radius: f64) -> bool {
        let Self::Pinhole { intrinsics: k, near, far } = self else {
            return true;
        };
        // Farther than its radius outside a plane through the camera and a border of the image.
        let beyond = |x: f64, focal: f64, axis: f64, size: u32| {
            let to_left = -(x * focal + axis * center.z) / focal.hypot(axis);
            let other = f64::from(size) - axis;
            let to_right = (x * focal - other * center.z) / focal.hypot(other);
            to_left.max(to_right) > radius
        };
        let in_depth = center.z + radius >= *near && center.z - radius <= *far;
        in_depth && !beyond(center.x, k.fx, k.cx, k.width) && !beyond(center.y, k.fy, k.cy, k.height)
    }

    /// Greatest error of a level whose bounds begin at depth `z`, metres.
    fn tolerance(&self, z: f64) -> f64 {
        match self {
            Self::Pinhole { intrinsics: k, near, .. } => PIXEL_SHARE * z.max(*near) / k.fx.max(k.fy),
            // A shadow's border is several pixels wide.
            Self::Parallel { pixels_per_metre, .. } => 1.0 / pixels_per_metre,
        }
    }
}

impl View {
    pub(crate) fn of_camera(camera: &Camera, detail: Detail) -> Self {
        Self {
            view_from_world: camera.world_from_camera().inverse(),
            projection: Projection::Pinhole {
                intrinsics: *camera.intrinsics(),
                near: camera.near(),
                far: camera.far(),
            },
            detail,
        }
    }

    fn level<'a>(&self, model: &'a Model, view_from_model: &Isometry3<f64>) -> &'a Level {
        if self.detail == Detail::Full {
            return model.level(0.0);
        }
        let depths = model.bounds().map(|p| (view_from_model * p).z);
        model.level(self.projection.tolerance(depths.fold(f64::INFINITY, f64::min)))
    }
}

/// Sides of a closed model that are culled.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cull {
    Back,
    Front,
}

/// A rasterized triangle: a face, or part of a clipped one.
pub(crate) struct Piece<'a> {
    pub(crate) level: &'a Level,
    pub(crate) face: usize,
    pub(crate) corners: &'a [Corner; 3],
    pub(crate) gradient: Gradient,
    /// For each of `corners`, its weights on the face's corners; `None` if they are the same.
    pub(crate) weights: Option<&'a [[f64; 3]; 3]>,
    /// True if its back is visible.
    pub(crate) back: bool,
}

/// Reusable memory.
#[derive(Default)]
pub(crate) struct Scratch {
    points: Vec<Point3<f64>>,
    corners: Vec<Corner>,
}

/// Rasterizes `instance`; `sink` is called for each triangle and returns the id of the next one. The first id is `id`.
pub(crate) fn rasterize<const IDS: bool>(
    raster: &mut Raster,
    scratch: &mut Scratch,
    view: &View,
    cull: Cull,
    instance: &Instance,
    id: u32,
    sink: &mut impl FnMut(&Piece) -> u32,
) {
    let model = instance.model;
    let view_from_model = view.view_from_world * instance.world_from_model;
    let (center, radius) = model.ball();
    let center = view_from_model * center;
    if !view.projection.sees(&center, radius) {
        return;
    }
    let level = view.level(model, &view_from_model);
    let rotation = view_from_model.rotation.to_rotation_matrix();
    let placed = level.mesh.vertices().iter().map(|p| rotation * p + view_from_model.translation.vector);
    // If all of it is beyond the near plane, nothing needs clipping, and the camera is outside.
    let ahead = center.z - radius > view.projection.near();
    let hidden = if model.is_closed() && ahead { Some(cull) } else { None };
    let mut pen = Pen { raster, level, hidden, id, sink };
    if ahead {
        scratch.corners.clear();
        scratch.corners.extend(placed.map(|p| view.projection.project(&p)));
        for (f, face) in level.mesh.faces().iter().enumerate() {
            pen.rasterize::<IDS>(f, &face.map(|v| scratch.corners[v as usize]), None);
        }
    } else {
        scratch.points.clear();
        scratch.points.extend(placed);
        for (f, face) in level.mesh.faces().iter().enumerate() {
            pen.rasterize_clipped::<IDS>(f, &face.map(|v| scratch.points[v as usize]), &view.projection);
        }
    }
}

struct Pen<'a, Sink> {
    raster: &'a mut Raster,
    level: &'a Level,
    hidden: Option<Cull>,
    id: u32,
    sink: &'a mut Sink,
}

impl<Sink: FnMut(&Piece) -> u32> Pen<'_, Sink> {
    #[inline(always)]
    fn rasterize<const IDS: bool>(&mut self, face: usize, corners: &[Corner; 3], weights: Option<&[[f64; 3]; 3]>) {
        let area = twice_area(corners);
        let back = area > 0.0;
        if self.hidden.is_some_and(|side| (side == Cull::Back) == back) || !self.raster.may_cover(corners) {
            return;
        }
        if let Some(gradient) = self.raster.triangle::<IDS>(corners, area, self.id) {
            let level = self.level;
            self.id = (self.sink)(&Piece { level, face, corners, gradient, weights, back });
        }
    }

    fn rasterize_clipped<const IDS: bool>(&mut self, face: usize, points: &[Point3<f64>; 3], projection: &Projection) {
        let near = projection.near();
        if points.iter().all(|p| p.z >= near) {
            return self.rasterize::<IDS>(face, &points.map(|p| projection.project(&p)), None);
        }
        let (polygon, count) = clip(points, near);
        for k in 2..count {
            let weights = [polygon[0], polygon[k - 1], polygon[k]];
            let corners = weights.map(|w| {
                let mut p = points[0].coords * w[0] + points[1].coords * w[1] + points[2].coords * w[2];
                p.z = p.z.max(near);
                projection.project(&p.into())
            });
            self.rasterize::<IDS>(face, &corners, Some(&weights));
        }
    }
}

/// The part of a triangle with `z >= near`, as weights on its corners: a polygon of 0, 3 or 4.
///
/// A cut is computed from the kept corner, so the neighbour across the edge gets the same point.
fn clip(points: &[Point3<f64>; 3], near: f64) -> ([[f64; 3]; 4], usize) {
    let (mut polygon, mut count) = ([[0.0; 3]; 4], 0);
    let mut add = |weights: [f64; 3]| {
        polygon[count] = weights;
        count += 1;
    };
    for i in 0..3 {
        let j = (i + 1) % 3;
        let (here, next) = (points[i].z - near, points[j].z - near);
        let mut weights = [0.0; 3];
        if here >= 0.0 {
            weights[i] = 1.0;
            add(weights);
        }
        if (here >= 0.0) != (next >= 0.0) {
            let (kept, gone) = if here >= 0.0 { (i, j) } else { (j, i) };
            let share = (points[kept].z - near) / (points[kept].z - points[gone].z);
            weights[gone] = share;
            weights[kept] = 1.0 - share;
            add(weights);
        }
    }
    (polygon, count)
}
