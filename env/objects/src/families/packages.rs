//! Packages: grocery boxes, wood blocks, cans, bottles.

use crate::draft::{Draft, Rest};
use crate::lathe::{self, Rz};
use crate::sample::Sampler;
use crate::surface::{P3, Surface, cube_grid};
use nalgebra::{Point3, Vector3};
use std::f64::consts::FRAC_PI_4;

/// A box with half extents `half` and edges rounded by `radius`; one convex part.
pub(crate) fn rounded_box(half: Vector3<f64>, radius: f64, cells: [usize; 3], bevel: usize) -> (Surface, Vec<P3>) {
    let inner = half.map(|h| h - radius);
    let surface = cube_grid(cells, |q| {
        let flat = Vector3::from_fn(|axis, _| {
            let rim = 1.0 - 2.0 * bevel as f64 / cells[axis] as f64;
            let reach = (q[axis].abs() - rim) / (1.0 - rim);
            let size = if reach > 1e-9 {
                inner[axis] + radius * (reach * FRAC_PI_4).tan()
            } else {
                inner[axis] * q[axis].abs() / rim
            };
            size.copysign(q[axis])
        });
        let core = Vector3::from_fn(|axis, _| flat[axis].clamp(-inner[axis], inner[axis]));
        Point3::from(core + (flat - core).normalize() * radius)
    });
    let mut cloud = Vec::new();
    for corner in 0..8 {
        let sign = Vector3::from_fn(|axis, _| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 });
        let core = inner.component_mul(&sign);
        if radius < 0.001 {
            cloud.push(Point3::from(half.component_mul(&sign)));
        } else {
            cloud.extend((0..3).map(|axis| Point3::from(core + Vector3::ith(axis, radius * sign[axis]))));
        }
    }
    (surface, cloud)
}

/// Grocery box of cardboard, upright or on its largest face.
pub(crate) fn grocery_box(sampler: &mut Sampler) -> Draft {
    let thick = sampler.range(0.025, 0.075);
    let wide = thick * sampler.range(1.2, 2.6);
    let high = wide * sampler.range(0.8, 1.6);
    let half = Vector3::new(wide, thick, high) / 2.0;
    let half = if sampler.chance(0.6) { half } else { Vector3::new(half.z, half.x, half.y) };
    // Cardboard folds with an edge radius of about half a millimetre.
    let cells = half.map(|h| (h / 0.006).round().clamp(6.0, 24.0) as usize + 2);
    let (surface, cloud) = rounded_box(half, 0.0005, cells.into(), 1);
    let mass = surface.volume() * sampler.range(200.0, 850.0);
    Draft { surface, parts: vec![cloud], mass, rest: Rest::Stands }
}

/// Wooden toy block with broken edges.
pub(crate) fn wood_block(sampler: &mut Sampler) -> Draft {
    let size = sampler.range(0.022, 0.055);
    let half = Vector3::new(size * sampler.pick([1.0, 1.0, 1.5, 2.0]), size, size * sampler.range(0.6, 1.0)) / 2.0;
    let radius = sampler.range(0.0015, 0.003);
    let cells = half.map(|h| (h / 0.0025).round().clamp(5.0, 16.0) as usize + 4);
    let (surface, cloud) = rounded_box(half, radius, cells.into(), 2);
    let mass = surface.volume() * sampler.range(450.0, 750.0);
    Draft { surface, parts: vec![cloud], mass, rest: Rest::Stands }
}

