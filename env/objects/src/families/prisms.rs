//! Prisms: solid ones, from a die to a piece of timber, in sizes and masses that packages do not have; and filled cartons.

use crate::draft::{Draft, Rest};
use crate::families::packages::rounded_box;
use crate::lathe::{self, Rz};
use crate::sample::Sampler;
use crate::surface::{P3, Surface};
use nalgebra::Vector3;
use std::f64::consts::{PI, TAU};

/// Greatest masses of a prism and of a carton, kilograms: larger ones are of a lighter material.
const HEAVIEST: [f64; 2] = [0.9, 1.0];
/// Steps around a section that is no rectangle; a multiple of the number of its sides.
const COLUMNS: usize = 48;

/// Solid prism, standing or lying: a rectangular, hexagonal, octagonal or round section.
pub(crate) fn prism(sampler: &mut Sampler) -> Draft {
    // Sizes are log-uniform: as many of 15 to 30 mm as of 45 to 90 mm.
    let thick = 0.014 * (sampler.unit() * (0.095_f64 / 0.014).ln()).exp();
    let wide = (thick * sampler.range(1.0, 1.8)).min(0.1).max(thick);
    let wide = if sampler.chance(0.4) { thick } else { wide };
    let long = (wide * sampler.range(0.4, 3.0)).clamp(thick, 0.22);
    let long = if sampler.chance(0.3) { wide } else { long };
    let sides = sampler.pick([4, 4, 4, 4, 6, 8, 0]);
    let (surface, cloud) = solid(sampler, sides, Vector3::new(thick, wide, long));
    let most = (HEAVIEST[0] / surface.volume()).min(1200.0);
    let mass = surface.volume() * sampler.range(0.3 * most, most);
    Draft { surface, parts: vec![cloud], mass, rest: Rest::Stands }
}

/// Filled carton or canister, standing or lying, or a thick piece of timber: heavy, and little narrower than the open hand.
pub(crate) fn carton(sampler: &mut Sampler) -> Draft {
    let thick = sampler.range(0.06, 0.094);
    let wide = if sampler.chance(0.6) { thick } else { (thick * sampler.range(1.0, 1.3)).min(0.11) };
    let long = sampler.range(wide, 0.24);
    let sides = sampler.pick([4, 4, 4, 4, 8, 0]);
    let (surface, cloud) = solid(sampler, sides, Vector3::new(thick, wide, long));
    let most = (HEAVIEST[1] / surface.volume()).min(950.0);
    let mass = surface.volume() * sampler.range(0.45 * most, most);
    Draft { surface, parts: vec![cloud], mass, rest: Rest::Stands }
}

/// Prism with a section of 4 or more sides, or a round one for 0, whose sizes are `size`, the least first.
fn solid(sampler: &mut Sampler, sides: usize, size: Vector3<f64>) -> (Surface, Vec<P3>) {
    let (thick, long) = (size.x, size.z);
    match sides {
        4 => bar(sampler, size),
        0 => rod(thick / 2.0, long, lathe::round, |outline| lathe::band_cloud(outline, &lathe::round)),
        _ => {
            let place = move |p: Rz, angle: f64| polygon(p, angle, sides);
            let corner = move |k: usize| TAU * k as f64 / sides as f64;
            let corners = move |p: &Rz| (0..sides).map(move |k| lathe::round(*p, corner(k))).collect::<Vec<P3>>();
            rod(thick / 2.0, long, place, |outline| outline.iter().flat_map(corners).collect())
        }
    }
}

/// Rectangular section, on any of its faces; edges broken as far as its size allows.
fn bar(sampler: &mut Sampler, size: Vector3<f64>) -> (Surface, Vec<P3>) {
    let half = match sampler.pick([0, 1, 2]) {
        0 => size,
        1 => Vector3::new(size.y, size.z, size.x),
        _ => Vector3::new(size.z, size.x, size.y),
    } / 2.0;
    let radius = size.min() * sampler.range(0.04, 0.12);
    let cells = half.map(|h| (h / 0.005).round().clamp(5.0, 20.0) as usize + 4);
    rounded_box(half, radius.min(0.003), cells.into(), 2)
}

/// Upright rod of radius `r` and height `high`, its edges broken; `cloud` returns the points of its hull.
fn rod(r: f64, high: f64, place: impl Fn(Rz, f64) -> P3, cloud: impl Fn(&[Rz]) -> Vec<P3>) -> (Surface, Vec<P3>) {
    let edge = (r * 0.08).min(0.002);
    let outline = [Rz::new(r - edge, 0.0), Rz::new(r, edge), Rz::new(r, high - edge), Rz::new(r - edge, high)];
    let profile = [&[Rz::new(r * 0.5, 0.0)], &outline[..], &[Rz::new(r * 0.5, high)]].concat();
    (lathe::revolve(&lathe::refine(&profile, 0.006), COLUMNS, place), cloud(&outline))
}

/// The point of a regular section whose corners lie at `p.x` from the axis, the first at angle zero.
fn polygon(p: Rz, angle: f64, sides: usize) -> P3 {
    let sector = TAU / sides as f64;
    let off = angle.rem_euclid(sector) - sector / 2.0;
    lathe::round(Rz::new(p.x * (PI / sides as f64).cos() / off.cos(), p.y), angle)
}
