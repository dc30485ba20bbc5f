//! `.binvox` files: a short text header, then runs of equal voxels, each a value and a length of 1 to 255.
//!
//! y runs fastest in the file, then z, then x; the centre of voxel (i, j, k) is `translate + scale * (i + 0.5, j + 0.5, k + 0.5) / n`.
//! So `translate` and `scale` are the origin and the side of a [`VoxelFrame`]; a header without them means the unit cube.
//!
//! Source: Patrick Min, "binvox voxel file format specification", <https://www.patrickmin.com/binvox/binvox.html>.
//!
//! Own code: no Rust crate for this format is known.

use super::grid::{MAX_RESOLUTION, VoxelFrame, VoxelGrid, out_of_memory, with_room};
use crate::error::MeshError;
use crate::io::{read_bounded, write_atomic};
use nalgebra::Point3;
use std::path::Path;

/// Largest file that is read, bytes: a grid of 1024 with 128 runs in each of its columns.
const MAX_BYTES: u64 = 256 << 20;
/// Longest header that is read, bytes; binvox's own have about a hundred.
const MAX_HEADER: usize = 4096;
/// The header ends with this line.
const DATA: &[u8] = b"data";

/// Reads a `.binvox` file.
///
/// Version 1 and 2; every value but 0 is a set voxel. Only cubes, which is all that the format allows.
///
/// # Errors
/// [`MeshError::Io`], and those of [`parse_binvox`].
pub fn load_binvox(path: &Path) -> Result<VoxelGrid, MeshError> {
    let io = |source| MeshError::Io { path: path.to_path_buf(), source };
    parse_binvox(&read_bounded(path, MAX_BYTES).map_err(io)?)
}

/// Reads the bytes of a `.binvox` file.
///
/// # Errors
/// [`MeshError::Malformed`] or [`MeshError::Truncated`], saying where: a file of more than 256 MiB, no binvox header, a grid that is no
/// cube or has more than 1024 voxels a side, numbers that are not finite, values other than 0 and 1 in version 1, runs of no voxels,
/// or more or fewer voxels than the header names; [`MeshError::OutOfMemory`].
pub fn parse_binvox(bytes: &[u8]) -> Result<VoxelGrid, MeshError> {
    if bytes.len() as u64 > MAX_BYTES {
        return Err(malformed(format!("it has more than {} MiB", MAX_BYTES >> 20)));
    }
    let (header, runs) = Header::read(bytes)?;
    let frame = VoxelFrame::new(header.resolution, header.translate, header.scale)
        .map_err(|error| malformed(error.to_string()))?;
    // A pair of bytes stands for 255 voxels at most, so the size of the file also bounds the allocation.
    if !runs.len().is_multiple_of(2) || (runs.len() / 2).saturating_mul(255) < frame.len() {
        return Err(truncated(header.resolution, runs.len() / 2));
    }
    let mut columns = with_room(frame.len())?;
    for (run, &[value, length]) in runs.as_chunks::<2>().0.iter().enumerate() {
        if header.version == 1 && value > 1 {
            return Err(malformed(format!("run {run} has the value {value} instead of 0 or 1")));
        }
        if length == 0 || columns.len() + usize::from(length) > frame.len() {
            let rest = frame.len() - columns.len();
            return Err(malformed(format!("run {run} has {length} voxels where 1 to {rest} were expected")));
        }
        columns.resize(columns.len() + usize::from(length), value != 0);
    }
    if columns.len() < frame.len() {
        return Err(truncated(header.resolution, runs.len() / 2));
    }
    VoxelGrid::new(frame, swap_yz(&columns, header.resolution)?)
}

