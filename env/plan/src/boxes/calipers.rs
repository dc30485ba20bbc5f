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
    hull: Vec<[f64; 2]>,
    order: Vec<(i64, i64)>,
}

/// A rectangle must be smaller by this factor to be better, so rounding does not choose between equal ones: the first edge from the leftmost
/// point wins.
const BETTER: f64 = 1.0 - 1e-10;

/// An integer with the order of [`f64::total_cmp`], which sorts faster.
fn key(x: f64) -> i64 {
    let bits = x.to_bits() as i64;
    bits ^ (((bits >> 63) as u64) >> 1) as i64
}

/// The inverse of [`key`].
fn value(key: i64) -> f64 {
    f64::from_bits((key ^ (((key >> 63) as u64) >> 1) as i64) as u64)
}

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
        self.build_hull(points);
        let hull = &self.hull;
        let n = hull.len();
        if n < 3 {
            return segment(hull);
        }
        let mut best = Rectangle { side: [1.0, 0.0], length: f64::INFINITY, width: f64::INFINITY };
        let mut least = f64::INFINITY;
        let (mut right, mut top, mut left) = (1, 1, 1);
        for i in 0..n {
            let (a, b) = (hull[i], hull[wrap(i + 1, n)]);
            let length = (b[0] - a[0]).hypot(b[1] - a[1]);
            let u = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
            let v = [-u[1], u[0]];
            right = climb(hull, u, right.max(i + 1));
            top = climb(hull, v, top.max(right));
            left = climb(hull, [-u[0], -u[1]], left.max(top));
            let extent = dot(u, hull[wrap(left, n)], hull[wrap(right, n)]);
            let height = dot(v, a, hull[wrap(top, n)]);
            let area = (extent + pad) * (height + pad);
            if area < least * BETTER {
                least = area;
                best = Rectangle { side: u, length: extent, width: height };
            }
        }
        best
    }

    /// Builds the counter-clockwise hull without collinear points.
    fn build_hull(&mut self, points: &mut [[f64; 2]]) {
        self.order.clear();
        self.order.extend(points.iter().map(|&[x, y]| (key(x), key(y))));
        self.order.sort_unstable();
        for (point, &(x, y)) in points.iter_mut().zip(&self.order) {
            *point = [value(x), value(y)];
        }
        self.hull.clear();
        for &p in points.iter() {
            self.push(p, 2);
        }
        let lower = self.hull.len() + 1;
        for &p in points.iter().rev().skip(1) {
            self.push(p, lower);
        }
        self.hull.pop();
    }

    fn push(&mut self, p: [f64; 2], floor: usize) {
        let hull = &mut self.hull;
        while hull.len() >= floor && cross(hull[hull.len() - 2], hull[hull.len() - 1], p) <= 0.0 {
            hull.pop();
        }
        hull.push(p);
    }
}

/// Walks counter-clockwise from `start` while the hull rises along `u`, at most once around.
fn climb(hull: &[[f64; 2]], u: [f64; 2], start: usize) -> usize {
    let n = hull.len();
    let mut at = start;
    let mut from = hull[wrap(at, n)];
    while at < start + n {
        let to = hull[wrap(at + 1, n)];
        if dot(u, from, to) <= 0.0 {
            break;
        }
        from = to;
        at += 1;
    }
    at
}

/// `at` modulo `n`, for `at` of at most a few times `n`: faster than a division.
fn wrap(mut at: usize, n: usize) -> usize {
    while at >= n {
        at -= n;
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
