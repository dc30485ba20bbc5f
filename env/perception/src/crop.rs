//! The crop: a cube around the observed object, in a frame defined by gravity, the table and the camera.
//!
//! The crop frame has its origin on the table (z = 0 of the world) below the middle of the object's visible part, z up, and x horizontally away from
//! the camera. It rotates with the camera, so the crop does not depend on the world's x and y axes.
//!
//! The object is the largest group of pixels above the table, or given by its pixels. In plan view, gaps between pixels of one group are at
//! most `gap`.

use crate::PerceptionError;
use graspbox_mesh::{VoxelFrame, in_range};
use graspbox_render::Camera;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Side of a cell of the plan view in which pixels are grouped, metres.
const PLAN_CELL: f64 = 0.01;
/// Greatest distance of a pixel of the object from the world's origin, horizontally and upward, metres.
const FURTHEST: f64 = 5.0;
/// Share of outlying pixels on each side that do not count for the middle of the object.
const STRAY: f64 = 0.02;

/// Settings of the crop, and of the segmentation of the object from the table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CropConfig {
    /// Side of the cube, metres.
    pub side: f64,
    /// Voxels along each side.
    pub resolution: usize,
    /// Depth of the cube below the table, metres.
    pub below: f64,
    /// Height from which a pixel does not belong to the table, metres: three standard deviations of the smoothed depth noise.
    pub min_height: f64,
    /// Widest gap between pixels of one object in plan view, metres.
    pub gap: f64,
    /// Least number of pixels of an object.
    pub min_pixels: usize,
}

impl Default for CropConfig {
    fn default() -> Self {
        Self { side: 0.30, resolution: 48, below: 0.0125, min_height: 0.004, gap: 0.03, min_pixels: 8 }
    }
}

impl CropConfig {
    /// # Errors
    /// [`PerceptionError::OutOfRange`] names the first field outside its range.
    pub fn check(&self) -> Result<(), PerceptionError> {
        in_range("side", self.side, 0.01..=10.0, "m")?;
        in_range("resolution", self.resolution as f64, 4.0..=256.0, "voxels per side")?;
        in_range("below", self.below, 0.0..=self.side / 2.0, "m")?;
        in_range("min_height", self.min_height, 0.0..=0.1, "m")?;
        in_range("gap", self.gap, 0.0..=0.5, "m")?;
        Ok(in_range("min_pixels", self.min_pixels as f64, 1.0..=1e6, "pixels")?)
    }

    /// The voxels, in the crop frame.
    ///
    /// # Errors
    /// As [`CropConfig::check`].
    pub fn grid(&self) -> Result<VoxelFrame, PerceptionError> {
        self.check()?;
        let half = -0.5 * self.side;
        Ok(VoxelFrame::new(self.resolution, Point3::new(half, half, -self.below), self.side)?)
    }
}

/// The object in a depth image.
#[derive(Clone, Debug, PartialEq)]
pub struct Observed {
    /// Pixels of the object, (H, W).
    pub object: Vec<bool>,
    /// The crop frame; `None` if the object has fewer than `min_pixels` pixels.
    pub world_from_crop: Option<Isometry3<f64>>,
}

/// Finds the object above the table, and its crop frame.
///
/// * `depth`: (H, W), metres along the optical axis; 0 for no depth.
/// * `labels`: pixels of the object, (H, W), if they are known.
/// * `middle`: pixels around which the crop lies, (H, W), if these are not all of the object.
///
/// # Errors
/// [`PerceptionError::OutOfRange`] for the config or images of another size than the camera's.
pub fn observe(
    camera: &Camera,
    depth: &[f32],
    labels: Option<&[bool]>,
    middle: Option<&[bool]>,
    config: &CropConfig,
) -> Result<Observed, PerceptionError> {
    config.check()?;
    check_sizes(camera, [Some(depth.len()), labels.map(<[bool]>::len), middle.map(<[bool]>::len)])?;
    let points = world_points(camera, depth);
    let object = match labels {
        Some(labels) => labels.iter().zip(&points).map(|(label, point)| *label && point.is_some()).collect(),
        None => above_table(&points, camera.intrinsics().width as usize, config),
    };
    let around = points.iter().zip(middle.unwrap_or(&object));
    let seen: Vec<Point3<f64>> = around.filter_map(|(point, own)| if *own { *point } else { None }).collect();
    let world_from_crop = (seen.len() >= config.min_pixels).then(|| crop_frame(camera, &seen));
    Ok(Observed { object, world_from_crop })
}

