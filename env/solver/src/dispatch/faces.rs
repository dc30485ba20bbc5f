//! Contact points between whole flat faces.
//!
//! Parry describes the face of a convex polyhedron by at most four of its corners, and these are neighbours. Of a face with 16 corners (the
//! bottom of a cup) that leaves a sliver next to the rim: what touches the face elsewhere gets a single contact point, and rocks on it. Here the
//! two faces are clipped with all their corners.
//!
//! Parry also joins triangles that lean from each other by up to 1.5 degrees, so a face of a scanned object may bulge by some tenths of a
//! millimetre. Heights on a face are therefore interpolated between its corners: exact on its sides, and elsewhere never outside of the solid.

use parry3d::math::{Pose, Real, Vector};
use parry3d::query::{ContactManifold, TrackedContact};
use parry3d::shape::{ConvexPolyhedron, PackedFeatureId, Shape};
use std::f32::consts::TAU;

/// Corners of a face that parry keeps: faces with at most this many are left to it.
const KEPT_BY_PARRY: usize = 4;

/// Corners of the polygon that stands for the flat end of a cylinder.
const CAP_CORNERS: u8 = 16;

/// Polygons whose area, seen along the contact's normal, is smaller than this are edges: parry's area, 0.01 mm2.
const LEAST_AREA: Real = 1e-4;

/// Axes of a contact: two in its plane, and its normal from the first to the second shape.
struct Axes([Vector; 3]);

impl Axes {
    fn new(normal: Vector) -> Self {
        let (x, y) = normal.any_orthonormal_pair();
        Self([x, y, normal])
    }

    fn seen(&self, point: Vector) -> Vector {
        Vector::from_array(self.0.map(|axis| axis.dot(point)))
    }

    fn point(&self, seen: Vector) -> Vector {
        self.0[0] * seen.x + self.0[1] * seen.y + self.0[2] * seen.z
    }
}

/// A face, or an edge: its corners seen along the normal of a contact, counter-clockwise and convex; z is the height along the normal.
struct Face(Vec<Vector>);

impl Face {
    fn new(corners: impl IntoIterator<Item = Vector>, axes: &Axes) -> Self {
        let mut corners: Vec<Vector> = corners.into_iter().map(|corner| axes.seen(corner)).collect();
        if corners.len() > 2 && twice_area(&corners) < 0.0 {
            corners.reverse();
        }
        if turns(&corners).any(|turn| turn < 0.0) {
            corners = convex(corners);
        }
        Self(corners)
    }

    fn is_polygon(&self) -> bool {
        self.0.len() > 2 && twice_area(&self.0) > 2.0 * LEAST_AREA
    }

    /// Corners of the intersection of two faces, seen along the normal; `self` is a polygon.
    fn clip(&self, other: &Self) -> Vec<Vector> {
        let mut corners = other.0.clone();
        for (from, to) in sides(&self.0) {
            let depth = |p: Vector| cross(to - from, p - from);
            let mut kept = Vec::with_capacity(corners.len() + 1);
            for (one, next) in sides(&corners) {
                let (a, b) = (depth(one), depth(next));
                if a >= 0.0 {
                    kept.push(one);
                }
                if (a < 0.0) != (b < 0.0) {
                    kept.push(one + (next - one) * (a / (a - b)));
                }
            }
            corners = kept;
        }
        corners
    }

    /// Height of the face at a point, which it covers or nearly covers, seen along the normal.
    fn height(&self, at: Vector) -> Real {
        let corners = &self.0;
        let first = corners[0];
        if !self.is_polygon() {
            let along = corners[1] - first;
            let (x, y) = (along.x, along.y);
            let share = ((at.x - first.x) * x + (at.y - first.y) * y) / (x * x + y * y).max(Real::MIN_POSITIVE);
            return first.z + share.clamp(0.0, 1.0) * along.z;
        }
        // The triangle of the first corner and a side that holds the point; the last one if rounding puts it outside.
        let last = corners.len() - 2;
        let holds = |i: &usize| cross(corners[i + 1] - first, at - first) <= 0.0;
        let i = (1..last).find(holds).unwrap_or(last);
        let (one, two) = (corners[i] - first, corners[i + 1] - first);
        let area = cross(one, two);
        if area <= Real::EPSILON {
            return first.z.min(corners[i].z);
        }
        let (a, b) = (cross(at - first, two) / area, cross(one, at - first) / area);
        first.z + a * one.z + b * two.z
    }
}

