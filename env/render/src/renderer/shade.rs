//! The colour of each pixel: a lamp with shadows, ambient light from above and below, a little light from the camera, and a highlight.
//!
//! Colours are squares of the displayed values (a gamma of 2), so light adds linearly.

use crate::renderer::raster::Raster;
use crate::renderer::rasterize::Piece;
use crate::renderer::shadow::ShadowMap;
use crate::{Camera, Instance, Light};
use nalgebra::{Matrix3, Vector3};

type Vec3 = Vector3<f32>;

/// Share of the ambient light that reaches a surface facing straight down.
const FROM_BELOW: f32 = 0.45;
/// Light from the camera, as a share of the ambient light: it shows shapes in the shade.
const FROM_CAMERA: f32 = 0.35;
/// Strength of the highlight.
const SHINE: f32 = 0.10;
/// Steepness of the background's transition at the horizon, over the sine of the elevation.
const HORIZON: f32 = 1.2;

/// Surface of a triangle: the normal over its image (world frame, of any length), and its instance.
pub(crate) struct Facet {
    origin: [f32; 2],
    normal: Vec3,
    dx: Vec3,
    dy: Vec3,
    instance: u32,
}

impl Facet {
    pub(crate) fn new(piece: &Piece, normals: &[Vec3], instance: u32) -> Self {
        let own = piece.level.corners[piece.face].map(|n| normals[n as usize]);
        let own = if piece.back { own.map(|n| -n) } else { own };
        let origin = [piece.corners[0][0] as f32, piece.corners[0][1] as f32];
        let flat = own[0] == own[1] && own[1] == own[2];
        if flat || piece.gradient.is_small() {
            return Self { origin, normal: own[0] + own[1] + own[2], dx: Vec3::zeros(), dy: Vec3::zeros(), instance };
        }
        // A quantity times the nearness is linear over the image; the length does not matter.
        let at = |k: usize| -> Vector3<f64> {
            let [a, b, c] = own.map(|n| n.cast::<f64>());
            let mixed = piece.weights.map_or([a, b, c][k], |w| a * w[k][0] + b * w[k][1] + c * w[k][2]);
            mixed * piece.corners[k][2]
        };
        let at = [at(0), at(1), at(2)];
        let slopes = |axis: usize| piece.gradient.of(at.map(|n| n[axis]));
        let [x, y, z] = [slopes(0), slopes(1), slopes(2)];
        let column = |k: usize| Vec3::new(x[k] as f32, y[k] as f32, z[k] as f32);
        Self { origin, normal: at[0].cast(), dx: column(0), dy: column(1), instance }
    }
}

/// All inputs of the colours of one image.
pub(crate) struct Shader<'a> {
    pub(crate) raster: &'a Raster,
    /// Entry `id - 1` belongs to the pixels with this id.
    pub(crate) facets: &'a [Facet],
    pub(crate) instances: &'a [Instance<'a>],
    pub(crate) shadow: &'a ShadowMap,
    pub(crate) light: &'a Light,
    pub(crate) camera: &'a Camera,
}

/// A linear function over the image: `at + column * x + row * y`.
struct Linear {
    at: Vec3,
    column: Vec3,
    row: Vec3,
}

impl Linear {
    /// `matrix` times the direction of each pixel's ray, whose camera-frame z is 1.
    fn rays(camera: &Camera, matrix: Matrix3<f64>) -> Self {
        let k = camera.intrinsics();
        let (column, row) = (matrix.column(0) / k.fx, matrix.column(1) / k.fy);
        let at = matrix.column(2) - column * k.cx - row * k.cy;
        Self { at: at.cast(), column: column.cast(), row: row.cast() }
    }
}

