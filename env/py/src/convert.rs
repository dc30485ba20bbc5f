//! Conversion of arrays between numpy and the core, with all checks of shapes and numbers, and of configs, which [`graspbox_gym::json`] reads.
//!
//! Input arrays must be C-contiguous float64, which the public functions of `graspbox` ensure. Output arrays are new.

use crate::errors::CoreError;
use graspbox_hand::rigid_motion;
use nalgebra::{Isometry3, Matrix3, Point3};
use numpy::{Element, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// An output array.
pub type Array<'py, T> = Bound<'py, PyArrayDyn<T>>;
/// An input array of float64, of any shape.
pub type Floats<'py> = PyReadonlyArrayDyn<'py, f64>;

/// A config from a dict of numbers, text, lists and dicts; errors name it `what`.
///
/// It is read by way of [`serde_json::Value`], which is strict about types (pythonize by itself accepts any object as a
/// bool) and is where errors look up the invalid value. Numbers keep their bits.
///
/// # Errors
/// As [`graspbox_gym::json::config_of`].
pub fn read_config<T: DeserializeOwned>(config: &Bound<'_, PyAny>, what: &str) -> Result<T, CoreError> {
    let value = pythonize::depythonize(config).map_err(|error| CoreError::Config(format!("{what}: {error}")))?;
    Ok(graspbox_gym::json::config_of(&value, what)?)
}

/// A value as numbers, text, lists and dicts: tuples become lists.
pub fn to_python<'py, T: Serialize>(py: Python<'py>, value: &T) -> PyResult<Bound<'py, PyAny>> {
    let value = serde_json::to_value(value).map_err(|error| CoreError::Internal(error.to_string()))?;
    Ok(pythonize::pythonize(py, &value)?)
}

/// The entries of `array`, which must have the shape `shape`; `None` allows any length.
///
/// # Errors
/// Another shape, or an array that is not C-contiguous.
pub fn entries<'a, T: Element>(
    array: &'a PyReadonlyArrayDyn<'_, T>,
    what: &str,
    shape: &[Option<usize>],
) -> Result<&'a [T], CoreError> {
    let have = array.shape();
    let fits =
        have.len() == shape.len() && shape.iter().zip(have).all(|(want, have)| want.is_none_or(|want| want == *have));
    if !fits {
        let want: Vec<String> = shape.iter().map(|n| n.map_or("n".into(), |n| n.to_string())).collect();
        return Err(CoreError::Config(format!("{what} has shape {have:?}; give ({})", want.join(", "))));
    }
    let layout = || CoreError::Config(format!("{what} is not C-contiguous; pass it through numpy.ascontiguousarray"));
    if !array.is_c_contiguous() {
        return Err(layout());
    }
    array.as_slice().map_err(|_| layout())
}

/// As [`entries`], for numbers that must be finite.
pub fn values<'a>(array: &'a Floats<'_>, what: &str, shape: &[Option<usize>]) -> Result<&'a [f64], CoreError> {
    let values = entries(array, what, shape)?;
    match values.iter().position(|x| !x.is_finite()) {
        Some(index) => {
            let value = values[index];
            Err(CoreError::Config(format!("{what} holds {value} at flat index {index}; give finite numbers")))
        }
        None => Ok(values),
    }
}

/// Triples of indices, shape (n, 3).
pub fn triples(array: &PyReadonlyArrayDyn<'_, u32>, what: &str) -> Result<Vec<[u32; 3]>, CoreError> {
    Ok(entries(array, what, &[None, Some(3)])?.as_chunks::<3>().0.to_vec())
}

/// The side and the flags of a cube, shape (n, n, n).
pub fn cube(array: &PyReadonlyArrayDyn<'_, bool>, what: &str) -> Result<(usize, Vec<bool>), CoreError> {
    let side = array.shape().first().copied();
    let entries = entries(array, what, &[side, side, side])?;
    let mut flags = Vec::new();
    let full =
        |_| CoreError::Config(format!("memory for {what} could not be allocated; {} bytes are needed", entries.len()));
    flags.try_reserve_exact(entries.len()).map_err(full)?;
    flags.extend_from_slice(entries);
    Ok((side.unwrap_or(0), flags))
}

/// A seed; Python's integers have no bounds.
pub fn seed(value: i128) -> Result<u64, CoreError> {
    u64::try_from(value).map_err(|_| CoreError::Config(format!("seed is {value}; give an integer in [0, 2^64)")))
}

