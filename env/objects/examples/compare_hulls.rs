//! Own quickhull against parry's, in f64 and f32: correctness and time on scanned, procedural and coplanar inputs.
//!
//! `cargo run --release -p graspbox-objects --features compare --example compare_hulls -- FOLDER_OF_YCB_STL_FILES`
//!
//! * `gap`: distance between the hull's corners and the input as convex sets, by 3,000 directions and the normals of all hulls.
//! * `dent`: volume that the surface encloses, against the median of the three methods, over area and size.
//! * `tilt`: greatest distance of an input point outside the plane of a face (without slivers 10,000 times as long as wide).
//!
//! Each is the worst of its group, as a share of the cloud's size. A hull fails without a result, with an open surface, or
//! with a gap or dent of more than 2 ten-thousandths.
#![allow(clippy::print_stdout)]

mod inputs;

use graspbox_mesh::{MeshError, TriMesh, check_watertight, convex_hull, fibonacci_sphere};
use graspbox_objects::{Family, generate};
use inputs::{folder, procedural, scanned};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::time::Instant;

type Cloud = Vec<Point3<f64>>;

/// Greatest distance of a point outside a correct hull, as a share of the size.
const TOLERANCE: f64 = 2e-4;

fn main() -> Result<(), MeshError> {
    std::panic::set_hook(Box::new(|_| {}));
    println!("| input | clouds | points | method | no hull / open / wrong | gap | dent | tilt | ms per hull |");
    println!("|---|---|---|---|---|---|---|---|---|");
    for (name, clouds) in groups()? {
        report(&name, &clouds);
    }
    Ok(())
}

fn groups() -> Result<Vec<(String, Vec<Cloud>)>, MeshError> {
    let mut meshes = procedural(&Family::ALL, 0..4)?;
    let mut groups = vec![("procedural vertices".into(), clouds(&meshes))];
    let mut parts = Vec::new();
    for family in Family::ALL {
        parts.extend(generate(family, 0)?.parts.into_iter().flatten());
    }
    groups.push(("procedural part clouds".into(), parts));
    if let Some(folder) = folder() {
        let ycb = scanned(&folder, &[])?;
        groups.push(("YCB vertices".into(), clouds(&ycb)));
        meshes.extend(ycb);
    }
    groups.push(("pieces with two cut faces".into(), meshes.iter().flat_map(|(_, m)| slabs(m)).collect()));
    groups.push(("lattices, prisms, domes".into(), coplanar()));
    Ok(groups)
}

fn clouds(meshes: &[inputs::Named]) -> Vec<Cloud> {
    meshes.iter().map(|(_, m)| m.vertices().to_vec()).collect()
}

/// Six slabs along a slanted axis: the points of each cut are coplanar up to rounding.
fn slabs(mesh: &TriMesh) -> Vec<Cloud> {
    let axis = Vector3::new(0.36, 0.48, 0.8);
    let height = |p: &Point3<f64>| axis.dot(&p.coords);
    let (low, high) = mesh.vertices().iter().map(height).fold((f64::MAX, f64::MIN), |(a, b), h| (a.min(h), b.max(h)));
    let cut = |k: u32| low + (high - low) * f64::from(k) / 6.0;
    let slab = |k: u32| {
        let (from, to) = (cut(k), cut(k + 1));
        let mut cloud: Cloud = mesh.vertices().iter().filter(|p| (from..=to).contains(&height(p))).copied().collect();
        for f in 0..mesh.faces().len() {
            let corners = mesh.triangle(f);
            for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (corners[i], corners[j])) {
                for at in [from, to] {
                    let (ha, hb) = (height(&a) - at, height(&b) - at);
                    if ha * hb < 0.0 {
                        cloud.push(a + (b - a) * (ha / (ha - hb)));
                    }
                }
            }
        }
        cloud
    };
    (0..6).map(slab).filter(|c| c.len() >= 8).collect()
}

/// Points of which many are coplanar, exactly or up to rounding.
fn coplanar() -> Vec<Cloud> {
    let mut clouds = Vec::new();
    for n in [2_u32, 3, 5, 9, 17] {
        let side = f64::from(n - 1);
        let lattice = (0..n * n * n)
            .map(|i| Point3::new(f64::from(i % n), f64::from(i / n % n), f64::from(i / n / n)) * (0.1 / side))
            .collect::<Cloud>();
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, 0.7, 1.1);
        clouds.push(lattice.iter().map(|p| turn * p).collect());
        clouds.push(lattice.iter().map(|p| p + Vector3::repeat(3.0)).collect());
        clouds.push(lattice);
    }
    for sides in [6_u32, 32, 256, 2048] {
        let ring = |z: f64, r: f64| {
            (0..sides).map(move |i| {
                let (s, c) = (f64::from(i) * std::f64::consts::TAU / f64::from(sides)).sin_cos();
                Point3::new(r * c, r * s, z)
            })
        };
        clouds.push((0..5).flat_map(|k| ring(0.02 * f64::from(k), 0.04)).collect());
        clouds.push(
            (0..9)
                .flat_map(|k| ring(0.005 * f64::from(k), (0.04_f64.powi(2) - (0.005 * f64::from(k)).powi(2)).sqrt()))
                .collect(),
        );
    }
    clouds
}

