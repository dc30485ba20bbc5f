//! Mass properties, sampling and resting poses against closed forms.
#![allow(clippy::unwrap_used)]

mod shapes;

use graspbox_mesh::{
    Mass, MassMethod, RestingOptions, TriMesh, check_manifold, convex_hull, mass_properties, resting_poses,
    sample_surface,
};
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use shapes::{cuboid, sphere, torus};

fn assert_near(a: f64, b: f64, relative: f64) {
    assert!((a - b).abs() <= relative * b.abs(), "{a} is not within {relative} of {b}");
}

#[test]
fn box_has_its_closed_form() {
    let size = Vector3::new(0.1, 0.2, 0.3);
    let mesh = cuboid(size).transformed(&Isometry3::translation(5.0, -3.0, 2.0));
    check_manifold(&mesh).unwrap();
    let m = mass_properties(&mesh, Mass::Kilograms(2.0)).unwrap();
    assert_eq!(m.method, MassMethod::Closed);
    assert_near(m.volume, 0.006, 1e-12);
    assert!((m.center_of_mass - Point3::new(5.0, -3.0, 2.0)).norm() < 1e-12);
    let square = size.component_mul(&size);
    let expected = Vector3::new(square.y + square.z, square.x + square.z, square.x + square.y) * (2.0 / 12.0);
    assert!((m.inertia - Matrix3::from_diagonal(&expected)).norm() < 1e-12);
    let by_density = mass_properties(&mesh, Mass::Density(2.0 / 0.006)).unwrap();
    assert_near(by_density.mass, 2.0, 1e-12);
}

#[test]
fn sphere_and_torus_converge_to_their_closed_forms() {
    use std::f64::consts::PI;
    let ball = mass_properties(&sphere(0.05, 200), Mass::Density(1000.0)).unwrap();
    assert_near(ball.volume, 4.0 / 3.0 * PI * 0.05_f64.powi(3), 1e-3);
    assert_near(ball.inertia[(2, 2)], 0.4 * ball.mass * 0.05 * 0.05, 1e-3);
    let (big, small) = (0.06, 0.02);
    let ring = mass_properties(&torus(big, small, 200), Mass::Density(1000.0)).unwrap();
    assert_near(ring.volume, 2.0 * PI * PI * big * small * small, 1e-3);
    assert_near(ring.inertia[(2, 2)], ring.mass * (big * big + 0.75 * small * small), 1e-3);
    assert_near(ring.inertia[(0, 0)], ring.mass * (0.5 * big * big + 0.625 * small * small), 1e-3);
}

#[test]
fn an_open_mesh_says_that_winding_numbers_decide() {
    let closed = cuboid(Vector3::new(0.1, 0.1, 0.1));
    let open = graspbox_mesh::TriMesh::new(closed.vertices().to_vec(), closed.faces()[2..].to_vec()).unwrap();
    let m = mass_properties(&open, Mass::Kilograms(1.0)).unwrap();
    assert_eq!(m.method, MassMethod::WindingNumber);
    assert_near(m.volume, 1e-3, 0.02);
}

