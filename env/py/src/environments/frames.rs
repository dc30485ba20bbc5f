//! Values of frames as Python objects, and back: arrays as numpy arrays, maps as dictionaries.

use crate::convert::array;
use crate::errors::CoreError;
use bytemuck::Pod;
use graspbox_server::wire::value::{Dtype, NdArray, SharedArray};
use graspbox_server::{Encoder, Value, segment};
use numpy::{Element, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyBytes, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use std::fs::File;
use std::io;

/// Greatest nesting of a value.
const MAX_DEPTH: usize = graspbox_server::wire::value::MAX_DEPTH;

/// A value as a Python object.
///
/// * `shared`: the shared memory that contains arrays.
///
/// # Errors
/// `ConnectionLostError` for shared memory that is missing.
pub fn to_python<'py>(py: Python<'py>, value: &Value<'_>, shared: Option<&File>) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::Nil => py.None().into_bound(py),
        Value::Bool(flag) => PyBool::new(py, *flag).to_owned().into_any(),
        Value::Integer(number) => number.into_pyobject(py)?.into_any(),
        Value::Float(number) => PyFloat::new(py, *number).into_any(),
        Value::Text(text) => PyString::new(py, text).into_any(),
        Value::Bytes(bytes) => PyBytes::new(py, bytes).into_any(),
        Value::List(items) => {
            let items = items.iter().map(|item| to_python(py, item, shared)).collect::<PyResult<Vec<_>>>()?;
            PyList::new(py, items)?.into_any()
        }
        Value::Map(entries) => {
            let dict = PyDict::new(py);
            for (key, item) in entries {
                dict.set_item(key, to_python(py, item, shared)?)?;
            }
            dict.into_any()
        }
        Value::Array(found) => numpy(py, found)?,
        Value::Shared(found) => in_segment(py, found, shared)?,
    })
}

/// A new array whose bytes `fill` writes.
fn fresh<'py, T: Element + Pod>(
    py: Python<'py>,
    shape: &[usize],
    fill: impl FnOnce(&mut [u8]) -> io::Result<()>,
) -> PyResult<Bound<'py, PyAny>> {
    let made = PyArrayDyn::<T>::zeros(py, shape, false);
    if let Ok(values) = made.readwrite().as_slice_mut() {
        fill(bytemuck::cast_slice_mut(values))?;
    }
    Ok(made.into_any())
}

/// An array of a type, whose bytes `fill` writes.
fn typed<'py>(
    py: Python<'py>,
    dtype: Dtype,
    shape: &[usize],
    fill: impl FnOnce(&mut [u8]) -> io::Result<()>,
) -> PyResult<Bound<'py, PyAny>> {
    match dtype {
        Dtype::Bool => {
            // Bytes other than 0 and 1 are invalid as bool, so each is checked.
            let mut bytes = vec![0; shape.iter().product()];
            fill(&mut bytes)?;
            Ok(array::<bool>(py, bytes.iter().map(|byte| *byte != 0).collect(), shape)?.into_any())
        }
        Dtype::U8 => fresh::<u8>(py, shape, fill),
        Dtype::I8 => fresh::<i8>(py, shape, fill),
        Dtype::U16 => fresh::<u16>(py, shape, fill),
        Dtype::I16 => fresh::<i16>(py, shape, fill),
        Dtype::U32 => fresh::<u32>(py, shape, fill),
        Dtype::I32 => fresh::<i32>(py, shape, fill),
        Dtype::U64 => fresh::<u64>(py, shape, fill),
        Dtype::I64 => fresh::<i64>(py, shape, fill),
        Dtype::F32 => fresh::<f32>(py, shape, fill),
        Dtype::F64 => fresh::<f64>(py, shape, fill),
    }
}

fn numpy<'py>(py: Python<'py>, found: &NdArray<'_>) -> PyResult<Bound<'py, PyAny>> {
    typed(py, found.dtype, &found.shape, |bytes| {
        bytes.copy_from_slice(found.data);
        Ok(())
    })
}

