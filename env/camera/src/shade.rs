//! The colour of each pixel: a lamp with shadows, light from above and below, a little from the eye, and a highlight.
//!
//! Colours are squares of what is shown, so that light adds up; a square root brings them back.

use crate::draw::Piece;
use crate::raster::Raster;
use crate::shadow::ShadowMap;
use crate::{Camera, Instance, Light};
use nalgebra::{Matrix3, Vector3};

type Vec3 = Vector3<f32>;

/// Share of the surroundings' light that reaches a surface looking straight down.
const FROM_BELOW: f32 = 0.45;
/// Light from the eye, as a share of the surroundings': it shows shapes in the shade.
const FROM_EYE: f32 = 0.35;
/// Strength of the highlight.
const SHINE: f32 = 0.10;
/// Shadows of open sheets are looked up this many texels in front of them: they would shade themselves.
const LIFT: f64 = 1.5;

/// What a triangle looks like: the normal over its image (world frame, of any length), and whose it is.
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
        if piece.weights.is_none() && own[0] == own[1] && own[1] == own[2] {
            let (normal, none) = (own[0], Vec3::zeros());
            return Self {
                origin,
                normal,
                dx: none,
                dy: none,
                instance,
            };
        }
        // A quantity times the nearness is linear over the image; the length does not matter.
        let at = |k: usize| -> Vector3<f64> {
            let [a, b, c] = own.map(|n| n.cast::<f64>());
            let mixed = piece
                .weights
                .map_or([a, b, c][k], |w| a * w[k][0] + b * w[k][1] + c * w[k][2]);
            mixed * piece.corners[k][2]
        };
        let at = [at(0), at(1), at(2)];
        let slopes = |axis: usize| piece.gradient.smooth(at.map(|n| n[axis]));
        let [x, y, z] = [slopes(0), slopes(1), slopes(2)];
        let column = |k: usize| Vec3::new(x[k] as f32, y[k] as f32, z[k] as f32);
        Self {
            origin,
            normal: at[0].cast(),
            dx: column(0),
            dy: column(1),
            instance,
        }
    }
}

/// All that the colours of one image depend on.
pub(crate) struct Shader<'a> {
    pub(crate) raster: &'a Raster,
    /// Number `id - 1` belongs to the pixels with this id.
    pub(crate) facets: &'a [Facet],
    pub(crate) instances: &'a [Instance<'a>],
    pub(crate) shadow: &'a ShadowMap,
    pub(crate) light: &'a Light,
    pub(crate) camera: &'a Camera,
}

/// Something linear over the image: `at + column * x + row * y`.
struct Linear {
    at: Vec3,
    column: Vec3,
    row: Vec3,
}

impl Linear {
    /// `matrix` times the way of each pixel's ray, whose camera-frame z is 1.
    fn rays(camera: &Camera, matrix: Matrix3<f64>) -> Self {
        let k = camera.intrinsics();
        let (column, row) = (matrix.column(0) / k.fx, matrix.column(1) / k.fy);
        let at = matrix.column(2) - column * k.cx - row * k.cy;
        Self {
            at: at.cast(),
            column: column.cast(),
            row: row.cast(),
        }
    }
}

struct Material {
    color: Vec3,
    lift: f32,
}