/// Corners of the face or edge of a shape that faces along `dir`; none for round shapes.
fn corners_toward(shape: &dyn Shape, dir: Vector) -> Vec<Vector> {
    if let Some(part) = shape.as_convex_polyhedron() {
        return face_of_part(part, dir).iter().map(|i| part.points()[*i as usize]).collect();
    }
    if let Some(solid) = shape.as_cuboid() {
        return solid.support_face(dir).vertices.to_vec();
    }
    let Some(round) = shape.as_cylinder() else { return Vec::new() };
    let (radius, half) = (round.radius, round.half_height);
    if is_side(dir) {
        let out = Vector::new(dir.x, 0.0, dir.z).normalize_or_zero() * radius;
        return vec![out - Vector::Y * half, out + Vector::Y * half];
    }
    let corner = |i: u8| {
        let (sin, cos) = (TAU * Real::from(i) / Real::from(CAP_CORNERS)).sin_cos();
        Vector::new(radius * cos, half.copysign(dir.y), radius * sin)
    };
    (0..CAP_CORNERS).map(corner).collect()
}

/// Indices of the corners of a part's face that faces along `dir`.
fn face_of_part(part: &ConvexPolyhedron, dir: Vector) -> &[u32] {
    let mut best = &part.faces()[0];
    for face in &part.faces()[1..] {
        if face.normal.dot(dir) > best.normal.dot(dir) {
            best = face;
        }
    }
    let first = best.first_vertex_or_edge as usize;
    &part.vertices_adj_to_face()[first..first + best.num_vertices_or_edges as usize]
}

/// Whether parry drops corners of the shape's face along `dir`: of the round end of a cylinder it keeps a square.
fn is_cut_short(shape: &dyn Shape, dir: Vector) -> bool {
    let many = |part: &ConvexPolyhedron| face_of_part(part, dir).len() > KEPT_BY_PARRY;
    shape.as_convex_polyhedron().is_some_and(many) || (shape.as_cylinder().is_some() && !is_side(dir))
}

/// Whether a cylinder touches with its side along a direction in its frame: within 60 degrees, as in parry.
fn is_side(dir: Vector) -> bool {
    dir.y.abs() < 0.5
}

fn cross(a: Vector, b: Vector) -> Real {
    a.x * b.y - a.y * b.x
}

