//! Lathed objects with a handle: a mug (its handle has a real hole).

use crate::draft::{Draft, Parts, Rest};
use crate::families::vessels::{CERAMIC, PLASTIC, Vessel, upright_walls};
use crate::lathe::{self, Rz};
use crate::sample::Sampler;
use crate::surface::{P3, Patch};
use nalgebra::{Point3, Vector2, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Rings of a tube in the plane y = 0: a centre line of (x, z) and the half axes (across y, in the plane) at each point.
fn rings(line: &[Vector2<f64>], half: impl Fn(f64) -> Vector2<f64>, section: &[Vector2<f64>]) -> Vec<Vec<P3>> {
    let last = line.len() - 1;
    let ring = |i: usize| {
        let along = (line[(i + 1).min(last)] - line[i.saturating_sub(1)]).normalize();
        let (up, size) = (Vector3::new(-along.y, 0.0, along.x), half(i as f64 / last as f64));
        let center = Point3::new(line[i].x, 0.0, line[i].y);
        section.iter().map(|s| center + Vector3::y() * (s.x * size.x) + up * (s.y * size.y)).collect()
    };
    (0..=last).map(ring).collect()
}

/// Convex parts of a tube: each spans `stride` steps between rings.
fn tube_parts(rings: &[Vec<P3>], stride: usize) -> Parts {
    let last = rings.len() - 1;
    let part = |start: usize| {
        let end = (start + stride).min(last);
        let mut cloud = Vec::new();
        for i in [start, (start + end) / 2, end] {
            cloud.extend(&rings[i]);
        }
        cloud
    };
    (0..last).step_by(stride).map(part).collect()
}

/// Rows of a profile that lie between two heights on its outside, as (first, last) row of quads.
fn rows_between(profile: &[Rz], low: f64, high: f64) -> (usize, usize) {
    let near = |z: f64| {
        let outside = profile.windows(2).take_while(|w| w[1].y >= w[0].y).count();
        (0..=outside).min_by(|&i, &j| (profile[i].y - z).abs().total_cmp(&(profile[j].y - z).abs())).unwrap_or(0)
    };
    (near(low), near(high))
}

/// Mug with a handle through which fingers go.
pub(crate) fn mug(sampler: &mut Sampler) -> Draft {
    let rim = sampler.range(0.036, 0.046);
    let height = rim * sampler.range(1.9, 2.5);
    let (taper, bulge) = (sampler.range(0.85, 1.0), sampler.range(0.0, 0.05));
    let (thickness, floor) = (sampler.range(0.003, 0.0045), sampler.range(0.004, 0.007));
    let radius = move |t: f64| rim * (taper + (1.0 - taper) * t + bulge * 4.0 * t * (1.0 - t));
    let walls = upright_walls(radius, height, thickness, floor);
    let vessel = Vessel { foot: vec![Rz::new(radius(0.0) - floor * 0.4, 0.0)], walls };
    let profile = outside_rows(&vessel, height);
    let columns = 60;
    let mut surface = lathe::revolve(&profile, columns, lathe::round);

    let (width, depth) = (sampler.range(0.009, 0.014), sampler.range(0.007, 0.010));
    let (reach, square) = (sampler.range(0.024, 0.034), sampler.range(2.0, 3.0));
    let (top, bottom) = (height * sampler.range(0.78, 0.85), height * sampler.range(0.18, 0.3));
    let across = if width > 0.0115 { 2 } else { 1 };
    let patch = |z: f64| Patch {
        rows: rows_between(&profile, z - depth / 2.0, z + depth / 2.0),
        columns: (columns - across, columns + across),
    };
    let (upper, mut lower) = (patch(top), patch(bottom));
    lower.rows.1 = lower.rows.0 + (upper.rows.1 - upper.rows.0);
    let middle = |p: &Patch| (profile[p.rows.0].y + profile[p.rows.1].y) / 2.0;
    let (z1, z0) = (middle(&upper), middle(&lower));
    let line: Vec<Vector2<f64>> = (1..32)
        .map(|k| {
            let angle = FRAC_PI_2 - PI * f64::from(k) / 32.0;
            let (sin, cos) = angle.sin_cos();
            let bow = Vector2::new(cos.abs().powf(2.0 / square), sin.abs().powf(2.0 / square).copysign(sin));
            let z = (z0 + z1) / 2.0 + (z1 - z0) / 2.0 * bow.y;
            Vector2::new(radius(z / height) + 0.0012 + reach * bow.x, z)
        })
        .collect();
    let rings = rings(&line, |_| Vector2::new(width / 2.0, depth / 2.0), &upper.section());
    surface.cut(columns, &[upper, lower]);
    let (from, to) = (upper.outward(columns), lower.inward(columns));
    let corners = |hole: &[u32]| hole.iter().map(|&v| surface.vertices[v as usize]).collect::<Vec<_>>();
    let (root, end) = ([corners(&from), rings[0].clone()], [rings[rings.len() - 1].clone(), corners(&to)]);
    surface.sew(&from, &rings, Some(&to));
    let mut parts = vessel.parts();
    parts.extend([root.concat(), end.concat()]);
    parts.extend(tube_parts(&rings, 3));
    let mass = surface.volume() * if sampler.chance(0.8) { CERAMIC } else { PLASTIC };
    Draft { surface, parts, mass, rest: Rest::Stands }
}

/// Profile of an upright vessel with rows of 4.5 mm outside, where handles are attached, and coarser ones inside.
fn outside_rows(vessel: &Vessel, height: f64) -> Vec<Rz> {
    let fine = vessel.profile(0.0045);
    let Some(top) = fine.iter().position(|p| p.y > height * 0.999) else {
        return fine;
    };
    let mut profile = fine[..=top].to_vec();
    let coarse = vessel.profile(0.012);
    let from = coarse.iter().position(|p| p.y > height * 0.999).map_or(0, |i| i + 1);
    profile.extend(&coarse[from..]);
    profile
}
