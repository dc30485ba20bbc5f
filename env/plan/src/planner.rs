//! The planner: boxes, candidate poses, collision filter, ranking.

use crate::PlanError;
use crate::boxes::{BoxTree, DecomposeParams, OrientedBox, decompose};
use crate::collision::{CollisionScene, Feasibility, Neighbour, Obstacle, Touch};
use crate::open_hand::OpenHand;
use crate::pairs::{Surroundings, propose_across};
use crate::poses::{PoseParams, Proposal, propose};
use crate::rank::{self, Prediction};
use graspbox_hand::{GraspPose, Hand};
use graspbox_mesh::{TriMesh, in_range};
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// An object at rest; the table is the plane z = 0 of the world.
#[derive(Clone, Debug)]
pub struct PlanObject<'a> {
    /// Surface, object frame, metres.
    pub mesh: &'a TriMesh,
    /// Its geometry for collision queries: the mesh, and the convex parts that the simulation uses.
    pub obstacle: &'a Arc<Obstacle>,
    /// Centre of mass, object frame, metres.
    pub center_of_mass: Point3<f64>,
    /// Pose of the object at rest.
    pub world_from_object: Isometry3<f64>,
    /// Other objects and walls.
    pub neighbours: Arc<[Neighbour]>,
}

/// Settings of the planner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlanParams {
    /// The box decomposition.
    pub decompose: DecomposeParams,
    /// The candidate poses.
    pub poses: PoseParams,
    /// Least distance of the open hand from object and table, metres.
    pub clearance: f64,
    /// Length of the straight approach along the hand's z, metres.
    pub standoff: f64,
    /// Greatest [`Touch::press`] of a neighbour by a feasible pose, metres; 0 refuses every touch.
    pub max_press: f64,
    /// Score lost for each metre of press, 1/m.
    pub press_penalty: f64,
    /// Seed of the random variations.
    pub seed: u64,
}

impl Default for PlanParams {
    fn default() -> Self {
        Self {
            decompose: DecomposeParams { max_boxes: 8, ..DecomposeParams::default() },
            poses: PoseParams::default(),
            clearance: 0.001,
            standoff: 0.10,
            max_press: 0.0,
            press_penalty: 2000.0,
            seed: 0,
        }
    }
}

/// A pose with its feasibility and score.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Candidate {
    /// The pose, object frame.
    pub grasp: GraspPose,
    /// Index of the box that it comes from, in the order of [`BoxTree::leaves`]; the number of leaves denotes the box around the whole object. For a
    /// pose across a wall, the nearest box.
    pub box_index: usize,
    /// Face of the box: `2 axis` on the positive side of the axis, `2 axis + 1` on the negative.
    pub face: usize,
    /// Higher is better; comparable within a plan. 0 for poses that are not feasible.
    pub score: f64,
    /// Result of the collision filter.
    pub feasibility: Feasibility,
    /// How far the open hand pushes neighbours; 0 for poses that are not feasible.
    pub touch: Touch,
    /// Prediction of the closed hand; `None` for poses that are not feasible.
    pub prediction: Option<Prediction>,
}

impl Candidate {
    /// True if the open hand, at the pose and on the approach, collides with nothing but neighbours that it may push aside.
    pub fn feasible(&self) -> bool {
        is_feasible(self.feasibility)
    }
}

/// A plan: candidate poses, the feasible ones first, ranked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    pub tree: BoxTree,
    /// Feasible candidates, best first, then the others in the order of their creation.
    pub candidates: Vec<Candidate>,
    /// Number of feasible candidates.
    pub feasible: usize,
    /// Pose of the object at rest.
    pub world_from_object: Isometry3<f64>,
}

impl Plan {
    /// The feasible candidates, best first.
    pub fn ranked(&self) -> &[Candidate] {
        &self.candidates[..self.feasible]
    }
}

/// Plans grasps of an object with a hand by geometry. Equal input returns equal plans with any number of threads.
///
/// # Errors
/// [`PlanError::OutOfRange`] for bad parameters, [`PlanError::Degenerate`] for a flat mesh, [`PlanError::UnsupportedHand`],
/// [`PlanError::UnknownTerm`] and [`PlanError::Collision`] as named there.
pub fn plan(object: &PlanObject<'_>, hand: &Hand, params: &PlanParams) -> Result<Plan, PlanError> {
    in_range("clearance", params.clearance, 0.0..=0.05, "m")?;
    in_range("standoff", params.standoff, 0.0..=1.0, "m")?;
    in_range("max_press", params.max_press, 0.0..=0.05, "m")?;
    in_range("press_penalty", params.press_penalty, 0.0..=1e6, "1/m")?;
    params.poses.validate()?;
    let tree = decompose(object.mesh, &params.decompose)?;
    let scene =
        CollisionScene::among(Arc::clone(object.obstacle), &object.world_from_object, Arc::clone(&object.neighbours));
    let boxes = boxes_of(&tree, &params.poses);
    let mut proposals = propose(&boxes, &object.center_of_mass, &scene.up(), hand, &params.poses, params.seed)?;
    let samples = rank::samples(object.mesh);
    let thin = Surroundings { samples: &samples, boxes: &boxes, up: scene.up() };
    proposals.extend(propose_across(&thin, hand, &params.poses, params.seed, proposals.len())?);
    let grasps: Vec<GraspPose> = proposals.iter().map(|proposal| proposal.grasp).collect();
    let found = filter(&scene, hand, &grasps, params)?;
    let candidate = |(proposal, (feasibility, touch)): (&Proposal, &(Feasibility, Touch))| Candidate {
        grasp: proposal.grasp,
        box_index: proposal.box_index,
        face: proposal.face,
        score: 0.0,
        prediction: None,
        feasibility: *feasibility,
        touch: *touch,
    };
    let (free, others): (Vec<_>, Vec<_>) =
        proposals.iter().zip(&found).partition(|(_, (feasibility, _))| is_feasible(*feasibility));
    let feasible: Vec<Proposal> = free.iter().map(|(proposal, _)| **proposal).collect();
    let penalties: Vec<f64> = free.iter().map(|(_, (_, touch))| params.press_penalty * touch.press).collect();
    let ranked = rank::rank(&samples, object.center_of_mass, hand, &scene, &feasible, &penalties)?;
    let scored = ranked.into_iter().map(|row| Candidate {
        score: row.score,
        prediction: Some(row.prediction),
        ..candidate(free[row.index])
    });
    let candidates = scored.chain(others.into_iter().map(candidate)).collect();
    Ok(Plan { tree, candidates, feasible: feasible.len(), world_from_object: object.world_from_object })
}