impl Shader<'_> {
    /// Colours of the pixels, row by row, as squares of the displayed values.
    pub(crate) fn rows(&self, mut take: impl FnMut(&Colors)) {
        let world_from_camera = self.camera.world_from_camera();
        let rotation = world_from_camera.rotation.to_rotation_matrix().into_inner();
        let to_texel = self.shadow.texel_from_world.matrix();
        let texel_axes: Matrix3<f64> = to_texel.fixed_view::<3, 3>(0, 0).into_owned();
        let eye = texel_axes * world_from_camera.translation.vector + to_texel.fixed_view::<3, 1>(0, 3);
        let scene = Scene {
            shader: self,
            rays: Linear::rays(self.camera, rotation),
            texels: Linear::rays(self.camera, texel_axes * rotation),
            eye: eye.cast(),
            to_lamp: (-self.light.direction.normalize()).cast(),
            sky: linear(self.light.sky),
            floor: linear(self.light.floor),
            colors: self.instances.iter().map(|i| linear(i.color)).collect(),
        };
        let width = self.raster.width;
        let (mut surface, mut lighting) = (SurfaceRow::new(width), LightRow::new(width));
        for (y, ids) in self.raster.ids.chunks_exact(width).enumerate() {
            let nearness = &self.raster.nearness[y * width..][..width];
            let y = y as f32 + 0.5;
            scene.gather(y, ids, &mut surface);
            scene.light(y, &surface, &mut lighting);
            scene.shadows(y, nearness, &mut lighting);
            scene.mix(&mut surface.color, &lighting);
            scene.background(y, ids, &mut surface.color);
            take(&surface.color);
        }
    }
}

/// One row of red, green and blue.
pub(crate) type Colors = [Vec<f32>; 3];

/// One row of surfaces: normals of any length (zero where there is none) and colours. One vector per coordinate, as for all rows in
/// this file, so the loops vectorize.
struct SurfaceRow {
    normal: [Vec<f32>; 3],
    color: Colors,
}

impl SurfaceRow {
    fn new(width: usize) -> Self {
        let row = || std::array::from_fn(|_| vec![0.0; width]);
        Self { normal: row(), color: row() }
    }
}

/// One row of light, before it is multiplied with the colours.
struct LightRow {
    /// Ambient light, and light from the camera.
    around: Vec<f32>,
    /// Lamp: cosine of incidence, highlight, and the strength that reaches the surface.
    facing: Vec<f32>,
    shine: Vec<f32>,
    lit: Vec<f32>,
    /// Column, row and nearness on the shadow map.
    texel: [Vec<f32>; 3],
}

impl LightRow {
    fn new(width: usize) -> Self {
        let row = || vec![0.0; width];
        Self { around: row(), facing: row(), shine: row(), lit: row(), texel: std::array::from_fn(|_| row()) }
    }
}

struct Scene<'a> {
    shader: &'a Shader<'a>,
    /// Ray directions in the world.
    rays: Linear,
    /// The same on the shadow map.
    texels: Linear,
    /// The camera on the shadow map.
    eye: Vec3,
    to_lamp: Vec3,
    sky: Vec3,
    floor: Vec3,
    /// Of the instances.
    colors: Vec<Vec3>,
}

