//! OBJ: the vertices and faces of all objects and groups; points, lines and everything else are skipped.
//!
//! Own code: `tobj` reads materials, texture coordinates and lines too, and refuses a file for them or takes a line for a face.

use super::format::{LoadOptions, MeshFormat, Raw, check_count};
use super::text::{Words, quote, without_comment};
use crate::error::MeshError;
use nalgebra::Point3;
use std::borrow::Cow;

/// Vertices come in the order of their first use, without those that no face uses.
pub(super) fn parse(bytes: &[u8], options: &LoadOptions) -> Result<Raw, MeshError> {
    let points = vertices(bytes, options)?;
    let mut number_of = vec![u32::MAX; points.len()];
    let mut raw = Raw::default();
    let (mut defined, mut corners) = (0, Vec::new());
    for (line, text) in Lines::new(bytes) {
        let mut words = Words::new(MeshFormat::Obj, line, &text);
        match words.next_word() {
            Some(b"v") => defined += 1,
            Some(b"f") => {
                corners.clear();
                while let Some(corner) = words.next_word() {
                    let vertex = vertex(corner, &words, defined, points.len())?;
                    if number_of[vertex] == u32::MAX {
                        number_of[vertex] = raw.vertices.len() as u32;
                        raw.vertices.push(points[vertex]);
                    }
                    corners.push(number_of[vertex]);
                }
                raw.push_polygon(MeshFormat::Obj, &corners, options)?;
            }
            _ => {}
        }
    }
    Ok(raw)
}

/// All vertices: a face may name one that is defined behind it. Weights and colours behind the coordinates are skipped.
fn vertices(bytes: &[u8], options: &LoadOptions) -> Result<Vec<Point3<f64>>, MeshError> {
    let mut points = Vec::new();
    for (line, text) in Lines::new(bytes) {
        let mut words = Words::new(MeshFormat::Obj, line, &text);
        if words.next_word() == Some(b"v") {
            check_count(MeshFormat::Obj, "vertices", points.len() as u64 + 1, options.max_vertices)?;
            points.push(words.point::<f64>()?);
        }
    }
    Ok(points)
}

/// The vertex of a corner such as `7/3/7`: counted from 1, or backwards from the last of the `defined` ones before this line.
fn vertex(corner: &[u8], words: &Words, defined: usize, count: usize) -> Result<usize, MeshError> {
    let number: i64 = words.parse(corner.split(|&b| b == b'/').next().unwrap_or_default())?;
    let vertex = if number < 0 { (defined as i64).checked_add(number) } else { number.checked_sub(1) };
    let found = vertex.and_then(|v| usize::try_from(v).ok()).filter(|&v| v < count);
    found.ok_or_else(|| {
        words.error(format!("the face names vertex {}, which is none of the {count} vertices", quote(corner)))
    })
}

/// The lines without comments, with their numbers; a backslash at the end of a line continues it on the next one.
struct Lines<'a> {
    rest: Option<&'a [u8]>,
    line: usize,
}

impl<'a> Lines<'a> {
    fn new(text: &'a [u8]) -> Self {
        Self { rest: Some(text), line: 0 }
    }

    fn physical(&mut self) -> Option<&'a [u8]> {
        let text = self.rest?;
        self.line += 1;
        let end = text.iter().position(|&b| b == b'\n');
        self.rest = end.map(|end| &text[end + 1..]);
        Some(without_comment(&text[..end.unwrap_or(text.len())]))
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = (usize, Cow<'a, [u8]>);

    fn next(&mut self) -> Option<Self::Item> {
        let before_backslash = |line: &'a [u8]| line.trim_ascii_end().strip_suffix(b"\\");
        let first = self.physical()?;
        let number = self.line;
        let Some(mut part) = before_backslash(first) else {
            return Some((number, Cow::Borrowed(first)));
        };
        let mut whole = Vec::new();
        loop {
            whole.extend_from_slice(part);
            whole.push(b' ');
            let Some(next) = self.physical() else { break };
            match before_backslash(next) {
                Some(continued) => part = continued,
                None => {
                    whole.extend_from_slice(next);
                    break;
                }
            }
        }
        Some((number, Cow::Owned(whole)))
    }
}
