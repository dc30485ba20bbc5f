//! The source of an object, and its description from Python.

use crate::EnvError;
use graspbox_episode::{EpisodeError, ObjectSpec};
use graspbox_mesh::LoadOptions;
use graspbox_objects::{Family, generate};
use nalgebra::Point3;
use serde::Deserialize;
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

/// The source of an object.
#[derive(Clone, Debug)]
pub enum Source {
    /// An object in memory.
    Given(Arc<ObjectSpec>),
    /// A mesh file.
    File {
        /// Name of the object.
        name: String,
        path: PathBuf,
        /// Metres per unit of the file.
        scale: f64,
        /// Mass, kg.
        mass: Option<f64>,
    },
    /// A procedural object.
    Procedural {
        /// Name of the object.
        name: String,
        family: Family,
        seed: u64,
        /// Factor on its size.
        scale: f64,
        /// Mass, kg; by default the family's times `scale` cubed.
        mass: Option<f64>,
    },
}

impl Source {
    /// Name of the object.
    pub fn name(&self) -> &str {
        match self {
            Self::Given(spec) => &spec.name,
            Self::File { name, .. } | Self::Procedural { name, .. } => name,
        }
    }

    /// The error with the object's file, if it has one.
    pub fn in_file(&self, error: EnvError) -> EnvError {
        match self {
            Self::File { path, .. } => EnvError::InFile { path: path.clone(), source: Box::new(error) },
            _ => error,
        }
    }

    /// Reads or generates the object.
    ///
    /// # Errors
    /// A file that cannot be read, or a mesh that cannot be used.
    pub fn read(&self) -> Result<ObjectSpec, EnvError> {
        let mesh_error = |source| EpisodeError::Mesh { object: self.name().to_owned(), source };
        match self {
            Self::Given(spec) => Ok(ObjectSpec::clone(spec)),
            Self::File { name, path, scale, mass } => {
                let options = LoadOptions { scale: *scale, ..LoadOptions::default() };
                let mesh = graspbox_mesh::load(path, &options).map_err(mesh_error)?;
                Ok(ObjectSpec { name: name.clone(), mesh, mass: *mass, parts: None })
            }
            Self::Procedural { name, family, seed, scale, mass } => {
                let made = generate(*family, *seed).map_err(mesh_error)?;
                let grow = |part: Vec<Point3<f64>>| part.iter().map(|p| p * *scale).collect();
                Ok(ObjectSpec {
                    name: name.clone(),
                    mesh: made.mesh.scaled(*scale),
                    mass: Some(mass.unwrap_or(made.mass * scale.powi(3))),
                    parts: made.parts.map(|parts| parts.into_iter().map(grow).collect()),
                })
            }
        }
    }
}

impl fmt::Display for Source {
    /// The file if there is one, else the name.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File { path, .. } => write!(f, "`{}`", path.display()),
            Self::Given(_) | Self::Procedural { .. } => write!(f, "object `{}`", self.name()),
        }
    }
}

/// Description of an object that is read or generated at first use: `graspbox.object_sets.ObjectSpec`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectDescription {
    pub name: String,
    /// A mesh file; or `family` and `seed`.
    #[serde(default)]
    pub path: Option<PathBuf>,
    /// A family of procedural objects.
    #[serde(default)]
    pub family: Option<String>,
    /// Seed of a procedural object.
    #[serde(default)]
    pub seed: Option<u64>,
    /// Metres per unit of the file; factor on the size of a procedural object.
    #[serde(default = "unscaled")]
    pub scale: f64,
    /// Mass, kg.
    #[serde(default)]
    pub mass: Option<f64>,
}

fn unscaled() -> f64 {
    1.0
}

impl TryFrom<ObjectDescription> for Source {
    type Error = EnvError;

    fn try_from(description: ObjectDescription) -> Result<Self, EnvError> {
        let ObjectDescription { name, path, family, seed, scale, mass } = description;
        let bad = |object: &str, why: String| EnvError::BadObject { object: object.to_owned(), why };
        if !(scale.is_finite() && scale > 0.0) {
            return Err(bad(&name, format!("scale is {scale}; give a positive factor")));
        }
        match (path, family, seed) {
            (Some(path), None, None) => Ok(Self::File { name, path, scale, mass }),
            (None, Some(family), Some(seed)) => {
                let family = family.parse::<Family>().map_err(|error| bad(&name, error.to_string()))?;
                Ok(Self::Procedural { name, family, seed, scale, mass })
            }
            _ => Err(bad(&name, "it needs either a path, or a family and a seed".to_owned())),
        }
    }
}
