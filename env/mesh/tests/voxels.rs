//! Voxels against closed forms and a brute-force oracle; their options.
#![allow(clippy::unwrap_used)]

mod shapes;

use graspbox_mesh::{FillRule, TriMesh, VoxelFrame, VoxelGrid, VoxelMode, VoxelOptions, voxelize};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use shapes::{cuboid, cup, sphere, torus};
use std::f64::consts::PI;

fn solid(resolution: usize) -> VoxelOptions {
    VoxelOptions { resolution, ..VoxelOptions::default() }
}

fn surface(resolution: usize) -> VoxelOptions {
    VoxelOptions { mode: VoxelMode::Surface, ..solid(resolution) }
}

fn grid(mesh: &TriMesh, options: &VoxelOptions) -> VoxelGrid {
    voxelize(mesh, options).unwrap().0
}

/// A rotation that leaves nothing aligned with the grid.
fn skew(mesh: &TriMesh) -> TriMesh {
    let turn = UnitQuaternion::from_euler_angles(0.3, 0.7, 1.1);
    mesh.transformed(&Isometry3::from_parts(Translation3::new(0.2, -0.1, 0.4), turn))
}

fn difference(a: &VoxelGrid, b: &VoxelGrid) -> usize {
    a.flags().iter().zip(b.flags()).filter(|(a, b)| a != b).count()
}

/// The error of a sum over voxel centres falls faster than the voxel's size (1/N); 1.5 is the exponent of a smooth convex body.
#[test]
fn volumes_converge_to_their_closed_forms() {
    let ball = skew(&sphere(0.05, 300));
    let ring = skew(&torus(0.06, 0.02, 300));
    let cases = [(ball, 4.0 / 3.0 * PI * 0.05_f64.powi(3)), (ring, 2.0 * PI * PI * 0.06 * 0.02 * 0.02)];
    for (mesh, closed) in cases {
        let exact = mesh.signed_volume();
        assert!((exact / closed - 1.0).abs() < 1e-3);
        for (n, bound) in [(16, 0.03), (32, 0.01), (64, 0.004), (128, 0.0015)] {
            let (grid, rule) = voxelize(&mesh, &solid(n)).unwrap();
            assert_eq!(rule, Some(FillRule::Winding));
            let error = (grid.volume() / exact - 1.0).abs();
            println!("{n}: {error:.5}");
            assert!(error < bound, "{n}: {error}");
        }
    }
}

#[test]
fn a_box_in_grid_planes_has_exactly_its_voxels() {
    let mesh = cuboid(Vector3::new(0.08, 0.04, 0.02));
    let set = grid(&mesh, &solid(8));
    assert_eq!(set.count(), 8 * 4 * 2);
    assert!((set.volume() / mesh.signed_volume() - 1.0).abs() < 1e-12);
    // Through the centres of voxels: of the two faces, one is within.
    let slid = grid(&cuboid(Vector3::new(0.08, 0.05, 0.01)), &solid(8));
    assert_eq!(slid.count(), 8 * 5);
    // A face in a grid plane touches the voxels on both sides of it.
    let thick = cuboid(Vector3::new(0.08, 0.04, 0.04));
    assert_eq!(grid(&thick, &surface(8)).count(), 8 * 5 * 5 - 6 * 2 * 2);
}

#[test]
fn solids_know_cavities_and_overlaps() {
    let box_of = |size: f64, center: f64| {
        let at = Translation3::new(center, center, center).into();
        cuboid(Vector3::repeat(size)).transformed(&at)
    };
    let with = |other: &TriMesh, turned: bool| {
        let outer = box_of(0.16, 0.0);
        let faces = other.faces().iter().map(|f| f.map(|v| v + 8));
        let faces = faces.map(|[a, b, c]| if turned { [a, c, b] } else { [a, b, c] });
        let vertices = outer.vertices().iter().chain(other.vertices()).copied().collect();
        TriMesh::new(vertices, outer.faces().iter().copied().chain(faces).collect()).unwrap()
    };
    let count = |mesh: &TriMesh| grid(mesh, &solid(16)).count();
    assert_eq!(count(&with(&box_of(0.08, 0.0), true)), 16_usize.pow(3) - 8_usize.pow(3));
    assert_eq!(count(&with(&box_of(0.08, 0.0), false)), 16_usize.pow(3), "a box in a box is no cavity");
}

