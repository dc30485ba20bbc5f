//! Formats, limits, and the output of a parser.

use crate::error::MeshError;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The formats that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Stereolithography, binary or ASCII.
    Stl,
    /// Polygon file format, ASCII or binary of either byte order.
    Ply,
    /// Wavefront.
    Obj,
    /// Object file format, text.
    Off,
    /// glTF 2.0, binary (GLB) or JSON.
    Gltf,
}

/// The endings of files, and their formats.
const ENDINGS: [(&str, MeshFormat); 6] = [
    (".stl", MeshFormat::Stl),
    (".ply", MeshFormat::Ply),
    (".obj", MeshFormat::Obj),
    (".off", MeshFormat::Off),
    (".glb", MeshFormat::Gltf),
    (".gltf", MeshFormat::Gltf),
];

impl MeshFormat {
    /// The format that the ending of `path` names, in any case.
    pub fn from_path(path: &Path) -> Option<Self> {
        let ending = path.extension()?.to_str()?.to_ascii_lowercase();
        ENDINGS.iter().find(|(known, _)| known[1..] == ending).map(|(_, format)| *format)
    }

    /// The endings of files that are read, in lower case, with the dot.
    pub fn endings() -> [&'static str; ENDINGS.len()] {
        ENDINGS.map(|(ending, _)| ending)
    }

    /// Its name, as errors spell it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stl => "STL",
            Self::Ply => "PLY",
            Self::Obj => "OBJ",
            Self::Off => "OFF",
            Self::Gltf => "glTF",
        }
    }
}

/// How a file is read, and how much of it at most.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LoadOptions {
    /// Metres in one unit of the file: 1 for metres, 0.001 for millimetres.
    pub scale: f64,
    /// Largest file, bytes.
    pub max_bytes: u64,
    /// Most vertices.
    pub max_vertices: u64,
    /// Most triangles, after polygons have been cut into triangles.
    pub max_faces: u64,
}

impl Default for LoadOptions {
    /// Metres; 256 MiB, 4 million vertices and triangles (a scanned object has 10^4 to 10^6).
    fn default() -> Self {
        Self { scale: 1.0, max_bytes: 256 << 20, max_vertices: 4_000_000, max_faces: 4_000_000 }
    }
}

/// Vertices and faces as a parser found them: in the file's unit, not yet checked.
#[derive(Default)]
pub(crate) struct Raw {
    pub vertices: Vec<Point3<f64>>,
    pub faces: Vec<[u32; 3]>,
    /// Faces with fewer than three corners, which are left out.
    pub edges: usize,
    /// Sentences for a warning: what was left out of the shape.
    pub notes: Vec<String>,
    /// Faces of the meshes that have ended.
    pub ended: usize,
}

impl Raw {
    /// Ends a mesh of a file that may hold several: its faces name no vertex of the next one.
    pub fn end_mesh(&mut self) -> Result<(), MeshError> {
        let count = self.vertices.len();
        for (face, corners) in self.faces.iter().enumerate().skip(self.ended) {
            if let Some(&vertex) = corners.iter().find(|&&vertex| vertex as usize >= count) {
                return Err(MeshError::BadIndex { face, vertex, count });
            }
        }
        self.ended = self.faces.len();
        Ok(())
    }

    /// Cuts a polygon into the fan of triangles around its first corner.
    pub fn push_polygon(
        &mut self,
        format: MeshFormat,
        corners: &[u32],
        options: &LoadOptions,
    ) -> Result<(), MeshError> {
        if corners.len() < 3 {
            self.edges += 1;
            return Ok(());
        }
        check_count(format, "triangles", (self.faces.len() + corners.len() - 2) as u64, options.max_faces)?;
        self.faces.extend(corners[1..].windows(2).map(|w| [corners[0], w[0], w[1]]));
        Ok(())
    }
}

/// Compares the size of a file with its limit.
pub(super) fn check_size(format: MeshFormat, bytes: u64, options: &LoadOptions) -> Result<(), MeshError> {
    if bytes > options.max_bytes {
        return Err(MeshError::FileTooLarge { format: format.name(), bytes, limit: options.max_bytes });
    }
    Ok(())
}

/// Compares a count with its limit.
pub(in crate::io) fn check_count(
    format: MeshFormat,
    what: &'static str,
    count: u64,
    limit: u64,
) -> Result<(), MeshError> {
    // Indices are u32, so a larger limit of the caller does not apply.
    let limit = limit.min(u64::from(u32::MAX));
    if count > limit {
        return Err(MeshError::TooMany { format: format.name(), what, count, limit });
    }
    Ok(())
}
