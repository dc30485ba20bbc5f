//! Composite objects as signed distances: rounded convex prisms, turned pieces and tubes, joined into one solid.
//!
//! Each piece defines its own convex parts, so the object needs no decomposition.

use crate::draft::Parts;
use crate::lathe::{self, Rz, to_segment};
use crate::surface::P3;
use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector2, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Turns a piece made along z to run along x.
pub(crate) fn along_x(at: Vector3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(at.into(), UnitQuaternion::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2))
}

/// Turns a piece made along z to run along y.
pub(crate) fn along_y(at: Vector3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(at.into(), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -FRAC_PI_2))
}

/// The form of a piece in its own frame.
enum Form {
    /// A convex polygon (counter-clockwise, inset by `round`) swept over `|z| <= half - round`, then rounded.
    Prism { core: Vec<Point2<f64>>, half: f64, round: f64 },
    /// A convex half outline `(r, z)` turned about z; `core` is the closed outline inset by `round`.
    Turned { outline: Vec<Rz>, core: Vec<Point2<f64>>, round: f64 },
    /// Round rods from point to point.
    Tube { line: Vec<P3>, radius: f64 },
}

/// A piece of a solid.
pub(crate) struct Piece {
    form: Form,
    object_from_piece: Isometry3<f64>,
    /// Radius over which it blends into the pieces before it, metres.
    blend: f64,
    /// A ball around it: nothing of the piece lies farther from its centre, metres.
    ball: (P3, f64),
    /// Cells in x and y into which a prism's part is cut (for a surface that is bent afterwards).
    cells: [usize; 2],
}

impl Piece {
    fn new(form: Form) -> Self {
        Self { form, object_from_piece: Isometry3::identity(), blend: 0.0015, cells: [1, 1], ball: (P3::origin(), 0.0) }
    }

    /// A plate over the convex polygon `outline` (counter-clockwise), `2 half` thick, with rounded edges.
    pub(crate) fn prism(outline: &[[f64; 2]], half: f64, round: f64) -> Self {
        let outline: Vec<Point2<f64>> = outline.iter().map(|p| Point2::new(p[0], p[1])).collect();
        Self::new(Form::Prism { core: inset(&outline, round), half, round })
    }

    /// A block of the given half extents.
    pub(crate) fn block(half: [f64; 3], round: f64) -> Self {
        let [x, y, z] = half;
        Self::prism(&[[-x, -y], [x, -y], [x, y], [-x, y]], z, round)
    }

    /// A convex piece turned about z: `outline` lists (r, z) with z rising.
    pub(crate) fn turned(outline: &[[f64; 2]], round: f64) -> Self {
        let outline: Vec<Rz> = outline.iter().map(|p| Rz::new(p[0], p[1])).collect();
        let mut whole = outline.clone();
        whole.extend(outline.iter().rev().map(|p| Rz::new(-p.x, p.y)));
        Self::new(Form::Turned { core: inset(&whole, round), outline, round })
    }

    /// Rods along `line`; repeat the first point at the end to close it.
    pub(crate) fn tube(line: Vec<P3>, radius: f64) -> Self {
        Self::new(Form::Tube { line, radius })
    }

    pub(crate) fn at(mut self, object_from_piece: Isometry3<f64>) -> Self {
        self.object_from_piece = object_from_piece;
        self
    }

    pub(crate) fn blend(mut self, radius: f64) -> Self {
        self.blend = radius;
        self
    }

    pub(crate) fn cells(mut self, x: usize, y: usize) -> Self {
        self.cells = [x, y];
        self
    }

    fn distance(&self, p: &P3) -> f64 {
        let p = self.object_from_piece.inverse_transform_point(p);
        match &self.form {
            Form::Prism { core, half, round } => {
                let (side, top) = (polygon_distance(core, p.xy()), p.z.abs() - (half - round));
                side.max(top).min(0.0) + side.max(0.0).hypot(top.max(0.0)) - round
            }
            Form::Turned { core, round, .. } => polygon_distance(core, Point2::new(p.x.hypot(p.y), p.z)) - round,
            Form::Tube { line, radius } => {
                line.windows(2).map(|w| rod(&p, w[0], w[1])).fold(f64::MAX, f64::min) - radius
            }
        }
    }