/// A vector, shape (n,).
pub fn vector(array: &Floats<'_>, what: &str) -> Result<Vec<f64>, CoreError> {
    values(array, what, &[None]).map(<[f64]>::to_vec)
}

/// A point, shape (3,).
pub fn point(array: &Floats<'_>, what: &str) -> Result<Point3<f64>, CoreError> {
    values(array, what, &[Some(3)]).map(Point3::from_slice)
}

/// Points, shape (n, 3).
pub fn points(array: &Floats<'_>, what: &str) -> Result<Vec<Point3<f64>>, CoreError> {
    let values = values(array, what, &[None, Some(3)])?;
    Ok(values.as_chunks::<3>().0.iter().map(|&p| Point3::from(p)).collect())
}

/// A rigid motion, shape (4, 4), row-major and homogeneous.
pub fn isometry(array: &Floats<'_>, what: &str) -> Result<Isometry3<f64>, CoreError> {
    rigid(values(array, what, &[Some(4), Some(4)])?, what)
}

/// Rigid transforms, shape (n, 4, 4).
pub fn isometries(array: &Floats<'_>, what: &str) -> Result<Vec<Isometry3<f64>>, CoreError> {
    let values = values(array, what, &[None, Some(4), Some(4)])?;
    let name = |i| format!("{what}[{i}]");
    values.chunks_exact(16).enumerate().map(|(i, m)| rigid(m, &name(i))).collect()
}

/// Which of `poses` (n, 4, 4) are rigid motions: flags (n,).
#[pyfunction]
pub fn is_rigid<'py>(py: Python<'py>, poses: Floats<'_>) -> PyResult<Array<'py, bool>> {
    let (matrices, _) = entries(&poses, "poses", &[None, Some(4), Some(4)])?.as_chunks::<16>();
    array(py, matrices.iter().map(|rows| rigid_motion(rows).is_some()).collect(), &[matrices.len()])
}

fn rigid(rows: &[f64], what: &str) -> Result<Isometry3<f64>, CoreError> {
    rows.try_into().ok().and_then(rigid_motion).ok_or_else(|| {
        CoreError::Config(format!(
            "{what} is not a rigid motion; give a rotation matrix, a translation column and the last row 0 0 0 1"
        ))
    })
}

/// The homogeneous matrix of `pose`, row-major.
fn rows(pose: &Isometry3<f64>) -> [f64; 16] {
    let matrix = pose.to_homogeneous();
    std::array::from_fn(|i| matrix[(i / 4, i % 4)])
}

/// A new array of the given shape; `values` in C order.
pub fn array<'py, T: Element>(py: Python<'py>, values: Vec<T>, shape: &[usize]) -> PyResult<Array<'py, T>> {
    PyArray1::from_vec(py, values).reshape(shape.to_vec())
}

/// (4, 4).
pub fn matrix<'py>(py: Python<'py>, pose: &Isometry3<f64>) -> PyResult<Array<'py, f64>> {
    array(py, rows(pose).to_vec(), &[4, 4])
}

/// (n, 4, 4).
pub fn matrices<'py>(
    py: Python<'py>,
    poses: impl ExactSizeIterator<Item = Isometry3<f64>>,
) -> PyResult<Array<'py, f64>> {
    let count = poses.len();
    array(py, poses.flat_map(|p| rows(&p)).collect(), &[count, 4, 4])
}

/// (n, k, 4, 4): n rows of k poses, one after the other.
pub fn matrix_rows<'py>(py: Python<'py>, poses: &[Isometry3<f64>], shape: [usize; 2]) -> PyResult<Array<'py, f64>> {
    array(py, poses.iter().flat_map(rows).collect(), &[shape[0], shape[1], 4, 4])
}

/// (n, N), one row per item.
pub fn table<'py, T: Element, const N: usize>(
    py: Python<'py>,
    items: impl ExactSizeIterator<Item = [T; N]>,
) -> PyResult<Array<'py, T>> {
    let count = items.len();
    array(py, items.flatten().collect(), &[count, N])
}

/// The entries of a matrix in row-major order.
pub fn row_major(matrix: &Matrix3<f64>) -> [f64; 9] {
    std::array::from_fn(|i| matrix[(i / 3, i % 3)])
}
