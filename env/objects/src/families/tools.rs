//! Tools, lying on the table: hammer, screwdriver, clamp, chain, ring.

use crate::draft::{Draft, Rest};
use crate::implicit::{Piece, Solid, along_x, along_y};
use crate::lathe::{self, Rz};
use crate::nets;
use crate::sample::Sampler;
use crate::surface::P3;
use graspbox_mesh::MeshError;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Density of carbon steel, kg/m3.
pub(crate) const STEEL: f64 = 7850.0;
/// Density of ash and hickory handles, kg/m3.
const WOOD: f64 = 720.0;

/// Cross-peen hammer: an oval handle along x, the head across it.
pub(crate) fn hammer(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let length = sampler.range(0.22, 0.32);
    let head = sampler.range(0.085, 0.125);
    let half = head * sampler.range(0.1, 0.13);
    let grip = sampler.range(0.012, 0.0155);
    let (neck, face) = ((grip * sampler.range(0.72, 0.85)).min(half * 0.95), half * sampler.range(1.0, 1.2));
    let handle = [[grip * 0.8, 0.0], [grip, 0.02], [grip, length * 0.4], [neck, length - half]];
    let (eye, reach) = (half * 1.1, head / 2.0);
    let at_head = |y: f64| Vector3::new(length, y, 0.0);
    let (root, edge) = (half * 0.94, half * 0.35);
    let wedge = [[-root, -0.006], [root, -0.006], [root, 0.0], [edge, reach - eye], [-edge, reach - eye], [-root, 0.0]];
    // The outline of the wedge is given in (z, y) and swept along x.
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2)
        * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
    let solid = Solid::new(vec![
        Piece::turned(&handle, 0.004).at(along_x(Vector3::zeros())),
        Piece::block([half * 1.05, eye + 0.002, half], 0.0025).at(Isometry3::translation(length, 0.0, 0.0)).blend(0.0),
        Piece::prism(&wedge, half, 0.0023).at(Isometry3::from_parts(at_head(-eye).into(), turn)).blend(0.0),
        Piece::turned(&[[half * 0.85, 0.0], [half * 0.85, (reach - eye) * 0.45]], 0.001)
            .at(along_y(at_head(eye - 0.001))),
        Piece::turned(&[[face * 0.9, 0.0], [face, 0.002], [face, (reach - eye) * 0.6]], 0.0025)
            .at(along_y(at_head(eye + (reach - eye) * 0.4))),
    ]);
    let surface = nets::surface(|p| solid.distance(p), solid.bounds(), Vector3::new(0.0036, 0.003, 0.003))?;
    let steel = 4.0 * half * half * (2.0 * eye + 0.62 * (reach - eye)) + PI * face * face * (reach - eye) * 0.85;
    let mass = steel * STEEL + (surface.volume() - steel).max(0.0) * WOOD;
    Ok(Draft { surface, parts: solid.parts(), mass, rest: Rest::Lies })
}

/// Slotted or cross-head screwdriver: fluted handle, collar, blade.
pub(crate) fn screwdriver(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let (grip, handle) = (sampler.range(0.012, 0.017), sampler.range(0.08, 0.11));
    let (blade_r, blade) = (sampler.range(0.0025, 0.004), sampler.range(0.075, 0.15));
    let flutes = sampler.pick([0.0, 4.0, 6.0]);
    let slotted = sampler.chance(0.5);
    let collar = grip * sampler.range(0.6, 0.75);
    let tip = handle + blade;
    let profile = [
        [grip * 0.35, 0.0],
        [grip * 0.8, 0.001],
        [grip, 0.008],
        [grip, handle * 0.65],
        [collar, handle * 0.85],
        [collar, handle - 0.002],
        [collar - 0.0015, handle],
        [blade_r + 0.0005, handle + 0.0005],
        [blade_r, handle + 0.003],
        [blade_r, tip - 0.012],
        [blade_r * if slotted { 1.25 } else { 0.9 }, tip - 0.006],
        [blade_r * if slotted { 1.15 } else { 0.3 }, tip],
    ];
    let profile: Vec<Rz> = profile.iter().map(|p| Rz::new(p[0], p[1])).collect();
    let place = move |p: Rz, angle: f64| {
        let (sin, cos) = angle.sin_cos();
        let gripped = ((handle * 0.75 - p.y) / 0.02).clamp(0.0, 1.0) * (p.y / 0.01).clamp(0.0, 1.0);
        let r = p.x * (1.0 + 0.035 * gripped * (flutes * angle).cos());
        let flat = if slotted { ((tip - 0.004 - p.y) / 0.01).clamp(0.2, 1.0) } else { 1.0 };
        Point3::new(p.y, r * cos, r * sin * flat)
    };
    let surface = lathe::revolve(&lathe::refine(&profile, 0.006), 32, place);
    // The blade's steel runs half way into the plastic handle.
    let steel = PI * blade_r * blade_r * (blade + handle / 2.0);
    let mass = steel * STEEL + (surface.volume() - PI * blade_r * blade_r * blade) * 1100.0;
    Ok(Draft { surface, parts: lathe::solid_parts(&profile, place), mass, rest: Rest::Lies })
}