    fn parts(&self) -> Parts {
        let mut parts = match &self.form {
            Form::Prism { core, half, round } => {
                cut(core, self.cells).iter().map(|cell| prism_cloud(cell, core, *half, *round)).collect()
            }
            Form::Turned { outline, round, .. } => lathe::solid_parts(&broken_edges(outline, *round), lathe::round),
            Form::Tube { line, radius } => tube_parts(line, *radius),
        };
        for p in parts.iter_mut().flatten() {
            *p = self.object_from_piece * *p;
        }
        parts
    }
}

/// Pieces joined one after the other.
pub(crate) struct Solid(Vec<Piece>);

impl Solid {
    pub(crate) fn new(mut pieces: Vec<Piece>) -> Self {
        for piece in &mut pieces {
            let (low, high) = bounds(&piece.parts());
            piece.ball = (nalgebra::center(&low, &high), (high - low).norm() / 2.0 + 0.001);
        }
        Self(pieces)
    }

    /// Signed distance (negative inside), metres; exact outside of the blends.
    pub(crate) fn distance(&self, p: &P3) -> f64 {
        let mut d = f64::MAX;
        for piece in &self.0 {
            // Skips pieces that are too far away to matter.
            if (p - piece.ball.0).norm() - piece.ball.1 > d + piece.blend {
                continue;
            }
            let other = piece.distance(p);
            let share = if piece.blend > 0.0 { (1.0 - (d - other).abs() / piece.blend).max(0.0) } else { 0.0 };
            d = d.min(other) - share * share * piece.blend / 4.0;
        }
        d
    }

    pub(crate) fn parts(&self) -> Parts {
        self.0.iter().flat_map(Piece::parts).collect()
    }

    /// Bounds of the solid, a little wider.
    pub(crate) fn bounds(&self) -> (P3, P3) {
        let (low, high) = bounds(&self.parts());
        let rim = Vector3::repeat(0.002);
        (low - rim, high + rim)
    }
}

fn bounds(parts: &Parts) -> (P3, P3) {
    let first = parts.iter().flatten().next().copied().unwrap_or_default();
    parts.iter().flatten().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)))
}

fn rod(p: &P3, a: P3, b: P3) -> f64 {
    let (ab, ap) = (b - a, p - a);
    (ap - ab * (ap.dot(&ab) / ab.norm_squared()).clamp(0.0, 1.0)).norm()
}

/// Signed distance to a convex polygon, counter-clockwise.
fn polygon_distance(polygon: &[Point2<f64>], p: Point2<f64>) -> f64 {
    let (mut inside, mut outside) = (f64::MIN, f64::MAX);
    for (i, &a) in polygon.iter().enumerate() {
        let b = polygon[(i + 1) % polygon.len()];
        let side = b - a;
        inside = inside.max((p - a).perp(&side) / side.norm());
        outside = outside.min(to_segment(p, a, b));
    }
    if inside <= 0.0 { inside } else { outside }
}

/// The polygon with every side moved in by `depth`.
fn inset(polygon: &[Point2<f64>], depth: f64) -> Vec<Point2<f64>> {
    let n = polygon.len();
    let corner = |i: usize| {
        let (before, at, after) = (polygon[(i + n - 1) % n], polygon[i], polygon[(i + 1) % n]);
        let normal = |a: Point2<f64>, b: Point2<f64>| Vector2::new(a.y - b.y, b.x - a.x).normalize();
        let (n1, n2) = (normal(before, at), normal(at, after));
        at + (n1 + n2) * (depth / (1.0 + n1.dot(&n2)))
    };
    (0..n).map(corner).collect()
}

/// The outline with each corner replaced by the ends of its rounding.
fn broken_edges(outline: &[Rz], round: f64) -> Vec<Rz> {
    let last = outline.len() - 1;
    let mut line = Vec::new();
    for (i, p) in outline.iter().enumerate() {
        let before = if i == 0 { Rz::new(0.0, p.y) } else { outline[i - 1] };
        let after = if i == last { Rz::new(0.0, p.y) } else { outline[i + 1] };
        for other in [before, after] {
            let way = other - p;
            // Two thirds of the radius: the chamfer then runs half inside, half outside of the arc.
            line.push(p + way * (round * 0.67 / way.norm().max(1e-9)).min(0.5));
        }
    }
    line
}

