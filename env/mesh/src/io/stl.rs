//! STL. Binary and ASCII are distinguished by size: many binary files begin with the word "solid" too.

use super::format::{LoadOptions, MeshFormat, Raw, check_count};
use crate::error::MeshError;
use nalgebra::Point3;
use std::io::Cursor;

/// Header and count of a binary file, bytes.
const HEADER: usize = 84;
/// One triangle of a binary file, bytes.
const RECORD: u64 = 50;
/// Fewest bytes of an ASCII triangle ("facet normal 0 0 0 ... endfacet").
const ASCII_RECORD: u64 = 80;

pub(super) fn parse(bytes: &[u8], options: &LoadOptions) -> Result<Raw, MeshError> {
    let claimed = bytes.get(80..HEADER).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let body = (bytes.len() as u64).saturating_sub(HEADER as u64);
    let fits = claimed.is_some_and(|n| u64::from(n) * RECORD == body);
    if !fits && looks_like_text(bytes) {
        check_count(MeshFormat::Stl, "triangles", bytes.len() as u64 / ASCII_RECORD, options.max_faces)?;
        let text = ascii_bytes(bytes);
        return collect(&text);
    }
    let Some(count) = claimed else {
        let detail = format!("{} bytes, but a binary header alone has {HEADER}", bytes.len());
        return Err(MeshError::Truncated { format: "STL", detail });
    };
    check_count(MeshFormat::Stl, "triangles", u64::from(count), options.max_faces)?;
    if u64::from(count) * RECORD > body {
        let detail = format!("its header names {count} triangles, but there is room for only {}", body / RECORD);
        return Err(MeshError::Truncated { format: "STL", detail });
    }
    // Some writers append a short note. Where a triangle would fit, the count may be wrong and a part of the surface lost.
    let trailing = body - u64::from(count) * RECORD;
    if trailing >= RECORD {
        let detail = format!("{trailing} bytes follow the {count} triangles that its header names; export it again");
        return Err(MeshError::Malformed { format: "STL", detail });
    }
    let mut binary = bytes.to_vec();
    binary[..80].fill(0);
    collect(&binary)
}

fn looks_like_text(bytes: &[u8]) -> bool {
    let start = bytes.trim_ascii_start();
    start.len() >= 5 && start[..5].eq_ignore_ascii_case(b"solid") && !bytes.contains(&0)
}

/// The text as `stl_io` expects it: lower case, "solid " with a blank even when the solid has no name.
fn ascii_bytes(bytes: &[u8]) -> Vec<u8> {
    let start = bytes.trim_ascii_start();
    let mut text = Vec::with_capacity(start.len() + 1);
    text.extend_from_slice(b"solid ");
    text.extend(start[5..].iter().map(u8::to_ascii_lowercase));
    text
}

fn collect(bytes: &[u8]) -> Result<Raw, MeshError> {
    let mut cursor = Cursor::new(bytes);
    let mesh = stl_io::create_stl_reader(&mut cursor).and_then(|mut reader| reader.as_indexed_triangles()).map_err(
        |e| match e.kind() {
            std::io::ErrorKind::UnexpectedEof => MeshError::Truncated { format: "STL", detail: e.to_string() },
            _ => MeshError::Malformed { format: "STL", detail: e.to_string() },
        },
    )?;
    let vertices = mesh.vertices.iter().map(|v| Point3::from(v.0.map(f64::from))).collect();
    // Below 2^32 by the size limits that were checked before.
    let faces = mesh.faces.iter().map(|f| f.vertices.map(|v| v as u32)).collect();
    Ok(Raw { vertices, faces })
}