/// A box on a larger one, and the face that they share, which has no volume of its own: by rounding it was turned at one size and not
/// at another. Where it was, the mesh was no longer closed, and took a hundred times longer.
#[test]
fn a_face_that_solids_share_keeps_its_side() {
    let square = |half: f64, z: f64| [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]];
    let corners = [square(2.0, -1.0), square(2.0, 0.0), square(1.0, 0.0), square(1.0, 1.0)].concat();
    let mut faces: Vec<[u32; 3]> = vec![[0, 2, 1], [0, 3, 2], [12, 13, 14], [12, 14, 15]];
    // The sides of both boxes, and the ring around the small one.
    for (low, high) in [(0, 4), (4, 8), (8, 12)] {
        faces.extend((0..4).flat_map(|i| {
            let [a, b] = [i, (i + 1) % 4];
            [[low + a, low + b, high + b], [low + a, high + b, high + a]]
        }));
    }
    // The shared face from both sides, cut along its two diagonals.
    faces.extend([[8, 9, 10], [8, 10, 11], [8, 11, 9], [9, 11, 10]]);
    for step in 1..40 {
        let turn = UnitQuaternion::from_euler_angles(0.1 * f64::from(step), 0.7, 1.3);
        let points = corners.iter().map(|&p| turn * Point3::from(p) * (0.01 + 1e-4 * f64::from(step))).collect();
        let given = TriMesh::new(points, faces.clone()).unwrap();
        let (mesh, report) = graspbox_mesh::clean(&given, &graspbox_mesh::CleanOptions::default()).unwrap();
        assert_eq!(report.flipped_faces, 0, "{step}");
        let m = mass_properties(&mesh, Mass::Density(1.0)).unwrap();
        assert_eq!(m.method, MassMethod::Closed, "{step}");
        assert_near(m.volume, 20.0 * (0.01 + 1e-4 * f64::from(step)).powi(3), 1e-9);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Volume, principal moments and the centre of mass move with the mesh, to rounding.
    #[test]
    fn mass_properties_move_with_the_mesh(axis in prop::array::uniform3(-1.0..1.0_f64), shift in prop::array::uniform3(-1.0..1.0_f64)) {
        let mesh = torus(0.06, 0.02, 24);
        let pose = Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::from_scaled_axis(Vector3::from(axis) * 3.0));
        let before = mass_properties(&mesh, Mass::Kilograms(0.5)).unwrap();
        let after = mass_properties(&mesh.transformed(&pose), Mass::Kilograms(0.5)).unwrap();
        prop_assert!((after.volume / before.volume - 1.0).abs() < 1e-9);
        prop_assert!((after.center_of_mass - pose * before.center_of_mass).norm() < 1e-9 * mesh.extent());
        let r = pose.rotation.to_rotation_matrix();
        let expected = r * before.inertia * r.transpose();
        prop_assert!((after.inertia - expected).norm() < 1e-9 * expected.norm());
    }
}

#[test]
fn samples_lie_on_the_surface_and_are_uniform_by_area() {
    let mesh = cuboid(Vector3::new(0.1, 0.2, 0.4));
    let samples = sample_surface(&mesh, 10_000, 7);
    assert_eq!(samples.len(), 10_000);
    assert_eq!(samples, sample_surface(&mesh, 10_000, 7));
    assert_ne!(samples, sample_surface(&mesh, 10_000, 8));
    let area = mesh.area();
    for face in 0..mesh.faces().len() {
        let share = mesh.face_area_vector(face).norm() / area;
        let found = samples.iter().filter(|s| s.face == face as u32).count() as f64 / 10_000.0;
        assert!((found - share).abs() < 2e-4, "face {face}: {found} of the samples, {share} of the area");
    }
    for s in &samples {
        let [a, ..] = mesh.triangle(s.face as usize);
        assert!((s.point - a).dot(&s.normal).abs() < 1e-12);
    }
}

#[test]
fn a_box_rests_on_its_six_sides_as_often_as_it_sees_them() {
    let mesh = cuboid(Vector3::new(0.1, 0.1, 0.1));
    let poses = resting_poses(&mesh, &Point3::origin(), &RestingOptions::default()).unwrap();
    assert_eq!(poses.len(), 6);
    for pose in &poses {
        assert_near(pose.probability, 1.0 / 6.0, 1e-9);
        assert_near(pose.margin, 0.05, 1e-9);
        let placed = mesh.transformed(&pose.world_from_object).aabb();
        assert!(placed.min.z.abs() < 1e-12 && (placed.min.x + placed.max.x).abs() < 1e-12);
        assert!((pose.world_from_object * pose.face_normal + Vector3::z()).norm() < 1e-9);
    }
    // A weight near one side: the opposite side is reached less often, and the four others tip over.
    let low = resting_poses(&mesh, &Point3::new(0.0, 0.0, -0.04), &RestingOptions::default()).unwrap();
    assert!(low[0].face_normal.z < -0.99 && low[0].probability > 0.4);
    assert_near(low.iter().map(|p| p.probability).sum(), 1.0, 1e-9);
    assert!(resting_poses(&mesh, &Point3::new(0.0, 0.0, 0.2), &RestingOptions::default()).is_err());
}

