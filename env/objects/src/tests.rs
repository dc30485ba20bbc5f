//! Every family keeps its bounds for any seed.
#![allow(clippy::unwrap_used, clippy::panic)]

use super::{Family, ProceduralObject, generate};
use graspbox_mesh::clean::{check_manifold, components};
use nalgebra::{Point3, Vector3};
use parry3d::math::Vector;
use parry3d::query::PointQuery;
use parry3d::shape::{TriMesh as ParryMesh, TriMeshFlags};

use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// Greatest distance of a part outside the mesh, and of the mesh outside its parts, metres.
const TOLERANCE: f64 = 0.0015;

fn glam(p: &Point3<f64>) -> Vector {
    Vector::new(p.x as f32, p.y as f32, p.z as f32)
}

/// Closed, oriented, one fan around every vertex, in one piece.
fn check_surface(object: &ProceduralObject) {
    assert_eq!(check_manifold(&object.mesh), Ok(()), "{}", object.name);
    let pieces = components(object.mesh.faces()).1;
    assert_eq!(pieces, 1, "{}: {pieces} components", object.name);
    let holes = match object.family {
        Family::Mug | Family::Ring | Family::Kettle => 1..=1,
        Family::Scissors => 2..=2,
        // One for each link.
        Family::Chain => 3..=5,
        _ => 0..=0,
    };
    let genus = genus(object);
    assert!(holes.contains(&genus), "{}: {genus} holes, not {holes:?}", object.name);
    assert!(object.mesh.signed_volume() > 0.0, "{}: inside out", object.name);
}

fn genus(object: &ProceduralObject) -> i64 {
    let (v, f) = (object.mesh.vertices().len() as i64, object.mesh.faces().len() as i64);
    1 - (v - f / 2) / 2
}

fn check_promises(object: &ProceduralObject) {
    let facts = object.family.facts();
    let bounds = object.mesh.aabb();
    let size = bounds.max - bounds.min;
    for axis in 0..3 {
        let range = facts.least[axis]..=facts.greatest[axis];
        assert!(range.contains(&size[axis]), "{}: extent {axis} is {} not in {range:?}", object.name, size[axis]);
    }
    let masses = facts.mass[0]..=facts.mass[1];
    assert!(masses.contains(&object.mass), "{}: {} kg not in {masses:?}", object.name, object.mass);
    let faces = object.mesh.faces().len();
    assert!((500..=8000).contains(&faces), "{}: {faces} faces", object.name);
    assert!(bounds.min.z.abs() < 1e-12 && (bounds.min.x + bounds.max.x).abs() < 1e-12);
    assert!((bounds.min.y + bounds.max.y).abs() < 1e-12);
    let (least, flattest) = smallest_face(object);
    assert!(least > 1e-10, "{}: a face of {least} m2", object.name);
    assert!(flattest > 1e-3, "{}: a needle of a face, height over length {flattest}", object.name);
}

/// Least area, and least height over longest edge, of all faces.
fn smallest_face(object: &ProceduralObject) -> (f64, f64) {
    let mut worst = (f64::INFINITY, f64::INFINITY);
    for f in 0..object.mesh.faces().len() {
        let [a, b, c] = object.mesh.triangle(f);
        let area = object.mesh.face_area_vector(f).norm();
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        worst = (worst.0.min(area), worst.1.min(2.0 * area / (longest * longest)));
    }
    worst
}

/// A part as its hull's triangles.
struct Hull {
    corners: Vec<[Point3<f64>; 3]>,
    low: Point3<f64>,
    high: Point3<f64>,
}

impl Hull {
    fn new(cloud: &[Point3<f64>]) -> Self {
        let points: Vec<Vector> = cloud.iter().map(glam).collect();
        let (points, faces) = parry3d::transformation::try_convex_hull(&points).unwrap();
        let point = |i: u32| points[i as usize];
        let corners: Vec<[Point3<f64>; 3]> = faces
            .iter()
            .map(|f| f.map(|i| Point3::new(point(i).x.into(), point(i).y.into(), point(i).z.into())))
            .collect();
        let all = corners.iter().flatten();
        let (low, high) = all.fold((corners[0][0], corners[0][0]), |(l, h), p| (l.inf(p), h.sup(p)));
        Self { corners, low, high }
    }

    /// Distance from `p` to the solid hull.
    fn distance(&self, p: &Point3<f64>) -> f64 {
        let apart = (self.low - p).sup(&(p - self.high)).sup(&Vector3::zeros()).norm();
        if apart > TOLERANCE {
            return apart;
        }
        let normal = |[a, b, c]: &[Point3<f64>; 3]| (b - a).cross(&(c - a));
        if self.corners.iter().all(|t| normal(t).dot(&(p - t[0])) <= 0.0) {
            return 0.0;
        }
        let triangle = |t: &[Point3<f64>; 3]| {
            let [a, b, c] = [glam(&t[0]), glam(&t[1]), glam(&t[2])];
            let near = parry3d::shape::Triangle::new(a, b, c).project_local_point(glam(p), false).point;
            f64::from((near - glam(p)).length())
        };
        self.corners.iter().map(triangle).fold(f64::INFINITY, f64::min)
    }
}

