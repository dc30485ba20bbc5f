//! Scanline rasterization into a nearness buffer.
//!
//! Nearness is 1/z for a perspective camera and -z for an orthographic one: both are linear over the image of a plane, and the greater value
//! hides the smaller. The point at which an edge crosses a row depends only on the edge, so neighbouring faces neither leave a gap nor
//! share a pixel.

/// A projected corner: column, row, nearness.
pub(crate) type Corner = [f64; 3];

/// Twice the area, pixels squared, below which a triangle has one normal.
const SMALL: f64 = 3.0;

pub(crate) struct Raster {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) nearness: Vec<f32>,
    /// Id of the triangle at each pixel; 0 for none. Empty if no ids are kept.
    pub(crate) ids: Vec<u32>,
}

/// Gradients of quantities over a triangle's image.
pub(crate) struct Gradient {
    edges: [[f64; 2]; 2],
    per_area: f64,
}

impl Gradient {
    /// Change per column and per row of a quantity with these values at the corners.
    pub(crate) fn of(&self, [a, b, c]: [f64; 3]) -> [f64; 2] {
        let [[bx, by], [cx, cy]] = self.edges;
        let (b, c) = ((b - a) * self.per_area, (c - a) * self.per_area);
        [b * cy - c * by, c * bx - b * cx]
    }

    /// True if the image is about a pixel, or a sliver whose gradients are dominated by rounding.
    pub(crate) fn is_small(&self) -> bool {
        self.per_area.abs() > 1.0 / SMALL
    }
}

/// Twice the signed area of the image: positive if the corners are clockwise in the image (rows grow downward).
pub(crate) fn twice_area([a, b, c]: &[Corner; 3]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
}

impl Raster {
    pub(crate) fn new() -> Self {
        Self { width: 0, height: 0, nearness: Vec::new(), ids: Vec::new() }
    }

    /// Clears the image; only triangles nearer than `nothing` will be visible.
    pub(crate) fn clear(&mut self, width: usize, height: usize, nothing: f32, keep_ids: bool) {
        (self.width, self.height) = (width, height);
        self.nearness.clear();
        self.nearness.resize(width * height, nothing);
        self.ids.clear();
        if keep_ids {
            self.ids.resize(width * height, 0);
        }
    }

    /// True if the bounds of a triangle contain a pixel's centre; many triangles of a fine mesh contain none.
    #[inline]
    pub(crate) fn may_cover(&self, corners: &[Corner; 3]) -> bool {
        let crosses = |[from, to]: [f64; 2], size: usize| pixel_from(from, size) < pixel_from(to, size);
        crosses(range(corners, 0), self.width) && crosses(range(corners, 1), self.height)
    }

    /// Rasterizes a triangle with a depth test; with `IDS`, writes `id`.
    ///
    /// Returns its gradient, or `None` if it is edge-on.
    pub(crate) fn triangle<const IDS: bool>(&mut self, corners: &[Corner; 3], area: f64, id: u32) -> Option<Gradient> {
        if area == 0.0 {
            return None;
        }
        let [mut top, mut mid, mut low] = *corners;
        if top[1] > mid[1] {
            (top, mid) = (mid, top);
        }
        if mid[1] > low[1] {
            (mid, low) = (low, mid);
        }
        if top[1] > mid[1] {
            (top, mid) = (mid, top);
        }
        let (first, end) = (pixel_from(top[1], self.height), pixel_from(low[1], self.height));
        let [a, b, c] = corners;
        let gradient =
            Gradient { edges: [[b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]], per_area: 1.0 / area };
        let [dx, dy] = gradient.of([a[2], b[2], c[2]]);
        let plane = Plane { origin: *a, dx, dy, range: range(corners, 2) };
        let long = Edge::new(&top, &low);
        // The side of the long edge on which the middle corner is.
        let mid_right = (mid[0] - top[0]) * (low[1] - top[1]) > (low[0] - top[0]) * (mid[1] - top[1]);
        let knee = pixel_from(mid[1], self.height);
        for (from, to, short) in [(first, knee, Edge::new(&top, &mid)), (knee, end, Edge::new(&mid, &low))] {
            let (l, r) = if mid_right { (&long, &short) } else { (&short, &long) };
            for row in from..to {
                let y = row as f64 + 0.5;
                let (start, stop) = (pixel_from(l.at(y), self.width), pixel_from(r.at(y), self.width));
                if start < stop {
                    self.span::<IDS>(row, start, stop, plane.ramp(start, stop, y), id);
                }
            }
        }
        Some(gradient)
    }

