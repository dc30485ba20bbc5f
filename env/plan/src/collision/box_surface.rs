//! A box against a triangle surface by separating axes, in the box's frame.

use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::partitioning::BvhNode;
use parry3d_f64::shape::TriMesh;

/// True if the box of half extents `half` at `surface_from_box` intersects a triangle of `surface`; touching counts.
pub(super) fn meets(half: Vector, surface_from_box: &Pose, surface: &TriMesh) -> bool {
    let turn = surface_from_box.rotation.inverse();
    let local = |p: Vector| turn * (p - surface_from_box.translation);
    // Columns: absolute values of the surface's axes in the box's frame.
    let axes = [Vector::X, Vector::Y, Vector::Z].map(|axis| (turn * axis).abs());
    let near = |node: &BvhNode| {
        let bounds = node.aabb();
        let reach = bounds.half_extents();
        let reach = axes[0] * reach.x + axes[1] * reach.y + axes[2] * reach.z + half;
        local(bounds.center()).abs().cmple(reach).all()
    };
    let mut leaves = surface.bvh().leaves(near);
    leaves.any(|leaf| {
        let triangle = surface.triangle(leaf);
        meets_triangle(half, [local(triangle.a), local(triangle.b), local(triangle.c)])
    })
}

/// True if the box |x| <= `half` intersects the triangle `corners`: none of 13 axes separates them.
fn meets_triangle(half: Vector, corners: [Vector; 3]) -> bool {
    let [a, b, c] = corners;
    let apart = a.min(b).min(c).cmpgt(half).any() || a.max(b).max(c).cmplt(-half).any();
    if apart {
        return false;
    }
    let edges = [b - a, c - b, a - c];
    let normal = edges[0].cross(edges[1]);
    if normal.dot(a).abs() > normal.abs().dot(half) {
        return false;
    }
    let separates = |axis: Vector| {
        let spans = corners.map(|p| axis.dot(p));
        let least = spans[0].min(spans[1]).min(spans[2]);
        let most = spans[0].max(spans[1]).max(spans[2]);
        let reach = axis.abs().dot(half);
        least > reach || most < -reach
    };
    !edges.into_iter().any(|e| [Vector::X, Vector::Y, Vector::Z].into_iter().any(|axis| separates(axis.cross(e))))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use parry3d_f64::math::Rotation;
    use parry3d_f64::query::intersection_test;
    use parry3d_f64::shape::Cuboid;
    use proptest::prelude::*;

    fn vector(range: std::ops::Range<f64>) -> impl Strategy<Value = Vector> {
        [range.clone(), range.clone(), range].prop_map(|p| Vector::new(p[0], p[1], p[2]))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// A bug here: a missing axis (false collisions), or one that separates intersecting shapes.
        #[test]
        fn agrees_with_the_collision_library(
            corners in [vector(-5.0..5.0), vector(-5.0..5.0), vector(-5.0..5.0)],
            half in vector(0.2..3.0),
            turn in vector(-3.0..3.0),
            shift in vector(-3.0..3.0),
        ) {
            let surface = TriMesh::new(corners.to_vec(), vec![[0, 1, 2]]).unwrap();
            let place = Pose::from_parts(shift, Rotation::from_scaled_axis(turn));
            let meets_grown = |by: f64| meets(half + Vector::splat(by), &place, &surface);
            let library = intersection_test(&place, &Cuboid::new(half), &Pose::IDENTITY, &surface.triangle(0))
                .unwrap()
                .intersecting;
            // Within rounding of touching, either result is right.
            if meets_grown(1e-3) == meets_grown(-1e-3) {
                prop_assert_eq!(meets_grown(0.0), library);
            }
        }
    }
}
