//! Values of frames as Python objects, and back: arrays as numpy arrays, maps as dictionaries.

use crate::convert::array;
use crate::errors::CoreError;
use graspbox_server::value::{Dtype, NdArray, SharedArray};
use graspbox_server::{Encoder, Value, segment};
use numpy::{PyArrayDescrMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyBytes, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use std::fs::File;

/// Deepest nesting of what is written.
const MAX_DEPTH: usize = graspbox_server::value::MAX_DEPTH;

/// A value as a Python object.
///
/// * `shared`: where arrays in shared memory lie.
///
/// # Errors
/// Memory that is not there.
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

fn numpy<'py>(py: Python<'py>, found: &NdArray<'_>) -> PyResult<Bound<'py, PyAny>> {
    fn of<'py, T: numpy::Element + bytemuck::Pod>(py: Python<'py>, found: &NdArray<'_>) -> PyResult<Bound<'py, PyAny>> {
        Ok(array(py, bytemuck::pod_collect_to_vec::<u8, T>(found.data), &found.shape)?.into_any())
    }
    match found.dtype {
        Dtype::Bool => {
            let flags = found.data.iter().map(|byte| *byte != 0).collect();
            Ok(array::<bool>(py, flags, &found.shape)?.into_any())
        }
        Dtype::U8 => of::<u8>(py, found),
        Dtype::I8 => of::<i8>(py, found),
        Dtype::U16 => of::<u16>(py, found),
        Dtype::I16 => of::<i16>(py, found),
        Dtype::U32 => of::<u32>(py, found),
        Dtype::I32 => of::<i32>(py, found),
        Dtype::U64 => of::<u64>(py, found),
        Dtype::I64 => of::<i64>(py, found),
        Dtype::F32 => of::<f32>(py, found),
        Dtype::F64 => of::<f64>(py, found),
    }
}

/// An array in shared memory, copied.
fn in_segment<'py>(py: Python<'py>, found: &SharedArray, shared: Option<&File>) -> PyResult<Bound<'py, PyAny>> {
    let lost = |why: String| CoreError::Connection(format!("the shared memory of the server cannot be read: {why}"));
    let file = shared.ok_or_else(|| lost("it was not opened".to_owned()))?;
    let count = found.bytes / found.dtype.size();
    fn of<'py, T: numpy::Element + bytemuck::Pod>(
        py: Python<'py>,
        file: &File,
        found: &SharedArray,
        count: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        let mut values = vec![T::zeroed(); count];
        segment::read(file, bytemuck::cast_slice_mut(&mut values), found.offset)?;
        Ok(array(py, values, &found.shape)?.into_any())
    }
    let made = match found.dtype {
        Dtype::U8 => of::<u8>(py, file, found, count),
        Dtype::U16 => of::<u16>(py, file, found, count),
        Dtype::I64 => of::<i64>(py, file, found, count),
        Dtype::F32 => of::<f32>(py, file, found, count),
        Dtype::F64 => of::<f64>(py, file, found, count),
        _ => Err(lost(format!("it holds an array of {}", found.dtype.name())).into()),
    };
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
            let key = key.cast::<PyString>().map_err(|_| CoreError::Config(format!("a key of {what} is no text")))?;
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

/// What follows "an array" in a sentence.
fn tail(sentence: &str) -> &str {
    sentence.strip_prefix("an array ").unwrap_or(sentence)
}