/// Winding number of the surface around `p`: 1 inside, 0 outside (van Oosterom and Strackee's solid angles).
fn winding_number(object: &ProceduralObject, p: &Point3<f64>) -> f64 {
    let solid_angle = |f: usize| {
        let [a, b, c] = object.mesh.triangle(f).map(|q| q - p);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        2.0 * a.dot(&b.cross(&c)).atan2(below)
    };
    (0..object.mesh.faces().len()).map(solid_angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

/// Greatest distance of parts outside the mesh, and of the surface outside the parts, metres.
fn part_errors(object: &ProceduralObject, samples: usize) -> (f64, f64) {
    let parts = object.parts.as_ref().unwrap();
    assert!(parts.len() <= 64, "{}: {} parts", object.name, parts.len());
    assert!(parts.iter().all(|p| p.len() <= 64), "{}: a part of more than 64 points", object.name);
    let vertices = object.mesh.vertices().iter().map(glam).collect();
    let mesh = ParryMesh::with_flags(vertices, object.mesh.faces().to_vec(), TriMeshFlags::ORIENTED).unwrap();
    let hulls: Vec<Hull> = parts.iter().map(|p| Hull::new(p)).collect();
    let mut outside: f64 = 0.0;
    for hull in &hulls {
        let step = (hull.corners.len() * hulls.len()).div_ceil(samples * 4).max(1);
        for t in hull.corners.iter().step_by(step) {
            for weights in [[0.98, 0.01, 0.01], [0.33, 0.33, 0.34], [0.5, 0.5, 0.0]] {
                let p = Point3::from(t[0].coords * weights[0] + t[1].coords * weights[1] + t[2].coords * weights[2]);
                let near = mesh.project_local_point(glam(&p), false);
                let away = f64::from((near.point - glam(&p)).length());
                // Near a vertex the pseudonormal may be wrong: the winding number decides before a point counts.
                if !near.is_inside && away > outside && winding_number(object, &p) < 0.5 {
                    outside = away;
                }
            }
        }
    }
    let mut uncovered: f64 = 0.0;
    let step = object.mesh.faces().len().div_ceil(samples).max(1);
    for f in (0..object.mesh.faces().len()).step_by(step) {
        let [a, b, c] = object.mesh.triangle(f);
        let p = Point3::from((a.coords + b.coords + c.coords) / 3.0);
        let near = hulls.iter().map(|h| h.distance(&p)).fold(f64::INFINITY, f64::min);
        uncovered = uncovered.max(near);
    }
    (outside, uncovered)
}

fn check_parts(object: &ProceduralObject) {
    let (outside, uncovered) = part_errors(object, 300);
    assert!(outside <= TOLERANCE, "{}: a part lies {outside} m outside the mesh", object.name);
    assert!(uncovered <= TOLERANCE, "{}: the surface lies {uncovered} m outside the parts", object.name);
}

#[test]
fn every_family_keeps_its_promises() {
    for family in Family::ALL {
        for seed in 0..24 {
            let object = generate(family, seed).unwrap();
            check_surface(&object);
            check_promises(&object);
            check_parts(&object);
        }
    }
}

#[test]
fn same_seed_same_bits_and_another_seed_another_object() {
    for family in Family::ALL {
        let [a, b, c] = [7, 7, 8].map(|seed| generate(family, seed).unwrap());
        assert_eq!(a.mesh, b.mesh);
        assert_eq!(a.mass.to_bits(), b.mass.to_bits());
        assert_eq!(a.parts, b.parts);
        assert_ne!(a.mesh, c.mesh, "{family}: seeds 7 and 8 make the same mesh");
        assert_eq!(a.name, format!("{family}-000007"));
    }
}

/// A chain of five links of nearly the thickest wire and the longest straights.
#[test]
fn the_longest_chains_keep_their_bounds() {
    check_promises(&generate(Family::Chain, 18_319_913_164_365_112_584).unwrap());
}

proptest! {
    // A fixed stream of seeds: failures are reproducible. The report below tries more seeds.
    #![proptest_config(ProptestConfig {
        cases: 60,
        rng_seed: RngSeed::Fixed(2017),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn any_seed_keeps_the_promises(which in 0..Family::ALL.len(), seed in any::<u64>()) {
        let object = generate(Family::ALL[which], seed).unwrap();
        check_surface(&object);
        check_promises(&object);
        check_parts(&object);
    }
}

#[test]
fn names_round_trip_and_a_wrong_one_lists_the_right_ones() {
    for (number, family) in Family::ALL.into_iter().enumerate() {
        assert_eq!(family as usize, number, "facts are listed in the order of the numbers");
        assert_eq!(family.to_string().parse::<Family>(), Ok(family));
    }
    let message = "spaceship".parse::<Family>().unwrap_err().to_string();
    assert!(message.contains("spaceship") && message.contains("wood_block"), "{message}");
}

/// Prints a report of the families: run with `--ignored --nocapture`; `GRASPBOX_OBJ_DIR` also writes OBJ files there.
#[test]
#[ignore = "a report, not a check"]
fn report() {
    let seeds = std::env::var("GRASPBOX_SEEDS").ok().and_then(|s| s.parse().ok()).unwrap_or(40);
    let only = std::env::var("GRASPBOX_FAMILIES").unwrap_or_default();
    let chosen = Family::ALL.into_iter().filter(|f| only.is_empty() || only.split(',').any(|o| o == f.name()));
    for family in chosen {
        let (mut low, mut high) = ([f64::INFINITY; 3], [0f64; 3]);
        let (mut mass, mut faces, mut parts) = ([f64::INFINITY, 0.0], [usize::MAX, 0], [usize::MAX, 0]);
        let (mut outside, mut uncovered, mut seconds, mut needle) = (0f64, 0f64, 0f64, f64::INFINITY);
        let mut genera = std::collections::BTreeSet::new();
        for seed in 0..seeds {
            let clock = std::time::Instant::now();
            let object = generate(family, seed).unwrap_or_else(|e| panic!("{family} {seed}: {e}"));
            seconds += clock.elapsed().as_secs_f64();
            let size = object.mesh.aabb().max - object.mesh.aabb().min;
            for axis in 0..3 {
                (low[axis], high[axis]) = (low[axis].min(size[axis]), high[axis].max(size[axis]));
            }
            mass = [mass[0].min(object.mass), mass[1].max(object.mass)];
            let (f, p) = (object.mesh.faces().len(), object.parts.as_ref().map_or(0, Vec::len));
            (faces, parts) = ([faces[0].min(f), faces[1].max(f)], [parts[0].min(p), parts[1].max(p)]);
            genera.insert(genus(&object));
            needle = needle.min(smallest_face(&object).1);
            let errors = part_errors(&object, 300);
            (outside, uncovered) = (outside.max(errors.0), uncovered.max(errors.1));
            if let Ok(folder) = std::env::var("GRASPBOX_OBJ_DIR") {
                write_obj(&object, &folder);
            }
        }
        println!(
            "{family:13} size {low:.3?} to {high:.3?} mass {mass:.3?} faces {faces:?} parts {parts:?} genus {genera:?} \
             outside {:.2} uncovered {:.2} mm needle {needle:.4} {:.2} ms",
            outside * 1e3,
            uncovered * 1e3,
            seconds * 1e3 / seeds as f64
        );
    }
}

/// Hulls of turned shapes have slivers, whose normals are only rounding; if they counted as facets, one object in four could not rest. (Scissors 32
/// have one that is wide enough to look like a facet.)
#[test]
fn every_object_can_rest() {
    for family in Family::ALL {
        for seed in (0..6).chain([32]) {
            let object = generate(family, seed).unwrap();
            let hull = graspbox_mesh::convex_hull(object.mesh.vertices()).unwrap();
            let center = graspbox_mesh::mass_properties(&object.mesh, graspbox_mesh::Mass::Kilograms(object.mass))
                .unwrap()
                .center_of_mass;
            let poses =
                graspbox_mesh::resting_poses(&hull, &center, &graspbox_mesh::RestingOptions::default()).unwrap();
            assert!(poses[0].margin >= 0.0 && poses[0].height > 0.0, "{family:?} {seed}");
        }
    }
}

fn write_obj(object: &ProceduralObject, folder: &str) {
    let mut text = String::new();
    for p in object.mesh.vertices() {
        text += &format!("v {} {} {}\n", p.x, p.y, p.z);
    }
    for f in object.mesh.faces() {
        text += &format!("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1);
    }
    std::fs::write(format!("{folder}/{}.obj", object.name), text).unwrap();
    let mut text = String::new();
    let mut base = 1;
    for part in object.parts.iter().flatten() {
        for t in Hull::new(part).corners {
            for p in t {
                text += &format!("v {} {} {}\n", p.x, p.y, p.z);
            }
            text += &format!("f {} {} {}\n", base, base + 1, base + 2);
            base += 3;
        }
    }
    std::fs::write(format!("{folder}/{}.parts.obj", object.name), text).unwrap();
}