/// Removes or turns single faces: the rule reports it, and few voxels change.
#[test]
fn open_and_unoriented_meshes_are_filled_by_stated_rules() {
    let mesh = skew(&sphere(0.05, 40));
    let whole = grid(&mesh, &solid(32));
    let mut faces = mesh.faces().to_vec();
    let [a, b, c] = faces[700];
    faces[700] = [a, c, b];
    let turned = TriMesh::new(mesh.vertices().to_vec(), faces.clone()).unwrap();
    let (by_parity, rule) = voxelize(&turned, &solid(32)).unwrap();
    assert_eq!(rule, Some(FillRule::Parity));
    assert_eq!(by_parity, whole);
    faces.drain(700..740);
    let open = TriMesh::new(mesh.vertices().to_vec(), faces).unwrap();
    let (by_vote, rule) = voxelize(&open, &solid(32)).unwrap();
    assert_eq!(rule, Some(FillRule::Vote));
    assert!(difference(&by_vote, &whole) * 200 < whole.count());
    let lid_off = cuboid(Vector3::new(0.16, 0.16, 0.16));
    let top = |f: &usize| lid_off.triangle(*f).iter().all(|p| p.z > 0.0);
    let faces = (0..12).filter(|f| !top(f)).map(|f| lid_off.faces()[f]).collect();
    let open_box = TriMesh::new(lid_off.vertices().to_vec(), faces).unwrap();
    assert_eq!(grid(&open_box, &solid(16)).count(), 16_usize.pow(3), "five of six rays start inside");
    let sheet =
        TriMesh::new(vec![Point3::origin(), Point3::new(0.1, 0.0, 0.02), Point3::new(0.0, 0.1, 0.1)], vec![[0, 1, 2]])
            .unwrap();
    assert_eq!(grid(&sheet, &solid(16)).count(), 0);
    assert!(grid(&sheet, &surface(16)).count() > 50);
}

#[test]
fn exact_adds_the_surface_and_removal_leaves_a_shell() {
    for mesh in [skew(&torus(0.06, 0.02, 40)), skew(&cup(0.04, 0.1, 0.004, 40))] {
        let (fill, shell) = (grid(&mesh, &solid(48)), grid(&mesh, &surface(48)));
        let exact = grid(&mesh, &VoxelOptions { exact: true, ..solid(48) });
        let union = fill.flags().iter().zip(shell.flags()).map(|(a, b)| *a || *b);
        assert!(exact.flags().iter().copied().eq(union));
        let hollow = grid(&mesh, &VoxelOptions { exact: true, remove_internal: true, ..solid(48) });
        let interior = exact.count() - hollow.count();
        // Removed voxels are solid and off the surface, or wrapped in it.
        assert!(interior > 0);
        assert!(hollow.flags().iter().zip(exact.flags()).all(|(left, before)| *before || !left));
        // Voxels off the surface are on one side of it, with all their neighbours that are off it.
        let n = 48;
        for at in 0..exact.flags().len() - n * n {
            for other in [at + n * n, at + n, at + 1] {
                let inner = |i: usize| !shell.flags()[i];
                if other % n != 0 && other / n % n != 0 && inner(at) && inner(other) {
                    assert_eq!(fill.flags()[at], fill.flags()[other]);
                }
            }
        }
    }
}

#[test]
fn halving_keeps_the_cube_and_the_volume() {
    let mesh = skew(&sphere(0.05, 100));
    let whole = grid(&mesh, &solid(64));
    let half = grid(&mesh, &VoxelOptions { down: 1, ..solid(64) });
    let eighth = grid(&mesh, &VoxelOptions { down: 3, ..solid(64) });
    assert_eq!((half.frame().resolution(), eighth.frame().resolution()), (32, 8));
    assert_eq!((half.frame().origin(), half.frame().side()), (whole.frame().origin(), whole.frame().side()));
    assert!((half.volume() / whole.volume() - 1.0).abs() < 0.02);
    for i in 0..32 {
        let at = [i, 15, 31 - i];
        let parts = (0..8).filter(|p| {
            let part = [0, 1, 2].map(|k| 2 * at[k] + (p >> k & 1));
            whole.flags()[whole.frame().index(part)]
        });
        assert_eq!(half.flags()[half.frame().index(at)], parts.count() >= 4);
    }
    // The study's `-d 128 -down -ri -e`.
    let study = VoxelOptions { resolution: 128, mode: VoxelMode::Surface, down: 1, remove_internal: true, exact: true };
    let shell = grid(&mesh, &study);
    assert_eq!(shell.frame().resolution(), 64);
    assert!((0.7..1.5).contains(&(shell.volume() / (mesh.area() * shell.frame().voxel_size()))));
}

#[test]
fn impossible_options_are_refused() {
    let mesh = cuboid(Vector3::repeat(0.1));
    for (options, name) in [
        (solid(0), "resolution"),
        (solid(1025), "resolution"),
        (VoxelOptions { down: 2, ..solid(30) }, "down"),
        (VoxelOptions { down: 6, ..solid(32) }, "down"),
    ] {
        let error = voxelize(&mesh, &options).unwrap_err();
        assert!(error.to_string().trim_start_matches('`').starts_with(name), "{error}");
    }
    assert_eq!(grid(&mesh, &solid(1)).flags(), [true]);
    let point = TriMesh::new(vec![Point3::origin(); 3], vec![[0, 1, 2]]).unwrap();
    assert!(voxelize(&point, &solid(4)).is_err());
    assert!("hollow".parse::<VoxelMode>().unwrap_err().to_string().contains("solid or surface"));
    assert_eq!("surface".parse::<VoxelMode>().unwrap(), VoxelMode::Surface);
}

