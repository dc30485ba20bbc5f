//! The box of least volume around a cloud: calipers for every direction of a lattice, then the best few refined.
//!
//! For a given axis the best box is exact: the least rectangle around the projection along it, by rotating calipers. What remains is a
//! search over axes, which runs on a core set (see `core_set`) in the cloud's own frame, so that it turns with the cloud. Every start is
//! refined by a compass search with shrinking steps, during which each of the box's three axes takes its turn at the calipers; where the
//! box found does not hold the whole cloud, the points that stick out join the core set and the search goes on.
//!
//! Sources: J. O'Rourke, "Finding minimal enclosing boxes", 1985 (two faces of the best box are flush with edges of the hull);
//! G. Toussaint, "Solving geometric problems with the rotating calipers", 1983.

use super::calipers::Calipers;
use super::core_set::{CoreSet, half_sphere};
use super::moments::CloudFrame;
use nalgebra::{Matrix3, Point3, Vector3};

/// Lattice directions. A box is met by any of its three axes, so the nearest is about 3 degrees off.
const DIRECTIONS: usize = 300;
/// How many different boxes of the lattice are refined roughly, and how many of these to the end.
const STARTS: usize = 8;
const FINALISTS: usize = 6;
/// Two boxes whose axes agree within this angle (as a cosine: 6 degrees) are one start.
const SAME_BOX: f64 = 0.9945;
/// Steps of the compass search in radians: the first is half the spacing of the lattice.
const FIRST_STEP: f64 = 0.06;
/// Long, flat things (a knife) have narrow valleys: with a coarser step their best start is not recognised.
const ROUGH_STEP: f64 = 0.003;
/// A 10 cm box turned by this angle gains 0.1 micrometres.
const LAST_STEP: f64 = 1e-6;
/// Added to every length, as a share of the cloud's size: keeps an order among boxes of flat clouds, far above rounding (1e-16 / 1e-6 is
/// less than what `BETTER` asks for).
const PAD: f64 = 1e-6;
/// A box must be smaller by this share to be better: among equal boxes (round objects have many) the first of the lattice wins, so that
/// rounding does not choose.
const BETTER: f64 = 1.0 - 1e-9;
/// Rounds of growing the core set for one box; in practice 2 to 4 are used.
const MAX_ROUNDS: usize = 12;

/// A box on the core set.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    axes: Matrix3<f64>,
    volume: f64,
}

impl Candidate {
    /// Sorts by volume in steps of about 1e-7, so that equal boxes keep the lattice's order whatever the rounding.
    fn rank(&self) -> i64 {
        (self.volume.ln() * 1e7).round() as i64
    }
}

/// Axes (columns, orthonormal) of the box of least volume around `samples` and `more`; `samples` alone (at least one) set the frame of
/// the search.
pub(crate) fn least_volume_axes(samples: &[Point3<f64>], more: &[Point3<f64>]) -> Matrix3<f64> {
    let frame = CloudFrame::of(samples);
    let all = samples.iter().chain(more);
    let size = all.clone().map(|p| (p - frame.origin).norm()).fold(0.0, f64::max);
    if size == 0.0 {
        return frame.axes;
    }
    let local = all.map(|p| frame.axes.tr_mul(&(p - frame.origin)) / size);
    let mut search = Search { cloud: CoreSet::new(local), calipers: Calipers::default(), flat: Vec::new() };
    frame.axes * search.run()
}

struct Search {
    cloud: CoreSet,
    calipers: Calipers,
    flat: Vec<[f64; 2]>,
}

impl Search {
    fn run(&mut self) -> Matrix3<f64> {
        let mut found = self.starts();
        for candidate in &mut found {
            *candidate = self.refine_on_cloud(*candidate, FIRST_STEP, ROUGH_STEP, 2);
        }
        found.sort_by_key(Candidate::rank);
        let mut best = Candidate { axes: Matrix3::identity(), volume: f64::INFINITY };
        for candidate in found.into_iter().take(FINALISTS) {
            let refined = self.refine_on_cloud(candidate, ROUGH_STEP, LAST_STEP, MAX_ROUNDS);
            if refined.volume < best.volume * BETTER {
                best = refined;
            }
        }
        best.axes
    }

    /// The boxes of the lattice with the least lower bounds, each unlike the others.
    fn starts(&mut self) -> Vec<Candidate> {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let mut all: Vec<Candidate> =
            axes.into_iter().chain(half_sphere(DIRECTIONS)).map(|axis| self.best_about(&axis)).collect();
        all.sort_by_key(Candidate::rank);
        let mut picked: Vec<Candidate> = Vec::with_capacity(STARTS);
        for candidate in all {
            if picked.len() == STARTS {
                break;
            }
            if !picked.iter().any(|other| alike(&candidate.axes, &other.axes)) {
                picked.push(candidate);
            }
        }
        picked
    }

