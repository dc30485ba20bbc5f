//! Geometry in a chain's plane: links as rectangles, their frames, and their collisions with the object's points and the table.

/// A rectangle of a link in the chain's plane; metres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rect {
    pub x: [f64; 2],
    pub z: [f64; 2],
    pub pad: bool,
}

impl Rect {
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
}

impl LinkShape {
    pub fn new(rects: Vec<Rect>) -> Self {
        let none = [f64::INFINITY, f64::NEG_INFINITY];
        let join = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let empty = Rect { x: none, z: none, pad: false };
        let bounds = rects.iter().fold(empty, |all, r| Rect { x: join(all.x, r.x), z: join(all.z, r.z), pad: false });
        Self { rects, bounds }
    }

    fn holds(&self, frame: &Frame, [x, z]: [f64; 2]) -> bool {
        let (x, z) = frame.inward(x, z);
        self.bounds.holds(x, z) && self.rects.iter().any(|r| r.holds(x, z))
    }

    /// True if a corner of the link at this frame is below the table.
    pub fn hits_table(&self, frame: &Frame, table: &PlaneTable) -> bool {
        /// Margin for the rounding of a height, metres; far above it.
        const ROUNDING: f64 = 1e-9;
        let height = |[x, z]: [f64; 2]| table.normal[0] * x + table.normal[1] * z;
        let reach = [height([frame.cos, frame.sin]), height([-frame.sin, frame.cos])];
        let least = |reach: f64, side: [f64; 2]| (reach * side[0]).min(reach * side[1]);
        let lowest = height(frame.at) + least(reach[0], self.bounds.x) + least(reach[1], self.bounds.z);
        if lowest > table.offset + ROUNDING {
            return false;
        }
        self.rects.iter().any(|r| {
            let corners = [(r.x[1], r.z[0]), (r.x[1], r.z[1]), (r.x[0], r.z[1])];
            corners.iter().any(|&(x, z)| height(frame.outward(x, z)) < table.offset)
        })
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

/// A link's frame in the chain's plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub at: [f64; 2],
    pub angle: f64,
    pub sin: f64,
    pub cos: f64,
}

impl Frame {
    pub fn new(at: [f64; 2], angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self { at, angle, sin, cos }
    }

    pub fn outward(&self, x: f64, z: f64) -> [f64; 2] {
        [self.at[0] + self.cos * x - self.sin * z, self.at[1] + self.sin * x + self.cos * z]
    }

    pub fn inward(&self, x: f64, z: f64) -> (f64, f64) {
        let (x, z) = (x - self.at[0], z - self.at[1]);
        (self.cos * x + self.sin * z, self.cos * z - self.sin * x)
    }
}

/// The object's points around one closing chain in square cells, and a cache of the last steps. Neither changes results.
pub(crate) struct Obstacles {
    /// Row by row of cells, and cell by cell within a row.
    points: Vec<[f64; 2]>,
    /// Index of each cell's first point; the last entry is the number of points.
    begins: Vec<u32>,
    origin: [f64; 2],
    /// Number of cells along x and z.
    size: [usize; 2],
    /// The point that blocked each link last.
    last: Vec<[f64; 2]>,
    /// Recent positions of the first coordinate, and whether a point blocked the first link there, which depends on no other coordinate.
    known: [(f64, bool); Obstacles::KNOWN],
    next: usize,
}

impl Obstacles {
    /// Number of cached positions: those of two steps.
    const KNOWN: usize = 8;
    /// Side of a cell, metres: a third of a link's thickness.
    const CELL: f64 = 0.01;

