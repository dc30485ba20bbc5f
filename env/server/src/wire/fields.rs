//! The fields of a command, read with errors that name them.

use crate::wire::fault::Fault;
use crate::wire::value::{Dtype, MAX_VALUES, NdArray, Value, shorten};
use serde_json::{Map, Number};

/// Longest text of a command, bytes.
pub const MAX_TEXT: usize = 4096;

/// The fields of a map.
pub struct Fields<'v, 'a> {
    entries: &'v [(&'a str, Value<'a>)],
}

/// A field of another type.
pub fn wrong(name: &str, wanted: &str) -> Fault {
    Fault::config(name, format!("the field '{name}' has another type; give {wanted}"))
}

impl<'v, 'a> Fields<'v, 'a> {
    /// The fields of a value.
    ///
    /// # Errors
    /// Anything but a map.
    pub fn new(value: &'v Value<'a>) -> Result<Self, Fault> {
        match value {
            Value::Map(entries) => Ok(Self { entries }),
            _ => Err(Fault::config("", "a command is a map, such as {id: 1, command: 'reset'}; this frame is none")),
        }
    }

    /// Checks that all fields are in `known`.
    ///
    /// # Errors
    /// The first unknown or repeated field.
    pub fn only(&self, known: &[&str]) -> Result<(), Fault> {
        for (index, (name, _)) in self.entries.iter().enumerate() {
            if !known.contains(name) {
                let fields = known.join(", ");
                let message = format!("this command has no field '{}'; its fields are {fields}", shorten(name));
                return Err(Fault::config(shorten(name), message));
            }
            if self.entries[..index].iter().any(|(other, _)| other == name) {
                return Err(Fault::config(*name, format!("the field '{name}' is there twice; give it once")));
            }
        }
        Ok(())
    }

    /// The value of a field; none if it is missing or nil.
    pub fn get(&self, name: &str) -> Option<&'v Value<'a>> {
        let found = self.entries.iter().find(|(key, _)| *key == name).map(|(_, value)| value);
        found.filter(|value| !matches!(value, Value::Nil))
    }

    fn needed(&self, name: &str) -> Result<&'v Value<'a>, Fault> {
        self.get(name).ok_or_else(|| Fault::config(name, format!("the field '{name}' is missing; give it")))
    }

    /// A text.
    ///
    /// # Errors
    /// Another type, or a text of more than [`MAX_TEXT`] bytes.
    pub fn text(&self, name: &str) -> Result<&'a str, Fault> {
        match self.needed(name)? {
            Value::Text(text) if text.len() <= MAX_TEXT => Ok(text),
            Value::Text(_) => Err(wrong(name, "a text of at most 4096 bytes")),
            _ => Err(wrong(name, "a text")),
        }
    }

    /// A natural number; none if it is missing.
    ///
    /// # Errors
    /// Another type, a negative number, or one beyond 64 bits.
    pub fn natural(&self, name: &str) -> Result<Option<u64>, Fault> {
        self.get(name).map(|value| natural(value, name)).transpose()
    }

    /// A required natural number.
    ///
    /// # Errors
    /// As [`Fields::natural`], or a missing one.
    pub fn index(&self, name: &str) -> Result<usize, Fault> {
        index(self.needed(name)?, name)
    }

    /// Indices; none if they are missing.
    ///
    /// # Errors
    /// Anything but a list or an array of integers that are not negative.
    pub fn indices(&self, name: &str) -> Result<Option<Vec<usize>>, Fault> {
        let Some(value) = self.get(name) else {
            return Ok(None);
        };
        items(value, name)?.iter().map(|item| index(item, name)).collect::<Result<_, _>>().map(Some)
    }

    /// Truth values; none if they are missing.
    ///
    /// # Errors
    /// Anything but a list or an array of truth values.
    pub fn flags(&self, name: &str) -> Result<Option<Vec<bool>>, Fault> {
        let Some(value) = self.get(name) else {
            return Ok(None);
        };
        let flag = |item: &Value<'_>| match item {
            Value::Bool(flag) => Ok(*flag),
            _ => Err(wrong(name, "an array of bool")),
        };
        items(value, name)?.iter().map(flag).collect::<Result<_, _>>().map(Some)
    }

    /// A truth value; false if it is missing.
    ///
    /// # Errors
    /// Another type.
    pub fn flag(&self, name: &str) -> Result<bool, Fault> {
        match self.get(name) {
            None => Ok(false),
            Some(Value::Bool(flag)) => Ok(*flag),
            Some(_) => Err(wrong(name, "true or false")),
        }
    }

    /// A number; 0 if it is missing.
    ///
    /// # Errors
    /// Another type.
    pub fn number(&self, name: &str) -> Result<f64, Fault> {
        self.get(name).map_or(Ok(0.0), |value| float(value).ok_or_else(|| wrong(name, "a number")))
    }

    /// Bytes.
    ///
    /// # Errors
    /// Another type.
    pub fn bytes(&self, name: &str) -> Result<&'a [u8], Fault> {
        match self.needed(name)? {
            Value::Bytes(bytes) => Ok(bytes),
            _ => Err(wrong(name, "bytes")),
        }
    }

    /// Rows of numbers as float32, and the length of a row.
    ///
    /// # Errors
    /// Anything but an array (n, m) of float32 or float64, or a list of lists of numbers of one length.
    pub fn rows(&self, name: &str) -> Result<(Vec<f32>, usize), Fault> {
        let bad = || wrong(name, "an array (environments, numbers) of float32");
        match self.needed(name)? {
            Value::Array(NdArray { dtype: Dtype::F32, shape, data }) if shape.len() == 2 => {
                Ok((bytemuck::pod_collect_to_vec(data), shape[1]))
            }
            Value::Array(array) if array.shape.len() == 2 && array.dtype == Dtype::F64 => Ok((
                bytemuck::pod_collect_to_vec::<u8, f64>(array.data).iter().map(|x| *x as f32).collect(),
                array.shape[1],
            )),
            Value::List(rows) => {
                let (mut numbers, mut width) = (Vec::new(), None);
                for row in rows {
                    let Value::List(row) = row else { return Err(bad()) };
                    if *width.get_or_insert(row.len()) != row.len() {
                        return Err(bad());
                    }
                    for item in row {
                        numbers.push(float(item).ok_or_else(bad)? as f32);
                    }
                }
                Ok((numbers, width.unwrap_or(0)))
            }
            _ => Err(bad()),
        }
    }
}

