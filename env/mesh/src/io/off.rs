//! OFF text: a keyword, three counts, vertices, polygons; `#` begins a comment, the rest of a line (colours) is skipped.
//!
//! Own code: `off-rs` rounds to f32, and refuses `COFF` and counts on the line of the keyword.

use super::format::{LoadOptions, MeshFormat, Raw, check_count};
use super::text::{Words, numbered, quote, without_comment};
use crate::error::MeshError;

/// Fewest bytes of a vertex line ("0 0 0\n").
const VERTEX_BYTES: u64 = 6;
/// Fewest bytes of a face line ("0\n"; such a face is refused later).
const FACE_BYTES: u64 = 2;
const KEYWORDS: [&[u8]; 4] = [b"COFF", b"NOFF", b"CNOFF", b"OFF"];

/// Reads one mesh after the other, into one.
pub(super) fn parse(bytes: &[u8], options: &LoadOptions) -> Result<Raw, MeshError> {
    let mut lines = numbered(bytes)
        .map(|(n, line)| (n, without_comment(line).trim_ascii()))
        .filter(|(_, line)| !line.is_empty())
        .peekable();
    let mut raw = Raw::default();
    parse_one(&mut lines, bytes.len() as u64, &mut raw, options)?;
    raw.end_mesh()?;
    while let Some((n, line)) = lines.peek() {
        if !KEYWORDS.iter().any(|keyword| line.starts_with(keyword)) {
            let detail = format!(
                "\"{}\" follows the vertices and faces that the counts announce; correct the counts or delete it",
                quote(line)
            );
            return Err(Words::new(MeshFormat::Off, *n, line).error(detail));
        }
        parse_one(&mut lines, bytes.len() as u64, &mut raw, options)?;
        raw.end_mesh()?;
    }
    Ok(raw)
}

fn parse_one<'a>(
    lines: &mut impl Iterator<Item = (usize, &'a [u8])>,
    bytes: u64,
    raw: &mut Raw,
    options: &LoadOptions,
) -> Result<(), MeshError> {
    let (vertices, faces) = header(lines)?;
    let base = raw.vertices.len() as u32;
    check_count(MeshFormat::Off, "vertices", u64::from(base) + vertices, options.max_vertices)?;
    check_count(MeshFormat::Off, "faces", raw.faces.len() as u64 + faces, options.max_faces)?;
    // The last line may lack its newline.
    let least = (vertices * VERTEX_BYTES + faces * FACE_BYTES).saturating_sub(1);
    if least > bytes {
        let detail = format!("{vertices} vertices and {faces} faces cannot fit into {bytes} bytes");
        return Err(MeshError::Truncated { format: "OFF", detail });
    }
    raw.vertices.reserve(vertices as usize);
    raw.faces.reserve(faces as usize);
    for i in 0..vertices {
        let (n, line) = lines.next().ok_or_else(|| truncated("vertices", i, vertices))?;
        raw.vertices.push(Words::new(MeshFormat::Off, n, line).point::<f64>()?);
    }
    let mut corners = Vec::new();
    for i in 0..faces {
        let (n, line) = lines.next().ok_or_else(|| truncated("faces", i, faces))?;
        let mut words = Words::new(MeshFormat::Off, n, line);
        let count: usize = words.number()?;
        corners.clear();
        for _ in 0..count {
            // Ends with an error at the end of the line, however large `count` is.
            corners.push(base.saturating_add(words.number::<u32>()?));
        }
        raw.push_polygon(MeshFormat::Off, &corners, options)?;
    }
    Ok(())
}

/// Vertex and face count; the counts may follow the keyword on its line, even without a blank ("OFF490 518 0").
fn header<'a>(lines: &mut impl Iterator<Item = (usize, &'a [u8])>) -> Result<(u64, u64), MeshError> {
    let (n, first) = lines.next().ok_or_else(|| malformed("it has no line"))?;
    let rest = KEYWORDS
        .iter()
        .find_map(|keyword| first.strip_prefix(*keyword))
        .ok_or_else(|| malformed("its first line does not begin with OFF"))?
        .trim_ascii();
    if rest.starts_with(b"BINARY") {
        return Err(malformed("it is binary OFF, which is not read; save it as text"));
    }
    let (n, counts) = if rest.is_empty() {
        lines.next().ok_or_else(|| MeshError::Truncated { format: "OFF", detail: "it has no counts".into() })?
    } else {
        (n, rest)
    };
    let mut words = Words::new(MeshFormat::Off, n, counts);
    // u32, so that no product of a count overflows.
    Ok((words.number::<u32>()?.into(), words.number::<u32>()?.into()))
}

fn malformed(detail: &str) -> MeshError {
    MeshError::Malformed { format: "OFF", detail: detail.into() }
}

fn truncated(what: &str, found: u64, expected: u64) -> MeshError {
    MeshError::Truncated { format: "OFF", detail: format!("{found} of {expected} {what} are there") }
}
