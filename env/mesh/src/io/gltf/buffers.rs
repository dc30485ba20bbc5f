//! The bytes of a glTF file: of the GLB itself, in a data URI, or in a file beside it. Each is read at its first use.

use super::document::{Document, View};
use super::{malformed, missing};
use crate::error::MeshError;
use crate::io::format::LoadOptions;
use crate::io::read_bounded;
use base64::Engine;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use std::borrow::Cow;
use std::path::{Component, Path, PathBuf};

/// Header of a GLB, and of each chunk, bytes.
const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;
/// Base 64 with and without its padding: some writers leave it out.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// The JSON and the binary chunk of a GLB; of a text file the text alone.
pub(super) fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), MeshError> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let (Some(version), Some(length)) = (word(4), word(8)) else { return Err(truncated(bytes.len(), HEADER as u64)) };
    if version != 2 {
        return Err(malformed(format!("it is of version {version}, but only version 2 is read; convert it")));
    }
    let Some(body) = bytes.get(..length as usize) else { return Err(truncated(bytes.len(), length.into())) };
    let behind = bytes[body.len()..].trim_ascii();
    if behind.iter().any(|&b| b != 0) {
        return Err(malformed(format!(
            "{} bytes follow the {length} that its header names; export it again",
            behind.len()
        )));
    }
    let (mut json, mut binary, mut at) = (None, None, HEADER);
    while at + CHUNK_HEADER <= body.len() {
        let size = word(at).unwrap_or(0) as usize;
        let end = at + CHUNK_HEADER + size;
        let Some(chunk) = body.get(at + CHUNK_HEADER..end) else { return Err(truncated(bytes.len(), end as u64)) };
        match &body[at + 4..at + CHUNK_HEADER] {
            b"JSON" => _ = json.get_or_insert(chunk),
            b"BIN\0" => _ = binary.get_or_insert(chunk),
            _ => {}
        }
        at = end;
    }
    json.map(|json| (json, binary)).ok_or_else(|| malformed("it has no JSON chunk"))
}

fn truncated(found: usize, expected: u64) -> MeshError {
    MeshError::Truncated { format: "glTF", detail: format!("{found} of {expected} bytes are there") }
}

/// The buffers of a document.
pub(super) struct Buffers<'a> {
    document: &'a Document,
    binary: Option<&'a [u8]>,
    folder: Option<&'a Path>,
    read: Vec<Option<Cow<'a, [u8]>>>,
    /// Bytes that files beside this one may still have.
    left: u64,
    limit: u64,
}

impl<'a> Buffers<'a> {
    pub fn new(
        document: &'a Document,
        binary: Option<&'a [u8]>,
        folder: Option<&'a Path>,
        options: &LoadOptions,
    ) -> Self {
        let read = document.buffers.iter().map(|_| None).collect();
        Self { document, binary, folder, read, left: options.max_bytes, limit: options.max_bytes }
    }

    /// The bytes of a view.
    pub fn view(&mut self, view: &View) -> Result<&[u8], MeshError> {
        let bytes = self.buffer(view.buffer)?;
        let end = view.byte_offset.saturating_add(view.byte_length);
        let range = usize::try_from(view.byte_offset).unwrap_or(usize::MAX)..usize::try_from(end).unwrap_or(usize::MAX);
        bytes.get(range).ok_or_else(|| truncated(bytes.len(), end))
    }

    fn buffer(&mut self, index: usize) -> Result<&[u8], MeshError> {
        let document = self.document;
        let it = document.buffers.get(index).ok_or_else(|| missing("buffer", index))?;
        if self.read[index].is_none() {
            let bytes = match &it.uri {
                Some(uri) => Cow::Owned(self.fetch(uri)?),
                None => Cow::Borrowed(self.binary.ok_or_else(|| malformed(format!("buffer {index} has no bytes")))?),
            };
            if (bytes.len() as u64) < it.byte_length {
                return Err(truncated(bytes.len(), it.byte_length));
            }
            self.read[index] = Some(bytes);
        }
        Ok(self.read[index].as_deref().unwrap_or_default())
    }

    fn fetch(&mut self, uri: &str) -> Result<Vec<u8>, MeshError> {
        if let Some(data) = uri.strip_prefix("data:") {
            let text = data.split_once(";base64,").map(|(_, text)| text.trim_ascii());
            let bytes = text.and_then(|text| BASE64.decode(text).ok());
            return bytes.ok_or_else(|| malformed("a data URI of it is not in base 64"));
        }
        let name: PathBuf = percent_encoding::percent_decode_str(uri).decode_utf8_lossy().as_ref().into();
        let below = name.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
        let (true, Some(folder)) = (below && !uri.contains("://"), self.folder) else {
            let shown: String = uri.chars().take(100).collect();
            return Err(malformed(format!("its buffer {shown:?} is no file in its folder; export it as .glb")));
        };
        let path = folder.join(name);
        let bytes = read_bounded(&path, self.left).map_err(|source| MeshError::Io { path, source })?;
        let too_large = MeshError::FileTooLarge { format: "glTF", bytes: bytes.len() as u64, limit: self.limit };
        self.left = self.left.checked_sub(bytes.len() as u64).ok_or(too_large)?;
        Ok(bytes)
    }
}
