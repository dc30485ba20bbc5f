//! Bottom up: the two neighbours that fit together best become one, while they still fit or there are too many.

use super::cell::{Cell, Hull, hull_of};
use super::cut::Piece;
use super::fit::Fit;
use nalgebra::Point3;
use rayon::prelude::*;

/// Two pieces, their common hull, and how far it stands out.
struct Pair {
    a: usize,
    b: usize,
    hull: Hull,
    /// Metres.
    error: f64,
    /// Volume that the common hull adds, m3: decides between pairs that fit equally well.
    added: f64,
}

/// Merges until no pair fits within `max_error` metres and no more than `most` are left.
pub(super) fn merge(pieces: Vec<Piece>, fit: &Fit, max_error: f64, most: usize) -> Vec<Piece> {
    let mut slots: Vec<Option<Piece>> = pieces.into_iter().map(Some).collect();
    let mut alive = slots.len();
    let mut pairs = Vec::new();
    pairs.par_extend((0..slots.len()).into_par_iter().flat_map_iter(|b| {
        let slots = &slots;
        (0..b).filter_map(move |a| pair(slots, a, b, fit))
    }));
    while let Some(best) = best(&pairs, max_error) {
        if pairs[best].error > max_error && alive <= most {
            break;
        }
        let Pair { a, b, hull, error, .. } = pairs.swap_remove(best);
        pairs.retain(|p| p.a != a && p.b != a && p.a != b && p.b != b);
        let (Some(first), Some(second)) = (slots[a].take(), slots[b].take()) else {
            continue;
        };
        alive -= 1;
        let cell = Cell { faces: Vec::new(), points: union(first.cell.points, &second.cell.points) };
        let new = slots.len();
        slots.push(Some(Piece { cell, hull, error }));
        pairs.par_extend((0..new).into_par_iter().filter_map(|other| pair(&slots, other, new, fit)));
    }
    slots.into_iter().flatten().collect()
}

/// Among pairs that fit, the one that adds the least volume (parts of a solid overlap little then); among others the one that
/// stands out least. The older one of equals.
fn best(pairs: &[Pair], max_error: f64) -> Option<usize> {
    let key = |p: &Pair| {
        if p.error <= max_error { (0.0, p.added) } else { (p.error, p.added) }
    };
    let order = |p: &Pair, q: &Pair| {
        let (a, b) = (key(p), key(q));
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then((p.b, p.a).cmp(&(q.b, q.a)))
    };
    (0..pairs.len()).min_by(|&i, &j| order(&pairs[i], &pairs[j]))
}

fn pair(slots: &[Option<Piece>], a: usize, b: usize, fit: &Fit) -> Option<Pair> {
    let (first, second) = (slots[a].as_ref()?, slots[b].as_ref()?);
    if !touch(&first.hull.points, &second.hull.points, fit.step()) {
        return None;
    }
    let points: Vec<Point3<f64>> = first.hull.points.iter().chain(&second.hull.points).copied().collect();
    let hull = hull_of(&points)?;
    let error = fit.error(&hull);
    let added = hull.volume - first.hull.volume - second.hull.volume;
    Some(Pair { a, b, hull, error, added })
}

/// Whether the bounds come within `gap`.
fn touch(a: &[Point3<f64>], b: &[Point3<f64>], gap: f64) -> bool {
    let bounds = |p: &[Point3<f64>]| p.iter().fold((p[0], p[0]), |(min, max), q| (min.inf(q), max.sup(q)));
    let ((a_min, a_max), (b_min, b_max)) = (bounds(a), bounds(b));
    (b_min - a_max).sup(&(a_min - b_max)).max() <= gap
}

fn union(mut a: Vec<u32>, b: &[u32]) -> Vec<u32> {
    a.extend(b);
    a.sort_unstable();
    a.dedup();
    a
}
