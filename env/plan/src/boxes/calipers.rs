//! The least rectangle around points on a plane: convex hull by monotone chain, then rotating calipers.

/// The least rectangle around a planar cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rectangle {
    /// Unit vector along one side.
    pub side: [f64; 2],
    /// Length along `side`.
    pub length: f64,
    /// Length across `side`.
    pub width: f64,
}

/// Buffers for repeated queries.
#[derive(Default)]
pub(crate) struct Calipers {
    /// The corners of the hull, [`ROUNDS`] times, and their number.
    hull: Vec<[f64; 2]>,
    corners: usize,
    order: Vec<(i64, i64)>,
}

/// A rectangle must be smaller by this factor to be better, so rounding does not choose between equal ones: the first edge from the leftmost
/// point wins.
const BETTER: f64 = 1.0 - 1e-10;
/// Share of an area by which its estimate may be wrong; far above its rounding, and far below [`BETTER`].
const DOUBT: f64 = 1e-12;

/// An integer with the order of [`f64::total_cmp`], which sorts faster.
fn key(x: f64) -> i64 {
    let bits = x.to_bits() as i64;
    bits ^ (((bits >> 63) as u64) >> 1) as i64
}

/// The inverse of [`key`].
fn value(key: i64) -> f64 {
    f64::from_bits((key ^ (((key >> 63) as u64) >> 1) as i64) as u64)
}

/// The order of points: by x, then by y.
fn before(a: &[f64; 2], b: &[f64; 2]) -> bool {
    a[0] < b[0] || a[0] == b[0] && (key(a[0]), key(a[1])) < (key(b[0]), key(b[1]))
}

/// Number of times that a hull's corners are stored: the calipers go around once from any corner, each at most half a turn ahead.
const ROUNDS: usize = 3;

fn cross(o: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])
}

fn dot(u: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    u[0] * (b[0] - a[0]) + u[1] * (b[1] - a[1])
}

impl Calipers {
    /// The rectangle of least `(length + pad) (width + pad)` around `points`, which are sorted in place.
    ///
    /// * `pad`: added to both sides, so thin clouds have an order: without it, every rectangle around points on a line has area 0.
    pub fn least_rectangle(&mut self, points: &mut [[f64; 2]], pad: f64) -> Rectangle {
        self.sort(points);
        self.least_around(points, pad)
    }

    /// As [`Calipers::least_rectangle`] around points that are nearly sorted; their numbers follow them.
    pub fn least_rectangle_nearly_sorted(
        &mut self,
        points: &mut [[f64; 2]],
        numbers: &mut [u32],
        pad: f64,
    ) -> Rectangle {
        for i in 1..points.len() {
            let (point, number) = (points[i], numbers[i]);
            let mut at = i;
            while at > 0 && before(&point, &points[at - 1]) {
                points[at] = points[at - 1];
                numbers[at] = numbers[at - 1];
                at -= 1;
            }
            (points[at], numbers[at]) = (point, number);
        }
        self.least_around(points, pad)
    }

    fn sort(&mut self, points: &mut [[f64; 2]]) {
        self.order.clear();
        self.order.extend(points.iter().map(|&[x, y]| (key(x), key(y))));
        self.order.sort_unstable();
        for (point, &(x, y)) in points.iter_mut().zip(&self.order) {
            *point = [value(x), value(y)];
        }
    }

    /// The counter-clockwise hull of points, which are sorted in place.
    pub fn hull_of(&mut self, points: &mut [[f64; 2]]) -> &[[f64; 2]] {
        self.sort(points);
        self.hull(points)
    }

    /// The counter-clockwise hull of sorted points.
    pub fn hull(&mut self, points: &[[f64; 2]]) -> &[[f64; 2]] {
        self.build_hull(points);
        &self.hull[..self.corners]
    }

    /// Takes the corners of a hull, counter-clockwise; false if they have no convex outline.
    pub fn take_outline(&mut self, points: &[[f64; 2]]) -> bool {
        self.corners = 0;
        let [first, second, .., last] = points else { return false };
        let mut turns = 0;
        let (mut a, mut b) = (*last, *first);
        for c in points[1..].iter().chain([first]) {
            if cross(a, b, *c) <= 0.0 {
                return false;
            }
            // Once around, the outline passes from left to right once.
            turns += usize::from(b[0] < a[0] && c[0] >= b[0]);
            (a, b) = (b, *c);
        }
        if turns != 1 || first == second {
            return false;
        }
        self.corners = points.len();
        self.hull.clear();
        (0..ROUNDS).for_each(|_| self.hull.extend_from_slice(points));
        true
    }

    /// True if `(length + pad) (width + pad)` of the least rectangle around the last hull is surely at least `least`.
    pub fn none_below(&self, least: f64, pad: f64) -> bool {
        self.corners >= 3 && self.areas(pad).all(|area| area * (1.0 - DOUBT) >= least)
    }

