//! Convex parts: convex, within their bounds, open where the object is open, cached safely.
#![allow(clippy::unwrap_used)]

mod shapes;

use graspbox_mesh::{
    ConvexParts, PartsParams, PartsReport, TriMesh, check_manifold, convex_parts, measure_parts, sample_surface,
};
use nalgebra::{Point3, Vector3};
use shapes::{cuboid, cup, sphere};

/// Within `margin` metres of a part (or inside it).
fn inside(parts: &[TriMesh], p: &Point3<f64>, margin: f64) -> bool {
    parts.iter().any(|part| {
        (0..part.faces().len()).all(|f| {
            // Parts have no slivers: every face has a normal.
            let normal = part.face_area_vector(f).normalize();
            normal.dot(&(p - part.triangle(f)[0])) <= margin
        })
    })
}

fn check_convex(part: &TriMesh) {
    check_manifold(part).unwrap();
    let tolerance = 1e-3 * part.extent();
    for f in 0..part.faces().len() {
        let normal = part.face_area_vector(f).normalize();
        for p in part.vertices() {
            assert!(normal.dot(&(p - part.triangle(f)[0])) < tolerance);
        }
    }
}

fn checked(mesh: &TriMesh, params: &PartsParams) -> (ConvexParts, PartsReport) {
    let made = convex_parts(mesh, params, None).unwrap();
    assert!(made.parts.len() <= params.max_parts);
    for part in &made.parts {
        check_convex(part);
        assert!(part.vertices().len() <= params.max_points);
    }
    let report = measure_parts(mesh, &made.parts, params.max_error);
    (made, report)
}

#[test]
fn convex_objects_are_one_part_that_fits() {
    let params = PartsParams::default();
    let (_, block) = checked(&cuboid(Vector3::new(0.05, 0.08, 0.2)), &params);
    assert_eq!((block.parts, block.points), (1, 8));
    assert!(block.overfill_mean < 1e-6 && block.overfill_max < 3e-4 && block.underfill_max < 1e-6, "{block:?}");
    let (_, ball) = checked(&sphere(0.037, 64), &params);
    assert_eq!(ball.parts, 1);
    assert!(ball.underfill_max < 1.5e-3, "{ball:?}");
}

#[test]
fn a_cup_stays_open_and_keeps_its_walls() {
    let (radius, height, wall) = (0.035, 0.07, 0.003);
    let mesh = cup(radius, height, wall, 48);
    let (made, report) = checked(&mesh, &PartsParams::default());
    assert!(report.overfill_mean < 5e-4 && report.underfill_max < 1e-3, "{report:?}");
    // No part reaches into the cavity by more than two millimetres of overfill; the wall is all there.
    for s in sample_surface(&mesh, 2000, 1) {
        let r = s.point.coords.xy().norm();
        if r < radius - wall - 1e-3 && s.point.z > wall * 0.5 {
            let above = s.point + s.normal * 2e-3;
            assert!(!inside(&made.parts, &above, 0.0), "the cavity is filled at {above}");
        }
    }
    for i in 0..50 {
        let z = wall + f64::from(i) / 50.0 * (height - wall);
        assert!(!inside(&made.parts, &Point3::new(0.0, 0.0, z + 2e-3), 0.0));
        let (s, c) = (f64::from(i) * 0.7).sin_cos();
        let middle = radius - wall / 2.0;
        assert!(inside(&made.parts, &Point3::new(middle * c, middle * s, z), 2e-4), "the wall has a hole at {z}");
    }
}

#[test]
fn the_same_mesh_gives_the_same_bits() {
    let mesh = cup(0.03, 0.05, 0.004, 24);
    let params = PartsParams { max_parts: 12, ..PartsParams::default() };
    assert_eq!(convex_parts(&mesh, &params, None).unwrap().parts, convex_parts(&mesh, &params, None).unwrap().parts);
}

