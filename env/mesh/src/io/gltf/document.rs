//! The part of a glTF document that places triangles. All else (materials, cameras, animations) is skipped, right or wrong.

use super::malformed;
use crate::error::MeshError;
use crate::io::format::{MeshFormat, check_count};
use nalgebra::{Matrix4, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;

/// Most nodes, meshes, accessors and other objects together; a large assembly has 10^5.
const MOST_OBJECTS: u64 = 1 << 20;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document {
    scene: Option<usize>,
    #[serde(default)]
    scenes: Vec<Scene>,
    #[serde(default)]
    pub nodes: Vec<Node>,
    #[serde(default)]
    pub meshes: Vec<Mesh>,
    #[serde(default)]
    pub accessors: Vec<Accessor>,
    #[serde(default)]
    pub buffer_views: Vec<View>,
    #[serde(default)]
    pub buffers: Vec<Buffer>,
}

#[derive(Deserialize)]
struct Scene {
    #[serde(default)]
    nodes: Vec<usize>,
}

#[derive(Deserialize)]
pub(super) struct Node {
    #[serde(default)]
    pub children: Vec<usize>,
    pub mesh: Option<usize>,
    skin: Option<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
    #[serde(default)]
    extensions: Extensions,
}

#[derive(Deserialize)]
pub(super) struct Mesh {
    #[serde(default)]
    pub primitives: Vec<Primitive>,
    weights: Option<IgnoredAny>,
}

#[derive(Deserialize)]
pub(super) struct Primitive {
    pub attributes: Attributes,
    pub indices: Option<usize>,
    pub mode: Option<u32>,
    #[serde(default)]
    extensions: Extensions,
}

#[derive(Deserialize)]
pub(super) struct Attributes {
    #[serde(rename = "POSITION")]
    pub position: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub buffer_view: Option<usize>,
    #[serde(default)]
    pub byte_offset: u64,
    pub component_type: u32,
    #[serde(default)]
    pub normalized: bool,
    pub count: u64,
    #[serde(rename = "type")]
    pub kind: String,
    pub sparse: Option<IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct View {
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: u64,
    pub byte_length: u64,
    pub byte_stride: Option<u64>,
    #[serde(default)]
    extensions: Extensions,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub uri: Option<String>,
    pub byte_length: u64,
}

/// Extensions by name; their values are not read.
type Extensions = BTreeMap<String, IgnoredAny>;

/// Draco and meshopt.
fn is_compression(extensions: &Extensions) -> bool {
    extensions.keys().any(|name| name.ends_with("_mesh_compression") || name.ends_with("_meshopt_compression"))
}

impl Document {
    pub fn read(json: &[u8]) -> Result<Self, MeshError> {
        #[derive(Deserialize)]
        struct Head {
            asset: Asset,
        }
        #[derive(Deserialize)]
        struct Asset {
            version: String,
        }
        // A node of two bytes becomes one of hundreds.
        let objects = json.iter().filter(|&&b| b == b'{').count() as u64;
        check_count(MeshFormat::Gltf, "JSON objects", objects, MOST_OBJECTS)?;
        let explain = |error: serde_json::Error| malformed(format!("its JSON: {error}"));
        let document: Result<Self, _> = serde_json::from_slice(json);
        // Version 1 has tables where version 2 has lists.
        let version = serde_json::from_slice::<Head>(json).map_err(explain)?.asset.version;
        if !version.starts_with("2.") {
            return Err(malformed(format!("it is of version {version}, but only version 2 is read; convert it")));
        }
        document.map_err(explain)
    }

    /// The parts of the shape that are not read, as sentences.
    pub fn notes(&self) -> Vec<String> {
        let is_skinned = self.nodes.iter().any(|node| node.skin.is_some());
        let is_repeated = |node: &Node| node.extensions.contains_key("EXT_mesh_gpu_instancing");
        let (scenes, number) = (self.scenes.len(), self.scene.unwrap_or(0));
        let notes = [
            (scenes > 1, format!("of its {scenes} scenes, number {number} is read")),
            (
                is_skinned || self.meshes.iter().any(|mesh| mesh.weights.is_some()),
                "skins and morph targets are not applied to its shape".into(),
            ),
            (self.nodes.iter().any(is_repeated), "meshes that EXT_mesh_gpu_instancing repeats are read once".into()),
        ];
        notes.into_iter().filter(|(applies, _)| *applies).map(|(_, note)| note).collect()
    }

    /// The nodes of the default scene; without scenes those that are no other's child.
    pub fn roots(&self) -> Result<Vec<usize>, MeshError> {
        let wanted = self.scene.unwrap_or(0);
        match self.scenes.get(wanted) {
            Some(scene) => Ok(scene.nodes.clone()),
            None if self.scenes.is_empty() => {
                let mut is_child = vec![false; self.nodes.len()];
                let children = self.nodes.iter().flat_map(|node| &node.children);
                children.for_each(|&child| is_child.get_mut(child).into_iter().for_each(|it| *it = true));
                Ok((0..self.nodes.len()).filter(|&node| !is_child[node]).collect())
            }
            None => Err(super::missing("scene", wanted)),
        }
    }
}

impl Node {
    /// From its own frame to its parent's.
    pub fn matrix(&self) -> Matrix4<f64> {
        if let Some(columns) = self.matrix {
            return Matrix4::from_column_slice(&columns);
        }
        let [x, y, z, w] = self.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.0).unwrap_or_default();
        let scale = Vector3::from(self.scale.unwrap_or([1.0; 3]));
        Translation3::from(self.translation.unwrap_or_default()).to_homogeneous()
            * rotation.to_homogeneous()
            * Matrix4::new_nonuniform_scaling(&scale)
    }
}

impl Primitive {
    /// Whether its values are compressed; a copy without compression may be there too.
    pub fn is_packed(&self) -> bool {
        is_compression(&self.extensions)
    }
}

impl View {
    pub fn is_packed(&self) -> bool {
        is_compression(&self.extensions)
    }
}
