//! OBJ: the geometry of all objects and groups; materials are ignored.

use super::format::{LoadOptions, MeshFormat, Raw, check_count};
use crate::error::MeshError;
use nalgebra::Point3;
use std::borrow::Cow;
use std::io::Cursor;

pub(super) fn parse(bytes: &[u8], options: &LoadOptions) -> Result<Raw, MeshError> {
    let bytes: &[u8] = &joined(bytes);
    check_lines(bytes, options)?;
    let settings = tobj::LoadOptions { ignore_points: true, ignore_lines: true, ..Default::default() };
    let (models, _) = tobj::load_obj_buf(&mut Cursor::new(bytes), &settings, |_| Ok(Default::default()))
        .map_err(|e| MeshError::Malformed { format: "OBJ", detail: e.to_string() })?;
    let mut raw = Raw::default();
    let mut face = 0;
    for model in models {
        let mesh = model.mesh;
        let base = raw.vertices.len() as u32;
        let (points, rest) = mesh.positions.as_chunks::<3>();
        if !rest.is_empty() {
            return Err(MeshError::Malformed { format: "OBJ", detail: "a vertex has fewer than 3 coordinates".into() });
        }
        check_count(MeshFormat::Obj, "vertices", (raw.vertices.len() + points.len()) as u64, options.max_vertices)?;
        raw.vertices.extend(points.iter().map(|&p| Point3::from(p)));
        let mut rest = mesh.indices.as_slice();
        let mut corners = Vec::new();
        let triangles_only = mesh.face_arities.is_empty();
        let mut arities = mesh.face_arities.iter();
        while !rest.is_empty() {
            let arity = if triangles_only { 3 } else { arities.next().map_or(0, |&a| a as usize) };
            let Some((head, tail)) = (arity > 0).then(|| rest.split_at_checked(arity)).flatten() else {
                return Err(MeshError::Malformed { format: "OBJ", detail: "a face lists too few corners".into() });
            };
            corners.clear();
            corners.extend(head.iter().map(|&i| base.saturating_add(i)));
            raw.push_polygon(MeshFormat::Obj, face, &corners, options)?;
            rest = tail;
            face += 1;
        }
    }
    Ok(raw)
}

/// The text with continued lines joined: a backslash at the end of a line that is no comment continues it on the next one.
fn joined(bytes: &[u8]) -> Cow<'_, [u8]> {
    let lines = || bytes.split(|&b| b == b'\n');
    let before_backslash = |line: &'_ [u8]| line.trim_ascii_end().strip_suffix(b"\\").map(<[u8]>::len);
    if !lines().any(|line| before_backslash(line).is_some()) {
        return Cow::Borrowed(bytes);
    }
    let mut text = Vec::with_capacity(bytes.len() + 1);
    let mut continued = false;
    for line in lines() {
        let comment = !continued && line.trim_ascii_start().starts_with(b"#");
        let end = before_backslash(line).filter(|_| !comment);
        text.extend_from_slice(&line[..end.unwrap_or(line.len())]);
        continued = end.is_some();
        text.push(if continued { b' ' } else { b'\n' });
    }
    Cow::Owned(text)
}

/// Counts `v` and `f` lines before the parser allocates for them.
fn check_lines(bytes: &[u8], options: &LoadOptions) -> Result<(), MeshError> {
    let (mut vertices, mut faces) = (0, 0);
    for line in bytes.split(|&b| b == b'\n') {
        match line.trim_ascii_start() {
            [b'v', b' ' | b'\t', ..] => vertices += 1,
            [b'f', b' ' | b'\t', ..] => faces += 1,
            _ => {}
        }
    }
    check_count(MeshFormat::Obj, "vertices", vertices, options.max_vertices)?;
    check_count(MeshFormat::Obj, "faces", faces, options.max_faces)
}
