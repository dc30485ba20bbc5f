//! Procedural objects by family and seed.

use crate::convert;
use crate::errors::CoreError;
use crate::gil::detached;
use crate::mesh::{Mesh, MeshData};
use graspbox_episode::ObjectSpec;
use graspbox_objects::{Family, generate};
use nalgebra::Point3;
use pyo3::prelude::*;
use std::sync::Arc;

/// The family of that name.
///
/// # Errors
/// `ConfigError` for an unknown name.
pub fn family(name: &str) -> Result<Family, CoreError> {
    name.parse().map_err(|error: graspbox_objects::UnknownFamily| CoreError::Config(error.to_string()))
}

/// Names of the families.
#[pyfunction]
pub fn procedural_families() -> Vec<&'static str> {
    Family::ALL.iter().map(|f| f.name()).collect()
}

/// Makes object `seed` of a family, `scale` times as large; `mass` in kilograms, by default the family's times `scale` cubed.
#[pyfunction]
#[pyo3(signature = (family_name, seed, scale, mass))]
pub fn procedural(py: Python<'_>, family_name: &str, seed: i128, scale: f64, mass: Option<f64>) -> PyResult<Mesh> {
    let (family, seed) = (family(family_name)?, convert::seed(seed)?);
    if !(scale.is_finite() && scale > 0.0) {
        return Err(CoreError::Config(format!("scale is {scale}; give a positive factor")).into());
    }
    let data = detached(py, None, move || {
        let made = generate(family, seed)?;
        let grow = |part: Vec<Point3<f64>>| part.iter().map(|p| p * scale).collect();
        MeshData::new(ObjectSpec {
            name: made.name,
            mesh: made.mesh.scaled(scale),
            mass: Some(mass.unwrap_or(made.mass * scale.powi(3))),
            parts: made.parts.map(|parts| parts.into_iter().map(grow).collect()),
        })
    })?;
    Ok(Mesh(Arc::new(data)))
}