#[test]
fn voxels_know_where_they_are() {
    let frame = VoxelFrame::new(10, Point3::new(1.0, 2.0, 3.0), 0.5).unwrap();
    assert!((frame.center([0, 4, 9]) - Point3::new(1.025, 2.225, 3.475)).norm() < 1e-12);
    for at in [[0, 0, 0], [3, 4, 5], [9, 9, 9]] {
        assert_eq!(frame.voxel(&frame.center(at)), Some(at));
        assert_eq!(frame.index(at), 100 * at[0] + 10 * at[1] + at[2]);
    }
    assert_eq!(frame.voxel(&Point3::new(0.99, 2.1, 3.1)), None);
    assert_eq!(frame.voxel(&Point3::new(1.1, 2.1, f64::NAN)), None);
}

/// Whether a triangle and a box have a point in common, by cutting the triangle with the box' six planes.
fn clipped(triangle: [Point3<f64>; 3], center: &Point3<f64>, half: f64) -> bool {
    let mut polygon: Vec<Vector3<f64>> = triangle.iter().map(|p| p - center).collect();
    for (axis, side) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
        let depth = |p: &Vector3<f64>| half - side * p[axis];
        let mut cut = Vec::new();
        for (i, p) in polygon.iter().enumerate() {
            let q = &polygon[(i + 1) % polygon.len()];
            let (a, b) = (depth(p), depth(q));
            if a >= 0.0 {
                cut.push(*p);
            }
            if (a >= 0.0) != (b >= 0.0) {
                cut.push(p + (q - p) * (a / (a - b)));
            }
        }
        polygon = cut;
    }
    !polygon.is_empty()
}

/// How often the mesh turns around a point, from the solid angles of its faces (van Oosterom and Strackee, 1983).
fn winding(mesh: &TriMesh, p: &Point3<f64>) -> f64 {
    let angle = |face: usize| {
        let [a, b, c] = mesh.triangle(face).map(|q| q - p);
        let (x, y, z) = (a.norm(), b.norm(), c.norm());
        2.0 * a.dot(&b.cross(&c)).atan2(x * y * z + a.dot(&b) * z + b.dot(&c) * x + c.dot(&a) * y)
    };
    (0..mesh.faces().len()).map(angle).sum::<f64>() / (4.0 * PI)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// Each voxel is set where the solid angles add up to a turn, and touched where a cut triangle remains.
    #[test]
    fn voxels_agree_with_brute_force(
        angles in prop::array::uniform3(-3.0..3.0_f64),
        stretch in prop::array::uniform3(0.02..1.0_f64),
        which in 0..3_usize,
        n in 3..12_usize,
    ) {
        let mesh = [sphere(0.1, 8), torus(0.1, 0.04, 7), cup(0.1, 0.2, 0.03, 6)][which].clone();
        let stretched = mesh.vertices().iter().map(|p| Point3::from(p.coords.component_mul(&Vector3::from(stretch))));
        let turn = Rotation3::from_euler_angles(angles[0], angles[1], angles[2]);
        let mesh = TriMesh::new(stretched.map(|p| turn * p).collect(), mesh.faces().to_vec()).unwrap();
        let (fill, shell) = (grid(&mesh, &solid(n)), grid(&mesh, &surface(n)));
        let frame = fill.frame();
        let half = 0.5 * frame.voxel_size();
        for at in (0..n * n * n).map(|i| [i / n / n, i / n % n, i % n]) {
            let (center, i) = (frame.center(at), frame.index(at));
            let touches = |half: f64| (0..mesh.faces().len()).any(|f| clipped(mesh.triangle(f), &center, half));
            // Rounding decides within 1e-8 of a voxel.
            if touches(half * (1.0 - 1e-8)) {
                prop_assert!(shell.flags()[i]);
            } else if !touches(half * (1.0 + 1e-8)) {
                prop_assert!(!shell.flags()[i]);
            }
            if !touches(half * 1e-7) {
                prop_assert_eq!(fill.flags()[i], winding(&mesh, &center).abs() > 0.5);
            }
        }
    }

    /// Moving or scaling a mesh moves its grid, and nothing else, though boxes have faces in grid planes and through centres.
    #[test]
    fn grids_move_with_the_mesh(
        shift in prop::array::uniform3(-0.9..0.9_f64),
        scale in 0.01..50.0_f64,
        size in prop::array::uniform3(1..9_usize),
        n in 1..40_usize,
    ) {
        let size = Vector3::from(size.map(|x| 0.01 * x as f64));
        for mesh in [cuboid(size), torus(0.06, 0.02, 12)] {
            let moved = mesh.scaled(scale).transformed(&Translation3::from(Vector3::from(shift)).into());
            for options in [solid(n), surface(n), VoxelOptions { exact: true, remove_internal: true, ..solid(n) }] {
                let (a, b) = (grid(&mesh, &options), grid(&moved, &options));
                prop_assert_eq!(difference(&a, &b), 0);
                prop_assert!((b.frame().voxel_size() / a.frame().voxel_size() / scale - 1.0).abs() < 1e-9);
                let origin = a.frame().origin() * scale + Vector3::from(shift);
                prop_assert!((b.frame().origin() - origin).norm() < 1e-9);
            }
        }
    }
}