/// Hulls are computed in single precision: a corner in the middle of an edge leaves a face without width, which may look anywhere.
#[test]
fn a_sliver_of_the_hull_is_ignored() {
    let cube = cuboid(Vector3::new(0.1, 0.1, 0.1));
    let corners = cube.vertices();
    let [a, b, c] = cube.faces()[0];
    let (start, end) = (corners[a as usize], corners[b as usize]);
    let (middle, inward) = (nalgebra::center(&start, &end), (Point3::origin() - nalgebra::center(&start, &end)));
    for width in [1e-8, 1e-6, 1e-5] {
        let vertices: Vec<_> = corners.iter().copied().chain([middle + inward.normalize() * width]).collect();
        let new = corners.len() as u32;
        let faces = [[a, b, new], [a, new, c], [new, b, c]].into_iter().chain(cube.faces()[1..].iter().copied());
        let hull = TriMesh::new(vertices, faces.collect()).unwrap();
        for com in [Point3::new(0.0, 0.0, 0.0), Point3::new(0.03, 0.01, -0.02), Point3::new(-0.03, -0.02, 0.01)] {
            let [expected, found] =
                [&cube, &hull].map(|hull| resting_poses(hull, &com, &RestingOptions::default()).unwrap());
            assert_eq!(found.len(), expected.len());
            for (found, expected) in found.iter().zip(&expected) {
                assert!((found.probability - expected.probability).abs() < 1e-3, "{width}: {found:?} {expected:?}");
            }
        }
    }
}

#[test]
fn hulls_refuse_flat_points_and_close_over_solids() {
    let line: Vec<_> = (0..50).map(|i| Point3::new(f64::from(i) * 0.01, 0.02, 0.0)).collect();
    let plane: Vec<_> = (0..50).map(|i| Point3::new(f64::from(i % 7) * 0.01, f64::from(i / 7) * 0.013, 0.5)).collect();
    for points in [&line[..0], &line[..1], &line[..3], &line, &plane] {
        assert!(convex_hull(points).is_err());
    }
    let far: Vec<_> = sphere(0.05, 20).vertices().iter().map(|p| p + Vector3::new(300.0, -20.0, 7.0)).collect();
    let hull = convex_hull(&far).unwrap();
    check_manifold(&hull).unwrap();
    assert_near(hull.signed_volume(), sphere(0.05, 20).signed_volume(), 1e-4);
}

/// Cut faces and modelled objects give many coplanar, collinear and nearly equal points; none may end up outside.
#[test]
fn hulls_of_coplanar_and_repeated_points_leave_nothing_outside() {
    let grid = |n: i32, f: &dyn Fn(f64, f64) -> Point3<f64>| -> Vec<Point3<f64>> {
        (0..n * n).map(|k| f(f64::from(k / n) / f64::from(n - 1), f64::from(k % n) / f64::from(n - 1))).collect()
    };
    let mut block = Vec::new();
    for side in [0.0, 1.0] {
        block.extend(grid(12, &|u, v| Point3::new(u, v, side)));
        block.extend(grid(12, &|u, v| Point3::new(u, side, v)));
        block.extend(grid(12, &|u, v| Point3::new(side, u, v)));
    }
    block.extend(block.clone().iter().map(|p| p + Vector3::repeat(1e-12)));
    let half_cup: Vec<_> =
        shapes::cup(0.035, 0.07, 0.003, 48).vertices().iter().filter(|p| p.x >= -1e-12).copied().collect();
    let ball = sphere(0.037, 64).vertices().to_vec();
    for points in [block, half_cup, ball] {
        let hull = convex_hull(&points).unwrap();
        check_manifold(&hull).unwrap();
        let tolerance = 1e-4 * hull.extent();
        for f in 0..hull.faces().len() {
            let area = hull.face_area_vector(f);
            if area.norm() > 1e-4 * hull.extent().powi(2) {
                let [a, ..] = hull.triangle(f);
                assert!(points.iter().all(|p| (p - a).dot(&area.normalize()) < tolerance));
            }
        }
    }
}
