//! Generic flat objects: bars or rods joined in a plane.

use crate::draft::{Draft, Rest};
use crate::families::tools::STEEL;
use crate::implicit::{Piece, Solid};
use crate::nets;
use crate::sample::Sampler;
use graspbox_mesh::MeshError;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::f64::consts::FRAC_PI_2;

/// Greatest mass, kilograms: heavier ones are hollow.
const HEAVIEST: f64 = 0.6;

/// Angle bracket, hook, frame or hex key, lying: a spine along x, and limbs on either side at its ends or its middle.
pub(crate) fn bracket(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let length = sampler.range(0.06, 0.18);
    let thick = sampler.range(0.004, 0.012);
    let wide = (thick * sampler.range(0.7, 2.0)).clamp(0.004, length / 10.0);
    let round = sampler.chance(0.4);
    let bar = Bar { thick, wide: if round { thick } else { wide }, round };
    let mut pieces = vec![bar.between(Vector3::zeros(), Vector3::new(length, 0.0, 0.0))];
    // Limbs on one side are parallel, so they never close a ring.
    let first = sampler.pick([1, 2, 3, 4, 5, 5, 6, 7]);
    let second = sampler.pick([0, 0, 0, 1, 2, 4]);
    for (side, slots) in [(1.0, first), (-1.0, second)] {
        let tilt = FRAC_PI_2 + sampler.range(-0.35, 0.35);
        let along = Vector3::new(tilt.cos(), side * tilt.sin(), 0.0);
        for slot in (0..3).filter(|slot| slots >> slot & 1 == 1) {
            let root = Vector3::new(length * f64::from(slot) / 2.0, 0.0, 0.0);
            pieces.push(bar.between(root, root + along * sampler.range(0.025, 0.085)));
        }
    }
    let solid = Solid::new(pieces);
    let surface = nets::surface(|p| solid.distance(p), solid.bounds(), Vector3::repeat(thick * 0.4))?;
    let density = sampler.pick([600.0, 1000.0, 1000.0, 1200.0, 2700.0, STEEL]);
    let mass = (surface.volume() * density).min(HEAVIEST);
    Ok(Draft { surface, parts: solid.parts(), mass, rest: Rest::Stands })
}

/// The section that all limbs share: half sizes in metres.
struct Bar {
    thick: f64,
    wide: f64,
    round: bool,
}

impl Bar {
    /// The limb from `root` to `tip`, both in the plane z = 0.
    fn between(&self, root: Vector3<f64>, tip: Vector3<f64>) -> Piece {
        let (line, middle) = (tip - root, (root + tip) / 2.0);
        if self.round {
            return Piece::tube(vec![Point3::from(root), Point3::from(tip)], self.thick).blend(0.002);
        }
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), line.y.atan2(line.x));
        Piece::block([line.norm() / 2.0 + self.wide, self.wide, self.thick], 0.0015)
            .at(Isometry3::from_parts(middle.into(), turn))
            .blend(0.002)
    }
}
