//! Reading a frame: copies no array, and bounds allocations.

use crate::wire::value::{
    ARRAY, CodecError, Dtype, MAX_DEPTH, MAX_VALUES, NdArray, SCALAR, SHARED, SharedArray, Value,
};
use rmp::Marker;

/// Most axes of an array, numpy's own limit.
const MAX_AXES: usize = 32;
/// Most values allocated before they are read.
const MAX_ROOM: usize = 256;
/// Largest array in shared memory, bytes.
const MAX_SHARED: usize = 1 << 30;

/// Reads a frame.
///
/// ```
/// use graspbox_server::{Encoder, Value, decode};
///
/// let mut frame = Encoder::default();
/// frame.map(1);
/// frame.text("id");
/// frame.integer(7);
/// let bytes = frame.into_bytes();
/// assert_eq!(decode(&bytes)?.get("id"), Some(&Value::Integer(7)));
/// # Ok::<(), graspbox_server::CodecError>(())
/// ```
///
/// # Errors
/// Anything but one value that fills the frame, within the bounds of this module.
pub fn decode(bytes: &[u8]) -> Result<Value<'_>, CodecError> {
    let mut reader = Reader { rest: bytes, length: bytes.len(), values: 0 };
    let value = reader.value(0)?;
    match reader.rest.len() {
        0 => Ok(value),
        extra => Err(CodecError::Long { extra }),
    }
}

/// The number at the start of an answer, without reading the rest; none if it starts otherwise.
pub fn leading_id(frame: &[u8]) -> Option<u64> {
    let mut reader = Reader { rest: frame, length: frame.len(), values: 0 };
    let byte = reader.take(1).ok()?[0];
    match Marker::from_u8(byte) {
        Marker::FixMap(_) => {}
        Marker::Map16 => drop(reader.take(2).ok()?),
        _ => return None,
    }
    match (reader.value(1).ok()?, reader.value(1).ok()?) {
        (Value::Text("id"), Value::Integer(id)) => u64::try_from(id).ok(),
        _ => None,
    }
}

struct Reader<'a> {
    rest: &'a [u8],
    length: usize,
    values: usize,
}

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], CodecError> {
        let (head, rest) = self.rest.split_at_checked(count).ok_or(CodecError::Short { length: self.length })?;
        self.rest = rest;
        Ok(head)
    }

    /// A big-endian unsigned number of `size` bytes.
    fn number(&mut self, size: usize) -> Result<u64, CodecError> {
        Ok(self.take(size)?.iter().fold(0, |sum, byte| (sum << 8) | u64::from(*byte)))
    }

    fn count(&mut self, size: usize) -> Result<usize, CodecError> {
        // A length beyond the address space counts as a truncated frame, like any other that is too large.
        Ok(usize::try_from(self.number(size)?).unwrap_or(usize::MAX))
    }

    fn value(&mut self, depth: usize) -> Result<Value<'a>, CodecError> {
        self.values += 1;
        if self.values > MAX_VALUES {
            return Err(CodecError::Many);
        }
        if depth > MAX_DEPTH {
            return Err(CodecError::Deep);
        }
        let byte = self.take(1)?[0];
        Ok(match Marker::from_u8(byte) {
            Marker::Null => Value::Nil,
            Marker::True => Value::Bool(true),
            Marker::False => Value::Bool(false),
            Marker::FixPos(n) => Value::Integer(n.into()),
            Marker::FixNeg(n) => Value::Integer(n.into()),
            Marker::U8 => Value::Integer(self.number(1)?.into()),
            Marker::U16 => Value::Integer(self.number(2)?.into()),
            Marker::U32 => Value::Integer(self.number(4)?.into()),
            Marker::U64 => Value::Integer(self.number(8)?.into()),
            Marker::I8 => Value::Integer((self.number(1)? as i8).into()),
            Marker::I16 => Value::Integer((self.number(2)? as i16).into()),
            Marker::I32 => Value::Integer((self.number(4)? as i32).into()),
            Marker::I64 => Value::Integer((self.number(8)? as i64).into()),
            Marker::F32 => Value::Float(f32::from_bits(self.number(4)? as u32).into()),
            Marker::F64 => Value::Float(f64::from_bits(self.number(8)?)),
            Marker::FixStr(n) => self.text(n.into())?,
            Marker::Str8 => self.sized(1, Self::text)?,
            Marker::Str16 => self.sized(2, Self::text)?,
            Marker::Str32 => self.sized(4, Self::text)?,
            Marker::Bin8 => self.sized(1, Self::bytes)?,
            Marker::Bin16 => self.sized(2, Self::bytes)?,
            Marker::Bin32 => self.sized(4, Self::bytes)?,
            Marker::FixArray(n) => self.list(n.into(), depth)?,
            Marker::Array16 => self.sized(2, |reader, n| reader.list(n, depth))?,
            Marker::Array32 => self.sized(4, |reader, n| reader.list(n, depth))?,
            Marker::FixMap(n) => self.map(n.into(), depth)?,
            Marker::Map16 => self.sized(2, |reader, n| reader.map(n, depth))?,
            Marker::Map32 => self.sized(4, |reader, n| reader.map(n, depth))?,
            _ => return Err(CodecError::Unused { marker: byte }),
        })
    }

    fn sized<T>(
        &mut self,
        size: usize,
        read: impl FnOnce(&mut Self, usize) -> Result<T, CodecError>,
    ) -> Result<T, CodecError> {
        let count = self.count(size)?;
        read(self, count)
    }

    fn text(&mut self, count: usize) -> Result<Value<'a>, CodecError> {
        let bytes = self.take(count)?;
        Ok(Value::Text(std::str::from_utf8(bytes).map_err(|_| CodecError::NotText { what: "a text" })?))
    }

    fn bytes(&mut self, count: usize) -> Result<Value<'a>, CodecError> {
        Ok(Value::Bytes(self.take(count)?))
    }

    /// Capacity for the first of `count` values, limited by the rest of the frame. Every level of nesting allocates before its values
    /// are read.
    fn room(&self, count: usize) -> usize {
        count.min(self.rest.len()).min(MAX_ROOM)
    }

    fn list(&mut self, count: usize, depth: usize) -> Result<Value<'a>, CodecError> {
        let mut values = Vec::with_capacity(self.room(count));
        for _ in 0..count {
            values.push(self.value(depth + 1)?);
        }
        Ok(Value::List(values))
    }

    fn map(&mut self, count: usize, depth: usize) -> Result<Value<'a>, CodecError> {
        let mut entries = Vec::with_capacity(self.room(count) / 2);
        for _ in 0..count {
            let key = match self.value(depth + 1)? {
                Value::Text(key) => key,
                Value::Bytes(key) => {
                    std::str::from_utf8(key).map_err(|_| CodecError::NotText { what: "a key of a map" })?
                }
                _ => return Err(CodecError::NotText { what: "a key of a map" }),
            };
            entries.push((key, self.value(depth + 1)?));
        }
        let value = Value::Map(entries);
        if value.get(ARRAY) == Some(&Value::Bool(true)) {
            return Ok(Value::Array(array(&value)?));
        }
        if value.get(SHARED).is_some() {
            return shared(&value);
        }
        if value.get(SCALAR) == Some(&Value::Bool(true)) {
            return scalar(&value);
        }
        Ok(value)
    }
}

