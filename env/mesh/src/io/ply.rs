//! PLY: `vertex` x, y, z and `face` vertex_indices (or vertex_index); other elements and properties are skipped.
//!
//! `ply-rs-bw` reads headers and binary values.

mod text;

use super::format::{LoadOptions, MeshFormat, Raw, check_count};
use super::text::{Words, numbered, quote};
use crate::error::MeshError;
use nalgebra::Point3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};
use std::io::{BufRead, ErrorKind};

/// Longest header, bytes; a real one has a few hundred (comments included).
const MAX_HEADER: usize = 1 << 16;
/// First words of the lines of a header that count.
const KEYWORDS: [&[u8]; 5] = [b"ply", b"format", b"element", b"property", b"end_header"];
/// Fewest bytes of a triangle in a binary file. Some writers append a short note; where a face would fit, a count may be wrong.
const BINARY_FACE: usize = 13;

/// Reads one mesh after the other, into one.
pub(super) fn parse(bytes: &[u8], options: &LoadOptions) -> Result<Raw, MeshError> {
    let mut raw = Raw::default();
    let mut rest = parse_one(bytes, 0, &mut raw, options)?;
    raw.end_mesh()?;
    while rest.starts_with(b"ply") {
        rest = parse_one(rest, lines_before(bytes, rest), &mut raw, options)?;
        raw.end_mesh()?;
    }
    Ok(raw)
}

/// Reads the mesh at the start of `bytes`, behind `lines` lines of its file; returns what follows it.
fn parse_one<'a>(bytes: &'a [u8], lines: usize, raw: &mut Raw, options: &LoadOptions) -> Result<&'a [u8], MeshError> {
    let (lines_of_header, mut rest) = split(bytes)?;
    let header = Parser::<Corner>::new().read_header(&mut Reader::new(lines_of_header.as_slice())).map_err(explain)?;
    check_header(&header, bytes.len() as u64, raw, options)?;
    if header.encoding == Encoding::Ascii {
        let before = lines + lines_before(bytes, rest);
        let mut values = numbered(rest).map(|(n, line)| (n + before, line));
        text::read(&mut values, &header, raw, options)?;
        return match values.find(|(_, line)| !line.trim_ascii().is_empty()) {
            None => Ok(&[]),
            // A header begins.
            Some((n, line)) if line.trim_ascii() == b"ply" => Ok(from_line(rest, n - before)),
            Some((n, line)) => Err(Words::new(MeshFormat::Ply, n, line).error(format!(
                "\"{}\" follows the elements that the header names; correct its counts or delete it",
                quote(line.trim_ascii())
            ))),
        };
    }
    read_binary(&mut rest, &header, raw, options)?;
    let rest = rest.trim_ascii_start();
    if rest.len() >= BINARY_FACE && !rest.starts_with(b"ply") {
        let detail = format!("{} bytes follow the elements that its header names; export it again", rest.len());
        return Err(malformed(detail));
    }
    Ok(rest)
}

/// The header, with an empty line for each that begins with no keyword (some writers put notes there), and what follows it.
fn split(bytes: &[u8]) -> Result<(Vec<u8>, &[u8]), MeshError> {
    let head = &bytes[..bytes.len().min(MAX_HEADER)];
    let (mut header, mut size) = (Vec::new(), 0);
    for line in head.split_inclusive(|&b| b == b'\n') {
        let word = line.trim_ascii().split(u8::is_ascii_whitespace).next().unwrap_or_default();
        let known = KEYWORDS.contains(&word);
        header.extend_from_slice(if known { line } else { b"comment skipped\n" });
        size += line.len();
        if word == b"end_header" {
            return Ok((header, &bytes[size..]));
        }
    }
    let detail = format!("no end_header within its first {} bytes", head.len());
    Err(MeshError::Truncated { format: "PLY", detail })
}

/// The number of lines of `bytes` before its part `rest`, which reaches to the end.
fn lines_before(bytes: &[u8], rest: &[u8]) -> usize {
    bytes[..bytes.len() - rest.len()].iter().filter(|&&b| b == b'\n').count()
}

/// The text from line `line` on, counted from 1.
fn from_line(text: &[u8], line: usize) -> &[u8] {
    let mut breaks = text.iter().enumerate().filter(|(_, b)| **b == b'\n').map(|(at, _)| at + 1);
    line.checked_sub(2).and_then(|n| breaks.nth(n)).map_or(text, |at| &text[at..])
}

fn read_binary(bytes: &mut &[u8], header: &Header, raw: &mut Raw, options: &LoadOptions) -> Result<(), MeshError> {
    let mut reader = Reader::new(bytes);
    let base = raw.vertices.len() as u32;
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => {
                let corners: Vec<Corner> = read_element(&mut reader, element, header)?;
                raw.vertices.extend(corners.into_iter().map(|c| Point3::from(c.0)));
            }
            "face" => read_faces(&mut reader, element, header, base, raw, options)?,
            _ => {
                // Parsed only to skip it.
                let skipped: Vec<Skipped> = read_element(&mut reader, element, header)?;
                drop(skipped);
            }
        }
    }
    Ok(())
}

/// Holds every count against the limits and against the bytes that its element needs at least.
fn check_header(header: &Header, bytes: u64, raw: &Raw, options: &LoadOptions) -> Result<(), MeshError> {
    for (name, element) in &header.elements {
        let count = element.count as u64;
        let all = |before: usize| count.saturating_add(before as u64);
        match name.as_str() {
            "vertex" => check_count(MeshFormat::Ply, "vertices", all(raw.vertices.len()), options.max_vertices)?,
            "face" => check_count(MeshFormat::Ply, "faces", all(raw.faces.len()), options.max_faces)?,
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

fn read_faces(
    reader: &mut Reader<impl BufRead>,
    element: &ElementDef,
    header: &Header,
    base: u32,
    raw: &mut Raw,
    options: &LoadOptions,
) -> Result<(), MeshError> {
    let mut faces: Vec<Polygon> = read_element(reader, element, header)?;
    for (i, face) in faces.iter_mut().enumerate() {
        if face.bad_index {
            return Err(malformed(format!("face {i} names a negative vertex")));
        }
        face.corners.iter_mut().for_each(|corner| *corner = corner.saturating_add(base));
        raw.push_polygon(MeshFormat::Ply, &face.corners, options)?;
    }
    Ok(())
}

/// Whether a property of this name holds the corners of a face.
fn is_corners(name: &str) -> bool {
    name == "vertex_indices" || name == "vertex_index"
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
        if !is_corners(name) {
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