    #[inline]
    fn span<const IDS: bool>(&mut self, row: usize, start: usize, stop: usize, ramp: Ramp, id: u32) {
        let range = row * self.width + start..row * self.width + stop;
        let nearness = &mut self.nearness[range.clone()];
        let at = |k: usize| ramp.base + ramp.slope * (k as i32 - ramp.from) as f32;
        if IDS {
            for (k, (here, shown)) in nearness.iter_mut().zip(&mut self.ids[range]).enumerate() {
                let w = at(k);
                let nearer = w > *here;
                *here = if nearer { w } else { *here };
                *shown = if nearer { id } else { *shown };
            }
        } else {
            for (k, here) in nearness.iter_mut().enumerate() {
                let w = at(k);
                *here = if w > *here { w } else { *here };
            }
        }
    }
}

/// Nearness over a triangle.
struct Plane {
    origin: Corner,
    dx: f64,
    dy: f64,
    range: [f64; 2],
}

/// Nearness along a span: `base + slope * (k - from)`, computed from its smaller end to keep rounding relative to each value.
struct Ramp {
    base: f32,
    slope: f32,
    from: i32,
}

impl Plane {
    #[inline]
    fn ramp(&self, start: usize, stop: usize, y: f64) -> Ramp {
        let from = if self.dx < 0.0 { stop - 1 } else { start };
        let base = self.origin[2] + self.dx * (from as f64 + 0.5 - self.origin[0]) + self.dy * (y - self.origin[1]);
        Ramp {
            // Rounding must not take slivers out of the triangle's range.
            base: clamp(base, self.range[0], self.range[1]) as f32,
            slope: self.dx as f32,
            from: (from - start) as i32,
        }
    }
}

/// A side from its upper corner downward.
struct Edge {
    x: f64,
    y: f64,
    slope: f64,
}

impl Edge {
    #[inline]
    fn new(upper: &Corner, lower: &Corner) -> Self {
        let height = lower[1] - upper[1];
        Self { x: upper[0], y: upper[1], slope: if height > 0.0 { (lower[0] - upper[0]) / height } else { 0.0 } }
    }

    #[inline]
    fn at(&self, y: f64) -> f64 {
        self.x + (y - self.y) * self.slope
    }
}

/// The first pixel whose centre is not before `x`, in [0, size]; a centre exactly at `x` always falls on the same side.
#[inline]
fn pixel_from(x: f64, size: usize) -> usize {
    /// Adding this rounds to the nearest whole number and leaves it in the lowest bits: much faster than a checked conversion.
    const WHOLE: f64 = (1_u64 << 52) as f64;
    (clamp(x, 0.0, size as f64) + WHOLE).to_bits() as u32 as usize
}

/// Least and greatest of a coordinate.
#[inline]
fn range([a, b, c]: &[Corner; 3], axis: usize) -> [f64; 2] {
    let [a, b, c] = [a[axis], b[axis], c[axis]];
    let [low, high] = if a < b { [a, b] } else { [b, a] };
    [if c < low { c } else { low }, if c > high { c } else { high }]
}

/// `x` within the bounds in two instructions; `low` for NaN.
#[inline]
fn clamp(x: f64, low: f64, high: f64) -> f64 {
    let x = if x > low { x } else { low };
    if x < high { x } else { high }
}
