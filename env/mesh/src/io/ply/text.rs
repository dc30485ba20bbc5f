//! The values of a text file, line by line.
//!
//! Own code: `ply-rs-bw` refuses a file for a column that is not read (`nan` in a normal), and the numbers `0.` and `.5`.

use super::{is_corners, malformed};
use crate::error::MeshError;
use crate::io::format::{LoadOptions, MeshFormat, Raw};
use crate::io::text::Words;
use nalgebra::Point3;
use ply_rs_bw::ply::{ElementDef, Header, PropertyType, ScalarType};

/// Reads the elements from `lines`, which have their numbers, into a mesh whose vertices begin at `raw`'s.
pub(super) fn read<'a>(
    lines: &mut impl Iterator<Item = (usize, &'a [u8])>,
    header: &Header,
    raw: &mut Raw,
    options: &LoadOptions,
) -> Result<(), MeshError> {
    let base = raw.vertices.len() as u32;
    let mut corners = Vec::new();
    for (name, element) in &header.elements {
        for row in 0..element.count {
            let (line, text) = lines.find(|(_, text)| !text.trim_ascii().is_empty()).ok_or_else(|| {
                let detail = format!("{row} of {} lines of element {name} are there", element.count);
                MeshError::Truncated { format: "PLY", detail }
            })?;
            let mut words = Words::new(MeshFormat::Ply, line, text);
            match name.as_str() {
                "vertex" => raw.vertices.push(vertex(words, element)?),
                "face" => {
                    corners.clear();
                    face(words, element, base, &mut corners)?;
                    raw.push_polygon(MeshFormat::Ply, &corners, options)?;
                }
                // Its values are not read, but none may be missing: the next element begins behind them.
                _ => element.properties.iter().try_for_each(|(_, p)| skip(&mut words, &p.data_type))?,
            }
        }
    }
    Ok(())
}

fn vertex(mut words: Words, element: &ElementDef) -> Result<Point3<f64>, MeshError> {
    let mut point = Point3::from([f64::NAN; 3]);
    for (name, property) in &element.properties {
        match (["x", "y", "z"].iter().position(|axis| axis == name), &property.data_type) {
            // Rounded as the binary form is.
            (Some(axis), PropertyType::Scalar(ScalarType::Float)) => point[axis] = words.coordinate::<f32>()?,
            (Some(axis), PropertyType::Scalar(_)) => point[axis] = words.coordinate::<f64>()?,
            (_, kind) => skip(&mut words, kind)?,
        }
    }
    if point.iter().any(|x| x.is_nan()) {
        return Err(malformed("a coordinate of its vertices is a list".into()));
    }
    Ok(point)
}

/// Reads the corners of a face; other values are skipped.
fn face(mut words: Words, element: &ElementDef, base: u32, corners: &mut Vec<u32>) -> Result<(), MeshError> {
    for (name, property) in &element.properties {
        if is_corners(name) && matches!(property.data_type, PropertyType::List(..)) {
            for _ in 0..words.number::<usize>()? {
                // Ends with an error at the end of the line, however great the count is.
                corners.push(base.saturating_add(words.number::<u32>()?));
            }
        } else {
            skip(&mut words, &property.data_type)?;
        }
    }
    Ok(())
}

fn skip(words: &mut Words, kind: &PropertyType) -> Result<(), MeshError> {
    let count = if matches!(kind, PropertyType::List(..)) { words.number()? } else { 1 };
    words.skip(count)
}
