//! Hollow objects of revolution: cup, bowl, plate, wine glass. Walls have real thickness, and so have their convex parts.

use crate::draft::{Draft, Parts, Rest};
use crate::lathe::{self, Rz, Wall};
use crate::sample::Sampler;
use nalgebra::Vector2;
use std::f64::consts::FRAC_PI_2;

/// Density of glazed stoneware and porcelain, kg/m3 (2200 to 2500).
pub(crate) const CERAMIC: f64 = 2350.0;
/// Density of soda-lime glass, kg/m3.
const GLASS: f64 = 2500.0;
/// Density of polypropylene and similar plastics, kg/m3.
pub(crate) const PLASTIC: f64 = 950.0;

/// A vessel: `foot` is its solid underside (heights not falling, from the axis outward), `walls` rise from it.
pub(crate) struct Vessel {
    pub(crate) foot: Vec<Rz>,
    pub(crate) walls: Vec<Wall>,
}

impl Vessel {
    /// The closed profile: under the foot, up the outside, over the rim, down the inside. `step` is the longest row.
    pub(crate) fn profile(&self, step: f64) -> Vec<Rz> {
        let mut profile = vec![Rz::new(self.foot[0].x * 0.5, self.foot[0].y)];
        profile.extend(&self.foot);
        profile.extend(self.walls.iter().map(|w| w.outer));
        // The rim is rounded: its height is 0.28 times its thickness.
        let rim = self.walls[self.walls.len() - 1];
        let across = rim.inner - rim.outer;
        profile.extend([rim.outer + across * 0.2 + self.rim_rise(), rim.outer + across * 0.8 + self.rim_rise()]);
        profile.extend(self.walls.iter().rev().map(|w| w.inner));
        let floor = self.walls[0].inner;
        let mut profile = lathe::refine(&profile, step);
        let rings = (floor.x / (2.0 * step)).ceil().max(2.0) as usize;
        profile.extend((1..rings).map(|k| Rz::new(floor.x * (1.0 - k as f64 / rings as f64), floor.y)));
        profile
    }

    /// From the last wall to the crest of the rim.
    fn rim_rise(&self) -> Vector2<f64> {
        let rim = self.walls[self.walls.len() - 1];
        let across = rim.inner - rim.outer;
        Vector2::new(across.y, -across.x) * 0.28
    }

    /// Convex parts: the foot with the floor, then the wall's segments.
    pub(crate) fn parts(&self) -> Parts {
        let mut solid = self.foot.clone();
        solid.extend([self.walls[0].outer, self.walls[0].inner]);
        let mut parts = lathe::solid_parts(&solid, lathe::round);
        // The flat rim of the parts lies half way up the rounded one.
        let (mut walls, half) = (self.walls.clone(), self.rim_rise() / 2.0);
        if let Some(rim) = walls.last_mut() {
            (rim.outer, rim.inner) = (rim.outer + half, rim.inner + half);
        }
        parts.extend(lathe::wall_parts(&walls));
        parts
    }

    fn into_draft(self, columns: usize, step: f64, density: f64) -> Draft {
        let surface = lathe::revolve(&self.profile(step), columns, lathe::round);
        let mass = surface.volume() * density;
        Draft { surface, parts: self.parts(), mass, rest: Rest::Stands }
    }
}

/// Walls of the given thickness inside an outer line, measured along its normals.
pub(crate) fn shell(outer: &[Rz], thickness: f64) -> Vec<Wall> {
    let last = outer.len() - 1;
    let inner = |i: usize| {
        let along = (outer[(i + 1).min(last)] - outer[i.saturating_sub(1)]).normalize();
        outer[i] + Vector2::new(-along.y, along.x) * thickness
    };
    (0..=last).map(|i| Wall { outer: outer[i], inner: inner(i) }).collect()
}

/// Walls of a tumbler or mug with a floor of thickness `floor`; `radius` is a function of the share of the height, in [0, 1].
pub(crate) fn upright_walls(radius: impl Fn(f64) -> f64, height: f64, thickness: f64, floor: f64) -> Vec<Wall> {
    let station = |k: usize| {
        let share = k as f64 / 8.0;
        let z = height * share;
        let inside = (floor + (height - floor) * share) / height;
        Wall { outer: Rz::new(radius(share), z), inner: Rz::new(radius(inside) - thickness, inside * height) }
    };
    let mut walls: Vec<Wall> = (0..=8).map(station).collect();
    // The wall starts above the floor's underside, which has a broken edge.
    let edge = floor * 0.4;
    walls[0].outer = Rz::new(radius(edge / height), edge);
    walls
}