/// Writes a `.binvox` file of version 1; it reads back with the same bits.
///
/// # Errors
/// Those of [`write_atomic`]; [`MeshError::OutOfMemory`].
pub fn write_binvox(path: &Path, grid: &VoxelGrid) -> Result<(), MeshError> {
    let frame = grid.frame();
    let (n, origin) = (frame.resolution(), frame.origin());
    // Rust prints the shortest decimal that reads back as the same f64.
    let mut bytes = format!(
        "#binvox 1\ndim {n} {n} {n}\ntranslate {} {} {}\nscale {}\ndata\n",
        origin.x,
        origin.y,
        origin.z,
        frame.side()
    )
    .into_bytes();
    for run in swap_yz(grid.flags(), n)?.chunk_by(|a, b| a == b) {
        let more = 2 * run.len().div_ceil(255);
        bytes.try_reserve(more).map_err(|_| out_of_memory::<u8>(bytes.len() + more))?;
        for piece in run.chunks(255) {
            bytes.extend([u8::from(run[0]), piece.len() as u8]);
        }
    }
    write_atomic(path, &bytes)
}

/// From z fastest to y fastest, and back.
fn swap_yz(flags: &[bool], n: usize) -> Result<Vec<bool>, MeshError> {
    let mut swapped = with_room(flags.len())?;
    for slab in flags.chunks_exact(n * n) {
        swapped.extend((0..n).flat_map(|a| (0..n).map(move |b| slab[b * n + a])));
    }
    Ok(swapped)
}

struct Header {
    version: u8,
    resolution: usize,
    translate: Point3<f64>,
    scale: f64,
}

impl Header {
    /// The header, and the rest.
    fn read(bytes: &[u8]) -> Result<(Self, &[u8]), MeshError> {
        let mut rest = bytes;
        let mut line = || {
            let end = rest[..rest.len().min(MAX_HEADER)].iter().position(|&b| b == b'\n')?;
            let line = &rest[..end];
            rest = &rest[end + 1..];
            Some(line.trim_ascii())
        };
        let version = match line() {
            Some(b"#binvox 1") => 1,
            Some(b"#binvox 2") => 2,
            _ => return Err(malformed("it does not begin with the line \"#binvox 1\"".into())),
        };
        let (mut dim, mut translate, mut scale) = (None, None, None);
        loop {
            let Some(line) = line() else {
                return Err(malformed("no line \"data\" ends its header".into()));
            };
            if line == DATA {
                break;
            }
            let text = String::from_utf8_lossy(line);
            let mut words = text.split_ascii_whitespace();
            let known = match words.next() {
                Some("dim") => dim.replace(numbers::<usize, 3>(&text, words)?).is_none(),
                Some("translate") => translate.replace(numbers::<f64, 3>(&text, words)?).is_none(),
                Some("scale") => scale.replace(numbers::<f64, 1>(&text, words)?).is_none(),
                _ => false,
            };
            if !known {
                return Err(malformed(format!("{text:?} does not belong in its header")));
            }
        }
        let [depth, height, width] = dim.ok_or_else(|| malformed("its header has no line \"dim\"".into()))?;
        if depth != height || height != width || !(1..=MAX_RESOLUTION).contains(&depth) {
            return Err(malformed(format!(
                "its grid is {depth} x {height} x {width}; only cubes of 1 to {MAX_RESOLUTION} voxels a side are read"
            )));
        }
        let header = Self {
            version,
            resolution: depth,
            translate: Point3::from(translate.unwrap_or_default()),
            scale: scale.map_or(1.0, |[scale]| scale),
        };
        Ok((header, rest))
    }
}

fn numbers<'a, T: std::str::FromStr, const N: usize>(
    line: &str,
    words: impl Iterator<Item = &'a str>,
) -> Result<[T; N], MeshError> {
    let numbers: Option<Vec<T>> = words.map(|word| word.parse().ok()).collect();
    numbers
        .and_then(|numbers| numbers.try_into().ok())
        .ok_or_else(|| malformed(format!("{line:?} in its header needs {N} numbers")))
}

fn malformed(detail: String) -> MeshError {
    MeshError::Malformed { format: "binvox", detail }
}

fn truncated(n: usize, runs: usize) -> MeshError {
    MeshError::Truncated { format: "binvox", detail: format!("its {runs} runs do not fill {n} x {n} x {n} voxels") }
}
