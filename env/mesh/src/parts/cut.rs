//! Top down: the cell that stands out farthest is cut, until none stands out by more than the allowed error.

use super::cell::{Cell, Hull, Plane, Pool, hull_of, thicken};
use super::cloud::{Cloud, spatial_order};
use super::extremes::{Columns, key, supports, unique};
use super::fit::Fit;
use crate::sample::fibonacci_sphere;
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// Directions whose extremes stand for a hull when cuts are compared.
const COARSE: usize = 64;
/// Directions whose extremes stand for a hull when its error is measured.
pub(super) const FINE: usize = 162;
/// Places along each axis: every fourth is tried at first.
const PLACES: usize = 32;
/// Weight of the difference between the two volumes: without it a round shell, where no single cut gains anything, would be
/// cut at its edge.
const BALANCE: f64 = 0.05;
/// Pieces that stand out by more than this many times the allowed error are cut with a look-ahead of one cut.
const AHEAD: f64 = 3.0;
/// Share of the allowed error that cutting aims at; merging may use all of it.
const CUT_SHARE: f64 = 0.8;
/// Cells no wider than this many times the allowed error are not cut across that width.
const LEAST_SIZE: f64 = 2.0;

/// A cell with its hull and its error.
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
/// * `ahead`: look one cut further. A round shell gains nothing by being halved and much by being quartered, so a single cut
///   cannot distinguish the cut through its axis from the others.
fn best_plane(cell: &Cell, pool: &Pool, coarse: &[Vector3<f64>], least: f64, ahead: bool) -> Option<Plane> {
    let points: Vec<_> = cell.points.iter().map(|&v| pool[v as usize]).collect();
    let along = |normal: Vector3<f64>| {
        let sorted = Sorted::new(&points, normal).filter(|s| s.width() >= least)?;
        Some((sorted.at(0.5), sorted.best(coarse, 0.5 * least)))
    };
    let found: Vec<(Plane, Option<(f64, Plane)>)> = axes(&points).into_par_iter().filter_map(along).collect();
    let greedy = cheapest(found.iter().filter_map(|(_, best)| *best))?;
    if !ahead {
        return Some(greedy);
    }
    let planes: Vec<Plane> = std::iter::once(greedy).chain(found.iter().map(|(middle, _)| *middle)).collect();
    let order = spatial_order(&points);
    let costs: Vec<(f64, Plane)> =
        planes.into_par_iter().map(|p| (cost_ahead(&points, &order, &p, coarse), p)).collect();
    cheapest(costs.into_iter())
}

/// The first of planes that cost about the same.
fn cheapest(planes: impl Iterator<Item = (f64, Plane)>) -> Option<Plane> {
    let best = planes.reduce(|best, next| if next.0 < best.0 * (1.0 - 1e-6) { next } else { best });
    best.map(|(_, plane)| plane)
}

/// Points in the order in which a plane meets them.
struct Sorted {
    normal: Vector3<f64>,
    heights: Vec<f64>,
    points: Vec<Point3<f64>>,
    columns: Columns,
}

impl Sorted {
    fn new(points: &[Point3<f64>], normal: Vector3<f64>) -> Option<Self> {
        let mut order: Vec<(i64, u32)> = points.iter().zip(0..).map(|(p, i)| (key(normal.dot(&p.coords)), i)).collect();
        order.sort_unstable();
        let points: Vec<Point3<f64>> = order.iter().map(|&(_, i)| points[i as usize]).collect();
        let heights: Vec<f64> = points.iter().map(|p| normal.dot(&p.coords)).collect();
        (!points.is_empty()).then(|| Self { normal, heights, columns: Columns::new(points.iter()), points })
    }

    fn width(&self) -> f64 {
        self.heights[self.heights.len() - 1] - self.heights[0]
    }

    /// The plane at this share of the width.
    fn at(&self, share: f64) -> Plane {
        Plane { normal: self.normal, offset: self.heights[0] + share * self.width() }
    }

    /// How many points are below the plane at this share of the width.
    fn below(&self, share: f64) -> usize {
        let offset = self.at(share).offset;
        self.heights.partition_point(|h| *h < offset)
    }

