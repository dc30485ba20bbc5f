//! Surfaces of revolution (or of any star-shaped section) and the convex parts of their solids and walls.
//!
//! A profile is a list of points `(r, z)`: `x` is the distance from the axis, `y` the height, both in metres.

use crate::draft::Parts;
use crate::surface::{P3, Surface};
use nalgebra::{Point2, Point3, Vector2};
use std::f64::consts::{PI, TAU};

pub(crate) type Rz = Point2<f64>;

/// Greatest depth of a band of a profile below its hull for one convex part, metres.
const PROFILE_GAP: f64 = 0.0006;
/// Depth of the arc that one wall segment may cut off, metres; half of it lies inside the wall, half outside.
const WALL_SAGITTA: f64 = 0.00135;
/// The same for the height of a wall segment: greatest bend of its two sides, metres.
const WALL_BEND: f64 = 0.00135;
/// Most points of one part.
pub(crate) const PART_POINTS: usize = 64;

/// The point of a circular section.
pub(crate) fn round(p: Rz, angle: f64) -> P3 {
    let (sin, cos) = angle.sin_cos();
    Point3::new(p.x * cos, p.x * sin, p.y)
}

/// The closed surface swept by `profile` in `columns` steps; its ends are joined to the axis at their own heights.
///
/// The profile runs from the lower end of the axis along the outside to the other end, so faces point outward.
pub(crate) fn revolve(profile: &[Rz], columns: usize, place: impl Fn(Rz, f64) -> P3) -> Surface {
    let ring = |p: &Rz| (0..columns).map(|j| place(*p, TAU * j as f64 / columns as f64)).collect();
    let rings: Vec<Vec<P3>> = profile.iter().map(ring).collect();
    let pole = |p: &Rz| place(Rz::new(0.0, p.y), 0.0);
    Surface::skin(&rings, pole(&profile[0]), pole(&profile[profile.len() - 1]))
}

/// Adds points to `profile` until no step is longer than `step`, metres.
pub(crate) fn refine(profile: &[Rz], step: f64) -> Vec<Rz> {
    let mut fine = vec![profile[0]];
    for w in profile.windows(2) {
        let pieces = ((w[1] - w[0]).norm() / step).ceil().max(1.0) as usize;
        fine.extend((1..=pieces).map(|k| w[0] + (w[1] - w[0]) * (k as f64 / pieces as f64)));
    }
    fine
}

/// Convex parts of the solid inside `profile` (heights not falling): bands that are convex within 0.6 mm.
pub(crate) fn solid_parts(profile: &[Rz], place: impl Fn(Rz, f64) -> P3) -> Parts {
    let mut parts = Parts::new();
    let mut start = 0;
    while start + 1 < profile.len() {
        let mut end = start + 1;
        while end + 1 < profile.len() && gap_to_hull(&profile[start..=end + 1]) <= PROFILE_GAP {
            end += 1;
        }
        parts.push(band_cloud(&profile[start..=end], &place));
        start = end;
    }
    parts
}

/// Outer hull (largest r over z) of a band.
fn outer_hull(band: &[Rz]) -> Vec<Rz> {
    let mut hull: Vec<Rz> = Vec::new();
    for &p in band {
        while hull.len() >= 2 && (hull[hull.len() - 1] - hull[hull.len() - 2]).perp(&(p - hull[hull.len() - 2])) <= 0.0
        {
            hull.pop();
        }
        hull.push(p);
    }
    hull
}

/// The few points that represent the hull of a band.
fn band_hull(band: &[Rz]) -> Vec<Rz> {
    thin_out(outer_hull(band), 4)
}

/// Largest distance of a band's points from its hull, metres.
fn gap_to_hull(band: &[Rz]) -> f64 {
    let hull = band_hull(band);
    let distance = |p: &Rz| hull.windows(2).map(|w| to_segment(*p, w[0], w[1])).fold(f64::INFINITY, f64::min);
    band.iter().map(distance).fold(0.0, f64::max)
}

/// Distance from `p` to the segment `a`-`b`.
pub(crate) fn to_segment(p: Rz, a: Rz, b: Rz) -> f64 {
    let (ab, ap) = (b - a, p - a);
    let length = ab.norm_squared();
    let t = if length > 0.0 { (ap.dot(&ab) / length).clamp(0.0, 1.0) } else { 0.0 };
    (ap - ab * t).norm()
}