#[test]
fn the_cache_gives_back_what_it_was_given_and_survives_damage() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = cuboid(Vector3::new(0.05, 0.08, 0.2));
    let params = PartsParams::default();
    let cache = Some(folder.path());
    let made = convex_parts(&mesh, &params, cache).unwrap();
    assert!(!made.cached);
    let read = convex_parts(&mesh, &params, cache).unwrap();
    assert!(read.cached);
    assert_eq!(made.parts, read.parts);
    let entries: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path()).collect();
    assert_eq!(entries.len(), 1, "no temporary file is left behind");
    // Another parameter is another entry.
    assert!(!convex_parts(&mesh, &PartsParams { max_parts: 3, ..params }, cache).unwrap().cached);
    let whole = std::fs::read(&entries[0]).unwrap();
    let mut flipped = whole.clone();
    flipped[100] ^= 1;
    for damaged in [&whole[..whole.len() / 2], &flipped[..], &[]] {
        std::fs::write(&entries[0], damaged).unwrap();
        let again = convex_parts(&mesh, &params, cache).unwrap();
        assert!(!again.cached);
        assert_eq!(again.parts, made.parts);
        assert!(convex_parts(&mesh, &params, cache).unwrap().cached, "the entry was repaired");
    }
    // A folder that cannot be made (its parent is a file) costs the cache, not the result.
    let blocked = entries[0].join("below-a-file");
    assert_eq!(convex_parts(&mesh, &params, Some(&blocked)).unwrap().parts, made.parts);
}

/// Threads and processes that need the same object at once each make it, and none of them reads half an entry.
#[test]
fn an_entry_that_many_write_and_read_at_once_is_always_whole() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, params) = (cuboid(Vector3::new(0.05, 0.08, 0.2)), PartsParams::default());
    let parts = convex_parts(&mesh, &params, None).unwrap().parts;
    std::thread::scope(|scope| {
        for worker in 0..4 {
            let (mesh, parts, folder) = (&mesh, &parts, folder.path());
            scope.spawn(move || {
                for round in 0..10 {
                    if worker == 0 && round % 3 == 0 {
                        // Somebody else trims the folder.
                        std::fs::read_dir(folder).unwrap().flatten().for_each(|entry| {
                            if entry.path().extension().is_some_and(|suffix| suffix == "parts") {
                                std::fs::remove_file(entry.path()).ok();
                            }
                        });
                    }
                    assert_eq!(&convex_parts(mesh, &params, Some(folder)).unwrap().parts, parts);
                }
            });
        }
    });
    assert!(convex_parts(&mesh, &params, Some(folder.path())).unwrap().cached);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left behind");
}

/// A cache file of another object under this object's name gave this object the other one's shape.
#[test]
fn an_entry_of_another_mesh_is_not_used() {
    let folder = tempfile::tempdir().unwrap();
    let params = PartsParams::default();
    let entry = |mesh: &TriMesh| {
        let before: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path()).collect();
        convex_parts(mesh, &params, Some(folder.path())).unwrap();
        let mut after = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path());
        after.find(|p| !before.contains(p)).unwrap()
    };
    let (block, plank) = (cuboid(Vector3::new(0.05, 0.08, 0.2)), cuboid(Vector3::new(0.01, 0.08, 0.2)));
    let (of_block, of_plank) = (entry(&block), entry(&plank));
    std::fs::copy(of_plank, of_block).unwrap();
    let made = convex_parts(&block, &params, Some(folder.path())).unwrap();
    assert!(!made.cached);
    assert_eq!(made.parts, convex_parts(&block, &params, None).unwrap().parts);
    assert!(convex_parts(&block, &params, Some(folder.path())).unwrap().cached, "the entry was repaired");
}

#[test]
fn flat_meshes_and_bad_parameters_are_refused() {
    let flat = cuboid(Vector3::new(0.1, 0.1, 0.0));
    assert!(convex_parts(&flat, &PartsParams::default(), None).is_err());
    let mesh = cuboid(Vector3::new(0.1, 0.1, 0.1));
    for params in [
        PartsParams { max_error: 0.0, ..PartsParams::default() },
        PartsParams { max_error: f64::NAN, ..PartsParams::default() },
        PartsParams { max_parts: 0, ..PartsParams::default() },
        PartsParams { max_points: 4, ..PartsParams::default() },
        PartsParams { max_nodes: 10, ..PartsParams::default() },
    ] {
        assert!(convex_parts(&mesh, &params, None).is_err());
    }
}
