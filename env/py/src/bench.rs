//! Timings of operations that are too short to be timed through Python.

use crate::convert::{Array, array, seed as checked};
use crate::episode::Scene;
use crate::errors::CoreError;
use crate::gil::detached;
use crate::mesh::Mesh;
use graspbox_episode::{Episode, SuccessCriterion};
use graspbox_mesh::sample_surface;
use graspbox_plan::{Fit, SplitCost, best_split, fit_box};
use nalgebra::{Isometry3, Point3, Translation3};
use pyo3::prelude::*;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

/// Duration of each of `repeats` runs of `work`, seconds.
fn time(repeats: usize, mut work: impl FnMut()) -> Vec<f64> {
    let mut seconds = Vec::with_capacity(repeats);
    for _ in 0..repeats {
        let started = Instant::now();
        work();
        seconds.push(started.elapsed().as_secs_f64());
    }
    seconds
}

/// Times the best split of `points` surface points, sampled with `seed`, in their PCA box, seconds (repeats,).
#[pyfunction]
#[pyo3(name = "_time_best_split")]
pub fn time_best_split<'py>(
    py: Python<'py>,
    mesh: &Mesh,
    points: usize,
    repeats: usize,
    seed: i128,
) -> PyResult<Array<'py, f64>> {
    let (data, seed) = (Arc::clone(&mesh.0), checked(seed)?);
    let seconds = detached(py, Some(1), move || {
        let samples = sample_surface(&data.spec.mesh, points, seed);
        let points: Vec<Point3<f64>> = samples.iter().map(|s| s.point).collect();
        let bounds = fit_box(&points, Fit::Pca)?;
        Ok::<_, CoreError>(time(repeats, || {
            black_box(best_split(&points, &bounds, SplitCost::Share));
        }))
    })?;
    array(py, seconds, &[repeats])
}

/// Times the reset of an episode, seconds (repeats,).
#[pyfunction]
#[pyo3(name = "_time_reset")]
pub fn time_reset<'py>(py: Python<'py>, scene: &Scene, repeats: usize) -> PyResult<Array<'py, f64>> {
    let core = Arc::clone(&scene.core);
    let away: Isometry3<f64> = Translation3::new(0.0, 0.0, 1.0).into();
    let seconds = detached(py, Some(1), move || {
        Ok::<_, CoreError>(time(repeats, || {
            black_box(Episode::reset(&core, &away, 0.0, SuccessCriterion::default()));
        }))
    })?;
    array(py, seconds, &[repeats])
}
