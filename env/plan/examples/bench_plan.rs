//! Prints how long the three box goals take, in milliseconds, as the median of several runs.

use graspbox_mesh::TriMesh;
use graspbox_plan::{DecomposeParams, Fit, SplitCost, best_split, decompose, decompose_points, fit_box};
use nalgebra::{Point3, Vector3};
use std::error::Error;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let points = kettle(2000);
    let bounds = fit_box(&points, Fit::Minimum)?;
    let with = |fit| DecomposeParams {
        fit,
        max_boxes: 8,
        ..DecomposeParams::default()
    };
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
    println!(
        "total volume: PCA {:.6}, minimum {:.6} m3",
        pca.volume(),
        least.volume()
    );
    let ball = ball(64);
    println!(
        "minimum-volume decomposition of a mesh, {} faces: {:.1} ms",
        ball.faces().len(),
        median(5, || decompose(&ball, &with(Fit::Minimum)))
    );
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

/// A ball of 8 cm with `rings` by `2 rings` quadrilaterals.
fn ball(rings: u32) -> TriMesh {
    let columns = 2 * rings;
    let vertex = |i: u32, j: u32| {
        let (st, ct) = (std::f64::consts::PI * f64::from(i) / f64::from(rings)).sin_cos();
        let (sp, cp) = (std::f64::consts::TAU * f64::from(j) / f64::from(columns)).sin_cos();
        Point3::new(0.04 * st * cp, 0.04 * st * sp, 0.04 * ct)
    };
    let vertices = (0..=rings)
        .flat_map(|i| (0..columns).map(move |j| vertex(i, j)))
        .collect();
    let faces = (0..rings)
        .flat_map(|i| (0..columns).map(move |j| (i * columns + j, i * columns + (j + 1) % columns)))
        .flat_map(|(a, b)| [[a, a + columns, b], [b, a + columns, b + columns]])
        .collect();
    #[allow(clippy::unwrap_used)]
    TriMesh::new(vertices, faces).unwrap()
}