    /// `(length + pad) (width + pad)` of the least rectangle around the last hull, which has an area, within rounding.
    pub fn least_area(&self, pad: f64) -> f64 {
        self.areas(pad).fold(f64::INFINITY, f64::min)
    }

    /// `(length + pad) (width + pad)` of the rectangles flush with the edges of the last hull.
    fn areas(&self, pad: f64) -> impl Iterator<Item = f64> {
        let hull = &self.hull[..];
        let (mut right, mut top, mut left) = (1, 1, 1);
        (0..self.corners).map(move |i| {
            let (a, b) = (hull[i], hull[i + 1]);
            let e = [b[0] - a[0], b[1] - a[1]];
            right = climb(hull, e, right.max(i + 1));
            top = climb(hull, [-e[1], e[0]], top.max(right));
            left = climb(hull, [-e[0], -e[1]], left.max(top));
            let square = e[0] * e[0] + e[1] * e[1];
            let pad = pad * square.sqrt();
            (dot(e, hull[left], hull[right]) + pad) * (dot([-e[1], e[0]], a, hull[top]) + pad) / square
        })
    }

    /// The least rectangle around sorted points.
    fn least_around(&mut self, points: &[[f64; 2]], pad: f64) -> Rectangle {
        self.build_hull(points);
        let n = self.corners;
        let hull = &self.hull[..];
        if n < 3 {
            return segment(&hull[..n]);
        }
        let mut best = Rectangle { side: [1.0, 0.0], length: f64::INFINITY, width: f64::INFINITY };
        let mut least = f64::INFINITY;
        let (mut right, mut top, mut left) = (1, 1, 1);
        for i in 0..n {
            let (a, b) = (hull[i], hull[i + 1]);
            let e = [b[0] - a[0], b[1] - a[1]];
            right = climb(hull, e, right.max(i + 1));
            top = climb(hull, [-e[1], e[0]], top.max(right));
            left = climb(hull, [-e[0], -e[1]], left.max(top));
            let [right, top, left] = [right, top, left].map(|at| hull[at]);
            // Most rectangles are larger: an estimate without the exact length shows it.
            let length = (e[0] * e[0] + e[1] * e[1]).sqrt();
            let estimate = (dot(e, left, right) / length + pad) * (dot([-e[1], e[0]], a, top) / length + pad);
            if estimate * (1.0 - DOUBT) >= least * BETTER {
                continue;
            }
            let length = e[0].hypot(e[1]);
            let u = [e[0] / length, e[1] / length];
            let (extent, height) = (dot(u, left, right), dot([-u[1], u[0]], a, top));
            let area = (extent + pad) * (height + pad);
            if area < least * BETTER {
                least = area;
                best = Rectangle { side: u, length: extent, width: height };
            }
        }
        best
    }

    /// Builds the counter-clockwise hull of sorted points without collinear ones.
    fn build_hull(&mut self, points: &[[f64; 2]]) {
        let hull = &mut self.hull;
        hull.clear();
        // Rounding may keep every point of a line, on the way back too.
        hull.resize(2 * points.len() + 1, [0.0; 2]);
        let mut n = 0;
        let mut push = |n: &mut usize, p: [f64; 2], floor: usize| {
            while *n >= floor && cross(hull[*n - 2], hull[*n - 1], p) <= 0.0 {
                *n -= 1;
            }
            hull[*n] = p;
            *n += 1;
        };
        for &p in points {
            push(&mut n, p, 2);
        }
        let lower = n + 1;
        for &p in points.iter().rev().skip(1) {
            push(&mut n, p, lower);
        }
        n = n.saturating_sub(1);
        hull.truncate(n);
        for _ in 1..ROUNDS {
            hull.extend_from_within(..n);
        }
        self.corners = n;
    }
}

/// Walks counter-clockwise from `start` while the hull rises along `u`.
fn climb(hull: &[[f64; 2]], u: [f64; 2], start: usize) -> usize {
    let mut at = start;
    while at + 1 < hull.len() && dot(u, hull[at], hull[at + 1]) > 0.0 {
        at += 1;
    }
    at
}

fn segment(hull: &[[f64; 2]]) -> Rectangle {
    let (a, b) = match hull {
        [a, .., b] => (*a, *b),
        _ => {
            return Rectangle { side: [1.0, 0.0], length: 0.0, width: 0.0 };
        }
    };
    let length = (b[0] - a[0]).hypot(b[1] - a[1]);
    if length == 0.0 {
        return Rectangle { side: [1.0, 0.0], length: 0.0, width: 0.0 };
    }
    Rectangle { side: [(b[0] - a[0]) / length, (b[1] - a[1]) / length], length, width: 0.0 }
}
