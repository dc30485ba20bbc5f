//! The shadow map of the lamp, and the share of its light that reaches a point.
//!
//! Of closed models the map contains the sides that face away from the lamp, so lit surfaces do not shadow themselves.

use crate::renderer::raster::Raster;
use crate::renderer::rasterize::{Cull, Projection, Scratch, View, rasterize};
use crate::{Detail, Instance, Light};
use nalgebra::{Affine3, Isometry3, Matrix4, Rotation3, UnitQuaternion, Vector3};

/// Texels across the soft border.
const KERNEL: usize = 4;
/// Texels along a side of a block. A block has the extrema of nearness in it and its neighbours, which covers the kernel.
const BLOCK: usize = 4;
/// Largest number of texels along a side of the map.
const LARGEST: f64 = 1024.0;
/// Nearness of texels without a caster.
const NOTHING: f32 = f32::MIN;
/// Least distance of a caster in front of the receiver, metres.
const BIAS: f32 = 4e-4;
/// Offset of open surfaces away from the lamp, texels: they would shadow themselves without it.
const SETBACK: f64 = 4.0;

pub(crate) struct ShadowMap {
    raster: Raster,
    scratch: Scratch,
    /// (rows, columns) of blocks: least and greatest nearness in the 3 x 3 blocks about each.
    blocks: Vec<[f32; 2]>,
    spare: Vec<[f32; 2]>,
    /// (column, row, nearness) of a world point.
    pub(crate) texel_from_world: Affine3<f64>,
    /// Width of a texel, metres.
    texel: f64,
}

impl ShadowMap {
    pub(crate) fn new() -> Self {
        Self {
            raster: Raster::new(),
            scratch: Scratch::default(),
            blocks: Vec::new(),
            spare: Vec::new(),
            texel_from_world: Affine3::identity(),
            texel: 1.0,
        }
    }

    /// Rasterizes the casters from the lamp.
    pub(crate) fn rasterize(&mut self, instances: &[Instance], light: &Light, detail: Detail) {
        let direction = light.direction.normalize();
        let side = if direction.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let light_from_world =
            UnitQuaternion::from_rotation_matrix(&Rotation3::face_towards(&direction, &side)).inverse();
        let light_from_world = Isometry3::from_parts(Default::default(), light_from_world);
        let casters = || instances.iter().filter(|i| i.casts_shadow && light.shadows);
        let (mut least, mut most) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for instance in casters() {
            let light_from_model = light_from_world * instance.world_from_model;
            for p in instance.model.bounds().map(|p| light_from_model * p) {
                for axis in 0..2 {
                    least[axis] = least[axis].min(p[axis]);
                    most[axis] = most[axis].max(p[axis]);
                }
            }
        }
        let span = (most[0] - least[0]).max(most[1] - least[1]);
        if !span.is_finite() {
            self.raster.clear(0, 0, NOTHING, false);
            return;
        }
        self.texel = (light.softness / KERNEL as f64).max(span / LARGEST);
        let per_metre = 1.0 / self.texel;
        // A border that contains the kernel of every point inside.
        let origin = least.map(|x| x - (KERNEL + 1) as f64 * self.texel);
        let texels =
            |axis: usize| (((most[axis] - origin[axis]) * per_metre) as usize + KERNEL + 2).next_multiple_of(BLOCK);
        self.raster.clear(texels(0), texels(1), NOTHING, false);
        let view = View {
            view_from_world: light_from_world,
            projection: Projection::Parallel { pixels_per_metre: per_metre, origin },
            detail,
        };
        for instance in casters() {
            let mut caster = *instance;
            if !caster.model.is_closed() {
                caster.world_from_model.translation.vector += direction * (SETBACK * self.texel);
            }
            let (raster, scratch) = (&mut self.raster, &mut self.scratch);
            rasterize::<false>(raster, scratch, &view, Cull::Front, &caster, 0, &mut |_| 0);
        }
        self.summarize_blocks();
        let scale = Matrix4::new_nonuniform_scaling(&Vector3::new(per_metre, per_metre, -1.0));
        let shift = Matrix4::new_translation(&Vector3::new(-origin[0], -origin[1], 0.0));
        self.texel_from_world = Affine3::from_matrix_unchecked(scale * shift * light_from_world.to_homogeneous());
    }