fn float(value: &Value<'_>) -> Option<f64> {
    match value {
        Value::Float(number) => Some(*number),
        Value::Integer(number) => Some(*number as f64),
        _ => None,
    }
}

/// A natural number of 64 bits.
///
/// # Errors
/// Anything else.
pub fn natural(value: &Value<'_>, name: &str) -> Result<u64, Fault> {
    match value {
        Value::Integer(number) => u64::try_from(*number).map_err(|_| {
            Fault::config(name, format!("{name} is {number} (int); give an integer that is not negative"))
        }),
        _ => Err(wrong(name, "an integer that is not negative")),
    }
}

fn index(value: &Value<'_>, name: &str) -> Result<usize, Fault> {
    Ok(usize::try_from(natural(value, name)?).unwrap_or(usize::MAX))
}

/// The items of a list, or of an array of one axis.
///
/// # Errors
/// Anything else.
pub fn items<'a>(value: &Value<'a>, name: &str) -> Result<Vec<Value<'a>>, Fault> {
    match value {
        Value::List(items) => Ok(items.clone()),
        // Each entry becomes a value, which takes 64 times the memory of a byte.
        Value::Array(array) if array.len() > MAX_VALUES => Err(wrong(name, "at most 200000 entries")),
        Value::Array(array) if array.shape.len() == 1 => Ok((0..array.len()).map(|i| array.item(i)).collect()),
        _ => Err(wrong(name, "a list")),
    }
}

/// A value as JSON.
///
/// # Errors
/// Bytes, arrays, numbers that are not finite, and texts of more than [`MAX_TEXT`] bytes.
pub fn json(value: &Value<'_>, name: &str) -> Result<serde_json::Value, Fault> {
    use serde_json::Value as Json;
    Ok(match value {
        Value::Nil => Json::Null,
        Value::Bool(flag) => Json::Bool(*flag),
        Value::Integer(number) => {
            Json::Number(Number::from_i128(*number).ok_or_else(|| wrong(name, "an integer of at most 64 bits"))?)
        }
        Value::Float(number) => Json::Number(Number::from_f64(*number).ok_or_else(|| wrong(name, "a finite number"))?),
        Value::Text(text) if text.len() <= MAX_TEXT => Json::String((*text).to_owned()),
        Value::List(items) => Json::Array(items.iter().map(|item| json(item, name)).collect::<Result<_, _>>()?),
        Value::Map(entries) => {
            let pair = |(key, value): &(&str, Value<'_>)| match key.len() <= MAX_TEXT {
                true => Ok(((*key).to_owned(), json(value, name)?)),
                false => Err(wrong(name, "keys of at most 4096 bytes")),
            };
            Json::Object(entries.iter().map(pair).collect::<Result<Map<_, _>, Fault>>()?)
        }
        Value::Text(_) | Value::Bytes(_) | Value::Array(_) | Value::Shared(_) => {
            return Err(wrong(name, "numbers, short texts, lists and maps; no bytes and no arrays"));
        }
    })
}