fn is_feasible(feasibility: Feasibility) -> bool {
    matches!(feasibility, Feasibility::Feasible | Feasibility::PushesNeighbour)
}

/// The collision filter, which lets poses pass that push neighbours aside by no more than `params.max_press`.
fn filter(
    scene: &CollisionScene,
    hand: &Hand,
    grasps: &[GraspPose],
    params: &PlanParams,
) -> Result<Vec<(Feasibility, Touch)>, PlanError> {
    let hands = OpenHands::new(hand, grasps, params.clearance, params.standoff)?;
    let check = |grasp: &GraspPose| {
        let feasibility = hands.check(scene, grasp);
        if feasibility != Feasibility::HitsNeighbour || params.max_press == 0.0 {
            return (feasibility, Touch::default());
        }
        match scene.touch(hands.of(grasp), &grasp.object_from_hand) {
            Some(touch) if touch.press <= params.max_press => (Feasibility::PushesNeighbour, touch),
            _ => (feasibility, Touch::default()),
        }
    };
    Ok(grasps.par_iter().map(check).collect())
}

/// Passes any grasps through the planner's collision filter, which refuses every touch.
///
/// * `clearance`, `standoff`: as in [`PlanParams`], metres.
///
/// # Errors
/// As [`OpenHand::new`].
pub fn check_grasps(
    scene: &CollisionScene,
    hand: &Hand,
    grasps: &[GraspPose],
    clearance: f64,
    standoff: f64,
) -> Result<Vec<Feasibility>, PlanError> {
    let hands = OpenHands::new(hand, grasps, clearance, standoff)?;
    Ok(grasps.par_iter().map(|grasp| hands.check(scene, grasp)).collect())
}

/// Candidate poses on the faces of boxes without any filter, outermost box first.
///
/// * `centroid`, `up`: centre of the object and normal of the table, in the frame of the boxes.
///
/// # Errors
/// As [`plan`], for `params` and the hand.
pub fn box_grasps(
    tree: &BoxTree,
    centroid: &Point3<f64>,
    up: &Vector3<f64>,
    hand: &Hand,
    params: &PoseParams,
    seed: u64,
) -> Result<Vec<GraspPose>, PlanError> {
    params.validate()?;
    let proposals = propose(&boxes_of(tree, params), centroid, up, hand, params, seed)?;
    Ok(proposals.into_iter().map(|proposal| proposal.grasp).collect())
}

/// The leaves with their indices, then the box around the whole object if `params.whole` and it is not the only leaf.
fn boxes_of(tree: &BoxTree, params: &PoseParams) -> Vec<(usize, OrientedBox)> {
    let mut boxes: Vec<(usize, OrientedBox)> = tree.leaves().copied().enumerate().collect();
    if params.whole && boxes.len() > 1 {
        boxes.push((boxes.len(), tree.nodes[0].bounds));
    }
    boxes
}

/// The open hand, grown by the clearance, for each preshape in use.
struct OpenHands(Vec<(f64, OpenHand)>);

impl OpenHands {
    fn new(hand: &Hand, grasps: &[GraspPose], clearance: f64, standoff: f64) -> Result<Self, PlanError> {
        let mut hands: Vec<(f64, OpenHand)> = Vec::new();
        for preshape in grasps.iter().map(|grasp| grasp.preshape) {
            if !hands.iter().any(|(known, _)| *known == preshape) {
                hands.push((preshape, OpenHand::new(hand, preshape, clearance, standoff)?));
            }
        }
        Ok(Self(hands))
    }

    /// The hand with the preshape of a grasp.
    fn of(&self, grasp: &GraspPose) -> &OpenHand {
        let found = self.0.iter().position(|(known, _)| *known == grasp.preshape).unwrap_or(0);
        &self.0[found].1
    }

    fn check(&self, scene: &CollisionScene, grasp: &GraspPose) -> Feasibility {
        scene.check(self.of(grasp), &grasp.object_from_hand)
    }
}
