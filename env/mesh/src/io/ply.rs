//! PLY: `vertex` x, y, z and `face` vertex_indices (or vertex_index); other elements and properties are skipped.

use super::format::{LoadOptions, MeshFormat, Raw, check_count};
use crate::error::MeshError;
use nalgebra::Point3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};
use std::io::{BufRead, Cursor, ErrorKind};

/// Longest header, bytes; a real one has a few hundred (comments included).
const MAX_HEADER: usize = 1 << 16;

pub(super) fn parse(bytes: &[u8], options: &LoadOptions) -> Result<Raw, MeshError> {
    let head = &bytes[..bytes.len().min(MAX_HEADER)];
    if !head.windows(10).any(|w| w == b"end_header") {
        let detail = format!("no end_header within its first {} bytes", head.len());
        return Err(MeshError::Truncated { format: "PLY", detail });
    }
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = Parser::<Corner>::new().read_header(&mut reader).map_err(explain)?;
    check_header(&header, bytes.len() as u64, options)?;
    let mut raw = Raw::default();
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => raw.vertices = read_vertices(&mut reader, element, &header)?,
            "face" => read_faces(&mut reader, element, &header, &mut raw, options)?,
            _ => {
                // Parsed only to skip it.
                let skipped: Vec<Skipped> = read_element(&mut reader, element, &header)?;
                drop(skipped);
            }
        }
    }
    Ok(raw)
}

/// Holds every count against the limits and against the bytes that its element needs at least.
fn check_header(header: &Header, bytes: u64, options: &LoadOptions) -> Result<(), MeshError> {
    for (name, element) in &header.elements {
        let count = element.count as u64;
        match name.as_str() {
            "vertex" => check_count(MeshFormat::Ply, "vertices", count, options.max_vertices)?,
            "face" => check_count(MeshFormat::Ply, "faces", count, options.max_faces)?,
            _ => {}
        }
        let each: u64 = element.properties.iter().map(|(_, p)| least_bytes(&p.data_type, header.encoding)).sum();
        if each == 0 && count > 0 {
            return Err(malformed(format!("element {name} has no properties")));
        }
        if count.saturating_mul(each) > bytes + 1 {
            let detail = format!("{count} of element {name} need at least {each} bytes each, but the file has {bytes}");
            return Err(MeshError::Truncated { format: "PLY", detail });
        }
    }
    for (element, properties) in [("vertex", ["x", "y", "z"].as_slice()), ("face", &[])] {
        let Some(found) = header.elements.get(element) else {
            return Err(malformed(format!("it has no element {element}")));
        };
        if let Some(missing) = properties.iter().find(|&&p| !found.properties.contains_key(p)) {
            return Err(malformed(format!("its vertices have no {missing}")));
        }
    }
    Ok(())
}

/// Fewest bytes that one value can take.
fn least_bytes(kind: &PropertyType, encoding: Encoding) -> u64 {
    if encoding == Encoding::Ascii {
        return 2; // a digit and a space
    }
    let (PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) = kind;
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

fn read_element<E: PropertyAccess>(
    reader: &mut Reader<impl BufRead>,
    element: &ElementDef,
    header: &Header,
) -> Result<Vec<E>, MeshError> {
    Parser::<E>::new().read_payload_for_element(reader, element, header).map_err(explain)
}

fn read_vertices(
    reader: &mut Reader<impl BufRead>,
    element: &ElementDef,
    header: &Header,
) -> Result<Vec<Point3<f64>>, MeshError> {
    let corners: Vec<Corner> = read_element(reader, element, header)?;
    Ok(corners.into_iter().map(|c| Point3::from(c.0)).collect())
}

fn read_faces(
    reader: &mut Reader<impl BufRead>,
    element: &ElementDef,
    header: &Header,
    raw: &mut Raw,
    options: &LoadOptions,
) -> Result<(), MeshError> {
    let faces: Vec<Polygon> = read_element(reader, element, header)?;
    for (i, face) in faces.iter().enumerate() {
        if face.bad_index {
            return Err(malformed(format!("face {i} names a negative vertex")));
        }
        raw.push_polygon(MeshFormat::Ply, i, &face.corners, options)?;
    }
    Ok(())
}

/// A vertex; properties other than x, y, z are ignored.
struct Corner([f64; 3]);

impl PropertyAccess for Corner {
    fn new() -> Self {
        // A coordinate that is declared as a list stays NaN, which is refused later.
        Self([f64::NAN; 3])
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        let axis = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            _ => return PropertyAccessResult::Ignored,
        };
        self.0[axis] = match value {
            Property::Float(v) => f64::from(v),
            Property::Double(v) => v,
            Property::Char(v) => f64::from(v),
            Property::UChar(v) => f64::from(v),
            Property::Short(v) => f64::from(v),
            Property::UShort(v) => f64::from(v),
            Property::Int(v) => f64::from(v),
            Property::UInt(v) => f64::from(v),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// A face; only its list of corners is kept.
#[derive(Default)]
struct Polygon {
    corners: Vec<u32>,
    bad_index: bool,
}

impl Polygon {
    fn fill<T>(&mut self, list: Vec<T>)
    where
        u32: TryFrom<T>,
    {
        self.corners.clear();
        for corner in list {
            match u32::try_from(corner) {
                Ok(index) => self.corners.push(index),
                Err(_) => self.bad_index = true,
            }
        }
    }
}

impl PropertyAccess for Polygon {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        if name != "vertex_indices" && name != "vertex_index" {
            return PropertyAccessResult::Ignored;
        }
        match value {
            Property::ListInt(list) => self.fill(list),
            Property::ListUInt(list) => self.fill(list),
            Property::ListChar(list) => self.fill(list),
            Property::ListUChar(list) => self.fill(list),
            Property::ListShort(list) => self.fill(list),
            Property::ListUShort(list) => self.fill(list),
            _ => return PropertyAccessResult::UnsupportedType,
        }
        PropertyAccessResult::Set
    }
}

/// An element of no interest.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}

fn malformed(detail: String) -> MeshError {
    MeshError::Malformed { format: "PLY", detail }
}

fn explain(e: ParseError) -> MeshError {
    // The message may quote a whole line of a hostile file.
    let detail: String = e.to_string().chars().take(300).collect();
    match e.kind() {
        ErrorKind::UnexpectedEof => MeshError::Truncated { format: "PLY", detail },
        _ => malformed(detail),
    }
}
