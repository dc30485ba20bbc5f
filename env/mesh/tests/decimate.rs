//! Decimation keeps surfaces closed and near; cleaning repairs the faults that it reports.
#![allow(clippy::unwrap_used)]

mod shapes;

use graspbox_mesh::{
    CleanOptions, Defect, TriMesh, check_manifold, check_watertight, clean, decimate, decimate_levels, hausdorff, load,
};
use nalgebra::{Point3, Vector3};
use proptest::prelude::*;
use shapes::{cuboid, cup, sphere, torus};

#[test]
fn flat_sides_cost_nothing() {
    // A cube of 6 x 2 x 16 x 16 faces is again a cube of 12.
    let ball = cuboid(Vector3::new(0.1, 0.1, 0.1));
    let mut fine = ball;
    for _ in 0..4 {
        fine = halve(&fine);
    }
    check_manifold(&fine).unwrap();
    let small = decimate(&fine, 12).unwrap();
    check_manifold(&small.mesh).unwrap();
    assert_eq!(small.mesh.faces().len(), 12);
    assert!(small.hausdorff.max < 1e-6, "{:?}", small.hausdorff);
    assert!((small.mesh.signed_volume() - 1e-3).abs() < 1e-9);
}

#[test]
fn round_shapes_stay_near() {
    for (mesh, target, bound) in [(sphere(0.05, 128), 1000, 3e-4), (torus(0.06, 0.02, 80), 2000, 4e-4)] {
        let small = decimate(&mesh, target).unwrap();
        check_manifold(&small.mesh).unwrap();
        assert!(small.mesh.faces().len() <= target && small.mesh.faces().len() + 2 >= target);
        assert!(small.hausdorff.max < bound && small.hausdorff.max > 0.0, "{:?}", small.hausdorff);
    }
}

#[test]
fn the_distance_is_that_of_the_farther_side() {
    let (big, small) = (sphere(0.05, 64), sphere(0.04, 64));
    let d = hausdorff(&big, &small, 5000).unwrap();
    assert!((d.max - 0.01).abs() < 2e-4 && (d.mean - 0.01).abs() < 2e-4);
    assert!(decimate(&big, 3).is_err());
    assert_eq!(decimate(&big, 1 << 20).unwrap().mesh, big);
}

#[test]
fn levels_fall_in_faces_and_are_measured_against_the_original() {
    let fine = torus(0.06, 0.02, 80);
    let targets = [1 << 20, 3000, 800, 200, 60];
    let levels = decimate_levels(&fine, &targets, None).unwrap();
    assert_eq!(levels.len(), 4);
    for (level, target) in levels.iter().zip(&targets[1..]) {
        check_manifold(&level.mesh).unwrap();
        assert!(level.mesh.faces().len() <= *target && level.mesh.faces().len() + 2 >= *target);
        assert_eq!(level.hausdorff, hausdorff(&fine, &level.mesh, 10_000).unwrap());
    }
    assert!(levels.windows(2).all(|w| w[0].hausdorff.max < w[1].hausdorff.max));
    assert_eq!(levels[0], decimate(&fine, 3000).unwrap());
    assert!(decimate_levels(&fine, &[100, 3], None).is_err());
}

#[test]
fn cached_levels_have_the_same_bits_and_damaged_ones_are_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, targets) = (torus(0.06, 0.02, 40), [1000, 200]);
    let made = decimate_levels(&mesh, &targets, None).unwrap();
    assert_eq!(decimate_levels(&mesh, &targets, Some(folder.path())).unwrap(), made);
    let entries = || std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path()).collect::<Vec<_>>();
    assert_eq!(entries().len(), 1);
    let entry = &entries()[0];
    let whole = std::fs::read(entry).unwrap();
    let written = std::fs::metadata(entry).unwrap().modified().unwrap();
    assert_eq!(decimate_levels(&mesh, &targets, Some(folder.path())).unwrap(), made);
    assert_eq!(std::fs::metadata(entry).unwrap().modified().unwrap(), written, "the entry was read");
    let mut flipped = whole.clone();
    flipped[200] ^= 1;
    for damaged in [&whole[..whole.len() - 1], &flipped[..], &[]] {
        std::fs::write(entry, damaged).unwrap();
        assert_eq!(decimate_levels(&mesh, &targets, Some(folder.path())).unwrap(), made);
        assert_eq!(std::fs::read(entry).unwrap(), whole, "the entry was repaired");
    }
    // Other targets are another entry, and a folder that cannot be made costs the cache, not the result.
    decimate_levels(&mesh, &[500], Some(folder.path())).unwrap();
    assert_eq!(entries().len(), 2);
    assert_eq!(decimate_levels(&mesh, &targets, Some(&entry.join("below-a-file"))).unwrap(), made);
}