impl Scene<'_> {
    /// Normals and colours, facet by facet.
    fn gather(&self, y: f32, ids: &[u32], surface: &mut SurfaceRow) {
        let mut start = 0;
        for run in ids.chunk_by(|a, b| a == b) {
            let end = start + run.len();
            let facet = (run[0] as usize).checked_sub(1).map(|i| &self.shader.facets[i]);
            for axis in 0..3 {
                let normals = &mut surface.normal[axis][start..end];
                let Some(facet) = facet else {
                    normals.fill(0.0);
                    continue;
                };
                let first = facet.normal[axis] + facet.dy[axis] * (y - facet.origin[1]);
                let (slope, from) = (facet.dx[axis], start as f32 + 0.5 - facet.origin[0]);
                for (k, normal) in normals.iter_mut().enumerate() {
                    *normal = first + slope * (k as i32 as f32 + from);
                }
                surface.color[axis][start..end].fill(self.colors[facet.instance as usize][axis]);
            }
            start = end;
        }
    }

    /// All light, without shadows.
    fn light(&self, y: f32, surface: &SurfaceRow, lighting: &mut LightRow) {
        let light = self.shader.light;
        let (ray, step, lamp) = (self.rays.at + self.rays.row * y, self.rays.column, self.to_lamp);
        let (level, rise) = (light.ambient * 0.5 * (1.0 + FROM_BELOW), light.ambient * 0.5 * (1.0 - FROM_BELOW));
        let from_camera = light.ambient * FROM_CAMERA;
        let [nx, ny, nz] = &surface.normal;
        let normals = nx.iter().zip(ny).zip(nz);
        let lights = lighting.around.iter_mut().zip(&mut lighting.facing).zip(&mut lighting.shine);
        for (k, (((nx, ny), nz), ((around, facing), shine))) in normals.zip(lights).enumerate() {
            let x = k as i32 as f32 + 0.5;
            let (wx, wy, wz) = (ray.x + step.x * x, ray.y + step.y * x, ray.z + step.z * x);
            let back = 1.0 / (wx * wx + wy * wy + wz * wz).sqrt();
            let unit = 1.0 / (nx * nx + ny * ny + nz * nz + f32::MIN_POSITIVE).sqrt();
            let to_lamp = (nx * lamp.x + ny * lamp.y + nz * lamp.z) * unit;
            let to_eye = -(nx * wx + ny * wy + nz * wz) * unit * back;
            *around = level + rise * nz * unit + from_camera * positive(to_eye);
            *facing = positive(to_lamp);
            // Squared norm of the sum of the unit vectors to lamp and camera.
            let half = 2.0 - 2.0 * (lamp.x * wx + lamp.y * wy + lamp.z * wz) * back;
            let glance = positive(to_lamp + to_eye) / (positive(half) + f32::MIN_POSITIVE).sqrt();
            // The lower bound avoids denormal powers, which are slow.
            *shine = SHINE * power_32(if glance > 0.25 { glance } else { 0.25 });
        }
    }

    fn shadows(&self, y: f32, nearness: &[f32], lighting: &mut LightRow) {
        for (axis, texels) in lighting.texel.iter_mut().enumerate() {
            let (first, step) = (self.texels.at[axis] + self.texels.row[axis] * y, self.texels.column[axis]);
            for (k, (texel, nearness)) in texels.iter_mut().zip(nearness).enumerate() {
                *texel = self.eye[axis] + (first + step * (k as i32 as f32 + 0.5)) / nearness;
            }
        }
        let [columns, rows, depths] = &lighting.texel;
        let texels = columns.iter().zip(rows).zip(depths);
        for ((lit, facing), ((column, row), depth)) in lighting.lit.iter_mut().zip(&lighting.facing).zip(texels) {
            *lit = 0.0;
            if *facing > 0.0 {
                *lit = self.shader.light.intensity * self.shader.shadow.lit([*column, *row, *depth]);
            }
        }
    }

    fn mix(&self, color: &mut Colors, lighting: &LightRow) {
        for color in color {
            let lamps = lighting.facing.iter().zip(&lighting.shine).zip(&lighting.lit);
            for ((color, around), ((facing, shine), lit)) in color.iter_mut().zip(&lighting.around).zip(lamps) {
                *color = *color * (around + lit * facing) + lit * shine;
            }
        }
    }

    /// Background pixels: the horizon is a soft band.
    fn background(&self, y: f32, ids: &[u32], color: &mut Colors) {
        let ray = self.rays.at + self.rays.row * y;
        for (k, _) in ids.iter().enumerate().filter(|(_, id)| **id == 0) {
            let ray = ray + self.rays.column * (k as f32 + 0.5);
            let share = (0.5 + ray.z / ray.norm() * HORIZON).clamp(0.0, 1.0);
            let share = share * share * (3.0 - 2.0 * share);
            let shade = self.floor + (self.sky - self.floor) * share;
            color.iter_mut().zip(shade.iter()).for_each(|(color, shade)| color[k] = *shade);
        }
    }
}

#[inline]
fn positive(x: f32) -> f32 {
    if x > 0.0 { x } else { 0.0 }
}

#[inline]
fn power_32(x: f32) -> f32 {
    let x = x * x;
    let x = x * x;
    let x = x * x;
    let x = x * x;
    x * x
}

/// A colour as the square of the displayed value.
fn linear(color: [f32; 3]) -> Vec3 {
    Vec3::from(color.map(|c| c * c))
}

/// The displayed byte of a squared value.
#[inline]
pub(crate) fn shown(square: f32) -> u8 {
    /// Adding this rounds to the nearest whole number and leaves it in the lowest bits: much faster than a checked conversion.
    const WHOLE: f32 = (1_u32 << 23) as f32;
    let square = positive(if square < 1.0 { square } else { 1.0 });
    (square.sqrt() * 255.0 + WHOLE).to_bits() as u8
}