/// Tumbler, drinking glass or stacking cup without a handle.
pub(crate) fn cup(sampler: &mut Sampler) -> Draft {
    let rim = sampler.range(0.026, 0.046);
    let height = rim * sampler.range(1.5, 3.0);
    let (taper, bulge) = (sampler.range(0.7, 1.0), sampler.range(0.0, 0.04));
    let glass = sampler.chance(0.5);
    let thickness = sampler.range(0.002, 0.0035);
    let floor = if glass { sampler.range(0.004, 0.008) } else { sampler.range(0.002, 0.004) };
    let radius = |t: f64| rim * (taper + (1.0 - taper) * t + bulge * 4.0 * t * (1.0 - t));
    let walls = upright_walls(radius, height, thickness, floor);
    let foot = vec![Rz::new(radius(0.0) - floor * 0.4, 0.0)];
    Vessel { foot, walls }.into_draft(48, 0.007, if glass { GLASS } else { PLASTIC })
}

/// Bowl on a low foot, its side a quarter of an ellipse.
pub(crate) fn bowl(sampler: &mut Sampler) -> Draft {
    let rim = sampler.range(0.05, 0.076);
    let foot_r = rim * sampler.range(0.4, 0.55);
    let height = rim * sampler.range(0.55, 0.95);
    let foot_h = sampler.range(0.002, 0.005);
    let thickness = sampler.range(0.003, 0.005);
    let flare = sampler.range(0.55, 0.8);
    let side = |k: usize| {
        let (sin, cos) = (FRAC_PI_2 * flare * k as f64 / 12.0).sin_cos();
        let (s1, c1) = (FRAC_PI_2 * flare).sin_cos();
        Rz::new(foot_r + (rim - foot_r) * sin / s1, foot_h + (height - foot_h) * (1.0 - cos) / (1.0 - c1))
    };
    let walls = shell(&(0..=12).map(side).collect::<Vec<_>>(), thickness);
    let foot = vec![Rz::new(foot_r - 0.001, 0.0), Rz::new(foot_r, 0.001)];
    Vessel { foot, walls }.into_draft(64, 0.007, if sampler.chance(0.7) { CERAMIC } else { PLASTIC })
}

/// Flat plate with a raised rim; large ones cannot be grasped across.
pub(crate) fn plate(sampler: &mut Sampler) -> Draft {
    let rim = sampler.range(0.075, 0.135);
    let (foot_r, height) = (rim * sampler.range(0.55, 0.68), rim * sampler.range(0.13, 0.22));
    let thickness = sampler.range(0.0035, 0.005);
    let (foot_h, curl) = (0.002, sampler.range(1.0, 1.25));
    let side = |k: usize| {
        let t = k as f64 / 8.0;
        Rz::new(foot_r + (rim - foot_r) * t, foot_h + (height - foot_h) * t.powf(curl))
    };
    let outer: Vec<Rz> = (0..=8).map(side).collect();
    let foot = vec![Rz::new(foot_r, 0.0)];
    Vessel { foot, walls: shell(&outer, thickness) }.into_draft(
        72,
        0.007,
        if sampler.chance(0.8) { CERAMIC } else { PLASTIC },
    )
}

/// Stemmed glass of glass or, as YCB's wine cup, of plastic.
pub(crate) fn wine_glass(sampler: &mut Sampler) -> Draft {
    let belly = sampler.range(0.03, 0.042);
    let base = belly * sampler.range(0.8, 0.95);
    let stem_r = sampler.range(0.0035, 0.005);
    let stem = sampler.range(0.05, 0.085);
    let bowl_h = belly * sampler.range(1.7, 2.4);
    let mouth = sampler.range(0.72, 0.95);
    let thickness = sampler.range(0.002, 0.0026);
    let foot = vec![
        Rz::new(base - 0.001, 0.0),
        Rz::new(base, 0.001),
        Rz::new(base, 0.002),
        Rz::new(base * 0.4, 0.0045),
        Rz::new(stem_r * 1.6, 0.008),
        Rz::new(stem_r, 0.014),
        Rz::new(stem_r, stem),
    ];
    let side = |k: usize| {
        let t = k as f64 / 14.0;
        // An ellipse up to the belly at 45 per cent of the height, then a smooth taper to the mouth.
        let r = if t < 0.45 {
            let s = t / 0.45;
            (1.0 - (1.0 - s).powi(2)).sqrt()
        } else {
            let s = (t - 0.45) / 0.55;
            1.0 + (mouth - 1.0) * s * s * (2.0 - s)
        };
        let r_start = stem_r * 1.4;
        Rz::new(r_start + (belly - r_start) * r, stem + 0.003 + bowl_h * t)
    };
    let walls = shell(&(0..=14).map(side).collect::<Vec<_>>(), thickness);
    Vessel { foot, walls }.into_draft(48, 0.008, if sampler.chance(0.6) { GLASS } else { PLASTIC })
}
