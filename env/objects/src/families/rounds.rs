//! Round objects: balls, and superquadrics between box, ball and cylinder.

use crate::cloud::convex_cloud;
use crate::draft::{Draft, Rest};
use crate::sample::Sampler;
use crate::surface::cube_grid;
use graspbox_mesh::MeshError;
use nalgebra::{Point3, Vector3};
use std::f64::consts::FRAC_PI_4;

/// Direction of a point on the surface of the cube [-1, 1]^3, spaced evenly in angle.
fn direction(q: Vector3<f64>) -> Vector3<f64> {
    q.map(|x| (x * FRAC_PI_4).tan()).normalize()
}

/// Sports or toy ball: diameters and masses by the rules of each game.
pub(crate) fn ball(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    // (diameter, mass) from, to: table tennis, golf, tennis, baseball, softball (metres, kilograms).
    let [d0, d1, m0, m1] = sampler.pick([
        [0.0400, 0.0406, 0.0026, 0.0028],
        [0.0427, 0.0432, 0.0440, 0.0459],
        [0.0654, 0.0686, 0.0560, 0.0594],
        [0.0732, 0.0751, 0.1420, 0.1490],
        [0.0955, 0.0980, 0.1660, 0.1980],
    ]);
    let radius = sampler.range(d0, d1) / 2.0;
    let mass = sampler.range(m0, m1);
    let surface = cube_grid([14; 3], |q| Point3::from(direction(q) * radius));
    let parts = vec![convex_cloud(&surface.vertices)?];
    Ok(Draft { surface, parts, mass, rest: Rest::Stands })
}

/// Superquadric: |x/a|, |y/b|, |z/c| under two exponents; a block, ball, cylinder or lens in between.
///
/// Source: Barr, "Superquadrics and angle-preserving transformations", IEEE CG&A 1981.
pub(crate) fn superquadric(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let half = Vector3::from_fn(|_, _| sampler.range(0.016, 0.042));
    let (e1, e2) = (sampler.range(0.3, 1.4), sampler.range(0.3, 1.4));
    let surface = cube_grid([16; 3], |q| {
        let d = direction(q).component_mul(&half);
        let f = d.component_div(&half).map(f64::abs);
        let level = (f.x.powf(2.0 / e2) + f.y.powf(2.0 / e2)).powf(e2 / e1) + f.z.powf(2.0 / e1);
        Point3::from(d * level.powf(-e1 / 2.0))
    });
    let mass = surface.volume() * sampler.range(300.0, 1100.0);
    let parts = vec![convex_cloud(&surface.vertices)?];
    Ok(Draft { surface, parts, mass, rest: Rest::Stands })
}
