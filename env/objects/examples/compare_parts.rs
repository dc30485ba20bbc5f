//! Own convex decomposition against VHACD (of parry, f64) and CoACD on thin-walled, open objects.
//!
//! ```text
//! cargo run --release -p graspbox-objects --features compare --example compare_parts -- FOLDER_OF_YCB_STL_FILES OUT
//! python env/objects/examples/compare_parts_coacd.py OUT     # needs `pip install coacd`
//! ```
//!
//! The first run writes the meshes to the folder OUT; CoACD writes its parts there, and a second run with the third argument
//! `CoACD` prints only those rows.
//! Every method is measured by [`graspbox_mesh::measure_parts`]; distances are in millimetres, `volume` is the sum of the
//! parts' volumes over that of the object.
#![allow(clippy::print_stdout)]

mod inputs;

use graspbox_mesh::{MeshError, PartsParams, TriMesh, convex_hull, convex_parts, measure_parts, write_obj};
use graspbox_objects::Family;
use inputs::{Named, folder, procedural, scanned};
use nalgebra::Point3;
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::vhacd::{VHACD, VHACDParameters};
use serde::Deserialize;
use std::path::Path;
use std::time::Instant;

const OPEN: [Family; 5] = [Family::Mug, Family::Cup, Family::Bowl, Family::Plate, Family::WineGlass];
const OPEN_YCB: [&str; 6] = ["025_mug", "024_bowl", "065-a_cups", "065-g_cups", "029_plate", "019_pitcher_base"];

fn main() -> Result<(), MeshError> {
    let mut meshes = procedural(&OPEN, 0..2)?;
    if let Some(folder) = folder() {
        meshes.extend(scanned(&folder, &OPEN_YCB)?);
    }
    let out = std::env::args_os().nth(2);
    println!("| object | method | parts | overfill max / mean | underfill max / mean | volume | s |");
    println!("|---|---|---|---|---|---|---|");
    for named in &meshes {
        compare(named, out.as_deref().map(Path::new))?;
    }
    Ok(())
}

fn compare((name, mesh): &Named, out: Option<&Path>) -> Result<(), MeshError> {
    if std::env::args().nth(3).is_none_or(|method| method != "CoACD") {
        without_coacd(name, mesh)?;
    }
    let Some(out) = out else { return Ok(()) };
    let path = out.join(format!("{name}.obj"));
    write_obj(&path, mesh)?;
    for row in from_coacd(&path.with_extension("coacd.json"))? {
        let clouds = row.parts.iter().map(|part| part.iter().map(|p| Point3::from(*p)).collect());
        print(name, &row.label, mesh, &hulls(clouds), row.seconds);
    }
    Ok(())
}

fn without_coacd(name: &str, mesh: &TriMesh) -> Result<(), MeshError> {
    let begin = Instant::now();
    let own = convex_parts(mesh, &PartsParams::default(), None)?;
    print(name, "own, at most 48 parts", mesh, &own.parts, begin.elapsed().as_secs_f64());
    for (label, resolution, concavity, most) in
        [("VHACD, its defaults", 64, 0.01, 1024), ("VHACD, 256 voxels, at most 48 parts", 256, 0.001, 48)]
    {
        let begin = Instant::now();
        let parameters =
            VHACDParameters { resolution, concavity, max_convex_hulls: most, ..VHACDParameters::default() };
        let points: Vec<Vector> = mesh.vertices().iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
        let parts = VHACD::decompose(&parameters, &points, mesh.faces(), false).compute_convex_hulls(4);
        let clouds = parts.iter().map(|(v, _)| v.iter().map(|v| Point3::new(v.x, v.y, v.z)).collect());
        print(name, label, mesh, &hulls(clouds), begin.elapsed().as_secs_f64());
    }
    Ok(())
}

/// Parts that `compare_parts_coacd.py` wrote.
#[derive(Deserialize)]
struct Row {
    label: String,
    seconds: f64,
    parts: Vec<Vec<[f64; 3]>>,
}

fn from_coacd(path: &Path) -> Result<Vec<Row>, MeshError> {
    let Ok(text) = std::fs::read_to_string(path) else { return Ok(Vec::new()) };
    serde_json::from_str(&text).map_err(|e| MeshError::Io { path: path.to_path_buf(), source: e.into() })
}

/// Hulls of the clouds; flat ones have none.
fn hulls(clouds: impl Iterator<Item = Vec<Point3<f64>>>) -> Vec<TriMesh> {
    clouds.filter_map(|cloud| convex_hull(&cloud).ok()).collect()
}

fn print(name: &str, method: &str, mesh: &TriMesh, parts: &[TriMesh], seconds: f64) {
    let r = measure_parts(mesh, parts, PartsParams::default().max_error);
    let pair = |a: f64, b: f64| format!("{:.2} / {:.3}", 1e3 * a, 1e3 * b);
    println!(
        "| {name} | {method} | {} | {} | {} | {:.2} | {seconds:.2} |",
        r.parts,
        pair(r.overfill_max, r.overfill_mean),
        pair(r.underfill_max, r.underfill_mean),
        r.volume / mesh.signed_volume(),
    );
}
