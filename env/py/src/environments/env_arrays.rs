//! Results of environments as arrays by name.

use crate::convert::{Array, array};
use crate::errors::CoreError;
use graspbox_gym::observations::info::{INFO, InfoArray};
use graspbox_gym::rewards::reward::TERM_COUNT;
use graspbox_gym::{Batch, EnvSpec};
use graspbox_render::Pixels;
use numpy::{Element, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// A batch as arrays by name; observations are written into the arrays of `out` if it has them.
pub fn arrays<'py>(
    py: Python<'py>,
    spec: &EnvSpec,
    batch: Batch,
    out: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyDict>> {
    let rows = batch.len();
    let dict = PyDict::new(py);
    for (observation, values) in spec.observations.iter().zip(batch.observations) {
        let name = spec.config.shown_name(observation.observation.name());
        let given = out.map(|out| out.get_item(name)).transpose()?.flatten();
        let found = match given {
            Some(given) => filled(given.cast_into::<PyArrayDyn<f32>>()?, name, &values, rows)?,
            None => array(py, values, &[rows, observation.size])?,
        };
        dict.set_item(name, found)?;
    }
    images(py, spec, batch.images, rows, &dict, out)?;
    dict.set_item("terms", array(py, batch.terms, &[rows, TERM_COUNT])?)?;
    let flags = [("terminated", batch.terminated), ("truncated", batch.truncated), ("reset", batch.reset)];
    for (name, values) in flags {
        dict.set_item(name, array(py, values, &[rows])?)?;
    }
    let envs = batch.envs.iter().map(|env| *env as i64).collect();
    dict.set_item("env", array::<i64>(py, envs, &[rows])?)?;
    dict.set_item("info", infos(py, spec, batch.info, rows)?)?;
    Ok(dict)
}

/// The entries of the info as arrays by name.
fn infos<'py>(py: Python<'py>, spec: &EnvSpec, info: Vec<InfoArray>, rows: usize) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (row, values) in INFO.iter().zip(info).filter(|(row, _)| row.is_in(spec)) {
        match values {
            InfoArray::Flags(values) => dict.set_item(row.name, array(py, values, &[rows])?)?,
            InfoArray::Numbers(values) => dict.set_item(row.name, array(py, values, &[rows])?)?,
            InfoArray::Indices(values) => dict.set_item(row.name, array(py, values, &[rows])?)?,
        }
    }
    Ok(dict)
}

/// Writes `values` into the caller's array.
fn filled<'py, T: Element + Copy>(
    given: Bound<'py, PyArrayDyn<T>>,
    name: &str,
    values: &[T],
    rows: usize,
) -> PyResult<Array<'py, T>> {
    let wrong = || {
        let size = values.len() / rows.max(1);
        CoreError::Config(format!(
            "out[{name:?}] has shape {:?}; give a writeable C-contiguous array of {rows} rows of {size} numbers",
            given.shape()
        ))
    };
    let mut target = given.try_readwrite().map_err(|_| wrong())?;
    match target.as_slice_mut() {
        Ok(slice) if slice.len() == values.len() && given.is_c_contiguous() => slice.copy_from_slice(values),
        _ => return Err(wrong().into()),
    }
    drop(target);
    Ok(given)
}

/// Adds images as arrays by name to `dict`; they are written into the arrays of `out` if it has them.
fn images<'py>(
    py: Python<'py>,
    spec: &EnvSpec,
    images: Vec<Pixels>,
    rows: usize,
    dict: &Bound<'py, PyDict>,
    out: Option<&Bound<'py, PyDict>>,
) -> PyResult<()> {
    for (table, pixels) in spec.observer.tables().iter().zip(images) {
        let [a, b, c] = table.shape;
        let (shape, name) = ([rows, a, b, c], spec.config.shown_name(&table.name));
        match pixels {
            Pixels::Bytes(values) => put(py, dict, out, name, values, shape)?,
            Pixels::Floats(values) => put(py, dict, out, name, values, shape)?,
        }
    }
    Ok(())
}

fn put<'py, T: Element + Copy>(
    py: Python<'py>,
    dict: &Bound<'py, PyDict>,
    out: Option<&Bound<'py, PyDict>>,
    name: &str,
    values: Vec<T>,
    shape: [usize; 4],
) -> PyResult<()> {
    let given = out.map(|out| out.get_item(name)).transpose()?.flatten();
    let found = match given {
        Some(given) => filled(given.cast_into::<PyArrayDyn<T>>()?, name, &values, shape[0])?,
        None => array(py, values, &shape)?,
    };
    dict.set_item(name, found)
}