/// Drops the point that matters least until `most` are left.
pub(crate) fn thin_out(mut line: Vec<Rz>, most: usize) -> Vec<Rz> {
    while line.len() > most {
        let cost = |i: usize| to_segment(line[i], line[i - 1], line[i + 1]);
        let Some(least) = (1..line.len() - 1).min_by(|&i, &j| cost(i).total_cmp(&cost(j))) else {
            break;
        };
        line.remove(least);
    }
    line
}

/// Points of one band: a few rings whose polygon lies half inside and half outside the true section.
pub(crate) fn band_cloud(band: &[Rz], place: &impl Fn(Rz, f64) -> P3) -> Vec<P3> {
    let hull = band_hull(band);
    let widest = hull.iter().map(|p| p.x).fold(0.0, f64::max);
    let sides = (PART_POINTS / hull.len()).min(if widest > 0.055 { 24 } else { 16 });
    let swell = 1.0 / (PI / sides as f64).cos().sqrt();
    let mut cloud = Vec::with_capacity(PART_POINTS);
    for p in hull {
        if p.x < 1e-6 {
            cloud.push(place(Rz::new(0.0, p.y), 0.0));
        } else {
            let ring = Rz::new(p.x * swell, p.y);
            cloud.extend((0..sides).map(|k| place(ring, TAU * k as f64 / sides as f64)));
        }
    }
    cloud
}

/// A slice through a wall: its outer and its inner point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wall {
    pub(crate) outer: Rz,
    pub(crate) inner: Rz,
}

/// Convex parts of a hollow wall of revolution: bands along `walls` (first = at the floor, last = rim), each cut into
/// as many equal segments as its radius needs.
pub(crate) fn wall_parts(walls: &[Wall]) -> Parts {
    let mut parts = Parts::new();
    let mut start = 0;
    while start + 1 < walls.len() {
        let mut end = start + 1;
        while end + 1 < walls.len() && wall_gap(&walls[start..=end + 1]) <= WALL_BEND {
            end += 1;
        }
        parts.extend(ring_segments(&walls[start..=end]));
        start = end;
    }
    parts
}

/// Largest distance between the wall's two sides and the hull of the band's section.
fn wall_gap(band: &[Wall]) -> f64 {
    let (first, last) = (band[0], band[band.len() - 1]);
    let outward = Vector2::new((last.outer - first.outer).y, -(last.outer - first.outer).x);
    let mut gap: f64 = 0.0;
    for w in band {
        let outside = (w.outer - first.outer).dot(&outward);
        let inside = (w.inner - first.inner).dot(&outward);
        if outside < 0.0 {
            gap = gap.max(to_segment(w.outer, first.outer, last.outer));
        }
        if inside > 0.0 {
            gap = gap.max(to_segment(w.inner, first.inner, last.inner));
        }
    }
    gap
}

fn ring_segments(band: &[Wall]) -> Parts {
    let widest = band.iter().map(|w| w.inner.x).fold(0.0, f64::max).max(WALL_SAGITTA * 2.0);
    let count = (PI / (1.0 - WALL_SAGITTA / widest).acos()).ceil().max(6.0);
    let half = PI / count;
    // The inner chord is pushed out by half of its sagitta.
    let recess = |p: Rz| p.x * (1.0 + (1.0 - half.cos()) / 2.0);
    let outer = thin_out(band.iter().map(|w| w.outer).collect(), 5);
    // A side that bends inwards is moved back by half of the bend.
    let bend = wall_gap(band);
    let inner = |w: &Wall| {
        let across = w.outer - w.inner;
        let back = across * (bend / 2.0 / across.norm()).min(0.4);
        Rz::new(recess(w.inner) + back.x, w.inner.y + back.y)
    };
    let inner = thin_out(band.iter().map(inner).collect(), 5);
    // Three points span an outer arc: the middle one on it, all three pushed out by half of the remaining gap.
    let swell = 1.0 + (1.0 - (half / 2.0).cos()) / 2.0;
    let segment = |k: usize| {
        let middle = TAU * (k as f64 + 0.5) / count;
        let mut cloud = Vec::with_capacity(PART_POINTS);
        for p in &outer {
            let p = Rz::new(p.x * swell, p.y);
            cloud.extend([-1.0, 0.0, 1.0].map(|s| round(p, middle + s * half)));
        }
        for p in &inner {
            cloud.extend([-1.0, 1.0].map(|s| round(*p, middle + s * half)));
        }
        cloud
    };
    (0..count as usize).map(segment).collect()
}