fn parry64(points: &[Point3<f64>]) -> Option<(Cloud, Vec<[u32; 3]>)> {
    use parry3d_f64::math::Vector;
    let points: Vec<Vector> = points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
    let (corners, faces) = parry3d_f64::transformation::try_convex_hull(&points).ok()?;
    Some((corners.iter().map(|v| Point3::new(v.x, v.y, v.z)).collect(), faces))
}

fn parry32(points: &[Point3<f64>]) -> Option<(Cloud, Vec<[u32; 3]>)> {
    use parry3d::math::Vector;
    let points: Vec<Vector> = points.iter().map(|p| Vector::new(p.x as f32, p.y as f32, p.z as f32)).collect();
    let (corners, faces) = parry3d::transformation::try_convex_hull(&points).ok()?;
    Some((corners.iter().map(|v| Point3::new(v.x.into(), v.y.into(), v.z.into())).collect(), faces))
}

/// Result of one method for one cloud.
struct Hull {
    mesh: Option<TriMesh>,
    seconds: f64,
}

fn tried(build: impl FnOnce() -> Option<TriMesh>) -> Hull {
    let begin = Instant::now();
    let mesh = std::panic::catch_unwind(std::panic::AssertUnwindSafe(build)).ok().flatten();
    Hull { mesh, seconds: begin.elapsed().as_secs_f64() }
}

/// Errors of a hull, as shares of the cloud's size; NaN without a hull.
#[derive(Clone, Copy)]
struct Faults {
    none: bool,
    open: bool,
    gap: f64,
    dent: f64,
    tilt: f64,
    seconds: f64,
}

impl Faults {
    fn wrong(&self) -> bool {
        !self.none && !self.open && (self.gap > TOLERANCE || self.dent > TOLERANCE)
    }
}

fn faults(points: &Cloud) -> [Faults; 3] {
    let mesh = |(v, f): (Cloud, Vec<[u32; 3]>)| TriMesh::new(v, f).ok();
    let hulls = [
        tried(|| convex_hull(points).ok()),
        tried(|| parry64(points).and_then(mesh)),
        tried(|| parry32(points).and_then(mesh)),
    ];
    let mut volumes = [0, 1, 2].map(|k: usize| hulls[k].mesh.as_ref().map_or(0.0, TriMesh::signed_volume));
    volumes.sort_by(f64::total_cmp);
    let mut directions = fibonacci_sphere(3000);
    directions.extend(hulls.iter().filter_map(|h| h.mesh.as_ref()).flat_map(|m| normals(m).into_iter().map(|n| n.0)));
    let reach = supports(points, &directions);
    hulls.map(|h| judged(&h, points, volumes[1], &directions, &reach))
}

fn judged(hull: &Hull, points: &Cloud, volume: f64, directions: &[Vector3<f64>], reach: &[f64]) -> Faults {
    let Some(mesh) = &hull.mesh else {
        return Faults { none: true, open: false, gap: 0.0, dent: 0.0, tilt: 0.0, seconds: hull.seconds };
    };
    let size = mesh.extent();
    let own = supports(mesh.vertices(), directions);
    let gap = own.iter().zip(reach).map(|(a, b)| (b - a).abs()).fold(0.0, f64::max) / size;
    let above = |(n, d): &(Vector3<f64>, f64)| points.iter().map(|p| n.dot(&p.coords) - d).fold(0.0, f64::max);
    Faults {
        none: false,
        open: check_watertight(mesh).is_err(),
        gap,
        dent: (mesh.signed_volume() - volume).abs() / (mesh.area() * size),
        tilt: normals(mesh).iter().map(above).fold(0.0, f64::max) / size,
        seconds: hull.seconds,
    }
}

/// Unit normals and offsets of the faces that are not slivers.
fn normals(hull: &TriMesh) -> Vec<(Vector3<f64>, f64)> {
    let plane = |f: usize| {
        let [a, b, c] = hull.triangle(f);
        let normal = (b - a).cross(&(c - a));
        let longest = (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
        (normal.norm() > 1e-4 * longest).then(|| (normal.normalize(), normal.normalize().dot(&a.coords)))
    };
    (0..hull.faces().len()).filter_map(plane).collect()
}

/// Farthest reach of the points along each direction.
fn supports(points: &[Point3<f64>], directions: &[Vector3<f64>]) -> Vec<f64> {
    let farthest = |d: &Vector3<f64>| points.iter().map(|p| d.dot(&p.coords)).fold(f64::NEG_INFINITY, f64::max);
    directions.par_iter().map(farthest).collect()
}

fn report(name: &str, clouds: &[Cloud]) {
    let rows: Vec<[Faults; 3]> = clouds.iter().map(faults).collect();
    let points: usize = clouds.iter().map(Vec::len).sum();
    for (k, method) in ["own, f64", "parry, f64", "parry, f32"].into_iter().enumerate() {
        let column = || rows.iter().map(|r| r[k]);
        let worst = |share: fn(&Faults) -> f64| column().map(|f| share(&f)).fold(0.0, f64::max);
        println!(
            "| {name} | {} | {points} | {method} | {} / {} / {} | {:.1e} | {:.1e} | {:.1e} | {:.3} |",
            rows.len(),
            column().filter(|f| f.none).count(),
            column().filter(|f| f.open).count(),
            column().filter(Faults::wrong).count(),
            worst(|f| f.gap),
            worst(|f| f.dent),
            worst(|f| f.tilt),
            1e3 * column().map(|f| f.seconds).sum::<f64>() / rows.len() as f64,
        );
    }
}