/// Height of each pixel above the table, metres, as the median of it and its eight neighbours; NaN without depth, (H, W).
///
/// # Errors
/// [`PerceptionError::OutOfRange`] for an image of another size than the camera's.
pub fn heights(camera: &Camera, depth: &[f32]) -> Result<Vec<f32>, PerceptionError> {
    check_sizes(camera, [Some(depth.len())])?;
    let (points, width) = (world_points(camera, depth), camera.intrinsics().width as usize);
    let height = |index: usize| points[index].map_or(f32::NAN, |_| smoothed_height(&points, width, index) as f32);
    Ok((0..points.len()).map(height).collect())
}

/// Groups of pixels, by 1 and up from the largest, (H, W); 0 for pixels that are not `chosen` or have no depth.
///
/// * `gap`: the widest gap between pixels of one group in plan view, metres.
///
/// # Errors
/// [`PerceptionError::OutOfRange`] for images of another size than the camera's, or a gap that is no distance.
pub fn groups(camera: &Camera, depth: &[f32], chosen: &[bool], gap: f64) -> Result<Vec<u32>, PerceptionError> {
    CropConfig { gap, ..CropConfig::default() }.check()?;
    check_sizes(camera, [Some(depth.len()), Some(chosen.len())])?;
    let (groups, sizes) = grouped(&world_points(camera, depth), chosen, gap);
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&group| (std::cmp::Reverse(sizes[group]), group));
    let mut rank = vec![0_u32; sizes.len()];
    order.iter().zip(1..).for_each(|(&group, place)| rank[group] = place);
    Ok(groups.into_iter().map(|group| group.map_or(0, |group| rank[group])).collect())
}

fn check_sizes<const N: usize>(camera: &Camera, sizes: [Option<usize>; N]) -> Result<(), PerceptionError> {
    let pixels = camera.intrinsics().pixels() as f64;
    for size in sizes.into_iter().flatten() {
        in_range("pixels of an image", size as f64, pixels..=pixels, "(those of its camera)")?;
    }
    Ok(())
}

