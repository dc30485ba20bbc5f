//! Values of a frame: those of msgpack, and numpy arrays.

/// Deepest nesting of a frame.
pub const MAX_DEPTH: usize = 32;
/// Most values in a frame, counted with keys; 40 bytes of memory each. The numbers of an array are not counted.
pub const MAX_VALUES: usize = 200_000;
/// The key that marks a map as an array.
pub(crate) const ARRAY: &str = "__ndarray__";
/// The key that marks a map as an array in shared memory: its offset.
pub(crate) const SHARED: &str = "__shm__";
/// The key that marks a map as a numpy scalar.
pub(crate) const SCALAR: &str = "__npgeneric__";

/// A frame that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CodecError {
    /// The frame ends inside a value.
    #[error("the frame ends after {length} bytes, inside a value")]
    Short {
        /// Bytes of the frame.
        length: usize,
    },
    /// Bytes follow the value.
    #[error("{extra} bytes follow the value; send one value in each frame")]
    Long { extra: usize },
    /// Nested too deeply.
    #[error("values are nested more than {MAX_DEPTH} deep")]
    Deep,
    /// Too many values.
    #[error("the frame holds more than {MAX_VALUES} values; send numbers as arrays")]
    Many,
    /// A value of an unsupported kind.
    #[error("the frame holds a value of msgpack type {marker:#04x}, which is not used here")]
    Unused {
        /// Its first byte.
        marker: u8,
    },
    /// Text that is not UTF-8, or a key that is neither text nor bytes.
    #[error("{what} is not UTF-8 text")]
    NotText {
        /// The text or key.
        what: &'static str,
    },
    /// An invalid array.
    #[error("an array {why}")]
    Array { why: String },
}

/// A type of number in an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dtype {
    /// `|b1`
    Bool,
    /// `|u1`
    U8,
    /// `|i1`
    I8,
    /// `<u2`
    U16,
    /// `<i2`
    I16,
    /// `<u4`
    U32,
    /// `<i4`
    I32,
    /// `<u8`
    U64,
    /// `<i8`
    I64,
    /// `<f4`
    F32,
    /// `<f8`
    F64,
}

impl Dtype {
    /// Every type.
    pub const ALL: [Self; 11] = [
        Self::Bool,
        Self::U8,
        Self::I8,
        Self::U16,
        Self::I16,
        Self::U32,
        Self::I32,
        Self::U64,
        Self::I64,
        Self::F32,
        Self::F64,
    ];

    /// numpy's name of it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bool => "|b1",
            Self::U8 => "|u1",
            Self::I8 => "|i1",
            Self::U16 => "<u2",
            Self::I16 => "<i2",
            Self::U32 => "<u4",
            Self::I32 => "<i4",
            Self::U64 => "<u8",
            Self::I64 => "<i8",
            Self::F32 => "<f4",
            Self::F64 => "<f8",
        }
    }

    /// Bytes of one number.
    pub fn size(self) -> usize {
        match self {
            Self::Bool | Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// The type of that name.
    ///
    /// # Errors
    /// Another name: objects, records, text and complex numbers are refused, and so are big-endian numbers.
    pub fn parse(name: &str) -> Result<Self, CodecError> {
        Self::ALL.into_iter().find(|dtype| dtype.name() == name).ok_or_else(|| CodecError::Array {
            why: format!("has the dtype {:?}; use little-endian numbers or bool", shorten(name)),
        })
    }
}

/// At most 40 characters of a text, for errors.
pub fn shorten(text: &str) -> &str {
    text.char_indices().nth(40).map_or(text, |(end, _)| &text[..end])
}

/// A numpy array; its bytes are those of the frame.
#[derive(Clone, Debug, PartialEq)]
pub struct NdArray<'a> {
    /// Type of its numbers.
    pub dtype: Dtype,
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// The numbers in C order, little-endian.
    pub data: &'a [u8],
}

/// An array in shared memory.
#[derive(Clone, Debug, PartialEq)]
pub struct SharedArray {
    /// Type of its numbers.
    pub dtype: Dtype,
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// Offset of its bytes.
    pub offset: u64,
    pub bytes: usize,
}

/// A value of a frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Value<'a> {
    /// Nothing.
    Nil,
    /// A truth value.
    Bool(bool),
    /// An integer of up to 64 bits.
    Integer(i128),
    Float(f64),
    Text(&'a str),
    Bytes(&'a [u8]),
    /// Values in order.
    List(Vec<Value<'a>>),
    /// Values by name, in the order of the frame.
    Map(Vec<(&'a str, Value<'a>)>),
    Array(NdArray<'a>),
    /// An array in shared memory.
    Shared(SharedArray),
}

impl<'a> Value<'a> {
    /// The value of that name in a map; none in anything else, or if it is nil.
    pub fn get(&self, name: &str) -> Option<&Value<'a>> {
        match self {
            Self::Map(entries) => entries.iter().find(|(key, _)| *key == name).map(|(_, value)| value),
            _ => None,
        }
        .filter(|value| !matches!(value, Self::Nil))
    }
}

impl NdArray<'_> {
    /// Number of entries.
    pub fn len(&self) -> usize {
        self.data.len() / self.dtype.size()
    }

    /// True without entries.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// The bits of entry `index`, zero-extended.
    fn bits(&self, index: usize) -> u64 {
        let size = self.dtype.size();
        let bytes = self.data.get(index * size..(index + 1) * size).unwrap_or_default();
        bytes.iter().rev().fold(0, |sum, byte| (sum << 8) | u64::from(*byte))
    }

    /// Entry `index` in C order; zero beyond the end.
    pub fn item(&self, index: usize) -> Value<'static> {
        let bits = self.bits(index);
        match self.dtype {
            Dtype::Bool => Value::Bool(bits != 0),
            Dtype::U8 | Dtype::U16 | Dtype::U32 | Dtype::U64 => Value::Integer(bits.into()),
            Dtype::I8 => Value::Integer((bits as i8).into()),
            Dtype::I16 => Value::Integer((bits as i16).into()),
            Dtype::I32 => Value::Integer((bits as i32).into()),
            Dtype::I64 => Value::Integer((bits as i64).into()),
            Dtype::F32 => Value::Float(f32::from_bits(bits as u32).into()),
            Dtype::F64 => Value::Float(f64::from_bits(bits)),
        }
    }
}

/// Element types of arrays.
pub trait Number: bytemuck::NoUninit {
    /// Their type.
    const DTYPE: Dtype;
}

macro_rules! numbers {
    ($($number:ty => $dtype:ident),*) => {$(
        impl Number for $number {
            const DTYPE: Dtype = Dtype::$dtype;
        }
    )*};
}

numbers!(bool => Bool, u8 => U8, u16 => U16, i64 => I64, f32 => F32, f64 => F64);

// Arrays are written in their memory layout.
const _: () = assert!(cfg!(target_endian = "little"), "the codec needs a little-endian machine");
