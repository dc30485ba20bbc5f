//! A tree of triangles by place: the winding number of a point, and the triangles near a box.
//!
//! Triangles far from a point count together, as one dipole: Barill, Dickson, Schmidt, Levin, Jacobson, "Fast winding numbers for soups
//! and clouds", SIGGRAPH 2018. Winding numbers of meshes with holes: Jacobson, Kavan, Sorkine-Hornung, "Robust inside-outside
//! segmentation using generalized winding numbers", SIGGRAPH 2013.
//!
//! Own code: parry's trees hold f32 in this project, and have no winding numbers.

use crate::trimesh::Aabb;
use nalgebra::{Point3, Vector3};
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// Triangles of a leaf.
const LEAF: usize = 4;
/// A node farther away than this many of its radii counts as one dipole: winding numbers are right to about 0.01.
const FAR: f64 = 2.0;

/// A triangle by its corners.
pub(crate) type Triangle = [Point3<f64>; 3];

/// Triangles, sorted into nested boxes.
pub(crate) struct FaceTree {
    triangles: Vec<Triangle>,
    nodes: Vec<Node>,
}

struct Node {
    bounds: Aabb,
    /// Mean of the triangles, weighted by their areas.
    center: Point3<f64>,
    /// Greatest distance of a corner from the centre, metres.
    radius: f64,
    /// Sum of the normals times areas, m2.
    area: Vector3<f64>,
    /// The triangles of a leaf; of an inner node, its two children.
    content: Content,
}

enum Content {
    Leaf(Range<usize>),
    Inner([usize; 2]),
}

impl FaceTree {
    /// Sorts triangles.
    pub fn new(mut triangles: Vec<Triangle>) -> Self {
        let mut nodes = Vec::with_capacity(triangles.len() / 2 + 1);
        if !triangles.is_empty() {
            let all = 0..triangles.len();
            build(&mut triangles, all, &mut nodes);
        }
        Self { triangles, nodes }
    }

    /// How often the triangles wind around `p`: a whole number where they form closed surfaces, positive inside outward ones.
    pub fn winding(&self, p: &Point3<f64>) -> f64 {
        let mut sum = 0.0;
        let mut stack = self.root();
        while let Some(node) = stack.pop() {
            let Node { center, radius, area, content, .. } = &self.nodes[node];
            let d = center - p;
            let distance = d.norm();
            match content {
                _ if distance > FAR * radius => sum += d.dot(area) / distance.powi(3),
                Content::Leaf(range) => {
                    sum += self.triangles[range.clone()].iter().map(|t| solid_angle(p, t)).sum::<f64>()
                }
                Content::Inner(children) => stack.extend(children),
            }
        }
        sum / (4.0 * PI)
    }

    /// Whether `accept` holds for any triangle whose bounds touch `bounds`.
    pub fn any_touching(&self, bounds: &Aabb, mut accept: impl FnMut(&Triangle) -> bool) -> bool {
        let mut stack = self.root();
        while let Some(node) = stack.pop() {
            let node = &self.nodes[node];
            if !node.bounds.touches(bounds) {
                continue;
            }
            match &node.content {
                Content::Leaf(range) => {
                    let touching = |t: &&Triangle| Aabb::of(t.iter()).touches(bounds);
                    if self.triangles[range.clone()].iter().filter(touching).any(&mut accept) {
                        return true;
                    }
                }
                Content::Inner(children) => stack.extend(children),
            }
        }
        false
    }

    fn root(&self) -> Vec<usize> {
        self.nodes.len().checked_sub(1).into_iter().collect()
    }
}

/// Makes the node of `range` behind those below it; returns its index.
fn build(triangles: &mut [Triangle], range: Range<usize>, nodes: &mut Vec<Node>) -> usize {
    let content = if range.len() <= LEAF {
        Content::Leaf(range.clone())
    } else {
        let middle = range.start + range.len() / 2;
        let bounds = Aabb::of(&triangles[range.clone()].iter().map(middle_of).collect::<Vec<_>>());
        let axis = (bounds.max - bounds.min).imax();
        triangles[range.clone()]
            .select_nth_unstable_by(range.len() / 2, |a, b| middle_of(a)[axis].total_cmp(&middle_of(b)[axis]));
        let low = build(triangles, range.start..middle, nodes);
        Content::Inner([low, build(triangles, middle..range.end, nodes)])
    };
    let own = &triangles[range];
    let bounds = Aabb::of(own.iter().flatten());
    let (mut area, mut total, mut weighted) = (Vector3::zeros(), 0.0, Vector3::zeros());
    for triangle in own {
        let normal = area_vector(triangle);
        area += normal;
        total += normal.norm();
        weighted += (middle_of(triangle) - bounds.min) * normal.norm();
    }
    let center = if total > 0.0 { bounds.min + weighted / total } else { bounds.min };
    let radius = own.iter().flatten().map(|p| (p - center).norm()).fold(0.0, f64::max);
    nodes.push(Node { bounds, center, radius, area, content });
    nodes.len() - 1
}

fn middle_of(triangle: &Triangle) -> Point3<f64> {
    Point3::from(triangle.iter().map(|p| p.coords).sum::<Vector3<f64>>() / 3.0)
}

fn area_vector([a, b, c]: &Triangle) -> Vector3<f64> {
    (b - a).cross(&(c - a)) * 0.5
}

/// Solid angle of a triangle seen from `p`, in (-2 pi, 2 pi); positive from behind it. 0 from within its plane.
///
/// Van Oosterom and Strackee, "The solid angle of a plane triangle", 1983.
fn solid_angle(p: &Point3<f64>, triangle: &Triangle) -> f64 {
    let [a, b, c] = triangle.map(|corner| corner - p);
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let volume = a.dot(&b.cross(&c));
    let angle = 2.0 * volume.atan2(la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb);
    // From within the triangle itself atan2 gives a half turn of either sign.
    if volume == 0.0 || angle.abs() >= TAU { 0.0 } else { angle }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The faces of a box from -1 to 1, outward.
    fn cube() -> Vec<Triangle> {
        let corner = |i: u32| Point3::from([0, 1, 2].map(|bit| f64::from((i >> bit) & 1) * 2.0 - 1.0));
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).map(|face| face.map(corner)).collect()
    }

    /// Inside 1, outside 0, and at the middle of an open box the share of the sphere that its sides cover.
    #[test]
    fn winding_numbers_have_their_closed_forms() {
        let closed = FaceTree::new(cube());
        for (p, expected) in
            [([0.1, -0.2, 0.3], 1.0), ([0.9, 0.9, 0.9], 1.0), ([1.2, 0.0, 0.0], 0.0), ([9.0, 1.0, 2.0], 0.0)]
        {
            assert!((closed.winding(&Point3::from(p)) - expected).abs() < 0.01, "{p:?}");
        }
        let open = FaceTree::new(cube()[2..].to_vec());
        assert!((open.winding(&Point3::origin()) - 5.0 / 6.0).abs() < 1e-9);
    }

    /// A far box touches no triangle; a near one touches those around it.
    #[test]
    fn boxes_find_what_touches_them() {
        let tree = FaceTree::new(cube());
        let count = |low: [f64; 3], high: [f64; 3]| {
            let mut found = 0;
            tree.any_touching(&Aabb { min: low.into(), max: high.into() }, |_| {
                found += 1;
                false
            });
            found
        };
        assert_eq!(count([-0.5; 3], [0.5; 3]), 0);
        assert_eq!(count([0.5, -0.1, -0.1], [1.5, 0.1, 0.1]), 2);
        assert_eq!(count([-2.0; 3], [2.0; 3]), 12);
    }
}
