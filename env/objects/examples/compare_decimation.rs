//! Own decimation against meshoptimizer (crate `meshopt`, C++): distance, topology and time.
//!
//! `cargo run --release -p graspbox-objects --features compare --example compare_decimation -- FOLDER_OF_YCB_STL_FILES`
//!
//! Each mesh is reduced to each number of faces that it exceeds twice. `sound` counts results that are watertight and manifold
//! where the input was; the distances are Hausdorff's, by 10,000 samples on either surface, as a share of the size. The time of
//! [`decimate`] is without that of its own measurement of the distance.
#![allow(clippy::print_stdout)]

mod inputs;

use graspbox_mesh::{CleanOptions, MeshError, TriMesh, check_manifold, clean, decimate, hausdorff};
use graspbox_objects::Family;
use inputs::{Named, folder, procedural, scanned};
use meshopt::{SimplifyOptions, simplify_decoder};
use std::time::Instant;

const TARGETS: [usize; 3] = [4000, 1000, 250];
const SAMPLES: usize = 10_000;
/// Objects with handles, walls, blades and many pieces.
const YCB: [&str; 10] = [
    "025_mug",
    "024_bowl",
    "035_power_drill",
    "030_fork",
    "011_banana",
    "029_plate",
    "037_scissors",
    "052_",
    "006_",
    "072-a",
];

fn main() -> Result<(), MeshError> {
    let mut groups = vec![("procedural", procedural(&Family::ALL, 0..2)?)];
    if let Some(folder) = folder() {
        groups.push(("YCB", scanned(&folder, &YCB)?));
    }
    println!(
        "| input | target faces | method | meshes | faces left (mean) | sound | distance max: median / worst | mean | ms |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for (name, meshes) in groups {
        for target in TARGETS {
            let meshes: Vec<&Named> = meshes.iter().filter(|m| m.1.faces().len() > 2 * target).collect();
            if meshes.is_empty() {
                continue;
            }
            report(name, target, "own", &meshes, |m| decimate(m, target).ok().map(|d| d.mesh))?;
            report(name, target, "meshopt", &meshes, |m| simplified(m, target, SimplifyOptions::empty()))?;
            report(name, target, "meshopt, regularized", &meshes, |m| {
                simplified(m, target, SimplifyOptions::Regularize)
            })?;
        }
    }
    Ok(())
}

/// meshoptimizer's result, in f32; vertices without faces are dropped.
fn simplified(mesh: &TriMesh, target: usize, options: SimplifyOptions) -> Option<TriMesh> {
    let indices: Vec<u32> = mesh.faces().iter().flatten().copied().collect();
    let vertices: Vec<[f32; 3]> = mesh.vertices().iter().map(|p| p.coords.map(|x| x as f32).into()).collect();
    let left = simplify_decoder(&indices, &vertices, 3 * target, f32::MAX, options, None);
    let small = TriMesh::new(mesh.vertices().to_vec(), left.as_chunks::<3>().0.to_vec()).ok()?;
    let keep = CleanOptions { weld: 0.0, min_component_area: 0.0, orient: false };
    clean(&small, &keep).ok().map(|c| c.0)
}

fn report(
    input: &str,
    target: usize,
    method: &str,
    meshes: &[&Named],
    reduce: impl Fn(&TriMesh) -> Option<TriMesh>,
) -> Result<(), MeshError> {
    let (mut far, mut mean, mut seconds, mut faces) = (Vec::new(), 0.0, 0.0, 0);
    let (mut sound, mut could) = (0, 0);
    for (name, mesh) in meshes {
        let begin = Instant::now();
        let Some(small) = reduce(mesh) else { continue };
        let reduced = Instant::now();
        let distance = hausdorff(mesh, &small, SAMPLES)?;
        let measuring = if method == "own" { reduced.elapsed().as_secs_f64() } else { 0.0 };
        seconds += (reduced - begin).as_secs_f64() - measuring;
        far.push((distance.max / mesh.extent(), name.as_str()));
        mean += distance.mean / mesh.extent();
        faces += small.faces().len();
        if check_manifold(mesh).is_ok() {
            could += 1;
            sound += usize::from(check_manifold(&small).is_ok());
        }
    }
    far.sort_by(|a, b| a.0.total_cmp(&b.0));
    let n = far.len() as f64;
    let (median, worst) = (far.get(far.len() / 2), far.last());
    let share = |f: Option<&(f64, &str)>| f.map_or(f64::NAN, |f| f.0);
    println!(
        "| {input} | {target} | {method} | {} | {:.0} | {sound} of {could} | {:.1e} / {:.1e} ({}) | {:.1e} | {:.1} |",
        far.len(),
        faces as f64 / n,
        share(median),
        share(worst),
        worst.map_or("", |w| w.1),
        mean / n,
        1e3 * seconds / n
    );
    Ok(())
}