    /// * `links`: number of links of the chain.
    pub fn new(points: &[PlanePoint], links: usize) -> Self {
        let none = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let (low, high) = points
            .iter()
            .fold(none, |(low, high), p| ([low[0].min(p.x), low[1].min(p.z)], [high[0].max(p.x), high[1].max(p.z)]));
        let size = [0, 1].map(|k| ((high[k] - low[k]) / Self::CELL).max(0.0) as usize + 1);
        let mut all = Self {
            points: vec![[0.0; 2]; points.len()],
            begins: vec![0; size[0] * size[1] + 1],
            origin: low,
            size,
            last: vec![[f64::INFINITY; 2]; links],
            known: [(f64::NAN, false); Self::KNOWN],
            next: 0,
        };
        let cell = |all: &Self, p: &PlanePoint| all.cell(1, p.z) * size[0] + all.cell(0, p.x);
        for p in points {
            let cell = cell(&all, p);
            all.begins[cell] += 1;
        }
        let mut sum = 0;
        for begin in &mut all.begins {
            sum += *begin;
            *begin = sum;
        }
        // Filled from the end: each entry ends at the beginning of its cell.
        for p in points.iter().rev() {
            let cell = cell(&all, p);
            all.begins[cell] -= 1;
            let at = all.begins[cell] as usize;
            all.points[at] = [p.x, p.z];
        }
        all
    }

    /// Index along `axis` (0: x, 1: z) of the cell that contains `value`, or of the nearest one.
    fn cell(&self, axis: usize, value: f64) -> usize {
        (((value - self.origin[axis]) / Self::CELL).max(0.0) as usize).min(self.size[axis] - 1)
    }

    /// True if a point is inside one of the links at these frames.
    ///
    /// * `first`: position of the first coordinate, the only one on which the first link depends.
    pub fn block<'a>(&mut self, links: impl Iterator<Item = (&'a LinkShape, &'a Frame)> + Clone, first: f64) -> bool {
        // The point that blocked a link last usually does so again, and is tested first.
        links.clone().zip(&self.last).any(|((link, frame), last)| link.holds(frame, *last))
            || links.enumerate().any(|(which, (link, frame))| match which {
                0 => self.block_first(link, frame, first),
                _ => self.block_link(which, link, frame),
            })
    }

    fn block_first(&mut self, link: &LinkShape, frame: &Frame, position: f64) -> bool {
        if let Some(&(_, blocked)) = self.known.iter().find(|(known, _)| *known == position) {
            return blocked;
        }
        let blocked = self.block_link(0, link, frame);
        self.known[self.next] = (position, blocked);
        self.next = (self.next + 1) % Self::KNOWN;
        blocked
    }

    fn block_link(&mut self, which: usize, link: &LinkShape, frame: &Frame) -> bool {
        /// Margin for the rounding of a point from the plane to a link and back, metres; far above it.
        const ROUNDING: f64 = 1e-9;
        /// Points compared at once.
        const LANES: usize = 8;
        let bounds = &link.bounds;
        let (middle, half) = (|side: [f64; 2]| 0.5 * (side[0] + side[1]), |side: [f64; 2]| 0.5 * (side[1] - side[0]));
        let (center, half) = (frame.outward(middle(bounds.x), middle(bounds.z)), [half(bounds.x), half(bounds.z)]);
        let (cos, sin) = (frame.cos.abs(), frame.sin.abs());
        let reach = [cos * half[0] + sin * half[1] + ROUNDING, sin * half[0] + cos * half[1] + ROUNDING];
        let cells =
            |axis: usize| [self.cell(axis, center[axis] - reach[axis]), self.cell(axis, center[axis] + reach[axis])];
        let (x, z) = (cells(0), cells(1));
        for row in z[0]..=z[1] {
            let first = row * self.size[0];
            let [begin, end] = [first + x[0], first + x[1] + 1].map(|cell| self.begins[cell] as usize);
            for points in self.points[begin..end].chunks(LANES) {
                // Branch-free, so the compiler compares several points at once.
                let near = points.iter().fold(false, |near, &[x, z]| {
                    let (x, z) = frame.inward(x, z);
                    near | ((x > bounds.x[0]) & (x < bounds.x[1]) & (z > bounds.z[0]) & (z < bounds.z[1]))
                });
                if near && let Some(found) = points.iter().find(|p| link.holds(frame, **p)) {
                    self.last[which] = *found;
                    return true;
                }
            }
        }
        false
    }
}
