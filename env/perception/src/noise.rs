//! Noise of a depth camera: axial noise that grows with the square of the distance, alone and shared by neighbours, lateral noise, dropouts,
//! holes, 16-bit millimetres.
//!
//! Sources: axial and lateral noise of a structured-light camera from C. Nguyen, S. Izadi, D. Lovell, "Modeling Kinect sensor noise for
//! improved 3D reconstruction and tracking", 3DIMPVT 2012; stereo cameras have the same growth with distance.

use crate::PerceptionError;
use graspbox_mesh::in_range;
use graspbox_render::Intrinsics;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Greatest angle in the noise formula, radians: it has a pole at a right angle.
const STEEPEST: f64 = 1.48;

/// The noise of a depth camera.
///
/// A pixel at depth z, on a surface with the angle a between normal and ray, has axial noise of standard deviation
/// `axial_floor + axial_growth (z - axial_near)^2 + axial_grazing / sqrt(z) * (a / (pi/2 - a))^2`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DepthNoise {
    /// Least standard deviation, metres. Nguyen et al.: 1.2 mm.
    pub axial_floor: f64,
    /// Growth with the square of the distance beyond `axial_near`, 1/m. Nguyen et al.: 0.0019.
    pub axial_growth: f64,
    /// Distance at which the growth starts, metres. Nguyen et al.: 0.4.
    pub axial_near: f64,
    /// Growth with the angle between ray and normal, m^1.5. Nguyen et al.: 0.0001.
    pub axial_grazing: f64,
    /// Standard deviation of the direction of a pixel's ray, radians. Nguyen et al.: 0.8 pixels of a lens of 585 pixels.
    pub lateral: f64,
    /// A pixel is at an edge if the depth of a neighbour differs by more than this, metres. A choice.
    pub edge_step: f64,
    /// Probability that a pixel at an edge has no depth. A choice: only one of the two views sees half of the border.
    pub edge_dropout: f64,
    /// Angle between ray and normal from which a pixel may have no depth, radians. Nguyen et al. measured up to 1.4.
    pub grazing_angle: f64,
    /// Probability that a pixel beyond that angle has no depth. A choice.
    pub grazing_dropout: f64,
    /// Probability that any pixel has no depth. A choice.
    pub dropout: f64,
    /// Resolution of the depth values, metres: an integer number of millimetres.
    pub quantum: f64,
    /// Standard deviation of noise that neighbours share, divided by the square of the depth, 1/m. On tables that real cameras see it is
    /// 0.001 to 0.004.
    pub correlated_growth: f64,
    /// Extent of what neighbours share, and of holes, radians: tens of pixels of a lens of 585 pixels.
    pub correlation: f64,
    /// Share of the image that is lost in holes.
    pub holes: f64,
}

impl Default for DepthNoise {
    fn default() -> Self {
        Self {
            axial_floor: 0.0012,
            axial_growth: 0.0019,
            axial_near: 0.4,
            axial_grazing: 0.0001,
            lateral: 0.0014,
            edge_step: 0.02,
            edge_dropout: 0.5,
            grazing_angle: 1.4,
            grazing_dropout: 0.7,
            dropout: 0.002,
            quantum: 0.001,
            correlated_growth: 0.0,
            correlation: 0.03,
            holes: 0.0,
        }
    }
}

impl DepthNoise {
    /// A camera that only rounds to millimetres.
    #[must_use]
    pub fn none() -> Self {
        Self {
            axial_floor: 0.0,
            axial_growth: 0.0,
            axial_grazing: 0.0,
            lateral: 0.0,
            edge_dropout: 0.0,
            grazing_dropout: 0.0,
            dropout: 0.0,
            ..Self::default()
        }
    }

    /// # Errors
    /// [`PerceptionError::OutOfRange`] names the first field outside its range.
    pub fn check(&self) -> Result<(), PerceptionError> {
        in_range("axial_floor", self.axial_floor, 0.0..=0.1, "m")?;
        in_range("axial_growth", self.axial_growth, 0.0..=1.0, "1/m")?;
        in_range("axial_near", self.axial_near, 0.0..=10.0, "m")?;
        in_range("axial_grazing", self.axial_grazing, 0.0..=0.1, "m^1.5")?;
        in_range("lateral", self.lateral, 0.0..=0.1, "rad")?;
        in_range("edge_step", self.edge_step, 1e-4..=10.0, "m")?;
        in_range("grazing_angle", self.grazing_angle, 0.0..=FRAC_PI_2, "rad")?;
        in_range("quantum", self.quantum, 0.001..=0.1, "m")?;
        in_range("correlated_growth", self.correlated_growth, 0.0..=0.1, "1/m")?;
        in_range("correlation", self.correlation, 1e-4..=1.0, "rad")?;
        let shares = [
            ("edge_dropout", self.edge_dropout),
            ("grazing_dropout", self.grazing_dropout),
            ("dropout", self.dropout),
            ("holes", self.holes),
        ];
        Ok(shares.into_iter().try_for_each(|(name, share)| in_range(name, share, 0.0..=1.0, ""))?)
    }