/// C-clamp lying on its side: frame, screw with its pad, sliding bar.
pub(crate) fn clamp(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let (opening, throat) = (sampler.range(0.045, 0.085), sampler.range(0.03, 0.045));
    let (bar, half) = (sampler.range(0.0055, 0.008), sampler.range(0.0045, 0.0065));
    let screw = sampler.range(0.0038, 0.005);
    let open = opening * sampler.range(0.25, 0.8);
    let out = sampler.range(0.02, 0.035);
    let line = |points: &[[f64; 2]]| points.iter().map(|p| Point3::new(p[0], p[1], 0.0)).collect::<Vec<P3>>();
    let block = |x: f64, y: f64, hx: f64, hy: f64| {
        Piece::block([hx, hy, half], 0.0015).at(Isometry3::translation(x, y, 0.0)).blend(0.003)
    };
    // The frame's back runs along x at y = 0; its arms reach to y = throat, where the screw runs along x.
    let (left, right) = (-bar, opening + bar);
    let reach = throat / 2.0 + bar / 2.0;
    let end = right + bar + out;
    let solid = Solid::new(vec![
        block(opening / 2.0, 0.0, opening / 2.0 + 2.0 * bar, bar),
        block(left, reach, bar, reach + bar),
        block(right, reach, bar * 1.2, reach + bar),
        Piece::tube(line(&[[open, throat], [end, throat]]), screw).blend(0.002),
        Piece::turned(&[[screw * 1.8, -0.003], [screw * 1.8, 0.003]], 0.001)
            .at(along_x(Vector3::new(open, throat, 0.0))),
        Piece::tube(line(&[[end, throat - 0.026], [end, throat + 0.026]]), 0.003).blend(0.002),
    ]);
    let surface = nets::surface(|p| solid.distance(p), solid.bounds(), Vector3::new(0.0024, 0.0024, 0.002))?;
    let mass = surface.volume() * if sampler.chance(0.7) { 7200.0 } else { 2700.0 };
    Ok(Draft { surface, parts: solid.parts(), mass, rest: Rest::Stands })
}

/// A closed round line in the plane of `across`: two half circles of radius `bend` joined by straights along x.
fn link(center: f64, straight: f64, bend: f64, across: Vector3<f64>) -> Vec<P3> {
    let point = |k: usize| {
        let angle = TAU * k as f64 / 16.0;
        let (sin, cos) = angle.sin_cos();
        let side = if k % 16 == 4 || k % 16 == 12 { 0.0 } else { straight.copysign(cos) };
        Point3::from(Vector3::x() * (center + side + bend * cos) + across * (bend * sin))
    };
    let mut line: Vec<P3> = (0..=16).map(point).collect();
    line[16] = line[0];
    line
}

/// Straight chain of plastic or steel links, each fused to the next.
pub(crate) fn chain(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let wire = sampler.range(0.003, 0.0045);
    let bend = wire * sampler.range(2.3, 2.9);
    let straight = bend * sampler.range(0.4, 1.0);
    let count = (3.0 + sampler.unit() * 3.0) as usize;
    // Each link reaches into the last until the rods meet with a small overlap.
    let pitch = 2.0 * (straight + bend) - 1.75 * wire;
    // Every link touches the table if all are rotated by 45 degrees.
    let turn = FRAC_PI_4;
    let piece = |k: usize| {
        let tilt = if k.is_multiple_of(2) { turn } else { turn + FRAC_PI_2 };
        let across = Vector3::new(0.0, tilt.cos(), tilt.sin());
        Piece::tube(link(pitch * k as f64, straight, bend, across), wire).blend(0.001)
    };
    let solid = Solid::new((0..count).map(piece).collect());
    let surface = nets::surface(|p| solid.distance(p), solid.bounds(), Vector3::repeat(wire * 0.5))?;
    let mass = surface.volume() * if sampler.chance(0.6) { 1000.0 } else { STEEL };
    Ok(Draft { surface, parts: solid.parts(), mass, rest: Rest::Stands })
}

/// Ring or roll of tape lying flat, or a toy ring of round section.
pub(crate) fn ring(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let tube = sampler.range(0.005, 0.011);
    let radius = sampler.range(tube + 0.014, 0.048);
    let point = |k: usize| {
        let (sin, cos) = (TAU * (k % 32) as f64 / 32.0).sin_cos();
        Point3::new(radius * cos, radius * sin, 0.0)
    };
    let solid = Solid::new(vec![Piece::tube((0..=32).map(point).collect(), tube)]);
    let surface = nets::surface(|p| solid.distance(p), solid.bounds(), Vector3::repeat(tube * 0.4))?;
    let mass = surface.volume() * sampler.range(300.0, 1200.0);
    Ok(Draft { surface, parts: solid.parts(), mass, rest: Rest::Stands })
}