fn wrong(why: impl Into<String>) -> CodecError {
    CodecError::Array { why: why.into() }
}

fn typed<'a>(map: &Value<'a>) -> Result<(Dtype, &'a [u8]), CodecError> {
    let (Some(Value::Bytes(data)), Some(Value::Text(name))) = (map.get("data"), map.get("dtype")) else {
        return Err(wrong("lacks its data or its dtype; give data as bytes and dtype as text, such as \"<f4\""));
    };
    Ok((Dtype::parse(name)?, data))
}

fn array<'a>(map: &Value<'a>) -> Result<NdArray<'a>, CodecError> {
    let (dtype, data) = typed(map)?;
    let shape = shape(map)?;
    if bytes(dtype, &shape) != Some(data.len()) {
        return Err(wrong(format!("of shape {shape:?} and dtype {} has {} bytes of data", dtype.name(), data.len())));
    }
    Ok(NdArray { dtype, shape, data })
}

/// Bytes of an array; none if they exceed the address space, also without its empty axes, which numpy refuses.
fn bytes(dtype: Dtype, shape: &[usize]) -> Option<usize> {
    let most = shape.iter().try_fold(dtype.size(), |bytes, n| bytes.checked_mul((*n).max(1)));
    most.filter(|bytes| isize::try_from(*bytes).is_ok()).map(|bytes| if shape.contains(&0) { 0 } else { bytes })
}

fn shared<'a>(map: &Value<'a>) -> Result<Value<'a>, CodecError> {
    let (Some(Value::Integer(offset)), Some(Value::Text(name))) = (map.get(SHARED), map.get("dtype")) else {
        return Err(wrong("in shared memory lacks its offset or its dtype"));
    };
    let (dtype, shape) = (Dtype::parse(name)?, shape(map)?);
    let offset = u64::try_from(*offset).map_err(|_| wrong("in shared memory has no offset"))?;
    let bytes = bytes(dtype, &shape).filter(|bytes| *bytes <= MAX_SHARED);
    let bytes = bytes.ok_or_else(|| wrong(format!("in shared memory of shape {shape:?} is too large")))?;
    Ok(Value::Shared(SharedArray { dtype, shape, offset, bytes }))
}

fn shape(map: &Value<'_>) -> Result<Vec<usize>, CodecError> {
    let Some(Value::List(sizes)) = map.get("shape") else {
        return Err(wrong("lacks its shape; give a list of sizes"));
    };
    if sizes.len() > MAX_AXES {
        return Err(wrong(format!("has {} axes; at most {MAX_AXES} are possible", sizes.len())));
    }
    let size = |value: &Value<'_>| match value {
        Value::Integer(n) => usize::try_from(*n).map_err(|_| wrong(format!("has an axis of length {n}"))),
        _ => Err(wrong("has an axis whose length is no integer")),
    };
    sizes.iter().map(size).collect()
}

/// A numpy scalar, as a plain value.
fn scalar<'a>(map: &Value<'a>) -> Result<Value<'a>, CodecError> {
    // openpi writes the number, others its bytes.
    if let Some(value @ (Value::Bool(_) | Value::Integer(_) | Value::Float(_))) = map.get("data") {
        return Ok(value.clone());
    }
    let (dtype, data) = typed(map)?;
    let one = NdArray { dtype, shape: Vec::new(), data };
    if data.len() != dtype.size() {
        return Err(wrong(format!("scalar of dtype {} has {} bytes of data", dtype.name(), data.len())));
    }
    Ok(one.item(0))
}