    /// The least box on the core set with one side along `axis`.
    fn best_about(&mut self, axis: &Vector3<f64>) -> Candidate {
        // Axes are handed from box to box: without this, rounding shrinks them, and the shrinking looks like a gain.
        let axis = &axis.normalize();
        let (u, v) = plane_basis(axis);
        self.flat.clear();
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for p in self.cloud.core() {
            let along = p.dot(axis);
            low = low.min(along);
            high = high.max(along);
            self.flat.push([p.dot(&u), p.dot(&v)]);
        }
        let rectangle = self.calipers.least_rectangle(&mut self.flat, PAD);
        let side = u * rectangle.side[0] + v * rectangle.side[1];
        Candidate {
            axes: Matrix3::from_columns(&[*axis, side, axis.cross(&side)]),
            volume: (high - low + PAD) * (rectangle.length + PAD) * (rectangle.width + PAD),
        }
    }

    /// Lets each axis of the box take its turn at the calipers, until none improves it.
    fn exchange_axes(&mut self, mut best: Candidate) -> Candidate {
        /// In practice 2 to 8 turns are used.
        const MAX_TURNS: usize = 30;
        let mut since = 0;
        let mut axis = 1;
        for _ in 0..MAX_TURNS {
            if since == 2 {
                break;
            }
            let found = self.best_about(&best.axes.column(axis).into_owned());
            if found.volume < best.volume * BETTER {
                best = found;
                since = 0;
                axis = 1; // its column 0 has just had its turn
            } else {
                since += 1;
                axis = if axis == 1 { 2 } else { 1 };
            }
        }
        best
    }

    /// Compass search over the first axis, from steps of `first` radians down to `last`.
    fn refine(&mut self, start: Candidate, first: f64, last: f64) -> Candidate {
        const GOLDEN_TURN: f64 = 2.399_963_229_728_653;
        const COMPASS: usize = 6;
        /// A longer way at one step size is a creep that smaller steps end.
        const MAX_MOVES: usize = 12;
        let mut best = self.exchange_axes(start);
        let mut step = first;
        let mut turn: f64 = 0.0;
        let mut moves = 0;
        while step > last {
            let axis = best.axes.column(0).into_owned();
            let (u, v) = plane_basis(&axis);
            let mut improved = false;
            for k in 0..COMPASS {
                let (sin, cos) = (turn + std::f64::consts::TAU * k as f64 / COMPASS as f64).sin_cos();
                let moved = (axis + (u * cos + v * sin) * step).normalize();
                let found = self.best_about(&moved);
                if found.volume < best.volume * BETTER {
                    best = found;
                    improved = true;
                }
            }
            turn += GOLDEN_TURN;
            moves += 1;
            if improved && moves < MAX_MOVES {
                best = self.exchange_axes(best);
            } else {
                step *= 0.5;
                moves = 0;
            }
        }
        best
    }

    /// Refines on the core set, grows it by what sticks out, and repeats; the volume returned is that around the whole cloud.
    fn refine_on_cloud(&mut self, start: Candidate, first: f64, last: f64, rounds: usize) -> Candidate {
        let mut best = Candidate { volume: f64::INFINITY, ..start };
        let mut current = start;
        let mut step = first;
        for _ in 0..rounds {
            current = self.refine(current, step, last);
            let (lengths, grew) = self.cloud.grow(&current.axes);
            let volume = lengths.iter().map(|l| l + PAD).product::<f64>();
            if volume < best.volume * BETTER {
                best = Candidate { volume, ..current };
            }
            if !grew || volume <= current.volume * (1.0 + 1e-9) {
                break;
            }
            current.volume = volume;
            step = (first * 0.5).max(4.0 * last);
        }
        best
    }
}

/// Two unit vectors that complete `axis` to a right-handed frame.
pub(crate) fn plane_basis(axis: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let helper = Vector3::ith(axis.iamin(), 1.0);
    let u = axis.cross(&helper).normalize();
    (u, axis.cross(&u))
}

/// True where every axis of `a` is near one of `b`, up to sign.
fn alike(a: &Matrix3<f64>, b: &Matrix3<f64>) -> bool {
    let cosines = a.tr_mul(b).abs();
    (0..3).all(|i| cosines.row(i).max() > SAME_BOX)
}