/// The sides of a closed polygon.
fn sides(corners: &[Vector]) -> impl Iterator<Item = (Vector, Vector)> {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

/// Twice the area of a polygon, seen along the normal; negative if it is clockwise.
fn twice_area(corners: &[Vector]) -> Real {
    sides(corners).map(|(one, next)| cross(one - corners[0], next - corners[0])).sum()
}

/// The turn at every corner: negative to the right.
fn turns(corners: &[Vector]) -> impl Iterator<Item = Real> {
    sides(corners).zip(corners.iter().copied().cycle().skip(2)).map(|((a, b), c)| cross(b - a, c - b))
}

/// The corners around the convex hull, counter-clockwise (Andrew's monotone chain). Where triangles that are not quite flat are joined to a
/// face, its outline may have dents.
fn convex(mut corners: Vec<Vector>) -> Vec<Vector> {
    corners.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let mut around: Vec<Vector> = Vec::with_capacity(corners.len() + 1);
    for half in 0..2 {
        let start = around.len();
        for corner in &corners {
            while around.len() >= start + 2
                && cross(around[around.len() - 1] - around[around.len() - 2], *corner - around[around.len() - 1]) <= 0.0
            {
                around.pop();
            }
            around.push(*corner);
        }
        around.pop();
        if half == 0 {
            corners.reverse();
        }
    }
    around
}

/// Replaces the points of a manifold by those of whole faces and returns true, if parry has dropped corners of one, or in any case. The deepest
/// point of the two shapes, the last one that parry adds, stays.
pub(super) fn complete<M, C: Default + Copy>(
    pos12: &Pose,
    g1: &dyn Shape,
    g2: &dyn Shape,
    manifold: &mut ContactManifold<M, C>,
    in_any_case: bool,
) -> bool {
    let (normal1, normal2) = (manifold.local_n1, manifold.local_n2);
    let Some(deepest) = manifold.points.last().copied() else { return false };
    if !in_any_case && !is_cut_short(g1, normal1) && !is_cut_short(g2, normal2) {
        return false;
    }
    let axes = Axes::new(normal1);
    let one = Face::new(corners_toward(g1, normal1), &axes);
    let two = Face::new(corners_toward(g2, normal2).into_iter().map(|corner| *pos12 * corner), &axes);
    let common = match (one.is_polygon(), two.is_polygon()) {
        _ if one.0.len() < 2 || two.0.len() < 2 => return false,
        (true, _) => one.clip(&two),
        (false, true) => two.clip(&one),
        (false, false) => return false,
    };
    manifold.points.clear();
    for at in common {
        let heights = [one.height(at), two.height(at)];
        let [p1, p2] = heights.map(|height| axes.point(Vector::new(at.x, at.y, height)));
        let (on_2, unknown) = (pos12.inverse_transform_point(p2), PackedFeatureId::UNKNOWN);
        manifold.points.push(TrackedContact::new(p1, on_2, unknown, unknown, heights[1] - heights[0]));
    }
    manifold.points.push(deepest);
    true
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::Dispatcher;
    use super::*;
    use parry3d::math::Rotation;
    use parry3d::query::PersistentQueryDispatcher;
    use parry3d::shape::{Cuboid, Cylinder, SharedShape};

    const RADIUS: Real = 2.5;
    const HALF: Real = 1.0;
    /// Overlap of the faces in the tests, parry's lengths.
    const DEPTH: Real = 0.01;

    /// A prism with `n` sides around y.
    fn prism(n: u32) -> SharedShape {
        let corner = |i: u32, y| {
            let angle = TAU * (i as Real + 0.3) / n as Real;
            Vector::new(RADIUS * angle.cos(), y, RADIUS * angle.sin())
        };
        let points: Vec<_> = (0..n).map(|i| corner(i, -HALF)).chain((0..n).map(|i| corner(i, HALF))).collect();
        let side = |i: u32| {
            let j = (i + 1) % n;
            [[j, i, n + i], [n + i, n + j, j]]
        };
        let ends = |i: u32| [[0, i, i + 1], [n, n + i + 1, n + i]];
        let faces = (0..n).flat_map(side).chain((1..n - 1).flat_map(ends)).collect::<Vec<_>>();
        SharedShape::convex_mesh(points, &faces).unwrap()
    }

    /// Points where the lower end of `upper`, placed by `pose`, lies on the upper end of `lower`: on a grid of 0.1.
    fn shared(lower: &SharedShape, upper: &SharedShape, pose: &Pose) -> Vec<Vector> {
        let grid = (-60..=60).flat_map(|i| (-60..=60).map(move |k| (i as Real * 0.1, k as Real * 0.1)));
        let inside = |shape: &SharedShape, p: Vector, pose: &Pose| shape.contains_point(pose, p);
        grid.map(|(x, z)| Vector::new(x, HALF - DEPTH / 2.0, z))
            .filter(|p| inside(lower, *p, &Pose::IDENTITY) && inside(upper, *p, pose))
            .collect()
    }

    fn contacts(one: &SharedShape, two: &SharedShape, pose: &Pose) -> ContactManifold<(), ()> {
        let mut manifold = ContactManifold::new();
        Dispatcher::default()
            .contact_manifold_convex_convex(pose, &**one, &**two, None, None, 0.1, &mut manifold)
            .unwrap();
        manifold
    }

    /// The contact points span all that two faces share, and nothing else.
    #[test]
    fn contact_points_span_what_two_faces_share() {
        let others = [
            (SharedShape::new(Cuboid::new(Vector::new(0.9, HALF, 1.1))), 0.02),
            (SharedShape::new(Cylinder::new(HALF, 0.8)), 0.08),
            (prism(5), 0.02),
            (prism(32), 0.02),
        ];
        for n in [3, 4, 5, 8, 16, 64] {
            let lower = prism(n);
            for (upper, tolerance) in &others {
                for (x, z, turn) in [(0.0, 0.0, 0.0), (1.0, 0.2, 0.7), (-0.4, -1.3, 2.0), (-1.5, 0.9, 4.0)] {
                    let pose = Pose::from_parts(
                        Vector::new(x, 2.0 * HALF - DEPTH, z),
                        Rotation::from_scaled_axis(Vector::Y * turn),
                    );
                    let common = shared(&lower, upper, &pose);
                    for flip in [false, true] {
                        let found = if flip {
                            contacts(upper, &lower, &pose.inverse())
                        } else {
                            contacts(&lower, upper, &pose)
                        };
                        let points: Vec<Vector> = found
                            .points
                            .iter()
                            .map(|point| if flip { point.local_p2 } else { point.local_p1 })
                            .collect();
                        for point in &found.points {
                            assert!((point.dist + DEPTH).abs() < 1e-4, "{n}: {}", point.dist);
                        }
                        for i in 0..24_u8 {
                            let (sin, cos) = (TAU * Real::from(i) / 24.0).sin_cos();
                            let out = Vector::new(cos, 0.0, sin);
                            let most = |points: &[Vector]| points.iter().map(|p| p.dot(out)).fold(Real::MIN, Real::max);
                            let (reached, truth) = (most(&points), most(&common));
                            assert!(
                                reached > truth - tolerance && reached < truth + 0.15,
                                "{n} sides, {x} {z}, flip {flip}: {reached} for {truth}"
                            );
                        }
                    }
                }
            }
        }
    }

    /// A cylinder that lies on a face touches it along a line, over the whole face.
    #[test]
    fn a_lying_cylinder_touches_a_face_from_end_to_end() {
        let (lower, roll) = (prism(16), SharedShape::new(Cylinder::new(6.0, 0.8)));
        let lie = Rotation::from_scaled_axis(Vector::X * (TAU / 4.0));
        let pose = Pose::from_parts(Vector::new(0.3, HALF + 0.8 - DEPTH, 0.0), lie);
        let found = contacts(&lower, &roll, &pose);
        let along = found.points.iter().map(|point| point.local_p1.z);
        let (least, most) = along.fold((Real::MAX, Real::MIN), |(a, b), z| (a.min(z), b.max(z)));
        assert!(least < -2.3 && most > 2.3, "{least} to {most}");
        assert!(found.points.iter().all(|point| (point.dist + DEPTH).abs() < 1e-3));
    }

    /// Triangles that lean from each other by less than 1.5 degrees count as one face; its points stay on the solid, or within it.
    #[test]
    fn points_on_a_bulging_face_are_not_outside() {
        let bulge = |x: Real, z: Real| Vector::new(x, HALF - 0.004 * (x * x + z * z), z);
        let grid = (-3..=3_i8).flat_map(|i| (-3..=3_i8).map(move |k| (Real::from(i), Real::from(k))));
        let points: Vec<Vector> = grid.flat_map(|(x, z)| [bulge(x, z), Vector::new(x, -HALF, z)]).collect();
        let solid = SharedShape::convex_hull(&points).unwrap();
        let part = solid.as_convex_polyhedron().unwrap();
        assert!(face_of_part(part, Vector::Y).len() > 4, "nothing is joined");
        let pad = SharedShape::new(Cuboid::new(Vector::new(0.8, 0.5, 1.1)));
        let mut total = 0;
        for (x, z) in [(0.0, 0.0), (1.3, 0.4), (-0.9, 1.7), (2.6, -2.6)] {
            let under = bulge(x, z).y;
            let pose = Pose::from_parts(Vector::new(x, under + 0.5, z), Rotation::from_scaled_axis(Vector::Y * 0.4));
            let found = contacts(&solid, &pad, &pose);
            total += found.points.len();
            for point in &found.points {
                let outside = solid.distance_to_local_point(point.local_p1, true);
                assert!(outside < 2e-4, "{outside} outside at {x}, {z}");
                let across = pose.transform_point(point.local_p2) - point.local_p1;
                assert!((across.dot(found.local_n1) - point.dist).abs() < 1e-4);
            }
        }
        assert!(total > 12, "only {total} contacts");
    }
}