#[test]
fn an_open_mesh_keeps_its_rim() {
    let fine = halve(&halve(&sphere(0.05, 24)));
    let open: Vec<_> =
        fine.faces().iter().copied().filter(|f| f.iter().all(|&v| fine.vertices()[v as usize].z < 0.01)).collect();
    let bowl = TriMesh::new(fine.vertices().to_vec(), open).unwrap();
    let small = decimate(&bowl, 400).unwrap();
    assert!(small.mesh.faces().len() <= 400);
    assert!(matches!(check_watertight(&small.mesh), Err(Defect::OpenEdge { .. })));
    assert!(small.hausdorff.max < 1.5e-3, "{:?}", small.hausdorff);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    /// For any shape, noise and target: a manifold stays a manifold.
    #[test]
    fn watertight_stays_watertight(kind in 0..3, n in 8..40_u32, noise in 0.0..2e-3_f64, share in 0.01..0.9_f64, seed in 0..1000_u64) {
        let mesh = match kind { 0 => sphere(0.05, n), 1 => torus(0.06, 0.02, n), _ => halve(&cup(0.04, 0.08, 0.004, n)) };
        let shake = |i: usize| {
            let hash = blake3::hash(&[seed.to_le_bytes(), (i as u64).to_le_bytes()].concat());
            let byte = |k: usize| f64::from(hash.as_bytes()[k]) / 255.0 - 0.5;
            Vector3::new(byte(0), byte(1), byte(2)) * noise
        };
        let vertices = mesh.vertices().iter().enumerate().map(|(i, p)| p + shake(i)).collect();
        let mesh = TriMesh::new(vertices, mesh.faces().to_vec()).unwrap();
        check_manifold(&mesh).unwrap();
        let target = ((mesh.faces().len() as f64 * share) as usize).max(4);
        let small = decimate(&mesh, target).unwrap();
        prop_assert!(check_manifold(&small.mesh).is_ok());
        prop_assert_eq!(&small, &decimate(&mesh, target).unwrap());
    }
}

#[test]
fn cleaning_repairs_what_it_says() {
    let good = cup(0.04, 0.08, 0.004, 32);
    // Every corner its own vertex, as in a file; three faces turned over; one face twice; one face on a point.
    let mut vertices: Vec<Point3<f64>> = Vec::new();
    let mut faces: Vec<[u32; 3]> = Vec::new();
    for f in 0..good.faces().len() {
        let base = vertices.len() as u32;
        vertices.extend(good.triangle(f));
        faces.push(if f % 50 == 7 { [base, base + 2, base + 1] } else { [base, base + 1, base + 2] });
    }
    faces.extend([faces[0], [0, 0, 1]]);
    let dirty = TriMesh::new(vertices, faces).unwrap();
    assert!(check_watertight(&dirty).is_err());
    let (mesh, report) = clean(&dirty, &CleanOptions::default()).unwrap();
    check_manifold(&mesh).unwrap();
    assert!(report.watertight && report.manifold && report.components == 1);
    assert_eq!((report.degenerate_faces, report.duplicate_faces), (1, 1));
    assert_eq!(mesh.vertices().len(), good.vertices().len());
    assert!((mesh.signed_volume() - good.signed_volume()).abs() < 1e-12);
    let inside_out =
        TriMesh::new(mesh.vertices().to_vec(), mesh.faces().iter().map(|&[a, b, c]| [a, c, b]).collect()).unwrap();
    let (turned, report) = clean(&inside_out, &CleanOptions::default()).unwrap();
    assert_eq!(report.flipped_faces, mesh.faces().len());
    assert!(turned.signed_volume() > 0.0);
}

#[test]
fn floaters_go_and_cavities_stay() {
    let outer = sphere(0.05, 32);
    let cavity = sphere(0.02, 32);
    let floater = sphere(0.002, 8).transformed(&nalgebra::Isometry3::translation(0.2, 0.0, 0.0));
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    for mesh in [&outer, &cavity, &floater] {
        let base = vertices.len() as u32;
        vertices.extend_from_slice(mesh.vertices());
        faces.extend(mesh.faces().iter().map(|f| f.map(|v| v + base)));
    }
    let all = TriMesh::new(vertices, faces).unwrap();
    let options = CleanOptions { min_component_area: 0.01, ..CleanOptions::default() };
    let (mesh, report) = clean(&all, &options).unwrap();
    assert_eq!((report.components, report.dropped_components), (3, 1));
    let hollow = outer.signed_volume() - cavity.signed_volume();
    assert!((mesh.signed_volume() - hollow).abs() < 1e-12, "the cavity counts against the solid");
    let missing = load(std::path::Path::new("no/such/file.stl"), &Default::default());
    assert!(missing.unwrap_err().to_string().contains("no/such/file.stl"));
}

/// Every face into four, by the middles of its edges.
fn halve(mesh: &TriMesh) -> TriMesh {
    let mut vertices = mesh.vertices().to_vec();
    let mut middles = std::collections::HashMap::new();
    let mut faces = Vec::new();
    for &[a, b, c] in mesh.faces() {
        let mut middle = |u: u32, v: u32| {
            *middles.entry((u.min(v), u.max(v))).or_insert_with(|| {
                vertices.push(nalgebra::center(&vertices[u as usize], &vertices[v as usize]));
                vertices.len() as u32 - 1
            })
        };
        let (x, y, z) = (middle(a, b), middle(b, c), middle(c, a));
        faces.extend([[a, x, z], [x, b, y], [z, y, c], [x, y, z]]);
    }
    TriMesh::new(vertices, faces).unwrap()
}
