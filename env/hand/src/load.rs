//! A hand from its two files: each is read, then both are checked against each other.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use serde::de::DeserializeOwned;

use crate::assemble::assemble;
use crate::error::{HandError, Problem, ProblemKind, Problems, Report};
use crate::model::{Hand, Joint, Link};
use crate::table::{HandTable, Reader};
use crate::urdf::assumption::Assumption;
use crate::urdf::{self, MeshShape, Tree};

/// Largest size of each file, bytes; those of the ReFlex have 20 kB.
pub const MAX_FILE_BYTES: u64 = 1 << 20;

impl Hand {
    /// Reads a hand from a URDF and a `hand.toml`.
    ///
    /// # Errors
    /// [`HandError::Io`] for a file that cannot be read, else as [`Hand::from_strs`].
    pub fn load(urdf: &Path, toml: &Path) -> Result<Self, HandError> {
        let [u, t] = Self::read_files(urdf, toml)?;
        Self::from_strs(&u, &t, [&urdf.display().to_string(), &toml.display().to_string()])
    }

    /// The text of both files, at most [`MAX_FILE_BYTES`] each.
    ///
    /// # Errors
    /// [`HandError::Io`] for a file that cannot be read, [`HandError::Invalid`] for one that is too large or not text.
    pub fn read_files(urdf: &Path, toml: &Path) -> Result<[String; 2], HandError> {
        read_files(urdf, toml)
    }

    /// Reads a hand from the text of a URDF and of a `hand.toml`.
    ///
    /// * `names`: names of the two files in errors.
    ///
    /// # Errors
    /// [`HandError::Invalid`] with every problem, each with its file and line.
    pub fn from_strs(urdf: &str, toml: &str, names: [&str; 2]) -> Result<Self, HandError> {
        let mut links = Report::new(names[0]);
        let mut tables = Report::new(names[1]);
        let tree = read_tree(urdf, &mut links);
        let table = read_table::<HandTable>(toml, &mut tables);
        let mut hand = None;
        if let (Some(tree), Some(table)) = (tree, table) {
            let lines = tree.joint_lines.clone();
            hand = assemble(tree, &table, &mut Reader::new(toml, &mut tables));
            if let Some(hand) = &hand {
                check_driven(hand, &lines, &mut links);
            }
        }
        links.problems.sort_by_key(|p| p.line);
        tables.problems.sort_by_key(|p| p.line);
        links.problems.append(&mut tables.problems);
        match hand.filter(|_| links.problems.is_empty()) {
            Some(hand) => Ok(Self { assumptions: sorted(links.assumptions), ..hand }),
            None => Err(HandError::Invalid(Problems(links.problems))),
        }
    }
}

/// The text of two files: see [`Hand::read_files`].
pub(crate) fn read_files(urdf: &Path, toml: &Path) -> Result<[String; 2], HandError> {
    let mut problems = Vec::new();
    let mut texts = Vec::new();
    for path in [urdf, toml] {
        let name = path.display().to_string();
        match read_file(path)? {
            Ok(text) => texts.push(text),
            Err(kind) => problems.push(Problem { file: name, line: 1, kind }),
        }
    }
    texts.try_into().map_err(|_| HandError::Invalid(Problems(problems)))
}

/// The tables of a file that is not too large.
pub(crate) fn read_table<'a, T: DeserializeOwned>(toml: &'a str, report: &mut Report<'a>) -> Option<T> {
    bounded(toml, report).then(|| Reader::new(toml, report).parse()).flatten()
}

/// Links and joints of a URDF without a `hand.toml`: pads, springs and losses are not known.
///
/// * `name`: name of the file in errors.
///
/// # Errors
/// [`HandError::Invalid`] with every problem, each with its line.
pub fn read_urdf(urdf: &str, name: &str) -> Result<(Vec<Link>, Vec<Joint>), HandError> {
    let mut report = Report::new(name);
    let tree = read_tree(urdf, &mut report);
    finished(tree, report).map(|tree| (tree.links, tree.joints))
}

