//! glTF 2.0, binary (GLB) or JSON: the triangles of the default scene, with the transforms of its nodes, in metres.
//!
//! | module | purpose |
//! |---|---|
//! | `document` | the part of the JSON that is read |
//! | `buffers` | the bytes: of the GLB, in a data URI, or in a file beside it |
//! | `accessor` | positions and indices in those bytes |
//!
//! The y axis stays the vertical one, as in the file: grasps and masses of other programs are in that frame.
//!
//! Own code: the `gltf` crate refuses a file for a texture or an animation that is not read, and reads no quantised positions.

mod accessor;
mod buffers;
mod document;

use super::format::{LoadOptions, MeshFormat, Raw, check_count};
use crate::error::MeshError;
use crate::fast_hash::{FastMap, map_for};
use accessor::Accessors;
use buffers::{Buffers, split};
use document::{Document, Primitive};
use nalgebra::{Matrix4, Point3};
use std::fmt::Display;
use std::path::Path;

/// Kinds of primitive: above 3 triangles in a list, a strip or a fan; below points and lines.
const TRIANGLES: u32 = 4;
const STRIP: u32 = 5;
const FAN: u32 = 6;

/// * `folder`: where buffers that are files of their own lie; without it they are refused.
pub(super) fn parse(bytes: &[u8], folder: Option<&Path>, options: &LoadOptions) -> Result<Raw, MeshError> {
    let (json, binary) = split(bytes)?;
    let document = Document::read(json)?;
    let mut reader = Scene {
        buffers: Buffers::new(&document, binary, folder, options),
        document: &document,
        options,
        raw: Raw { notes: document.notes(), ..Raw::default() },
        primitives: 0,
    };
    reader.read()?;
    Ok(reader.raw)
}

struct Scene<'a> {
    document: &'a Document,
    buffers: Buffers<'a>,
    options: &'a LoadOptions,
    raw: Raw,
    /// Primitives so far, as often as nodes name them; empty ones cost time too.
    primitives: u64,
}

impl Scene<'_> {
    /// Reads the meshes of the nodes; each in its place, as often as nodes name it.
    fn read(&mut self) -> Result<(), MeshError> {
        let nodes = &self.document.nodes;
        if nodes.is_empty() {
            (0..self.document.meshes.len()).try_for_each(|mesh| self.add(mesh, &Matrix4::identity()))?;
        }
        let mut seen = vec![false; nodes.len()];
        // Checked before a node is kept, so that there are never more than nodes.
        let mut first = |index: usize| match seen.get_mut(index).map(|seen| std::mem::replace(seen, true)) {
            Some(false) => Ok(index),
            Some(true) => Err(malformed(format!("node {index} has two parents"))),
            None => Err(missing("node", index)),
        };
        let mut stack: Vec<(usize, Matrix4<f64>)> = Vec::new();
        for root in self.document.roots()?.into_iter().rev() {
            stack.push((first(root)?, Matrix4::identity()));
        }
        while let Some((index, world_from_parent)) = stack.pop() {
            let node = &nodes[index];
            let world_from_node = world_from_parent * node.matrix();
            if let Some(mesh) = node.mesh {
                self.add(mesh, &world_from_node)?;
            }
            for &child in node.children.iter().rev() {
                stack.push((first(child)?, world_from_node));
            }
        }
        Ok(())
    }

    fn add(&mut self, mesh: usize, world_from_mesh: &Matrix4<f64>) -> Result<(), MeshError> {
        let found = self.document.meshes.get(mesh).ok_or_else(|| missing("mesh", mesh))?;
        self.primitives += found.primitives.len() as u64;
        check_count(MeshFormat::Gltf, "primitives", self.primitives, self.options.max_faces)?;
        for (index, primitive) in found.primitives.iter().enumerate() {
            self.add_primitive(primitive, world_from_mesh, &format!("mesh {mesh}, primitive {index}"))?;
        }
        Ok(())
    }

    fn add_primitive(&mut self, it: &Primitive, world_from_mesh: &Matrix4<f64>, name: &str) -> Result<(), MeshError> {
        let mode = it.mode.unwrap_or(TRIANGLES);
        if mode < TRIANGLES {
            return Ok(());
        }
        let accessors = Accessors { document: self.document, is_packed: it.is_packed() };
        let position = it.attributes.position.ok_or_else(|| malformed(format!("{name} has no POSITION")))?;
        let count = accessors.count(it.indices.unwrap_or(position))?;
        let triangles =
            triangles(mode, count).ok_or_else(|| malformed(format!("{name}: {count} corners, mode {mode}")))?;
        let all = self.raw.faces.len() + triangles;
        check_count(MeshFormat::Gltf, "triangles", all as u64, self.options.max_faces)?;
        let corners: Option<Vec<u32>> = it.indices.map(|of| accessors.indices(of, &mut self.buffers)).transpose()?;
        let points = accessors.positions(position, &mut self.buffers)?;
        // A mirror image turns the faces inside out.
        let mirrored = world_from_mesh.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        // Many primitives may share one accessor: each takes the vertices that it uses.
        let mut numbers: FastMap<u32, u32> = map_for(count.min(points.count));
        for mut face in (0..triangles).map(|i| corners_of(mode, i)) {
            if mirrored {
                face.swap(1, 2);
            }
            let mut triangle = [0; 3];
            for (vertex, corner) in triangle.iter_mut().zip(face) {
                let index = corners.as_ref().map_or(corner as u32, |corners| corners[corner]);
                let next = self.raw.vertices.len() as u32;
                *vertex = *numbers.entry(index).or_insert(next);
                if *vertex == next {
                    check_count(MeshFormat::Gltf, "vertices", u64::from(next) + 1, self.options.max_vertices)?;
                    let point = points.get(index as usize).ok_or_else(|| {
                        malformed(format!("{name} names vertex {index}, but it has only {} vertices", points.count))
                    })?;
                    self.raw.vertices.push(placed(world_from_mesh, &point));
                }
            }
            self.raw.faces.push(triangle);
        }
        Ok(())
    }
}

/// A point moved by an affine transform.
fn placed(world_from_mesh: &Matrix4<f64>, point: &Point3<f64>) -> Point3<f64> {
    Point3::from((world_from_mesh * point.to_homogeneous()).xyz())
}

/// Number of triangles that `corners` corners make; `None` if they do not fit.
fn triangles(mode: u32, corners: usize) -> Option<usize> {
    match mode {
        TRIANGLES if corners.is_multiple_of(3) => Some(corners / 3),
        STRIP | FAN => Some(corners.saturating_sub(2)),
        _ => None,
    }
}

/// The three corners of triangle `i`, outside in front.
fn corners_of(mode: u32, i: usize) -> [usize; 3] {
    match mode {
        STRIP => [i + i % 2, i + 1 - i % 2, i + 2],
        FAN => [0, i + 1, i + 2],
        _ => [3 * i, 3 * i + 1, 3 * i + 2],
    }
}

fn missing(what: &str, index: usize) -> MeshError {
    malformed(format!("it names {what} {index}, which does not exist"))
}

fn malformed(detail: impl Display) -> MeshError {
    MeshError::Malformed { format: "glTF", detail: detail.to_string() }
}