/// The point of each pixel in the world; `None` without depth or far away.
fn world_points(camera: &Camera, depth: &[f32]) -> Vec<Option<Point3<f64>>> {
    let width = camera.intrinsics().width as usize;
    let point = |(index, &z): (usize, &f32)| {
        let (u, v) = ((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
        let p = camera.unproject(u, v, f64::from(z));
        (z > 0.0 && p.iter().all(|x| x.abs() <= FURTHEST)).then_some(p)
    };
    depth.iter().enumerate().map(point).collect()
}

/// The largest group of pixels above the table.
fn above_table(points: &[Option<Point3<f64>>], width: usize, config: &CropConfig) -> Vec<bool> {
    let above: Vec<bool> = (0..points.len())
        .map(|index| points[index].is_some() && smoothed_height(points, width, index) > config.min_height)
        .collect();
    let (groups, sizes) = grouped(points, &above, config.gap);
    // Ties go to the first group.
    let largest = sizes.iter().enumerate().max_by(|a, b| a.1.cmp(b.1).then(b.0.cmp(&a.0))).map(|(group, _)| group);
    groups.into_iter().map(|group| group.is_some() && group == largest).collect()
}

/// The group of each chosen pixel, numbered by the first pixels, and the number of pixels of each group.
fn grouped(points: &[Option<Point3<f64>>], chosen: &[bool], gap: f64) -> (Vec<Option<usize>>, Vec<usize>) {
    let cell = |p: &Point3<f64>| [p.x, p.y].map(|x| (x / PLAN_CELL).floor() as i64);
    let cells: Vec<Option<[i64; 2]>> =
        points.iter().zip(chosen).map(|(point, own)| point.as_ref().filter(|_| *own).map(cell)).collect();
    let groups = group(&cells, (gap / PLAN_CELL).ceil() as i64);
    let mut sizes = vec![0_usize; groups.iter().flatten().map(|group| group + 1).max().unwrap_or(0)];
    groups.iter().flatten().for_each(|group| sizes[*group] += 1);
    (groups, sizes)
}

/// Median height of a pixel and those of its eight neighbours that have a depth, metres.
fn smoothed_height(points: &[Option<Point3<f64>>], width: usize, index: usize) -> f64 {
    let (row, column, rows) = (index / width, index % width, points.len() / width);
    let (mut heights, mut count) = ([0.0; 9], 0);
    for r in row.saturating_sub(1)..(row + 2).min(rows) {
        let near = &points[r * width + column.saturating_sub(1)..r * width + (column + 2).min(width)];
        for p in near.iter().flatten() {
            heights[count] = p.z;
            count += 1;
        }
    }
    let heights = &mut heights[..count];
    heights.sort_unstable_by(f64::total_cmp);
    heights.get(count / 2).copied().unwrap_or(0.0)
}

/// Numbers the groups of occupied cells; cells at most `reach` apart along both axes belong to one group.
fn group(cells: &[Option<[i64; 2]>], reach: i64) -> Vec<Option<usize>> {
    let (mut low, mut high) = ([i64::MAX; 2], [i64::MIN; 2]);
    for cell in cells.iter().flatten() {
        for axis in 0..2 {
            low[axis] = low[axis].min(cell[axis]);
            high[axis] = high[axis].max(cell[axis]);
        }
    }
    if low[0] > high[0] {
        return vec![None; cells.len()];
    }
    let size = [high[0] - low[0] + 1, high[1] - low[1] + 1];
    let index = |cell: [i64; 2]| ((cell[0] - low[0]) * size[1] + cell[1] - low[1]) as usize;
    let mut occupied = vec![false; (size[0] * size[1]) as usize];
    cells.iter().flatten().for_each(|cell| occupied[index(*cell)] = true);
    let mut labels: Vec<Option<usize>> = vec![None; occupied.len()];
    let mut count = 0;
    for cell in cells.iter().flatten() {
        if labels[index(*cell)].is_some() {
            continue;
        }
        let mut front = vec![*cell];
        labels[index(*cell)] = Some(count);
        while let Some([i, j]) = front.pop() {
            for a in (i - reach).max(low[0])..=(i + reach).min(high[0]) {
                for b in (j - reach).max(low[1])..=(j + reach).min(high[1]) {
                    let at = index([a, b]);
                    if occupied[at] && labels[at].is_none() {
                        labels[at] = Some(count);
                        front.push([a, b]);
                    }
                }
            }
        }
        count += 1;
    }
    cells.iter().map(|cell| cell.and_then(|cell| labels[index(cell)])).collect()
}

/// The crop frame of the visible points `seen` (world; at least one).
fn crop_frame(camera: &Camera, seen: &[Point3<f64>]) -> Isometry3<f64> {
    let mean = seen.iter().fold(Vector3::zeros(), |sum, p| sum + p.coords) / seen.len() as f64;
    let pose = camera.world_from_camera();
    let ray = (mean - pose.translation.vector).normalize().xy();
    // From above the ray defines no direction, but the upper border of the image does. Both agree for an upright camera.
    let upper = (pose.rotation * -Vector3::y()).xy();
    let away = (ray + upper).try_normalize(1e-9).unwrap_or_else(Vector2::x);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), away.y.atan2(away.x));
    let middle = |direction: Vector3<f64>| {
        let mut along: Vec<f64> = seen.iter().map(|p| p.coords.dot(&direction)).collect();
        along.sort_unstable_by(f64::total_cmp);
        let stray = (along.len() as f64 * STRAY) as usize;
        direction * (0.5 * (along[stray] + along[along.len() - 1 - stray]))
    };
    let origin = middle(turn * Vector3::x()) + middle(turn * Vector3::y());
    Isometry3::from_parts(Translation3::from(origin), turn)
}