    /// Extrema of each block, then of each with its neighbours along the rows, then along the columns.
    fn summarize_blocks(&mut self) {
        let (wide, high) = (self.raster.width / BLOCK, self.raster.height / BLOCK);
        self.spare.clear();
        self.spare.resize(wide * high, NONE);
        for (y, row) in self.raster.nearness.chunks_exact(self.raster.width).enumerate() {
            let blocks = &mut self.spare[y / BLOCK * wide..][..wide];
            for (block, texels) in blocks.iter_mut().zip(row.chunks_exact(BLOCK)) {
                *block = texels.iter().fold(*block, |b, w| join(b, [*w, *w]));
            }
        }
        self.blocks.clear();
        for row in self.spare.chunks_exact(wide) {
            let around = |x: usize| row[x.saturating_sub(1)..(x + 2).min(wide)].iter();
            self.blocks.extend((0..wide).map(|x| around(x).fold(NONE, |a, b| join(a, *b))));
        }
        self.spare.clear();
        for y in 0..high {
            let row = |y: usize| &self.blocks[y * wide..][..wide];
            let (above, below) = (row(y.saturating_sub(1)), row((y + 1).min(high - 1)));
            let lines = above.iter().zip(row(y)).zip(below);
            self.spare.extend(lines.map(|((a, b), c)| join(join(*a, *b), *c)));
        }
        std::mem::swap(&mut self.blocks, &mut self.spare);
    }

    /// Share of the lamp's light that reaches a point at (column, row, nearness), in [0, 1].
    #[inline]
    pub(crate) fn lit(&self, [x, y, nearness]: [f32; 3]) -> f32 {
        let half = 0.5 * KERNEL as f32;
        let (left, top) = (x - half, y - half);
        let fits = |from: f32, size: usize| from >= 1.0 && from < size as f32 - (KERNEL + 1) as f32;
        if !fits(left, self.raster.width) || !fits(top, self.raster.height) {
            return 1.0;
        }
        let limit = nearness + BIAS;
        let block = whole(y) / BLOCK * (self.raster.width / BLOCK) + whole(x) / BLOCK;
        let [least, most] = self.blocks[block];
        if most <= limit {
            return 1.0;
        }
        if least > limit {
            return 0.0;
        }
        let (column, row) = (whole(left), whole(top));
        let (share_x, share_y) = (left - column as f32, top - row as f32);
        let mut columns = [0.0; KERNEL + 1];
        for k in 0..=KERNEL {
            let weight = [1.0 - share_y, 1.0, 1.0, 1.0, share_y][k];
            let start = (row + k) * self.raster.width + column;
            let texels = &self.raster.nearness[start..start + KERNEL + 1];
            for (sum, w) in columns.iter_mut().zip(texels) {
                *sum += if *w > limit { weight } else { 0.0 };
            }
        }
        let [first, inner @ .., last] = columns;
        let shaded = first * (1.0 - share_x) + inner.iter().sum::<f32>() + last * share_x;
        let lit = 1.0 - shaded / (KERNEL * KERNEL) as f32;
        lit * lit * (3.0 - 2.0 * lit)
    }
}

/// Extrema of no texels.
const NONE: [f32; 2] = [f32::MAX, f32::MIN];

#[inline]
fn join(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [if b[0] < a[0] { b[0] } else { a[0] }, if b[1] > a[1] { b[1] } else { a[1] }]
}

/// `x`, at least 1, rounded down; a whole `x` may lose 1. Much faster than a checked conversion.
#[inline]
fn whole(x: f32) -> usize {
    const WHOLE: f32 = (1_u32 << 23) as f32;
    (((x - 0.5) + WHOLE).to_bits() & 0xffff) as usize
}
