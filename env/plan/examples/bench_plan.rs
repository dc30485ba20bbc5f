//! Times boxes, filter and plan: the median of several runs.

use graspbox_hand::Hand;
use graspbox_mesh::{Mass, TriMesh, convex_hull, default_pose, mass_properties};
use graspbox_objects::{Family, generate};
use graspbox_plan::{
    CollisionScene, DecomposeParams, Feasibility, Fit, Obstacle, OpenHand, PlanObject, PlanParams, SplitCost,
    best_split, decompose, decompose_points, fit_box, plan,
};
use nalgebra::{Point3, Vector3};
use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let points = kettle(2000);
    let bounds = fit_box(&points, Fit::Minimum)?;
    let with = |fit| DecomposeParams { fit, max_boxes: 8, ..DecomposeParams::default() };
    println!(
        "best split, 2,000 points: {:.3} ms (goal 0.6)",
        median(31, || best_split(&points, &bounds, SplitCost::Share))
    );
    let pca = decompose_points(&points, &with(Fit::Pca))?;
    println!(
        "PCA decomposition, 2,000 points, {} boxes: {:.2} ms (goal 4)",
        pca.boxes().len(),
        median(11, || decompose_points(&points, &with(Fit::Pca)))
    );
    let least = decompose_points(&points, &with(Fit::Minimum))?;
    println!(
        "minimum-volume decomposition, 2,000 points, {} boxes: {:.1} ms (goal 150)",
        least.boxes().len(),
        median(5, || decompose_points(&points, &with(Fit::Minimum)))
    );
    println!("total volume: PCA {:.6}, minimum {:.6} m3", pca.volume(), least.volume());
    let mug = generate(Family::Mug, 0)?;
    println!(
        "minimum-volume decomposition of a mesh, {} faces: {:.1} ms",
        mug.mesh.faces().len(),
        median(5, || decompose(&mug.mesh, &with(Fit::Minimum)))
    );
    bench_filter(&mug.mesh, mug.parts.as_deref().unwrap_or_default(), mug.mass)?;
    Ok(())
}

/// Median of `runs` timings, milliseconds.
fn median<T>(runs: usize, mut work: impl FnMut() -> T) -> f64 {
    let mut times: Vec<f64> = (0..runs)
        .map(|_| {
            let start = Instant::now();
            std::hint::black_box(work());
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[runs / 2]
}

/// The collision filter, and the whole plan, on one object.
fn bench_filter(mesh: &TriMesh, parts: &[Vec<Point3<f64>>], mass: f64) -> Result<(), Box<dyn Error>> {
    let hand = Hand::reflex()?;
    let world_from_object = default_pose(mesh);
    let center_of_mass = mass_properties(mesh, Mass::Kilograms(mass))?.center_of_mass;
    let parts = parts.iter().map(|points| convex_hull(points)).collect::<Result<Vec<_>, _>>()?;
    let obstacle = Arc::new(Obstacle::new(mesh, &parts)?);
    let object =
        PlanObject { mesh, obstacle: &obstacle, center_of_mass, world_from_object, neighbours: Arc::default() };
    let params = PlanParams::default();
    let made = plan(&object, hand, &params)?;
    let scene = CollisionScene::new(Arc::clone(&obstacle), &world_from_object);
    let open = OpenHand::new(hand, 0.0, params.clearance, params.standoff)?;
    let filter = median(5, || {
        made.candidates
            .iter()
            .filter(|c| scene.check(&open, &c.grasp.object_from_hand) == Feasibility::Feasible)
            .count()
    });
    let whole = median(5, || plan(&object, hand, &params));
    let count = made.candidates.len();
    println!("collision filter, one thread: {:.0} poses/s", count as f64 / filter * 1e3);
    println!("whole plan, {count} candidates, {} feasible: {whole:.0} ms", made.feasible);
    Ok(())
}

/// Points on a kettle-like shape: a round body, a spout and a handle.
fn kettle(count: usize) -> Vec<Point3<f64>> {
    let golden = 2.399_963_229_728_653;
    (0..count)
        .map(|i| {
            let t = (i as f64 + 0.5) / count as f64;
            let angle = golden * i as f64;
            let (sin, cos) = angle.sin_cos();
            match i % 8 {
                0 => Point3::new(0.08 + 0.09 * t, 0.012 * cos, 0.02 + 0.11 * t + 0.012 * sin),
                1 => {
                    let (s, c) = (t * 3.0 - 1.5).sin_cos();
                    let ring = Vector3::new(c, 0.0, s) * (0.055 + 0.008 * cos) + Vector3::new(0.0, 0.008 * sin, 0.0);
                    Point3::new(-0.07 - ring.x, ring.y, 0.07 + ring.z)
                }
                _ => {
                    let z = 2.0 * t - 1.0;
                    let r = 0.085 * (1.0 - z * z * 0.6).sqrt();
                    Point3::new(r * cos, r * sin, 0.08 + 0.08 * z)
                }
            }
        })
        .collect()
}