/// The collision shapes of a URDF that are meshes, which primitives must replace before a hand is made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UrdfMeshes {
    /// The meshes, in the order of the links.
    pub meshes: Vec<MeshShape>,
    /// Bytes of the text at which ` name="NAME"` must be inserted, and NAME: shapes without a name, on links with meshes, are numbered,
    /// and would get other numbers.
    pub unnamed: Vec<(usize, String)>,
}

/// Finds the collision meshes of a URDF that has no other problem.
///
/// * `name`: name of the file in errors.
///
/// # Errors
/// As [`read_urdf`].
pub fn urdf_meshes(urdf: &str, name: &str) -> Result<UrdfMeshes, HandError> {
    let mut report = Report::new(name);
    let tree = bounded(urdf, &mut report).then(|| urdf::read(urdf, &mut report)).flatten();
    finished(tree, report).map(|tree| UrdfMeshes { meshes: tree.meshes, unnamed: tree.unnamed })
}

/// As [`read_urdf`], with numbers that no hand has, such as millimetres; `None` where the file has no tree of links.
#[must_use]
pub fn read_urdf_anyway(urdf: &str) -> Option<(Vec<Link>, Vec<Joint>)> {
    let tree = (urdf.len() as u64 <= MAX_FILE_BYTES).then(|| urdf::read_anyway(urdf)).flatten()?;
    Some((tree.links, tree.joints))
}

/// Reads a URDF whose collision shapes are primitives.
pub(crate) fn read_tree(urdf: &str, report: &mut Report<'_>) -> Option<Tree> {
    let tree = bounded(urdf, report).then(|| urdf::read(urdf, report)).flatten()?;
    for mesh in &tree.meshes {
        report.add(mesh.line, ProblemKind::CollisionMesh { name: mesh.name.clone(), file: mesh.file.clone() });
    }
    Some(tree)
}

/// The tree, or the problems by line.
fn finished(tree: Option<Tree>, mut report: Report<'_>) -> Result<Tree, HandError> {
    report.problems.sort_by_key(|problem| problem.line);
    tree.filter(|_| report.problems.is_empty()).ok_or(HandError::Invalid(Problems(report.problems)))
}

pub(crate) fn sorted(mut assumptions: Vec<Assumption>) -> Vec<Assumption> {
    assumptions.sort_by_key(|assumption| assumption.line);
    assumptions
}

/// Every independent joint must be held by something: a spring, a tendon or an actuator.
fn check_driven(hand: &Hand, lines: &[usize], report: &mut Report<'_>) {
    for joint in hand.coordinates() {
        let tendon = hand.tendons.iter().any(|tendon| tendon.arms.iter().any(|(spanned, _)| *spanned == joint));
        if !tendon && hand.joints[joint].stiffness == 0.0 && hand.driver(joint).is_none() {
            report.add(lines[joint], ProblemKind::Undriven(hand.joints[joint].name.clone()));
        }
    }
}

/// Reads a file as text, at most [`MAX_FILE_BYTES`].
fn read_file(path: &Path) -> Result<Result<String, ProblemKind>, HandError> {
    let io = |source| HandError::Io { path: path.to_owned(), source };
    let file = File::open(path).map_err(io)?;
    let bytes = file.metadata().map_err(io)?.len();
    let mut content = Vec::new();
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut content).map_err(io)?;
    if content.len() as u64 > MAX_FILE_BYTES {
        return Ok(Err(ProblemKind::TooLarge { bytes: bytes.max(content.len() as u64), limit: MAX_FILE_BYTES }));
    }
    Ok(String::from_utf8(content).map_err(|_| ProblemKind::NotText))
}

fn bounded(text: &str, report: &mut Report<'_>) -> bool {
    let bytes = text.len() as u64;
    if bytes > MAX_FILE_BYTES {
        report.add(1, ProblemKind::TooLarge { bytes, limit: MAX_FILE_BYTES });
    }
    bytes <= MAX_FILE_BYTES
}