/// The polygon cut into a grid of cells over its bounds.
fn cut(polygon: &[Point2<f64>], cells: [usize; 2]) -> Vec<Vec<Point2<f64>>> {
    let mut pieces = vec![polygon.to_vec()];
    for axis in 0..2 {
        let values = || polygon.iter().map(|p| p[axis]);
        let (low, high) = (values().fold(f64::MAX, f64::min), values().fold(f64::MIN, f64::max));
        let edge = |k: usize| low + (high - low) * k as f64 / cells[axis] as f64;
        let slab = |piece: &Vec<Point2<f64>>, k: usize| {
            let below = |p: &Point2<f64>| p[axis] - edge(k + 1);
            let above = |p: &Point2<f64>| edge(k) - p[axis];
            let lower = if k + 1 < cells[axis] { clip(piece, below) } else { piece.clone() };
            if k > 0 { clip(&lower, above) } else { lower }
        };
        pieces = pieces.iter().flat_map(|p| (0..cells[axis]).map(move |k| (p, k))).map(|(p, k)| slab(p, k)).collect();
        pieces.retain(|p| p.len() >= 3);
    }
    pieces
}

/// The side of a convex polygon where `height` is not positive.
fn clip(polygon: &[Point2<f64>], height: impl Fn(&Point2<f64>) -> f64) -> Vec<Point2<f64>> {
    let mut kept = Vec::new();
    for (i, a) in polygon.iter().enumerate() {
        let b = polygon[(i + 1) % polygon.len()];
        let (ha, hb) = (height(a), height(&b));
        if ha <= 0.0 {
            kept.push(*a);
        }
        if (ha < 0.0 && hb > 0.0) || (ha > 0.0 && hb < 0.0) {
            kept.push(a + (b - a) * (ha / (ha - hb)));
        }
    }
    kept
}

/// Points of a rounded plate over `cell`, a part of `core`.
fn prism_cloud(cell: &[Point2<f64>], core: &[Point2<f64>], half: f64, round: f64) -> Vec<P3> {
    let mut cloud = Vec::new();
    for p in cell {
        cloud.extend([-half, half].map(|z| Point3::new(p.x, p.y, z)));
        for (i, a) in core.iter().enumerate() {
            let b = core[(i + 1) % core.len()];
            // A corner of the cell on a side of the plate also represents the rounding of that side.
            if to_segment(*p, *a, b) < 1e-9 {
                let out = Vector2::new(b.y - a.y, a.x - b.x).normalize() * round;
                let z = half - round;
                cloud.extend([-z, z].map(|z| Point3::new(p.x + out.x, p.y + out.y, z)));
            }
        }
    }
    cloud
}

/// A rod with eight sides, two steps per part.
fn tube_parts(line: &[P3], radius: f64) -> Parts {
    let last = line.len() - 1;
    let closed = (line[0] - line[last]).norm() < 1e-9;
    let ring = |i: usize| {
        let before = if i > 0 {
            i - 1
        } else if closed {
            last - 1
        } else {
            0
        };
        let after = if i < last {
            i + 1
        } else if closed {
            1
        } else {
            last
        };
        let along = (line[after] - line[before]).normalize();
        let side = along.cross(&if along.z.abs() > 0.8 { Vector3::x() } else { Vector3::z() }).normalize();
        let up = along.cross(&side);
        // Half inside, half outside of the circle.
        let around = move |k: u32, share: f64| {
            let (sin, cos) = (TAU * f64::from(k) / 8.0).sin_cos();
            (side * cos + up * sin) * (radius * share * 1.04)
        };
        let mut cloud: Vec<P3> = (0..8).map(|k| line[i] + around(k, 1.0)).collect();
        if !closed && (i == 0 || i == last) {
            let out = if i == 0 { -along } else { along };
            cloud.extend((0..8).map(|k| line[i] + out * (0.75 * radius) + around(k, 0.68)));
            cloud.push(line[i] + out * radius);
        }
        cloud
    };
    let part = |i: usize| (i..=(i + 2).min(last)).flat_map(ring).collect();
    (0..last).step_by(2).map(part).collect()
}
