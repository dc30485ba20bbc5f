//! Generic flat objects of unlike pieces: handles with heads, frames with screws, racks with discs.

use crate::draft::{Draft, Rest};
use crate::families::tools::STEEL;
use crate::implicit::{Piece, Solid};
use crate::nets;
use crate::sample::Sampler;
use graspbox_mesh::MeshError;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Greatest mass, kilograms: heavier ones are hollow.
const HEAVIEST: f64 = 0.7;
/// Greatest angle of a piece to the plane of the object.
const STEEPEST: f64 = 0.12;

/// Two to five rods, bars, discs and blocks, each of its own section, that form a tree in a plane, lying.
pub(crate) fn assembly(sampler: &mut Sampler) -> Result<Draft, MeshError> {
    let count = sampler.pick([2, 2, 3, 3, 4, 5]);
    let thinnest = sampler.range(0.0015, 0.005);
    let flat = sampler.chance(0.5);
    let length = length_between(sampler, 0.06, 0.12);
    let mut limbs = vec![Limb::random(sampler, thinnest, length)];
    for _ in 1..count {
        let length = length_between(sampler, 0.02, 0.06);
        let limb = Limb::random(sampler, thinnest, length);
        let parent = &limbs[(sampler.unit() * limbs.len() as f64) as usize];
        let limb = limb.grown_on(parent, flat, sampler);
        limbs.push(limb);
    }
    let solid = Solid::new(limbs.iter().map(Limb::piece).collect());
    let step = limbs.iter().map(|limb| limb.thick).fold(0.0024, f64::min) * 0.75;
    let surface = nets::surface(|p| solid.distance(p), solid.bounds(), Vector3::new(1.6 * step, 1.6 * step, step))?;
    let density = sampler.pick([600.0, 1000.0, 1200.0, 2700.0, STEEL, STEEL]);
    let mass = (surface.volume() * density).min(HEAVIEST);
    Ok(Draft { surface, parts: solid.parts(), mass, rest: Rest::Lies })
}

/// A length with a uniform logarithm.
fn length_between(sampler: &mut Sampler, least: f64, greatest: f64) -> f64 {
    least * (greatest / least).powf(sampler.unit())
}

/// The section of a piece.
#[derive(Clone, Copy, PartialEq)]
enum Section {
    Rod,
    Bar,
    Disc,
    Block,
}

/// A piece, from `root` along `forward`: half sizes and length in metres.
struct Limb {
    section: Section,
    root: Vector3<f64>,
    heading: f64,
    rise: f64,
    length: f64,
    wide: f64,
    thick: f64,
}

impl Limb {
    /// A piece along x from the origin; `thinnest` is the least half thickness.
    fn random(sampler: &mut Sampler, thinnest: f64, length: f64) -> Self {
        let section = sampler.pick([Section::Rod, Section::Bar, Section::Bar, Section::Disc, Section::Block]);
        let thick = thinnest * sampler.pick([1.0, 1.0, 1.5, 2.2]);
        let (length, wide, thick) = match section {
            Section::Rod => (length, thick.max(0.0025), thick.max(0.0025)),
            Section::Bar => (length, sampler.range(0.004, 0.01), thick),
            Section::Disc => (length.min(0.07), length.min(0.07) / 2.0 * sampler.range(0.5, 1.0), thick),
            Section::Block => (length.min(0.05), sampler.range(0.007, 0.018), (thick * 1.5).max(0.004)),
        };
        Self { section, root: Vector3::zeros(), heading: 0.0, rise: 0.0, length, wide, thick }
    }

    /// The same piece, rooted in the middle or at an end of another.
    fn grown_on(self, parent: &Limb, flat: bool, sampler: &mut Sampler) -> Self {
        let at = sampler.pick([0.0, 0.5, 1.0, 1.0]);
        let turn = sampler.pick([0.0, 0.0, FRAC_PI_4, FRAC_PI_2, -FRAC_PI_2]) + sampler.range(-0.2, 0.2);
        // A piece in the middle of another leaves it at an angle.
        let turn = if at == 0.5 && turn.abs() < 0.5 { FRAC_PI_2 } else { turn };
        let back = if at == 0.0 { PI } else { 0.0 };
        let rise = if flat { 0.0 } else { sampler.range(-STEEPEST, STEEPEST) };
        let root = parent.root + parent.forward() * (at * parent.length);
        Self { root, heading: parent.heading + back + turn, rise, ..self }
    }

    fn forward(&self) -> Vector3<f64> {
        let (sin, cos) = self.heading.sin_cos();
        Vector3::new(cos * self.rise.cos(), sin * self.rise.cos(), self.rise.sin())
    }

    fn piece(&self) -> Piece {
        let (half, tip) = (self.length / 2.0, self.root + self.forward() * self.length);
        if self.section == Section::Rod {
            return Piece::tube(vec![Point3::from(self.root), Point3::from(tip)], self.thick).blend(0.002);
        }
        let round = (self.thick * 0.5).min(0.0015);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.heading)
            * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -self.rise);
        let place = Isometry3::from_parts(((self.root + tip) / 2.0).into(), turn);
        let piece = if self.section == Section::Disc {
            let corner = |k: u32| {
                let (sin, cos) = (TAU * f64::from(k) / 16.0).sin_cos();
                [(half + self.wide * 0.2) * cos, self.wide * sin]
            };
            Piece::prism(&(0..16).map(corner).collect::<Vec<_>>(), self.thick, round).cells(3, 2)
        } else {
            Piece::block([half + self.wide * 0.5, self.wide, self.thick], round)
        };
        piece.at(place).blend(0.002)
    }
}
