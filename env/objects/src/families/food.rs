//! Fruit: apple, orange, lemon, pear, peach; and the banana.

use crate::cloud::convex_cloud;
use crate::draft::{Draft, Parts, Rest};
use crate::lathe::{self, Rz};
use crate::sample::Sampler;
use crate::surface::{P3, Surface};
use graspbox_mesh::MeshError;
use nalgebra::{Point3, Vector3};
use std::f64::consts::{PI, TAU};

/// A convex fruit: an ellipsoid with a slight point, `tip`, at both ends of its axis.
fn egg(radius: f64, stretch: f64, tip: f64) -> Surface {
    let profile: Vec<Rz> = (1..32)
        .map(|k| {
            let (sin, cos) = (PI * f64::from(k) / 32.0).sin_cos();
            Rz::new(radius * sin, -radius * (stretch + tip * cos.powi(8)) * cos)
        })
        .collect();
    let reach = radius * (stretch + tip);
    let mut surface = lathe::revolve(&profile, 40, lathe::round);
    let poles = surface.vertices.len();
    (surface.vertices[poles - 2].z, surface.vertices[poles - 1].z) = (-reach, reach);
    surface
}

/// Apple: dimples at both ends; its parts are wedges about the axis, whose half outlines are convex.
fn apple(sampler: &mut Sampler) -> (Surface, Parts) {
    let radius = sampler.range(0.031, 0.042);
    let (dimple, stretch) = (sampler.range(0.09, 0.16), sampler.range(0.92, 1.05));
    let point = |t: f64| {
        let (sin, cos) = t.sin_cos();
        // Full above the waist, narrower below, hollow where the axis comes out.
        let r = radius * sin * (1.0 - 0.1 * cos) / 1.01;
        let hollow = dimple * (-(sin / 0.45).powi(2)).exp();
        Rz::new(r, -radius * stretch * cos * (1.0 - hollow / 0.8))
    };
    let profile: Vec<Rz> = (1..32).map(|k| point(PI * f64::from(k) / 32.0)).collect();
    let ends = [point(0.0).y, point(PI).y];
    let mut surface = lathe::revolve(&profile, 40, lathe::round);
    let poles = surface.vertices.len();
    (surface.vertices[poles - 2].z, surface.vertices[poles - 1].z) = (ends[0], ends[1]);
    let wedge = |k: usize| {
        let mut cloud: Vec<P3> = ends.iter().map(|&z| Point3::new(0.0, 0.0, z)).collect();
        for p in profile.iter().step_by(2) {
            let p = Rz::new(p.x * 1.005, p.y);
            cloud.extend([0.0, 0.5, 1.0].map(|s| lathe::round(p, TAU * (k as f64 + s) / 8.0)));
        }
        cloud
    };
    (surface, (0..8).map(wedge).collect())
}

/// Pear: one outline with a belly and a neck.
fn pear(sampler: &mut Sampler) -> (Surface, Parts) {
    let radius = sampler.range(0.029, 0.038);
    let (height, neck) = (radius * sampler.range(2.3, 2.9), sampler.range(0.5, 0.62));
    let mut profile = Vec::new();
    for k in 1..32 {
        let t = f64::from(k) / 32.0;
        let z = height * (1.0 - (PI * t).cos()) / 2.0;
        let share = z / height;
        let belly =
            1.0 - (1.0 - neck) * (share / 0.95).clamp(0.0, 1.0).powi(2) * (3.0 - 2.0 * (share / 0.95).clamp(0.0, 1.0));
        let closing = (1.0 - (2.0 * share - 1.0).abs().powf(3.5)).max(0.0).sqrt();
        profile.push(Rz::new(radius * belly * closing, z));
    }
    let mut surface = lathe::revolve(&profile, 40, lathe::round);
    let poles = surface.vertices.len();
    (surface.vertices[poles - 2].z, surface.vertices[poles - 1].z) = (0.0, height);
    let mut outline = vec![Rz::new(0.0, 0.0)];
    outline.extend(&profile);
    outline.push(Rz::new(0.0, height));
    (surface, lathe::solid_parts(&outline, lathe::round))
}

/// Apple, orange, lemon, pear or peach.
pub(crate) fn fruit(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let (surface, parts, rest) = match sampler.pick([0, 1, 2, 3, 4]) {
        0 => {
            let (surface, parts) = apple(sampler);
            (surface, Some(parts), Rest::Stands)
        }
        1 => (egg(sampler.range(0.031, 0.042), sampler.range(0.9, 1.0), 0.0), None, Rest::Stands),
        2 => {
            let mut lemon = egg(sampler.range(0.022, 0.029), sampler.range(1.1, 1.25), sampler.range(0.08, 0.15));
            for p in &mut lemon.vertices {
                *p = Point3::new(p.z, p.y, -p.x);
            }
            (lemon, None, Rest::Lies)
        }
        3 => {
            let (surface, parts) = pear(sampler);
            (surface, Some(parts), Rest::Stands)
        }
        _ => (egg(sampler.range(0.027, 0.037), sampler.range(0.93, 1.05), 0.0), None, Rest::Stands),
    };
    let mass = surface.volume() * sampler.range(820.0, 1000.0);
    let parts = match parts {
        Some(parts) => parts,
        None => vec![convex_cloud(&surface.vertices)?],
    };
    Ok(Draft { surface, parts, mass, rest })
}

/// Banana: a rounded five-sided section along a bow, with its stalk.
pub(crate) fn banana(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let (length, radius) = (sampler.range(0.15, 0.21), sampler.range(0.015, 0.02));
    let (bow, edges) = (sampler.range(1.1, 1.7), sampler.range(0.02, 0.05));
    let stalk = sampler.range(0.1, 0.16);
    let arc = length / bow;
    let girth = |t: f64| {
        let body = (t / 0.16).min(1.0).min((1.0 - stalk - t).max(0.0) / 0.2 + 0.28);
        let body = (1.0 - (1.0 - body.min(1.0)).powi(2)).max(0.06);
        radius * body
    };
    let ring = |t: f64| -> Vec<P3> {
        let angle = bow * (t - 0.5);
        let (sin, cos) = angle.sin_cos();
        let (out, center) = (Vector3::new(sin, cos, 0.0), Vector3::new(sin, cos, 0.0) * arc);
        let point = |j: usize| {
            let turn = TAU * j as f64 / 30.0;
            let r = girth(t) * (1.0 + edges * (5.0 * turn).cos());
            Point3::from(center + out * (r * turn.cos()) + Vector3::z() * (r * turn.sin()))
        };
        (0..30).map(point).collect()
    };
    let rings: Vec<Vec<P3>> = (0..=48).map(|k| ring(f64::from(k) / 48.0)).collect();
    let middle = |r: &[P3]| Point3::from(r.iter().map(|p| p.coords).sum::<Vector3<f64>>() / r.len() as f64);
    let surface = Surface::skin(&rings, middle(&rings[0]), middle(&rings[48]));
    let part = |from: usize, to: usize| -> Vec<P3> {
        [from, (from + to) / 2, to].iter().flat_map(|&i| rings[i].iter().step_by(2).copied()).collect()
    };
    // Shorter parts at the stalk, where the outline is hollow.
    let mut parts: Parts = (0..9).map(|k| part(k * 4, k * 4 + 4)).collect();
    parts.extend((18..24).map(|k| part(k * 2, k * 2 + 2)));
    let mass = surface.volume() * sampler.range(900.0, 1000.0);
    Ok(Draft { surface, parts, mass, rest: Rest::Stands })
}