/// An array in shared memory, copied.
fn in_segment<'py>(py: Python<'py>, found: &SharedArray, shared: Option<&File>) -> PyResult<Bound<'py, PyAny>> {
    let lost = |why: String| CoreError::Connection(format!("the shared memory of the server cannot be read: {why}"));
    let file = shared.ok_or_else(|| lost("it was not opened".to_owned()))?;
    let made = typed(py, found.dtype, &found.shape, |bytes| segment::read(file, bytes, found.offset));
    made.map_err(|error| lost(error.to_string()).into())
}

/// Appends a Python object to a frame.
///
/// # Errors
/// `ConfigError`, naming `what`, for anything but None, bool, int, float, str, bytes, lists, tuples, dictionaries with text
/// keys, and numpy arrays and scalars of numbers.
pub fn write(frame: &mut Encoder, value: &Bound<'_, PyAny>, what: &str, depth: usize) -> PyResult<()> {
    if depth > MAX_DEPTH {
        return Err(CoreError::Config(format!("{what} is nested more than {MAX_DEPTH} deep")).into());
    }
    if value.is_none() {
        frame.nil();
    } else if let Ok(flag) = value.cast::<PyBool>() {
        frame.boolean(flag.is_true());
    } else if value.cast::<PyInt>().is_ok() {
        match (value.extract::<i64>(), value.extract::<u64>()) {
            (Ok(number), _) => frame.integer(number),
            (_, Ok(number)) => frame.unsigned(number),
            _ => return Err(CoreError::Config(format!("{what} is {value}; give an integer of 64 bits")).into()),
        }
    } else if let Ok(number) = value.cast::<PyFloat>() {
        frame.float(number.value());
    } else if let Ok(text) = value.cast::<PyString>() {
        frame.text(&text.to_cow()?);
    } else if let Ok(bytes) = value.cast::<PyBytes>() {
        frame.binary(bytes.as_bytes());
    } else if let Ok(dict) = value.cast::<PyDict>() {
        frame.map(dict.len());
        for (key, item) in dict {
            let key =
                key.cast::<PyString>().map_err(|_| CoreError::Config(format!("a key of {what} is not a string")))?;
            let key = key.to_cow()?.into_owned();
            frame.text(&key);
            write(frame, &item, &format!("{what}.{key}"), depth + 1)?;
        }
    } else if let Ok(items) = value.cast::<PyList>() {
        frame.list(items.len());
        for (index, item) in items.iter().enumerate() {
            write(frame, &item, &format!("{what}[{index}]"), depth + 1)?;
        }
    } else if let Ok(items) = value.cast::<PyTuple>() {
        write(frame, items.to_list().as_any(), what, depth)?;
    } else if let Ok(found) = value.cast::<PyUntypedArray>() {
        write_array(frame, found, what)?;
    } else {
        let kind = value.get_type().name()?;
        let wanted = "give numbers, texts, bytes, lists, dictionaries, or numpy arrays of numbers";
        return Err(CoreError::Config(format!("{what} is of type {kind}; {wanted}")).into());
    }
    Ok(())
}

fn write_array(frame: &mut Encoder, found: &Bound<'_, PyUntypedArray>, what: &str) -> PyResult<()> {
    let bad = |why: &str| CoreError::Config(format!("{what} {why}"));
    if !found.is_c_contiguous() {
        return Err(bad("is not C-contiguous; pass it through numpy.ascontiguousarray").into());
    }
    let dtype = found.dtype();
    let name = format!(
        "{}{}{}",
        char::from(dtype.byteorder()).to_string().replace('=', "<"),
        char::from(dtype.kind()),
        dtype.itemsize()
    );
    let dtype = Dtype::parse(&name).map_err(|error| bad(&format!("is an array that {}", tail(&error.to_string()))))?;
    let bytes = found.call_method0("tobytes")?;
    frame.array_bytes(dtype, found.shape(), bytes.cast::<PyBytes>()?.as_bytes());
    Ok(())
}

/// The part of a sentence after "an array".
fn tail(sentence: &str) -> &str {
    sentence.strip_prefix("an array ").unwrap_or(sentence)
}
