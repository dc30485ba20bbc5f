//! Box decomposition (algorithm 4 of the reference study): fit a box, cut it if that pays, and continue with the halves, largest box first.

use super::fit::{Fit, check_cloud, fit_cloud};
use super::obb::OrientedBox;
use super::split::{Split, SplitCost, best_split};
use super::surface::Surface;
use super::tree::{BoxNode, BoxTree};
use crate::PlanError;
use graspbox_mesh::{TriMesh, in_range, sample_surface};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use std::ops::Bound;

/// Most surface points for the search of cuts.
const MOST_SAMPLES: f64 = 1e6;

/// Settings of the box decomposition.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DecomposeParams {
    /// The fit of each box.
    pub fit: Fit,
    /// A cut is made only if its two rectangles cover less than this share of their face, in (0, 1]. Reference study: 0.9.
    pub area_gain: f64,
    /// Least volume of each child's box, m3. Reference study: 5e-7, a cube of 8 mm.
    pub min_volume: f64,
    /// If set, the children's boxes together must have less than this share of the parent's volume, in (0, 2].
    pub volume_gain: Option<f64>,
    /// Greatest number of leaves, at least 1. Without a cap, tight boxes break up into slivers (400 on a drill).
    pub max_boxes: usize,
    /// The cost that the best cut minimizes.
    pub split_cost: SplitCost,
    /// Number of surface points for the search of cuts, at least 16; ignored for a cloud of points.
    pub samples: usize,
    /// Seed of the surface points.
    pub seed: u64,
}

impl Default for DecomposeParams {
    fn default() -> Self {
        Self {
            fit: Fit::Minimum,
            area_gain: 0.9,
            min_volume: 5e-7,
            volume_gain: None,
            max_boxes: 16,
            split_cost: SplitCost::Share,
            samples: 2000,
            seed: 0,
        }
    }
}

impl DecomposeParams {
    /// # Errors
    /// [`PlanError::OutOfRange`] for the first value out of range.
    pub fn validate(&self) -> Result<(), PlanError> {
        let share = |most: f64| (Bound::Excluded(0.0), Bound::Included(most));
        in_range("area_gain", self.area_gain, share(1.0), "")?;
        in_range("min_volume", self.min_volume, 0.0..f64::INFINITY, "m3")?;
        in_range("volume_gain", self.volume_gain.unwrap_or(1.0), share(2.0), "")?;
        in_range("max_boxes", self.max_boxes as f64, 1.0.., "")?;
        Ok(in_range("samples", self.samples as f64, 16.0..=MOST_SAMPLES, "")?)
    }
}

/// Decomposes a mesh into boxes that cover its whole surface (within 1e-9 m).
///
/// Cuts are searched on surface points spread evenly over the area. Boxes are fitted to these and to the vertices of the surface, whose triangles
/// are clipped at every cut. Leaves are in depth-first order, in the mesh's frame.
///
/// # Errors
/// [`PlanError::OutOfRange`] for bad parameters, [`PlanError::Degenerate`] for a flat mesh.
///
/// Source: K. Huebner, S. Ruthotto, D. Kragic, "Minimum volume bounding box decomposition for shape approximation in robot grasping",
/// ICRA 2008.
pub fn decompose(mesh: &TriMesh, params: &DecomposeParams) -> Result<BoxTree, PlanError> {
    params.validate()?;
    let surface = Surface::of(mesh);
    check_cloud(&surface.vertices)?;
    let samples = sample_surface(mesh, params.samples, params.seed);
    let samples = samples.into_iter().map(|sample| sample.point).collect();
    Ok(grow(Piece { samples, surface }, params))
}

/// Decomposes a cloud of points (metres) into boxes that contain all of them; see [`decompose`].
///
/// # Errors
/// [`PlanError::OutOfRange`] for bad parameters, [`PlanError::Degenerate`] or [`PlanError::NotFinite`] for bad points.
pub fn decompose_points(points: &[Point3<f64>], params: &DecomposeParams) -> Result<BoxTree, PlanError> {
    params.validate()?;
    check_cloud(points)?;
    Ok(grow(Piece { samples: points.to_vec(), surface: Surface::default() }, params))
}

/// A part of the object.
struct Piece {
    samples: Vec<Point3<f64>>,
    surface: Surface,
}

impl Piece {
    fn fit(&self, fit: Fit) -> OrientedBox {
        fit_cloud(&self.samples, &self.surface.vertices, fit)
    }

    fn cut(&self, bounds: &OrientedBox, split: &Split) -> [Self; 2] {
        let (low, high) = self.samples.iter().partition(|p| split.side(bounds, p) < 0.0);
        let [below, above] = self.surface.cut(|p| split.side(bounds, p));
        [Self { samples: low, surface: below }, Self { samples: high, surface: above }]
    }
}

/// A node while the tree grows; nodes are numbered in the order of their creation.
struct Growing {
    bounds: OrientedBox,
    cut: Option<(Split, [usize; 2])>,
    /// The piece, if it may still be cut.
    piece: Option<Piece>,
}

fn grow(root: Piece, params: &DecomposeParams) -> BoxTree {
    let bounds = root.fit(params.fit);
    let mut nodes = vec![Growing { bounds, cut: None, piece: Some(root) }];
    let mut leaves = 1;
    while leaves < params.max_boxes {
        let open = nodes.iter().enumerate().filter(|(_, node)| node.piece.is_some());
        let largest = open.max_by(|(i, a), (j, b)| a.bounds.volume().total_cmp(&b.bounds.volume()).then(j.cmp(i)));
        let Some((index, _)) = largest else { break };
        let Some(piece) = nodes[index].piece.take() else { break };
        if let Some((split, children)) = try_cut(&piece, &nodes[index].bounds, params) {
            nodes[index].cut = Some((split, [nodes.len(), nodes.len() + 1]));
            nodes.extend(children);
            leaves += 1;
        }
    }
    let mut tree = BoxTree { nodes: Vec::with_capacity(nodes.len()) };
    lay_out(&nodes, 0, 0, &mut tree);
    tree
}

/// Cuts a piece if all criteria are met.
fn try_cut(piece: &Piece, bounds: &OrientedBox, params: &DecomposeParams) -> Option<(Split, [Growing; 2])> {
    /// Least number of points on each side of a cut.
    const MIN_POINTS: usize = 3;
    let split = best_split(&piece.samples, bounds, params.split_cost).filter(|split| split.share < params.area_gain)?;
    let [low, high] = piece.cut(bounds, &split);
    if low.samples.len() < MIN_POINTS || high.samples.len() < MIN_POINTS {
        return None;
    }
    let (a, b) = rayon::join(|| low.fit(params.fit), || high.fit(params.fit));
    let (va, vb) = (a.volume(), b.volume());
    let large = va > params.min_volume && vb > params.min_volume;
    let pays = params.volume_gain.is_none_or(|gain| va + vb < gain * bounds.volume());
    let node = |bounds, piece| Growing { bounds, cut: None, piece: Some(piece) };
    (large && pays).then(|| (split, [node(a, low), node(b, high)]))
}

/// Appends the subtree of `node` depth first; returns its index in `tree`.
fn lay_out(nodes: &[Growing], node: usize, depth: usize, tree: &mut BoxTree) -> usize {
    let at = tree.nodes.len();
    tree.nodes.push(BoxNode { bounds: nodes[node].bounds, cut: None, depth });
    if let Some((split, [low, high])) = nodes[node].cut {
        let low = lay_out(nodes, low, depth + 1, tree);
        let high = lay_out(nodes, high, depth + 1, tree);
        tree.nodes[at].cut = Some((split, [low, high]));
    }
    at
}