/// Full food can with seamed rims.
pub(crate) fn can(sampler: &mut Sampler) -> Draft {
    let r = sampler.range(0.026, 0.052);
    let h = r * sampler.range(0.8, 3.2);
    // The lid is 1.2 mm below its seam (a real one 3 to 5 mm), so one convex part is accurate enough.
    let (sink, neck) = (0.0012, r - sampler.range(0.0003, 0.0005));
    let mut profile = vec![Rz::new(r * 0.5, sink), Rz::new(r - 0.004, sink), Rz::new(r - 0.0025, 0.0)];
    profile.extend([Rz::new(r - 0.0008, 0.0), Rz::new(r, 0.0008), Rz::new(r, 0.0025), Rz::new(neck, 0.0035)]);
    let beads = if sampler.chance(0.5) { (h / 0.02) as usize * 2 } else { 0 };
    for bead in 0..beads {
        let z = h * (0.3 + 0.4 * (bead as f64 + 0.5) / beads as f64);
        profile.push(Rz::new(neck - if bead % 2 == 0 { 0.0004 } else { 0.0 }, z));
    }
    let lower: Vec<Rz> = profile[..7].to_vec();
    profile.extend(lower.iter().rev().map(|p| Rz::new(p.x, h - p.y)));
    let outline: Vec<Rz> = profile[2..profile.len() - 2].to_vec();
    let surface = lathe::revolve(&lathe::refine(&profile, 0.006), 48, lathe::round);
    // Wide cans hold coffee or powder, the others food in water (YCB: 360 and 910 to 1010 kg/m3).
    let density = if r > 0.047 { sampler.range(330.0, 450.0) } else { sampler.range(850.0, 1050.0) };
    let mass = surface.volume() * density;
    Draft { surface, parts: vec![lathe::band_cloud(&outline, &lathe::round)], mass, rest: Rest::Stands }
}

/// Full bottle, jar or shampoo bottle with its cap on: body, shoulder, neck, cap; the body may be oval or squarish.
pub(crate) fn bottle(sampler: &mut Sampler) -> Draft {
    let r = sampler.range(0.022, 0.042);
    let body = r * sampler.range(1.8, 3.6);
    let neck_r = r * sampler.range(0.3, 0.75);
    let shoulder = (r - neck_r) * sampler.range(0.6, 1.5);
    let neck = sampler.range(0.004, 0.03);
    let (cap_r, cap) = (neck_r + sampler.range(0.001, 0.002), sampler.range(0.012, 0.024));
    let foot = sampler.range(0.002, 0.005);
    let (squeeze, corner) = (sampler.pick([1.0, 1.0, 0.85, 0.65]), sampler.pick([2.0, 2.0, 3.5]));
    let mut profile = vec![Rz::new(r * 0.5, 0.0), Rz::new(r - foot, 0.0), Rz::new(r - foot * 0.3, foot * 0.3)];
    profile.extend([Rz::new(r, foot), Rz::new(r, body)]);
    for k in 1..8 {
        // A smooth step from body to neck.
        let t = f64::from(k) / 8.0;
        profile.push(Rz::new(r + (neck_r - r) * t * t * (3.0 - 2.0 * t), body + shoulder * t));
    }
    let top = body + shoulder + neck;
    profile.extend([Rz::new(neck_r, body + shoulder), Rz::new(neck_r, top), Rz::new(cap_r, top + 0.0008)]);
    profile.extend([Rz::new(cap_r, top + cap - 0.001), Rz::new(cap_r - 0.001, top + cap)]);
    let outline = profile[1..].to_vec();
    profile.push(Rz::new(cap_r * 0.5, top + cap));
    let place = move |p: Rz, angle: f64| {
        // Oval and square below, round from the neck up.
        let blend = ((body + shoulder - p.y) / shoulder).clamp(0.0, 1.0);
        let (sin, cos) = angle.sin_cos();
        let power = 2.0 + (corner - 2.0) * blend;
        let (x, y) = (cos.abs().powf(2.0 / power).copysign(cos), sin.abs().powf(2.0 / power).copysign(sin));
        let flat = 1.0 - (1.0 - squeeze) * blend;
        Point3::new(p.x * x, p.x * y * flat, p.y)
    };
    let surface = lathe::revolve(&lathe::refine(&profile, 0.007), 48, place);
    let mass = surface.volume() * sampler.range(850.0, 1100.0);
    Draft { surface, parts: lathe::solid_parts(&outline, place), mass, rest: Rest::Stands }
}
