//! Top down: the cell that stands out farthest is cut, until none stands out too far.

use super::cell::{Cell, Hull, Plane, Pool, hull_of, supports, thicken};
use super::fit::Fit;
use crate::sample::fibonacci_sphere;
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

/// Directions whose extremes stand for a hull when cuts are compared.
const COARSE: usize = 64;
/// Directions whose extremes stand for a hull when its error is measured.
pub(super) const FINE: usize = 162;
/// Places tried along each axis at first.
const PLACES: usize = 7;
/// Weight of the difference between the two volumes: without it a round shell, where no single cut gains anything, would be
/// cut at its edge.
const BALANCE: f64 = 0.05;
/// Pieces that stand out by more than this many times the allowed error are cut with a look ahead.
const AHEAD: f64 = 3.0;
/// Share of the allowed error that cutting aims at; merging may use all of it.
const CUT_SHARE: f64 = 0.8;
/// Cells no wider than this many times the allowed error are not cut across that width.
const LEAST_SIZE: f64 = 2.0;

/// A cell with its hull and what is wrong with it.
pub(super) struct Piece {
    pub cell: Cell,
    pub hull: Hull,
    /// Farthest that the hull stands out of the mesh, metres.
    pub error: f64,
}

impl Piece {
    fn new(cell: Cell, pool: &Pool, fit: &Fit, fine: &[Vector3<f64>]) -> Option<Self> {
        let points: Vec<_> = cell.points.iter().map(|&v| pool[v as usize]).collect();
        let extremes: Vec<_> = supports(&points, fine).into_iter().map(|i| points[i]).collect();
        let hull = hull_of(&extremes).or_else(|| hull_of(&thicken(&extremes, fit.sliver())))?;
        let error = fit.error(&hull);
        Some(Self { cell, hull, error })
    }
}

/// Cuts `whole` until no piece stands out by more than `max_error` metres or there are `most` pieces.
pub(super) fn cut_down(whole: Cell, pool: &mut Pool, fit: &Fit, max_error: f64, most: usize) -> Vec<Piece> {
    let (coarse, fine) = (fibonacci_sphere(COARSE), fibonacci_sphere(FINE));
    let least = LEAST_SIZE * max_error;
    let mut open: Vec<Piece> = Piece::new(whole, pool, fit, &fine).into_iter().collect();
    let mut done = Vec::new();
    if open.first().is_some_and(|p| p.error <= max_error) {
        return open;
    }
    while !open.is_empty() && open.len() + done.len() < most {
        // Few pieces, so a scan is as good as a heap; the first of equals wins.
        let worst = (1..open.len()).fold(0, |w, i| if open[i].error > open[w].error { i } else { w });
        let piece = open.swap_remove(worst);
        if piece.error <= CUT_SHARE * max_error {
            done.push(piece);
            break;
        }
        let ahead = piece.error > AHEAD * max_error;
        let halves = best_plane(&piece.cell, pool, &coarse, least, ahead)
            .map(|plane| piece.cell.cut(pool, &plane))
            .map(|halves| halves.map(|half| Piece::new(half, pool, fit, &fine)));
        match halves {
            Some([Some(a), Some(b)]) => open.extend([a, b]),
            // As narrow as the error that is allowed: it cannot be cut any finer.
            _ => done.push(piece),
        }
    }
    done.append(&mut open);
    done
}

/// The plane whose two hulls have the least volume together.
///
/// * `ahead`: look one cut further. A round shell gains nothing by being halved and much by being quartered, so one cut alone
///   cannot tell the cut through its axis from the others.
fn best_plane(cell: &Cell, pool: &Pool, coarse: &[Vector3<f64>], least: f64, ahead: bool) -> Option<Plane> {
    let points: Vec<_> = cell.points.iter().map(|&v| pool[v as usize]).collect();
    let mut best: Option<(f64, Plane)> = None;
    let mut middles = Vec::new();
    for normal in axes(&points) {
        let Some(sorted) = Sorted::new(&points, normal).filter(|s| s.width() >= least) else {
            continue;
        };
        middles.push(sorted.at(0.5));
        if let Some(found) = sorted.best(coarse, 0.5 * least)
            && best.as_ref().is_none_or(|b| found.0 < b.0 * (1.0 - 1e-6))
        {
            best = Some(found);
        }
    }
    let (_, greedy) = best?;
    if !ahead {
        return Some(greedy);
    }
    let mut chosen = (cost_ahead(&points, &greedy, coarse), greedy);
    for plane in middles {
        let cost = cost_ahead(&points, &plane, coarse);
        if cost < chosen.0 * (1.0 - 1e-6) {
            chosen = (cost, plane);
        }
    }
    Some(chosen.1)
}

