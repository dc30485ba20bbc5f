//! Writing a frame.

use crate::segment::{LEAST, Segment};
use crate::wire::value::{ARRAY, Dtype, Number, SHARED};
use rmp::encode as write;
use std::sync::Arc;

/// Writes a frame, value by value: a map of `n` entries is [`Encoder::map`] and then `n` times a key and a value.
#[derive(Default)]
pub struct Encoder {
    bytes: Vec<u8>,
    /// Shared memory for large arrays, and its used bytes.
    segment: Option<(Arc<Segment>, u64)>,
}

// Writing to a vector does not fail, so the results of `rmp` are dropped.
impl Encoder {
    /// Begins a frame of about `bytes` bytes.
    pub fn with_capacity(bytes: usize) -> Self {
        Self { bytes: Vec::with_capacity(bytes), segment: None }
    }

    /// Writes further large arrays into shared memory.
    pub fn share(&mut self, segment: Arc<Segment>) {
        self.segment = Some((segment, 0));
    }

    /// The frame.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// Appends the contents of another encoder.
    pub fn append(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// Begins a map.
    pub fn map(&mut self, entries: usize) {
        drop(write::write_map_len(&mut self.bytes, entries as u32));
    }

    /// Begins a list.
    pub fn list(&mut self, values: usize) {
        drop(write::write_array_len(&mut self.bytes, values as u32));
    }

    /// A text, or a key.
    pub fn text(&mut self, text: &str) {
        drop(write::write_str(&mut self.bytes, text));
    }

    pub fn binary(&mut self, bytes: &[u8]) {
        drop(write::write_bin(&mut self.bytes, bytes));
    }

    pub fn integer(&mut self, value: i64) {
        drop(write::write_sint(&mut self.bytes, value));
    }

    /// An integer that is not negative.
    pub fn unsigned(&mut self, value: u64) {
        drop(write::write_uint(&mut self.bytes, value));
    }

    pub fn float(&mut self, value: f64) {
        drop(write::write_f64(&mut self.bytes, value));
    }

    /// A truth value.
    pub fn boolean(&mut self, value: bool) {
        drop(write::write_bool(&mut self.bytes, value));
    }

    /// Nothing.
    pub fn nil(&mut self) {
        drop(write::write_nil(&mut self.bytes));
    }

    /// An array, in C order.
    pub fn array<T: Number>(&mut self, values: &[T], shape: &[usize]) {
        self.array_bytes(T::DTYPE, shape, bytemuck::cast_slice(values));
    }

    /// An array from its bytes.
    pub fn array_bytes(&mut self, dtype: Dtype, shape: &[usize], data: &[u8]) {
        if self.shared(dtype, shape, data) {
            return;
        }
        self.array_head(dtype, shape, data.len());
        self.bytes.extend_from_slice(data);
    }

    /// Writes a large array into shared memory; false if it belongs into the frame.
    fn shared(&mut self, dtype: Dtype, shape: &[usize], data: &[u8]) -> bool {
        let Some((segment, used)) = &mut self.segment else {
            return false;
        };
        if data.len() < LEAST || segment.write(data, *used).is_err() {
            return false;
        }
        let offset = *used;
        *used += data.len() as u64;
        self.map(4);
        self.binary(SHARED.as_bytes());
        self.unsigned(offset);
        self.head(dtype, shape);
        self.binary(b"bytes");
        self.unsigned(data.len() as u64);
        true
    }

    /// The header of an array, whose data must be appended next.
    fn array_head(&mut self, dtype: Dtype, shape: &[usize], length: usize) {
        self.map(4);
        self.binary(ARRAY.as_bytes());
        self.boolean(true);
        self.head(dtype, shape);
        self.binary(b"data");
        drop(write::write_bin_len(&mut self.bytes, length as u32));
    }

    fn head(&mut self, dtype: Dtype, shape: &[usize]) {
        self.binary(b"dtype");
        self.text(dtype.name());
        self.binary(b"shape");
        self.list(shape.len());
        shape.iter().for_each(|n| self.unsigned(*n as u64));
    }

    pub fn json(&mut self, value: &serde_json::Value) {
        use serde_json::Value as Json;
        match value {
            Json::Null => self.nil(),
            Json::Bool(value) => self.boolean(*value),
            Json::Number(number) => match (number.as_i64(), number.as_u64()) {
                (Some(value), _) => self.integer(value),
                (_, Some(value)) => self.unsigned(value),
                _ => self.float(number.as_f64().unwrap_or_default()),
            },
            Json::String(text) => self.text(text),
            Json::Array(values) => {
                self.list(values.len());
                values.iter().for_each(|value| self.json(value));
            }
            Json::Object(entries) => {
                self.map(entries.len());
                for (key, value) in entries {
                    self.text(key);
                    self.json(value);
                }
            }
        }
    }
}