    /// Standard deviation of the depth, metres.
    fn axial(&self, depth: f64, angle: f64) -> f64 {
        let a = angle.min(STEEPEST);
        let beyond = (depth - self.axial_near).max(0.0);
        let ratio = a / (FRAC_PI_2 - a);
        self.axial_floor
            + self.axial_growth * beyond * beyond
            + self.axial_grazing / depth.max(0.01).sqrt() * ratio * ratio
    }
}

/// Adds the noise to rendered depth images. Returns millimetres; 0 for no depth.
///
/// * `depth`: (n, H, W), metres along the optical axis; 0 for no depth.
/// * `seeds`: one per image; each image depends on its own seed only.
///
/// # Errors
/// [`PerceptionError::OutOfRange`] for the noise, a number of images that is not that of the seeds, or depths that are negative or not finite.
pub fn add_depth_noise(
    depth: &[f32],
    lens: &Intrinsics,
    seeds: &[u64],
    noise: &DepthNoise,
) -> Result<Vec<u16>, PerceptionError> {
    noise.check()?;
    lens.check()?;
    let wanted = (lens.pixels() * seeds.len()) as f64;
    in_range("number of pixels", depth.len() as f64, wanted..=wanted, "(one image for each seed)")?;
    depth.iter().try_for_each(|&d| in_range("depth", f64::from(d), 0.0..=1e4, "m (0 where nothing was seen)"))?;
    let mut images = vec![0_u16; depth.len()];
    let rows = images.par_chunks_mut(lens.pixels()).zip(depth.par_chunks(lens.pixels())).zip(seeds);
    rows.for_each(|((out, clean), seed)| degrade(clean, lens, *seed, noise, out));
    Ok(images)
}

fn degrade(clean: &[f32], lens: &Intrinsics, seed: u64, noise: &DepthNoise, out: &mut [u16]) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (width, height) = (lens.width as usize, lens.height as usize);
    let image = Image { depth: clean, width, height };
    let shared = Shared::new(noise, lens, seed);
    for row in 0..height {
        for column in 0..width {
            // Every pixel takes the same number of samples.
            let ([du, dv], [dz, _]) = (normals(&mut rng), normals(&mut rng));
            let chance = uniform(&mut rng);
            let at =
                |x: usize, shift: f64, end: usize| (x as f64 + shift.round()).clamp(0.0, end as f64 - 1.0) as usize;
            let u = at(column, du * noise.lateral * lens.fx, width);
            let v = at(row, dv * noise.lateral * lens.fy, height);
            let z = f64::from(clean[v * width + u]);
            if z == 0.0 {
                continue;
            }
            let edge = image.step(u, v) > noise.edge_step;
            // Across an edge, differences of depth do not give the normal.
            let angle = if edge { 0.0 } else { image.angle(lens, u, v) };
            let lost = if edge {
                noise.edge_dropout
            } else if angle > noise.grazing_angle {
                noise.grazing_dropout
            } else {
                0.0
            };
            if chance <= 1.0 - (1.0 - noise.dropout) * (1.0 - lost) {
                continue;
            }
            let pixel = row * width + column;
            if shared.hole(pixel) {
                continue;
            }
            let measured = z + dz * noise.axial(z, angle) + shared.shift(pixel) * noise.correlated_growth * z * z;
            let millimetres = (measured / noise.quantum).round() * noise.quantum * 1e3;
            out[pixel] = if millimetres >= 65535.5 { 0 } else { millimetres.round().max(0.0) as u16 };
        }
    }
}

/// What neighbouring pixels share: none of the fields exists if the noise has no such part.
struct Shared {
    shifts: Option<Vec<f64>>,
    holes: Option<(Vec<f64>, f64)>,
}

impl Shared {
    fn new(noise: &DepthNoise, lens: &Intrinsics, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        // The first stream is that of single pixels, which does not depend on these parts.
        rng.set_stream(1);
        let mut field = || smooth_field(lens, noise.correlation, &mut rng);
        let shifts = (noise.correlated_growth > 0.0).then(&mut field);
        let holes = (noise.holes > 0.0).then(field).map(|field| {
            let mut sorted = field.clone();
            let lost = ((sorted.len() as f64 * noise.holes) as usize).min(sorted.len() - 1);
            let (_, least, _) = sorted.select_nth_unstable_by(lost, f64::total_cmp);
            let least = *least;
            (field, least)
        });
        Self { shifts, holes }
    }

