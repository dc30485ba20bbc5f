//! What the lamp sees, and from it how much of its light reaches a point.
//!
//! Closed models are drawn by the sides that face away from the lamp: lit surfaces then do not shade themselves.

use crate::draw::{Cull, Lens, Scratch, View, draw};
use crate::raster::Raster;
use crate::{Detail, Instance, Light};
use nalgebra::{Affine3, Isometry3, Matrix4, Rotation3, UnitQuaternion, Vector3};

/// Texels across the soft border.
const KERNEL: usize = 4;
/// Texels along a side of a block; blocks know the least and greatest nearness in and next to them.
const BLOCK: usize = 8;
/// Most texels along a side of the map.
const LARGEST: f64 = 1024.0;
/// Nearness of texels in which no caster lies: the lamp's light goes on for ever.
const NOTHING: f32 = f32::MIN;
/// How much nearer to the lamp than the receiver a caster must be, metres.
const BIAS: f32 = 4e-4;

pub(crate) struct ShadowMap {
    raster: Raster,
    scratch: Scratch,
    /// (blocks high, blocks wide): least and greatest nearness in the 3 x 3 blocks about each.
    blocks: Vec<[f32; 2]>,
    spare: Vec<[f32; 2]>,
    /// (column, row, nearness) of a world point.
    pub(crate) texel_from_world: Affine3<f64>,
    /// Width of a texel, metres.
    pub(crate) texel: f64,
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

    /// Draws the casters as the lamp sees them.
    pub(crate) fn draw(&mut self, instances: &[Instance], light: &Light, detail: Detail) {
        let way = light.direction.normalize();
        let side = if way.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let light_from_world = UnitQuaternion::from_rotation_matrix(&Rotation3::face_towards(&way, &side)).inverse();
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
        // A border that holds the kernel of every point inside.
        let origin = least.map(|x| x - (KERNEL + 1) as f64 * self.texel);
        let texels =
            |axis: usize| (((most[axis] - origin[axis]) * per_metre) as usize + KERNEL + 2).next_multiple_of(BLOCK);
        self.raster.clear(texels(0), texels(1), NOTHING, false);
        let view = View {
            view_from_world: light_from_world,
            lens: Lens::Parallel {
                pixels_per_metre: per_metre,
                origin,
            },
            detail,
        };
        for instance in casters() {
            draw::<false>(
                &mut self.raster,
                &mut self.scratch,
                &view,
                Cull::Front,
                instance,
                0,
                &mut |_| 0,
            );
        }
        self.summarise();
        let scale = Matrix4::new_nonuniform_scaling(&Vector3::new(per_metre, per_metre, -1.0));
        let shift = Matrix4::new_translation(&Vector3::new(-origin[0], -origin[1], 0.0));
        self.texel_from_world = Affine3::from_matrix_unchecked(scale * shift * light_from_world.to_homogeneous());
    }

    fn summarise(&mut self) {
        let (wide, high) = (self.raster.width / BLOCK, self.raster.height / BLOCK);
        let join = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let none = [f32::MAX, f32::MIN];
        self.spare.clear();
        self.spare.resize(wide * high, none);
        for (y, row) in self.raster.nearness.chunks_exact(self.raster.width).enumerate() {
            let blocks = &mut self.spare[y / BLOCK * wide..][..wide];
            for (block, texels) in blocks.iter_mut().zip(row.chunks_exact(BLOCK)) {
                *block = texels.iter().fold(*block, |b, w| join(b, [*w, *w]));
            }
        }
        self.blocks.clear();
        for y in 0..high {
            for x in 0..wide {
                let mut all = none;
                for row in y.saturating_sub(1)..(y + 2).min(high) {
                    let around = &self.spare[row * wide + x.saturating_sub(1)..row * wide + (x + 2).min(wide)];
                    all = around.iter().fold(all, |a, b| join(a, *b));
                }
                self.blocks.push(all);
            }
        }
    }

    /// Share of the lamp's light that reaches a point at (column, row, nearness), in [0, 1].
    #[inline]
    pub(crate) fn lit(&self, [x, y, nearness]: [f32; 3]) -> f32 {
        let half = 0.5 * KERNEL as f32;
        let (left, top) = (x - half, y - half);
        let fits = |from: f32, size: usize| from >= 0.0 && from < size as f32 - (KERNEL + 1) as f32;
        if !fits(left, self.raster.width) || !fits(top, self.raster.height) {
            return 1.0;
        }
        let limit = nearness + BIAS;
        let block = y as usize / BLOCK * (self.raster.width / BLOCK) + x as usize / BLOCK;
        let [least, most] = self.blocks[block];
        if most <= limit {
            return 1.0;
        }
        if least > limit {
            return 0.0;
        }
        let (column, row) = (left as usize, top as usize);
        let (share_x, share_y) = (left - column as f32, top - row as f32);
        let mut shaded = 0.0;
        for k in 0..=KERNEL {
            let start = (row + k) * self.raster.width + column;
            let texels = &self.raster.nearness[start..=start + KERNEL];
            let dark = |w: f32| if w > limit { 1.0 } else { 0.0 };
            let inner: f32 = texels[1..KERNEL].iter().map(|w| dark(*w)).sum();
            let line = inner + dark(texels[0]) * (1.0 - share_x) + dark(texels[KERNEL]) * share_x;
            shaded += line
                * if k == 0 {
                    1.0 - share_y
                } else if k == KERNEL {
                    share_y
                } else {
                    1.0
                };
        }
        let lit = 1.0 - shaded / (KERNEL * KERNEL) as f32;
        lit * lit * (3.0 - 2.0 * lit)
    }
}
