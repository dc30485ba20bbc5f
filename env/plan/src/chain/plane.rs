//! Geometry in a chain's plane: links as rectangles, their frames, and their collisions with the table.

use crate::Lanes;
use std::sync::LazyLock;

/// A rectangle of a link in the chain's plane; metres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rect {
    pub x: [f64; 2],
    pub z: [f64; 2],
    pub pad: bool,
}

impl Rect {
    /// The corners that may be the first below the table: all but that at its joint.
    pub fn upper_corners(&self) -> [(f64, f64); 3] {
        [(self.x[1], self.z[0]), (self.x[1], self.z[1]), (self.x[0], self.z[1])]
    }

    fn holds(&self, x: f64, z: f64) -> bool {
        x > self.x[0] && x < self.x[1] && z > self.z[0] && z < self.z[1]
    }
}

/// A link: its rectangles, in its frame.
#[derive(Clone, Debug)]
pub(crate) struct LinkShape {
    pub rects: Vec<Rect>,
    /// Bounds of all rectangles, outside of which most points are.
    pub bounds: Rect,
    /// Middle and half sides of the bounds, in f32.
    pub middle_and_half: [[f32; 2]; 2],
    /// Middle and half sides of each rectangle, each number four times.
    pub rects_in_lanes: Vec<[[Lanes; 2]; 2]>,
    /// The upper corners of each rectangle, one of them twice.
    pub corners_in_lanes: Vec<[Lanes; 2]>,
}

impl LinkShape {
    pub fn new(rects: Vec<Rect>) -> Self {
        let none = [f64::INFINITY, f64::NEG_INFINITY];
        let join = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let empty = Rect { x: none, z: none, pad: false };
        let bounds = rects.iter().fold(empty, |all, r| Rect { x: join(all.x, r.x), z: join(all.z, r.z), pad: false });
        let middle_and_half = |rect: &Rect| {
            let sides = [rect.x, rect.z];
            [sides.map(|[low, high]| (0.5 * (low + high)) as f32), sides.map(|[low, high]| (0.5 * (high - low)) as f32)]
        };
        let rects_in_lanes =
            rects.iter().map(|rect| middle_and_half(rect).map(|pair| pair.map(Lanes::splat))).collect();
        let corners = |rect: &Rect| {
            let [a, b, c] = rect.upper_corners().map(|(x, z)| [x as f32, z as f32]);
            [0, 1].map(|axis| Lanes::new(a[axis], b[axis], c[axis], c[axis]))
        };
        let corners_in_lanes = rects.iter().map(corners).collect();
        let middle_and_half = middle_and_half(&bounds);
        Self { rects, bounds, middle_and_half, rects_in_lanes, corners_in_lanes }
    }

    /// Distance of the corner that is farthest from the origin of its frame; 0 without a rectangle.
    pub fn furthest_corner(&self) -> f64 {
        let most = |side: [f64; 2]| side[0].abs().max(side[1].abs());
        if self.rects.is_empty() { 0.0 } else { most(self.bounds.x).hypot(most(self.bounds.z)) }
    }

    /// True if a point is inside a rectangle.
    pub fn holds(&self, frame: &Frame, [x, z]: [f64; 2]) -> bool {
        let (x, z) = frame.inward(x, z);
        self.bounds.holds(x, z) && self.rects.iter().any(|r| r.holds(x, z))
    }

    /// True if a corner of the link at this frame is below the table.
    pub fn hits_table(&self, frame: &Frame, table: &PlaneTable) -> bool {
        let height = |[x, z]: [f64; 2]| table.normal[0] * x + table.normal[1] * z;
        let mut corners = self.rects.iter().flat_map(Rect::upper_corners);
        corners.any(|(x, z)| height(frame.outward(x, z)) < table.offset)
    }
}

/// An object point in a chain's plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlanePoint {
    pub x: f64,
    pub z: f64,
    pub index: u32,
}

/// The table in a chain's plane: free space is `normal . p >= offset`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlaneTable {
    pub normal: [f64; 2],
    pub offset: f64,
}

/// Angles of the table of [`Frame::nearly`] per radian, and the greatest of them: two joints that each turn by 4 rad.
const ANGLES_PER_RADIAN: f64 = 64.0;
const MOST_ANGLE: f64 = 8.0;

/// A link's frame in the chain's plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub at: [f64; 2],
    pub angle: f64,
    pub sin: f64,
    pub cos: f64,
}

impl Frame {
    /// At the origin, not rotated.
    pub const ORIGIN: Self = Self { at: [0.0; 2], angle: 0.0, sin: 0.0, cos: 1.0 };

    pub fn new(at: [f64; 2], angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self { at, angle, sin, cos }
    }

    /// As [`Frame::new`], its sine and cosine within 1e-13 for angles of a hand, from a table of `Frame::angles` at a fraction of the cost.
    pub fn nearly(at: [f64; 2], angle: f64, table: &[[f64; 2]]) -> Self {
        let nearest = ((angle + MOST_ANGLE) * ANGLES_PER_RADIAN + 0.5) as u32;
        let Some(&[sin, cos]) = table.get(nearest as usize) else { return Self::new(at, angle) };
        let d = angle - (f64::from(nearest) / ANGLES_PER_RADIAN - MOST_ANGLE);
        let square = d * d;
        let (odd, even) = (d - d * square * (1.0 / 6.0), 1.0 - square * (0.5 - square * (1.0 / 24.0)));
        Self { at, angle, sin: sin * even + cos * odd, cos: cos * even - sin * odd }
    }

    /// Sine and cosine of the angles of the table, from the least to the greatest.
    pub fn angles() -> &'static [[f64; 2]] {
        static TABLE: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
            let most = (MOST_ANGLE * ANGLES_PER_RADIAN) as i32;
            (-most..=most).map(|i| (f64::from(i) / ANGLES_PER_RADIAN).sin_cos().into()).collect()
        });
        &TABLE
    }

    pub fn outward(&self, x: f64, z: f64) -> [f64; 2] {
        [self.at[0] + self.cos * x - self.sin * z, self.at[1] + self.sin * x + self.cos * z]
    }

    pub fn inward(&self, x: f64, z: f64) -> (f64, f64) {
        let (x, z) = (x - self.at[0], z - self.at[1]);
        (self.cos * x + self.sin * z, self.cos * z - self.sin * x)
    }
}