/// Points in the order in which a plane meets them.
struct Sorted {
    normal: Vector3<f64>,
    points: Vec<(f64, Point3<f64>)>,
}

impl Sorted {
    fn new(points: &[Point3<f64>], normal: Vector3<f64>) -> Option<Self> {
        let mut points: Vec<_> = points.iter().map(|p| (normal.dot(&p.coords), *p)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        (!points.is_empty()).then_some(Self { normal, points })
    }

    fn width(&self) -> f64 {
        self.points[self.points.len() - 1].0 - self.points[0].0
    }

    /// The plane at this share of the width.
    fn at(&self, share: f64) -> Plane {
        Plane { normal: self.normal, offset: self.points[0].0 + share * self.width() }
    }

    /// Cheapest of evenly spaced places, refined twice by halving the space; no slab is thinner than `thinnest` metres, or a wavy
    /// side would be sliced like bread.
    fn best(&self, coarse: &[Vector3<f64>], thinnest: f64) -> Option<(f64, Plane)> {
        let margin = thinnest / self.width();
        let mut best: Option<(f64, f64)> = None;
        let mut step = 1.0 / (PLACES + 1) as f64;
        let mut shares: Vec<f64> = (1..=PLACES).map(|i| step * i as f64).collect();
        for _ in 0..3 {
            for share in shares {
                if (margin..=1.0 - margin).contains(&share)
                    && let Some(cost) = self.cost(self.at(share).offset, coarse)
                    && best.is_none_or(|b| cost < b.0)
                {
                    best = Some((cost, share));
                }
            }
            step /= 2.0;
            shares = best.map_or(Vec::new(), |b| vec![b.1 - step, b.1 + step]);
        }
        best.map(|(cost, share)| (cost, self.at(share)))
    }

    /// Volume of the two hulls, and a little for their difference; a flat one has none. `None` when one side is empty.
    fn cost(&self, offset: f64, coarse: &[Vector3<f64>]) -> Option<f64> {
        let at = self.points.partition_point(|p| p.0 < offset);
        let side = |half: &[(f64, Point3<f64>)]| {
            let points: Vec<_> = half.iter().map(|p| p.1).collect();
            (!points.is_empty()).then(|| volume(&points, coarse))
        };
        let (a, b) = (side(&self.points[..at])?, side(&self.points[at..])?);
        Some(a + b + BALANCE * (a - b).abs())
    }
}

/// Volume of the hull, by the extremes along `coarse`.
fn volume(points: &[Point3<f64>], coarse: &[Vector3<f64>]) -> f64 {
    let extremes: Vec<_> = supports(points, coarse).into_iter().map(|i| points[i]).collect();
    hull_of(&extremes).map_or(0.0, |h| h.volume)
}

/// Least volume after cutting at `plane` and then halving each half, where that helps.
fn cost_ahead(points: &[Point3<f64>], plane: &Plane, coarse: &[Vector3<f64>]) -> f64 {
    let (a, b): (Vec<_>, Vec<_>) = points.iter().partition(|p| plane.normal.dot(&p.coords) >= plane.offset);
    let after = |half: Vec<Point3<f64>>| {
        let whole = volume(&half, coarse);
        let halved = |normal: Vector3<f64>| {
            let sorted = Sorted::new(&half, normal)?;
            sorted.cost(sorted.at(0.5).offset, coarse)
        };
        axes(&half).into_iter().filter_map(halved).fold(whole, f64::min)
    };
    after(a) + after(b)
}

/// The axes of the mesh's frame and the principal axes of the points.
fn axes(points: &[Point3<f64>]) -> Vec<Vector3<f64>> {
    let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let covariance: Matrix3<f64> = points.iter().map(|p| p.coords - mean).map(|d| d * d.transpose()).sum();
    let principal = SymmetricEigen::new(covariance).eigenvectors;
    let mut axes = vec![Vector3::x(), Vector3::y(), Vector3::z()];
    for column in principal.column_iter() {
        // Within 5 degrees of an axis that is there already it would only repeat it.
        if axes.iter().all(|a| a.dot(&column).abs() < 0.996) {
            axes.push(column.into_owned());
        }
    }
    axes
}
