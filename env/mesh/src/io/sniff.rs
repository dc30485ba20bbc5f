//! Guesses the format of bytes, for errors about files with the wrong ending.

use super::format::MeshFormat;

/// First bytes of common files, in lower case, and their formats.
const STARTS: [(&[u8], &str); 15] = [
    (b"ply\n", "a PLY file"),
    (b"ply\r", "a PLY file"),
    (b"solid", "an ASCII STL file"),
    (b"off\n", "an OFF file"),
    (b"off\r", "an OFF file"),
    (b"off ", "an OFF file"),
    (b"gltf", "a binary glTF file (.glb)"),
    (b"version https://git-lfs", "a Git LFS pointer; fetch the file itself with `git lfs pull`"),
    (b"<!doctype html", "a web page (HTML)"),
    (b"<html", "a web page (HTML)"),
    (b"<?xml", "an XML file"),
    (b"pk\x03\x04", "a ZIP archive"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"\xff\xfe", "text in UTF-16; save it in UTF-8"),
    (b"\xfe\xff", "text in UTF-16; save it in UTF-8"),
];
/// Number of examined bytes.
const LENGTH: usize = 4096;

/// The apparent format of `bytes`; none if it is `expected` itself or unknown.
pub(super) fn looks_like(bytes: &[u8], expected: MeshFormat) -> Option<&'static str> {
    let head = &bytes[..bytes.len().min(LENGTH)];
    let start = head.trim_ascii_start().to_ascii_lowercase();
    let known = STARTS.iter().find(|(magic, _)| start.starts_with(magic)).map(|(_, what)| *what);
    // OBJ, OFF and glTF are text; the parser's own error names their problems.
    let is_text = matches!(expected, MeshFormat::Obj | MeshFormat::Off | MeshFormat::Gltf);
    let other = || if is_text { None } else { text(head) };
    let found = known.or_else(other)?;
    (!found.contains(&format!(" {} ", expected.name()))).then_some(found)
}

/// OBJ if lines begin with its keywords, else any text.
fn text(head: &[u8]) -> Option<&'static str> {
    let control = |b: &u8| b.is_ascii_control() && !b.is_ascii_whitespace();
    // The head may end within a character.
    let valid = std::str::from_utf8(head).map_or_else(|e| e.error_len().is_none(), |_| true);
    if head.is_empty() || !valid || head.iter().any(control) {
        return None;
    }
    let vertex = head.split(|&b| b == b'\n').any(|line| line.starts_with(b"v "));
    Some(if vertex { "an OBJ file" } else { "plain text" })
}
