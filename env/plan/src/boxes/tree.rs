//! The tree of boxes, and a check of its invariants.

use super::obb::OrientedBox;
use super::split::Split;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxNode {
    /// The box around this node's part of the object.
    pub bounds: OrientedBox,
    /// The cut that divides it, and the indices of its two children (lower side of the cut first); `None` for a leaf.
    pub cut: Option<(Split, [usize; 2])>,
    /// Number of cuts between this node and the root.
    pub depth: usize,
}

/// A box decomposition: a binary tree whose leaves together cover the object. Frame of the object, metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxTree {
    /// Nodes in depth-first order: the root is 0, and parents come before their children.
    pub nodes: Vec<BoxNode>,
}

impl BoxTree {
    /// The leaves' boxes, depth first.
    pub fn leaves(&self) -> impl Iterator<Item = &OrientedBox> {
        self.nodes.iter().filter(|node| node.cut.is_none()).map(|node| &node.bounds)
    }

    /// The leaves' boxes as a list, depth first.
    pub fn boxes(&self) -> Vec<OrientedBox> {
        self.leaves().copied().collect()
    }

    /// Sum of the leaves' volumes, m3; overlaps count twice.
    pub fn volume(&self) -> f64 {
        self.leaves().map(OrientedBox::volume).sum()
    }
}

/// A broken invariant of a box tree.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BoxTreeFault {
    /// Not a tree in depth-first order.
    #[error("node {node} breaks the depth-first order of a binary tree")]
    Structure { node: usize },
    /// Axes are not a right-handed orthonormal frame, or sides are not ordered, finite and at least 0.
    #[error("the box of node {node} is not a right-handed box with its longest side first")]
    Box { node: usize },
    /// A point that no leaf contains.
    #[error("point {point} lies {excess} m outside every leaf")]
    Uncovered {
        point: usize,
        /// Distance from the nearest leaf, metres.
        excess: f64,
    },
}

/// Checks that `tree` is a depth-first binary tree of valid boxes whose leaves contain every point of `samples` within `tolerance` metres.
///
/// # Errors
/// The first [`BoxTreeFault`] found.
pub fn check_box_tree(tree: &BoxTree, samples: &[Point3<f64>], tolerance: f64) -> Result<(), BoxTreeFault> {
    let end = check_subtree(tree, 0, 0)?;
    if end != tree.nodes.len() {
        return Err(BoxTreeFault::Structure { node: end });
    }
    let leaves = tree.boxes();
    for (point, p) in samples.iter().enumerate() {
        let excess = leaves.iter().map(|b| b.excess(p)).fold(f64::INFINITY, f64::min);
        if excess > tolerance {
            return Err(BoxTreeFault::Uncovered { point, excess });
        }
    }
    Ok(())
}

/// Checks the subtree of `node`; returns the index of the node after it.
fn check_subtree(tree: &BoxTree, node: usize, depth: usize) -> Result<usize, BoxTreeFault> {
    let found = tree.nodes.get(node).filter(|n| n.depth == depth).ok_or(BoxTreeFault::Structure { node })?;
    if !is_proper(&found.bounds) {
        return Err(BoxTreeFault::Box { node });
    }
    let Some((_, [low, high])) = found.cut else {
        return Ok(node + 1);
    };
    if low != node + 1 || check_subtree(tree, low, depth + 1)? != high {
        return Err(BoxTreeFault::Structure { node });
    }
    check_subtree(tree, high, depth + 1)
}

fn is_proper(bounds: &OrientedBox) -> bool {
    let h = &bounds.half_extents;
    let ordered = h.iter().all(|x| x.is_finite()) && h.x >= h.y && h.y >= h.z && h.z >= 0.0;
    let frame = (bounds.axes.tr_mul(&bounds.axes) - nalgebra::Matrix3::identity()).amax() < 1e-9;
    ordered && frame && bounds.axes.determinant() > 0.0 && bounds.center.iter().all(|x| x.is_finite())
}