    /// Standard normal.
    fn shift(&self, pixel: usize) -> f64 {
        self.shifts.as_ref().map_or(0.0, |field| field[pixel])
    }

    fn hole(&self, pixel: usize) -> bool {
        self.holes.as_ref().is_some_and(|(field, least)| field[pixel] < *least)
    }
}

/// Standard normal numbers, one per pixel, that change smoothly over an angle: those of a lattice, interpolated.
fn smooth_field(lens: &Intrinsics, extent: f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let (width, height) = (lens.width as usize, lens.height as usize);
    let spacing = [(extent * lens.fx).max(1.0), (extent * lens.fy).max(1.0)];
    let from = [uniform(rng), uniform(rng)];
    let nodes = |size: usize, spacing: f64| (size as f64 / spacing) as usize + 3;
    let (columns, rows) = (nodes(width, spacing[0]), nodes(height, spacing[1]));
    let lattice: Vec<f64> = (0..columns * rows).map(|_| normals(rng)[0]).collect();
    let place = |pixel: usize, axis: usize| {
        let at = pixel as f64 / spacing[axis] + from[axis];
        let (node, along) = (at as usize, at.fract());
        (node, along * along * (3.0 - 2.0 * along))
    };
    let value = |pixel: usize| {
        let ((column, u), (row, v)) = (place(pixel % width, 0), place(pixel / width, 1));
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        let first = row * columns + column;
        let near = [first, first + 1, first + columns, first + columns + 1].map(|node| lattice[node]);
        let sum: f64 = near.iter().zip(weights).map(|(number, weight)| number * weight).sum();
        sum / weights.iter().map(|weight| weight * weight).sum::<f64>().sqrt()
    };
    (0..width * height).map(value).collect()
}

/// A rendered depth image.
struct Image<'a> {
    depth: &'a [f32],
    width: usize,
    height: usize,
}

impl Image<'_> {
    fn at(&self, u: usize, v: usize) -> f64 {
        f64::from(self.depth[v * self.width + u])
    }

    /// The neighbours along u and v: the previous and the next pixel, or the pixel itself at a border.
    fn around(&self, u: usize, v: usize) -> [[(usize, usize); 2]; 2] {
        let next = |x: usize, end: usize| (x + 1).min(end - 1);
        [[(u.saturating_sub(1), v), (next(u, self.width), v)], [(u, v.saturating_sub(1)), (u, next(v, self.height))]]
    }

    /// Greatest difference of depth to a neighbour, metres; a neighbour without depth counts as far away.
    fn step(&self, u: usize, v: usize) -> f64 {
        let z = self.at(u, v);
        let difference = |&(u, v): &(usize, usize)| {
            let other = self.at(u, v);
            if other == 0.0 { f64::INFINITY } else { (other - z).abs() }
        };
        self.around(u, v).iter().flatten().map(difference).fold(0.0, f64::max)
    }

    /// Angle between the ray and the surface's normal, radians; 0 next to a pixel without depth.
    fn angle(&self, lens: &Intrinsics, u: usize, v: usize) -> f64 {
        let point = |(u, v): (usize, usize)| {
            let z = self.at(u, v);
            (z > 0.0).then(|| lens.unproject(u as f64 + 0.5, v as f64 + 0.5, z).coords)
        };
        let along = |[a, b]: [(usize, usize); 2]| Some(point(b)? - point(a)?);
        let [across, down] = self.around(u, v);
        let (Some(across), Some(down), Some(ray)) = (along(across), along(down), point((u, v))) else {
            return 0.0;
        };
        let normal = across.cross(&down);
        let cosine = normal.dot(&ray).abs() / (normal.norm() * ray.norm()).max(1e-300);
        cosine.min(1.0).acos()
    }
}

/// Uniform in (0, 1].
fn uniform(rng: &mut ChaCha8Rng) -> f64 {
    ((rng.next_u64() >> 11) + 1) as f64 * (-53_f64).exp2()
}

/// Two independent standard normal numbers (Box and Muller's transform).
fn normals(rng: &mut ChaCha8Rng) -> [f64; 2] {
    let (radius, turn) = ((-2.0 * uniform(rng).ln()).sqrt(), TAU * uniform(rng));
    let (sine, cosine) = turn.sin_cos();
    [radius * cosine, radius * sine]
}
