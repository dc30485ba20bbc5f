//! STL. Binary and ASCII are distinguished by size: many binary files begin with the word "solid" too.
//!
//! Own code for ASCII: `stl_io` stops behind the first solid, refuses a file for a normal that is no number, and names no line.

use super::format::{LoadOptions, MeshFormat, Raw, check_count};
use super::text::{Words, numbered, quote};
use crate::error::MeshError;
use nalgebra::Point3;
use std::io::{Cursor, Error, ErrorKind, Result as IoResult};
use stl_io::{Normal, Triangle, TriangleIterator, Vertex};

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
        return collect(&mut Facets::new(bytes));
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
    let mut cursor = Cursor::new(&binary);
    collect(stl_io::create_stl_reader(&mut cursor).map_err(explain)?.as_mut())
}

fn looks_like_text(bytes: &[u8]) -> bool {
    let start = bytes.trim_ascii_start();
    start.len() >= 5 && start[..5].eq_ignore_ascii_case(b"solid") && !bytes.contains(&0)
}

fn collect(triangles: &mut dyn TriangleIterator<Item = IoResult<Triangle>>) -> Result<Raw, MeshError> {
    let mesh = triangles.as_indexed_triangles().map_err(explain)?;
    let vertices = mesh.vertices.iter().map(|v| Point3::from(v.0.map(f64::from))).collect();
    // Below 2^32 by the size limits that were checked before.
    let faces = mesh.faces.iter().map(|f| f.vertices.map(|v| v as u32)).collect();
    Ok(Raw { vertices, faces, ..Raw::default() })
}

fn explain(error: Error) -> MeshError {
    match error.kind() {
        ErrorKind::UnexpectedEof => MeshError::Truncated { format: "STL", detail: error.to_string() },
        // The errors of `Facets` travel through `stl_io`.
        _ => error.downcast().unwrap_or_else(|e| MeshError::Malformed { format: "STL", detail: e.to_string() }),
    }
}

/// The facets of all solids of an ASCII file. Their normals are not read, and notes between solids are skipped.
struct Facets<I> {
    lines: I,
    in_solid: bool,
    /// The corners of the facet that has begun.
    corners: Option<Vec<Vertex>>,
}

impl<'a> Facets<()> {
    fn new(text: &'a [u8]) -> Facets<impl Iterator<Item = (usize, &'a [u8])>> {
        Facets { lines: numbered(text), in_solid: false, corners: None }
    }
}

impl<'a, I: Iterator<Item = (usize, &'a [u8])>> Facets<I> {
    /// Reads one line; returns the facet that it ends.
    fn read(&mut self, mut words: Words) -> Result<Option<Triangle>, MeshError> {
        let Some(word) = words.next_word() else { return Ok(None) };
        match word.to_ascii_lowercase().as_slice() {
            b"solid" => self.in_solid = true,
            b"endsolid" | b"facet" if self.corners.is_some() => {
                return Err(words.error("the facet before has no end (endfacet)"));
            }
            b"endsolid" => self.in_solid = false,
            b"facet" => self.corners = Some(Vec::with_capacity(3)),
            b"outer" | b"endloop" => {}
            b"vertex" => {
                let corners = self.corners.as_mut().ok_or_else(|| words.error("the vertex belongs to no facet"))?;
                let [x, y, z] = [(); 3].map(|()| words.coordinate::<f32>());
                // Back to the bits that were read.
                corners.push(Vertex::new([x? as f32, y? as f32, z? as f32]));
            }
            b"endfacet" => {
                let corners = self.corners.take().unwrap_or_default();
                let vertices: [Vertex; 3] = corners.try_into().map_err(|corners: Vec<_>| {
                    words.error(format!("the facet has {} corners; an STL facet has 3", corners.len()))
                })?;
                return Ok(Some(Triangle { normal: Normal::default(), vertices }));
            }
            _ if self.in_solid => return Err(words.error(format!("\"{}\" is no word of an STL file", quote(word)))),
            _ => {}
        }
        Ok(None)
    }
}

impl<'a, I: Iterator<Item = (usize, &'a [u8])>> Iterator for Facets<I> {
    type Item = IoResult<Triangle>;

    fn next(&mut self) -> Option<Self::Item> {
        while let Some((line, text)) = self.lines.next() {
            match self.read(Words::new(MeshFormat::Stl, line, text)) {
                Ok(Some(triangle)) => return Some(Ok(triangle)),
                Ok(None) => {}
                Err(error) => return Some(Err(Error::other(error))),
            }
        }
        let whole = !self.in_solid && self.corners.is_none();
        (!whole).then(|| Err(Error::new(ErrorKind::UnexpectedEof, "it ends before the solid does (endsolid)")))
    }
}

impl<'a, I: Iterator<Item = (usize, &'a [u8])>> TriangleIterator for Facets<I> {}
