//! Flat objects bent in one plane: fork, spoon, scissors.
//!
//! They are built flat from plates and then bent: every point is raised by a height that depends only on x and y.

use crate::draft::{Draft, Rest};
use crate::families::tools::STEEL;
use crate::implicit::{Piece, Solid};
use crate::nets;
use crate::sample::Sampler;
use crate::surface::P3;
use graspbox_mesh::MeshError;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::f64::consts::TAU;

/// Meshes a flat solid, bends it, and lays it down.
fn bent(solid: &Solid, step: [f64; 3], density: f64, lift: impl Fn(f64, f64) -> f64) -> Result<Draft, MeshError> {
    let mut surface = nets::surface(|p| solid.distance(p), solid.bounds(), Vector3::from(step))?;
    let mut parts = solid.parts();
    for p in surface.vertices.iter_mut().chain(parts.iter_mut().flatten()) {
        p.z += lift(p.x, p.y);
    }
    let mass = surface.volume() * density;
    Ok(Draft { surface, parts, mass, rest: Rest::Lies })
}

/// Smooth rise from 0 to 1 while `x` goes from `from` to `to`.
fn ease(x: f64, from: f64, to: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn material(sampler: &mut Sampler) -> f64 {
    if sampler.chance(0.7) { STEEL } else { 1050.0 }
}

/// Table fork with three or four tines.
pub(crate) fn fork(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let (handle, half) = (sampler.range(0.1, 0.13), sampler.range(0.0012, 0.0016));
    let (end, neck) = (sampler.range(0.008, 0.011), sampler.range(0.0035, 0.0045));
    let (count, tine, gap) = (sampler.pick([3usize, 4]), sampler.range(0.0028, 0.0036), sampler.range(0.003, 0.0038));
    let (palm, tines) = (sampler.range(0.016, 0.022), sampler.range(0.038, 0.05));
    let wide = (count as f64 * tine + (count - 1) as f64 * gap) / 2.0;
    let root = handle + 0.012;
    let mut pieces = vec![
        Piece::prism(
            &[[0.0, -end * 0.7], [0.01, -end], [root, -neck], [root, neck], [0.01, end], [0.0, end * 0.7]],
            half,
            0.0007,
        )
        .cells(5, 1),
        Piece::prism(
            &[
                [handle, -neck],
                [root + 0.01, -wide],
                [root + palm, -wide],
                [root + palm, wide],
                [root + 0.01, wide],
                [handle, neck],
            ],
            half,
            0.0007,
        )
        .cells(3, 1)
        .blend(0.001),
    ];
    for k in 0..count {
        let y = (k as f64 - (count - 1) as f64 / 2.0) * (tine + gap);
        let (from, to) = (root + palm - 0.003, root + palm + tines);
        let outline = [[from, y - tine / 2.0], [to, y - tine * 0.38], [to, y + tine * 0.38], [from, y + tine / 2.0]];
        pieces.push(Piece::prism(&outline, half, 0.0007).cells(3, 1).blend(0.001));
    }
    let (arch, curl) = (sampler.range(0.006, 0.012), sampler.range(0.008, 0.014));
    let tip = root + palm + tines;
    let lift = move |x: f64, _: f64| {
        arch * ease(x, 0.0, handle * 0.75) - (arch + 0.002) * ease(x, handle * 0.75, root + palm)
            + curl * ((x - root - palm * 0.5).max(0.0) / (tip - root - palm * 0.5)).powi(2)
    };
    let density = material(sampler);
    bent(&Solid::new(pieces), [0.0023, 0.0011, 0.001], density, lift)
}

/// Table or serving spoon.
pub(crate) fn spoon(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let (handle, half) = (sampler.range(0.09, 0.13), sampler.range(0.0012, 0.0016));
    let (end, neck) = (sampler.range(0.007, 0.01), sampler.range(0.0035, 0.0045));
    let (long, wide) = (sampler.range(0.024, 0.033), sampler.range(0.018, 0.022));
    let center = handle + long;
    let oval: Vec<[f64; 2]> = (0..24)
        .map(|k| {
            let (sin, cos) = (TAU * k as f64 / 24.0).sin_cos();
            [center + long * cos, wide * sin * (1.0 - 0.12 * cos)]
        })
        .collect();
    let root = handle + 0.008;
    let solid = Solid::new(vec![
        Piece::prism(
            &[[0.0, -end * 0.7], [0.012, -end], [root, -neck], [root, neck], [0.012, end], [0.0, end * 0.7]],
            half,
            0.0007,
        )
        .cells(6, 1),
        Piece::prism(&oval, half, 0.0007).cells(6, 4).blend(0.001),
    ]);
    let (arch, depth) = (sampler.range(0.006, 0.011), sampler.range(0.005, 0.0075));
    let lift = move |x: f64, y: f64| {
        let r = ((x - center) / long).powi(2) + (y / wide).powi(2);
        arch * ease(x, 0.0, handle * 0.7) - arch * ease(x, handle * 0.7, handle + 0.01) - depth * (1.0 - r).max(0.0)
    };
    let density = material(sampler);
    bent(&solid, [0.0028, 0.0018, 0.0009], density, lift)
}

/// Household scissors, a little open: two blades over each other, two finger rings.
pub(crate) fn scissors(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let (blade, shank) = (sampler.range(0.075, 0.105), sampler.range(0.025, 0.04));
    let (wide, half) = (sampler.range(0.007, 0.009), sampler.range(0.0012, 0.0015));
    let (bow, long) = (sampler.range(0.012, 0.015), sampler.range(0.016, 0.024));
    let (open, rod) = (sampler.range(0.06, 0.16), sampler.range(0.0038, 0.0048));
    let mut pieces = vec![Piece::turned(&[[0.004, -half * 2.6], [0.004, half * 2.6]], 0.0006)];
    for side in [-1.0, 1.0] {
        let turn = |z: f64| {
            let spin = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), side * open);
            Isometry3::from_parts(Vector3::new(0.0, 0.0, z).into(), spin)
        };
        // The blade's back is straight, its edge runs to the tip; the two are welded 1 mm into each other.
        let mut outline = [
            [-0.014, -wide * 0.8],
            [0.01, -wide],
            [blade - 0.002, -wide * 0.5],
            [blade, -wide * 0.3],
            [blade, 0.0],
            [blade - 0.002, wide * 0.2],
            [0.01, wide * 0.7],
            [-0.014, wide * 0.8],
        ];
        if side < 0.0 {
            outline.reverse();
            outline.iter_mut().for_each(|p| p[1] = -p[1]);
        }
        pieces.push(Piece::prism(&outline, half + 0.0002, 0.0008).at(turn(side * half)).blend(0.001));
        let from = Point3::new(-0.01, 0.0, side * half * 0.6);
        let ring = Point3::new(-shank - long, -side * (bow + rod) * 1.1, 0.0);
        let joint = ring + Vector3::new(long * 0.85, side * bow * 0.5, 0.0);
        pieces.push(Piece::tube(vec![from, joint], rod).at(turn(0.0)));
        let loop_point = |k: usize| {
            let (sin, cos) = (TAU * (k % 20) as f64 / 20.0).sin_cos();
            ring + Vector3::new(long * cos, bow * sin, 0.0)
        };
        pieces.push(Piece::tube((0..=20).map(loop_point).collect::<Vec<P3>>(), rod).at(turn(0.0)));
    }
    let mut draft = bent(&Solid::new(pieces), [0.0019, 0.0025, 0.0014], 1.0, |_, _| 0.0)?;
    // Steel blades in plastic bows: a third of the volume is steel.
    draft.mass = draft.surface.volume() * (STEEL * 0.35 + 1050.0 * 0.65);
    Ok(draft)
}