    /// Cheapest of evenly spaced places, refined twice by halving the space; no slab is thinner than `thinnest` metres, or a wavy
    /// side would be cut into many thin slices.
    fn best(&self, coarse: &[Vector3<f64>], thinnest: f64) -> Option<(f64, Plane)> {
        let margin = thinnest / self.width();
        let share = |place: usize| place as f64 / PLACES as f64;
        let slabs = Slabs::new(self, coarse, share);
        let mut best: Option<(f64, usize)> = None;
        let mut step = 4;
        let mut places: Vec<usize> = (1..PLACES / step).map(|i| step * i).collect();
        while step > 0 {
            for place in places {
                if (margin..=1.0 - margin).contains(&share(place))
                    && let Some(cost) = slabs.cost(self, place)
                    && best.is_none_or(|b| cost < b.0)
                {
                    best = Some((cost, place));
                }
            }
            step /= 2;
            places = best.map_or(Vec::new(), |b| vec![b.1 - step, b.1 + step]);
        }
        best.map(|(cost, place)| (cost, self.at(share(place))))
    }

    fn volume(&self, corners: &[usize]) -> f64 {
        let corners: Vec<_> = corners.iter().map(|&i| self.points[i]).collect();
        hull_of(&corners).map_or(0.0, |h| h.volume)
    }
}

/// Volume of the two hulls, and a little for their difference; a flat one has none.
fn cost([a, b]: [f64; 2]) -> f64 {
    a + b + BALANCE * (a - b).abs()
}

/// The extremes of the slabs between neighbouring places: the extremes below or above a place follow from these.
struct Slabs {
    /// Where each slab begins among the sorted points; the last entry is their number.
    begins: Vec<usize>,
    /// For each direction and slab, the greatest height and the first point that has it.
    extremes: Vec<[(f64, usize); PLACES]>,
}

impl Slabs {
    fn new(sorted: &Sorted, coarse: &[Vector3<f64>], share: impl Fn(usize) -> f64) -> Self {
        let mut begins: Vec<usize> = (0..PLACES).map(|place| sorted.below(share(place))).collect();
        begins.push(sorted.points.len());
        let extremes = coarse.iter().map(|direction| {
            std::array::from_fn(|slab| sorted.columns.farthest(begins[slab]..begins[slab + 1], direction))
        });
        Self { extremes: extremes.collect(), begins }
    }

    /// [`cost`] of the cut at a place; `None` when one side is empty.
    fn cost(&self, sorted: &Sorted, place: usize) -> Option<f64> {
        let at = self.begins[place];
        let side = |slabs: Range<usize>| {
            let farthest = |row: &[(f64, usize); PLACES]| {
                let best =
                    row[slabs.clone()].iter().fold((f64::NEG_INFINITY, 0), |a, b| if b.0 > a.0 { *b } else { a });
                best.1
            };
            sorted.volume(&unique(self.extremes.iter().map(farthest)))
        };
        (at > 0 && at < sorted.points.len()).then(|| cost([side(0..place), side(place..PLACES)]))
    }
}

/// Least volume after cutting at `plane` and then halving each half, where that helps.
///
/// * `order`: as [`spatial_order`] returns it for the points.
fn cost_ahead(points: &[Point3<f64>], order: &[u32], plane: &Plane, coarse: &[Vector3<f64>]) -> f64 {
    let after = |above: bool| {
        let inside: Vec<bool> = points.iter().map(|p| (plane.normal.dot(&p.coords) >= plane.offset) == above).collect();
        let half: Vec<Point3<f64>> =
            points.iter().zip(&inside).filter(|(_, inside)| **inside).map(|(p, _)| *p).collect();
        let mut count = 0;
        let numbers: Vec<u32> = inside
            .iter()
            .map(|inside| {
                count += u32::from(*inside);
                count.wrapping_sub(1)
            })
            .collect();
        let of_half = order.iter().filter(|i| inside[**i as usize]).map(|i| numbers[*i as usize]).collect();
        let cloud = Cloud::new(&half, of_half, coarse);
        let volume = |corners: &[u32]| {
            let corners: Vec<_> = corners.iter().map(|i| half[*i as usize]).collect();
            hull_of(&corners).map_or(0.0, |h| h.volume)
        };
        let whole = volume(&cloud.supports());
        let halved = |normal: Vector3<f64>| Some(cost(cloud.supports_of_halves(&normal)?.map(|side| volume(&side))));
        axes(&half).into_iter().filter_map(halved).fold(whole, f64::min)
    };
    after(true) + after(false)
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
