//! Kettle: body with lid and knob, spout, and a handle that arches over the lid.

use crate::draft::{Draft, Rest};
use crate::families::tools::STEEL;
use crate::implicit::{Piece, Solid};
use crate::nets;
use crate::sample::Sampler;
use crate::surface::{P3, Surface};
use graspbox_mesh::MeshError;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// Density of bakelite, of which the grip over the arch is made, kg/m3.
const BAKELITE: f64 = 1400.0;

/// Stove or tea kettle with its lid on, the spout along +x, the handle's arch in the plane y = 0: one hole.
///
/// The surface is only the outside, as a scan has it; the mass is that of an empty kettle of sheet steel.
pub(crate) fn kettle(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let radius = sampler.range(0.048, 0.060);
    let height = radius * sampler.range(1.25, 1.6);
    let (foot, shoulder) = (radius * sampler.range(0.82, 0.95), radius * sampler.range(0.55, 0.65));
    let (waist, neck) = (height * sampler.range(0.25, 0.4), height * sampler.range(0.72, 0.82));
    let body = [[foot, 0.0], [radius, waist], [radius * 0.9, neck], [shoulder, height]];
    let knob = sampler.range(0.008, 0.011);
    let lid = height + knob * 1.6;
    let rod = sampler.range(0.0070, 0.0085);
    // Room for fingers between the knob and the grip.
    let arch = (lid - neck) + rod + sampler.range(0.04, 0.055);
    let line = arch_line(radius * 0.72, neck, arch, sampler.range(2.0, 2.3));
    let grip = line[GRIP.0..=GRIP.1].to_vec();
    let (spout, reach) = spout(sampler, radius, neck, waist);
    let solid = Solid::new(vec![
        Piece::turned(&body, 0.004).blend(0.0),
        Piece::turned(&[[knob * 0.7, height - 0.004], [knob, lid - 0.003], [knob * 0.9, lid]], 0.0035).blend(0.002),
        spout.blend(0.0012),
        Piece::tube(line.clone(), rod).blend(0.0012),
        Piece::tube(grip.clone(), rod + GRIP_WALL).blend(0.0015),
    ]);
    // As fine as the largest number of faces allows, at any size.
    let surface = skin_of(&solid, radius * 0.079)?;
    // Sheet over floor, side and shoulder, the spout as its own tube, a hollow arch, the grip around it.
    let sheet = sampler.range(0.0005, 0.0009);
    let skin = PI * (foot * foot + 2.0 * radius * height + shoulder * shoulder) + 2.0 * PI * SPOUT_MEAN * reach;
    let length = |line: &[P3]| line.windows(2).map(|w| (w[1] - w[0]).norm()).sum::<f64>();
    let hollow = PI * (rod * rod - (rod - 0.001).powi(2)) * length(&line);
    let around = PI * ((rod + GRIP_WALL).powi(2) - rod * rod) * length(&grip);
    Ok(Draft {
        surface,
        parts: solid.parts(),
        mass: (skin * sheet + hollow) * STEEL + around * BAKELITE,
        rest: Rest::Stands,
    })
}

/// The surface of a solid on a grid of about `step` metres: the first of a few without needle faces.
fn skin_of(solid: &Solid, step: f64) -> Result<Surface, MeshError> {
    let net = |k: u32| {
        let step = step * (1.0 + 0.013 * f64::from(k));
        nets::surface(|p| solid.distance(p), solid.bounds(), Vector3::repeat(step))
    };
    for k in 0..GRIDS - 1 {
        let surface = net(k)?;
        let mesh = surface.clone().into_mesh()?;
        let slim = |f: usize| {
            let [a, b, c] = mesh.triangle(f);
            let longest = (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
            2.0 * mesh.face_area_vector(f).norm() < SLIMMEST * longest
        };
        if !(0..mesh.faces().len()).any(slim) {
            return Ok(surface);
        }
    }
    net(GRIDS - 1)
}

/// Number of grids that are tried for a surface without needles.
const GRIDS: u32 = 6;
/// Height over longest edge below which a face is a needle with an unreliable normal.
const SLIMMEST: f64 = 4e-3;
/// Thickness of the grip around the arch, metres.
const GRIP_WALL: f64 = 0.0012;
/// First and last point of the arch that the grip covers.
const GRIP: (usize, usize) = (16, 32);
/// Mean radius of a spout, metres.
const SPOUT_MEAN: f64 = 0.012;

/// Super-elliptic arch in the plane y = 0 from (-reach, base) over (0, base + rise) to (reach, base).
fn arch_line(reach: f64, base: f64, rise: f64, square: f64) -> Vec<P3> {
    let point = |k: usize| {
        let (sin, cos) = (PI * k as f64 / 48.0).sin_cos();
        let bow = |c: f64| c.abs().powf(2.0 / square).copysign(c);
        Point3::new(-reach * bow(cos), 0.0, base + rise * bow(sin))
    };
    (0..=48).map(point).collect()
}

/// A tapered spout that leaves the body at mid-height, and its length, metres.
fn spout(sampler: &mut Sampler, radius: f64, neck: f64, waist: f64) -> (Piece, f64) {
    let (root, tip) = (sampler.range(0.015, 0.019), sampler.range(0.008, 0.010));
    let lean = sampler.range(0.75, 0.95);
    let start = Vector3::new(radius - 0.02, 0.0, (waist + neck) / 2.0 - 0.006);
    let length = sampler.range(0.062, 0.08);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), lean);
    let frustum = Piece::turned(&[[root, 0.0], [tip, length]], 0.0035);
    (frustum.at(Isometry3::from_parts(start.into(), turn)), length)
}
