//! OFF text: a keyword, three counts, vertices, polygons; `#` begins a comment, the rest of a line (colours) is skipped.
//!
//! Own code: `off-rs` rounds to f32, and refuses `COFF` and counts on the line of the keyword.

use super::format::{LoadOptions, MeshFormat, Raw, check_count};
use crate::error::MeshError;
use nalgebra::Point3;
use std::str::{FromStr, SplitAsciiWhitespace};

/// Fewest bytes of a vertex line ("0 0 0\n").
const VERTEX_BYTES: u64 = 6;
/// Fewest bytes of a face line ("0\n"; such a face is refused later).
const FACE_BYTES: u64 = 2;

pub(super) fn parse(bytes: &[u8], options: &LoadOptions) -> Result<Raw, MeshError> {
    let text = std::str::from_utf8(bytes).map_err(|_| malformed("it is not text (binary OFF is not read)".into()))?;
    let mut lines = text
        .lines()
        .enumerate()
        .map(|(n, line)| (n + 1, line.split('#').next().unwrap_or_default().trim()))
        .filter(|(_, line)| !line.is_empty());
    let (vertices, faces) = header(&mut lines)?;
    check_count(MeshFormat::Off, "vertices", vertices, options.max_vertices)?;
    check_count(MeshFormat::Off, "faces", faces, options.max_faces)?;
    // The last line may lack its newline.
    let least = (vertices * VERTEX_BYTES + faces * FACE_BYTES).saturating_sub(1);
    if least > bytes.len() as u64 {
        let detail = format!("{vertices} vertices and {faces} faces cannot fit into {} bytes", bytes.len());
        return Err(MeshError::Truncated { format: "OFF", detail });
    }
    let mut raw = Raw { vertices: Vec::with_capacity(vertices as usize), faces: Vec::with_capacity(faces as usize) };
    for i in 0..vertices {
        let (n, line) = lines.next().ok_or_else(|| truncated("vertices", i, vertices))?;
        let mut words = line.split_ascii_whitespace();
        let (x, y, z) = (number(&mut words, n)?, number(&mut words, n)?, number(&mut words, n)?);
        raw.vertices.push(Point3::new(x, y, z));
    }
    let mut corners = Vec::new();
    for i in 0..faces {
        let (n, line) = lines.next().ok_or_else(|| truncated("faces", i, faces))?;
        let mut words = line.split_ascii_whitespace();
        let count: usize = number(&mut words, n)?;
        corners.clear();
        for _ in 0..count {
            // Ends with an error at the end of the line, however large `count` is.
            corners.push(number::<u32>(&mut words, n)?);
        }
        raw.push_polygon(MeshFormat::Off, i as usize, &corners, options)?;
    }
    Ok(raw)
}

/// Vertex and face count; the counts may follow the keyword on its line, even without a blank ("OFF490 518 0").
fn header<'a>(lines: &mut impl Iterator<Item = (usize, &'a str)>) -> Result<(u64, u64), MeshError> {
    let (n, first) = lines.next().ok_or_else(|| malformed("it has no line".into()))?;
    let rest = ["COFF", "NOFF", "CNOFF", "OFF"]
        .iter()
        .find_map(|keyword| first.strip_prefix(keyword))
        .ok_or_else(|| malformed("its first line does not begin with OFF".into()))?
        .trim();
    let (n, counts) = if rest.is_empty() {
        lines.next().ok_or_else(|| MeshError::Truncated { format: "OFF", detail: "it has no counts".into() })?
    } else {
        (n, rest)
    };
    let mut words = counts.split_ascii_whitespace();
    // u32, so that no product of a count overflows.
    Ok((number::<u32>(&mut words, n)?.into(), number::<u32>(&mut words, n)?.into()))
}

fn number<T: FromStr>(words: &mut SplitAsciiWhitespace, line: usize) -> Result<T, MeshError> {
    let word = words.next().ok_or_else(|| malformed(format!("line {line} has too few numbers")))?;
    word.parse().map_err(|_| {
        let shown: String = word.chars().take(40).collect();
        malformed(format!("line {line}: \"{shown}\" is not the number expected there"))
    })
}

fn malformed(detail: String) -> MeshError {
    MeshError::Malformed { format: "OFF", detail }
}

fn truncated(what: &str, found: u64, expected: u64) -> MeshError {
    MeshError::Truncated { format: "OFF", detail: format!("{found} of {expected} {what} are there") }
}