impl Shader<'_> {
    /// Colours of the pixels, row by row, as squares of what is shown.
    pub(crate) fn rows(&self, mut take: impl FnMut(&[Vec3])) {
        let world_from_camera = self.camera.world_from_camera();
        let rotation = world_from_camera.rotation.to_rotation_matrix().into_inner();
        let to_texel = self.shadow.texel_from_world.matrix();
        let texel_axes: Matrix3<f64> = to_texel.fixed_view::<3, 3>(0, 0).into_owned();
        let eye = texel_axes * world_from_camera.translation.vector + to_texel.fixed_view::<3, 1>(0, 3);
        let scene = Scene {
            shader: self,
            ways: Linear::rays(self.camera, rotation),
            texels: Linear::rays(self.camera, texel_axes * rotation),
            eye: eye.cast(),
            texel_axes: texel_axes.cast(),
            to_lamp: (-self.light.direction.normalize()).cast(),
            sky: linear(self.light.sky),
            floor: linear(self.light.floor),
            materials: self.materials(),
        };
        let width = self.raster.width;
        let mut colors = vec![Vec3::zeros(); width];
        for (y, ids) in self.raster.ids.chunks_exact(width).enumerate() {
            let nearness = &self.raster.nearness[y * width..][..width];
            scene.row(y as f32 + 0.5, ids, nearness, &mut colors);
            take(&colors);
        }
    }

    fn materials(&self) -> Vec<Material> {
        let of = |instance: &Instance| Material {
            color: linear(instance.color),
            lift: if instance.model.is_closed() {
                0.0
            } else {
                (LIFT * self.shadow.texel) as f32
            },
        };
        self.instances.iter().map(of).collect()
    }
}

struct Scene<'a> {
    shader: &'a Shader<'a>,
    /// Of the rays, in the world.
    ways: Linear,
    /// The same on the shadow map.
    texels: Linear,
    /// The camera on the shadow map.
    eye: Vec3,
    texel_axes: Matrix3<f32>,
    to_lamp: Vec3,
    sky: Vec3,
    floor: Vec3,
    materials: Vec<Material>,
}

impl Scene<'_> {
    fn row(&self, y: f32, ids: &[u32], nearness: &[f32], colors: &mut [Vec3]) {
        let way = self.ways.at + self.ways.row * y;
        let texel = self.texels.at + self.texels.row * y;
        for (x, ((id, nearness), color)) in ids.iter().zip(nearness).zip(colors).enumerate() {
            let x = x as f32 + 0.5;
            let way = way + self.ways.column * x;
            let inverse_length = 1.0 / way.norm();
            *color = if *id == 0 {
                self.background(way.z * inverse_length)
            } else {
                let to_eye = way * -inverse_length;
                let texel = self.eye + (texel + self.texels.column * x) * (1.0 / nearness);
                self.surface(&self.shader.facets[*id as usize - 1], [x, y], &to_eye, texel)
            };
        }
    }

    fn background(&self, rise: f32) -> Vec3 {
        // The horizon is a soft band.
        let share = (0.5 + rise * 2.5).clamp(0.0, 1.0);
        let share = share * share * (3.0 - 2.0 * share);
        self.floor + (self.sky - self.floor) * share
    }

    #[inline]
    fn surface(&self, facet: &Facet, [x, y]: [f32; 2], to_eye: &Vec3, texel: Vec3) -> Vec3 {
        let normal = facet.normal + facet.dx * (x - facet.origin[0]) + facet.dy * (y - facet.origin[1]);
        let normal = normal * (1.0 / normal.norm().max(f32::MIN_POSITIVE));
        let material = &self.materials[facet.instance as usize];
        let light = self.shader.light;
        let around = light.ambient * (FROM_BELOW + (1.0 - FROM_BELOW) * (0.5 + 0.5 * normal.z));
        let mut strength = around + light.ambient * FROM_EYE * normal.dot(to_eye).max(0.0);
        let mut shine = 0.0;
        let facing = normal.dot(&self.to_lamp);
        if facing > 0.0 {
            let texel = texel + self.texel_axes * normal * material.lift;
            let lamp = light.intensity * self.shader.shadow.lit(texel.into());
            strength += lamp * facing;
            let half = self.to_lamp + to_eye;
            let glance = (normal.dot(&half)).max(0.0) / half.norm().max(f32::MIN_POSITIVE);
            shine = lamp * SHINE * glance.powi(32);
        }
        material.color * strength + Vec3::repeat(shine)
    }
}

/// A colour as the square of what is shown.
fn linear(color: [f32; 3]) -> Vec3 {
    Vec3::from(color.map(|c| c * c))
}

/// The byte that shows a square.
#[inline]
pub(crate) fn shown(square: f32) -> u8 {
    (square.clamp(0.0, 1.0).sqrt() * 255.0 + 0.5) as u8
}
