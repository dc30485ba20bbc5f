//! Positions and indices: bounds are checked once per accessor, before anything is allocated for it.

use super::buffers::Buffers;
use super::document::{Accessor, Document};
use super::{malformed, missing};
use crate::error::MeshError;
use nalgebra::Point3;

/// Accessors of one primitive.
pub(super) struct Accessors<'a> {
    pub document: &'a Document,
    /// Whether the primitive is compressed.
    pub is_packed: bool,
}

impl<'a> Accessors<'a> {
    /// Number of values.
    pub fn count(&self, index: usize) -> Result<usize, MeshError> {
        let count = self.accessor(index)?.count;
        // Indices are u32.
        u32::try_from(count)
            .map(|count| count as usize)
            .map_err(|_| malformed(format!("accessor {index}: count {count}")))
    }

    pub fn indices(&self, index: usize, buffers: &mut Buffers) -> Result<Vec<u32>, MeshError> {
        let values = self.values(index, "SCALAR", buffers)?;
        if !matches!(values.kind, Kind::U8 | Kind::U16 | Kind::U32) {
            return Err(malformed(format!("accessor {index} holds no vertex indices")));
        }
        Ok((0..values.count).map(|i| values.kind.read(values.at(i)) as u32).collect())
    }

    pub fn positions<'b>(&self, index: usize, buffers: &'b mut Buffers) -> Result<Values<'b>, MeshError> {
        self.values(index, "VEC3", buffers)
    }

    fn accessor(&self, index: usize) -> Result<&'a Accessor, MeshError> {
        self.document.accessors.get(index).ok_or_else(|| missing("accessor", index))
    }

    fn values<'b>(&self, index: usize, kind: &str, buffers: &'b mut Buffers) -> Result<Values<'b>, MeshError> {
        let it = self.accessor(index)?;
        if it.kind != kind {
            return Err(malformed(format!("accessor {index} holds {:?} where {kind} is expected", it.kind)));
        }
        let component = Kind::of(it.component_type)
            .ok_or_else(|| malformed(format!("accessor {index} has the componentType {}", it.component_type)))?;
        let packed = || malformed("its meshes are compressed (Draco or meshopt); export it again without compression");
        let Some(view_index) = it.buffer_view.filter(|_| it.sparse.is_none()) else {
            return Err(if self.is_packed {
                packed()
            } else {
                malformed(format!("accessor {index} is sparse or empty"))
            });
        };
        let view = self.document.buffer_views.get(view_index).ok_or_else(|| missing("bufferView", view_index))?;
        if view.is_packed() {
            return Err(packed());
        }
        let size = component.bytes() * if kind == "VEC3" { 3 } else { 1 };
        let stride = view.byte_stride.unwrap_or(size);
        let count = self.count(index)?;
        let end = (count as u64).saturating_sub(1).saturating_mul(stride).saturating_add(size);
        let end = if count == 0 { 0 } else { it.byte_offset.saturating_add(end) };
        if end > view.byte_length || stride < size {
            return Err(malformed(format!("accessor {index} is larger than its bufferView")));
        }
        let bytes = buffers.view(view)?;
        let values = bytes.get(it.byte_offset as usize..).unwrap_or_default();
        let normalized = it.normalized && !matches!(component, Kind::F32);
        Ok(Values { bytes: values, stride: stride as usize, count, kind: component, normalized })
    }
}

/// Values in a buffer.
pub(super) struct Values<'a> {
    bytes: &'a [u8],
    stride: usize,
    pub count: usize,
    kind: Kind,
    normalized: bool,
}

impl Values<'_> {
    /// A position, if there is one.
    pub fn get(&self, index: usize) -> Option<Point3<f64>> {
        let bytes = (index < self.count).then(|| self.at(index))?;
        let size = self.kind.bytes() as usize;
        let factor = if self.normalized { self.kind.unit() } else { 1.0 };
        // A normalised signed integer has two forms of -1.
        let lowest = if self.normalized { -1.0 } else { f64::NEG_INFINITY };
        let read = |axis: usize| (self.kind.read(&bytes[axis * size..]) * factor).max(lowest);
        Some(Point3::new(read(0), read(1), read(2)))
    }

    fn at(&self, index: usize) -> &[u8] {
        &self.bytes[index * self.stride..]
    }
}

/// Type of a component.
#[derive(Clone, Copy)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Kind {
    fn of(component_type: u32) -> Option<Self> {
        let kinds = [(5120, Self::I8), (5121, Self::U8), (5122, Self::I16), (5123, Self::U16), (5125, Self::U32)];
        let known = kinds.into_iter().chain([(5126, Self::F32)]).find(|(code, _)| *code == component_type);
        known.map(|(_, kind)| kind)
    }

    fn bytes(self) -> u64 {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// What a normalised integer is multiplied by (KHR_mesh_quantization).
    fn unit(self) -> f64 {
        match self {
            Self::I8 => 1.0 / f64::from(i8::MAX),
            Self::U8 => 1.0 / f64::from(u8::MAX),
            Self::I16 => 1.0 / f64::from(i16::MAX),
            Self::U16 => 1.0 / f64::from(u16::MAX),
            Self::U32 | Self::F32 => 1.0,
        }
    }

    /// The value at the start of `bytes`, little-endian.
    fn read(self, bytes: &[u8]) -> f64 {
        match self {
            Self::I8 => f64::from(bytes[0] as i8),
            Self::U8 => f64::from(bytes[0]),
            Self::I16 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
            Self::U16 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            Self::U32 => f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
            Self::F32 => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        }
    }
}
