//! The tables of all inputs and outputs of environments, from which spaces, infos and documentation are made.

use crate::actions::control::{CONTROL_PERIOD, Control};
use crate::actions::workspace::{WORKSPACE_HIGH, WORKSPACE_LOW};
use crate::config::Randomization;
use crate::observations::column::Column;
use crate::observations::info::{InfoTableRow, failure_names, info_table, target_info_table};
use crate::observations::observation::Observation;
use crate::rewards::reward::{TermRow, term_table};
use graspbox_episode::approach::STOP_FORCE;
use graspbox_hand::Hand;
use graspbox_vision::{CamerasConfig, ImageTable, Observer, VisionError};
use serde::Serialize;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Columns of each observation, by its name.
pub type ObservationTables = BTreeMap<&'static str, Vec<Column>>;

/// Inputs and outputs of environments whose steps are decisions.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DecisionTables {
    /// Columns of an action.
    pub actions: Vec<Column>,
    /// Columns of the observations.
    pub observations: ObservationTables,
    /// Reward terms that are not always 0.
    pub terms: Vec<TermRow>,
    /// Entries of the info.
    pub info: Vec<InfoTableRow>,
}

impl DecisionTables {
    fn new(hand: &Hand, control: Control) -> Self {
        Self {
            actions: control.table(hand),
            observations: observations(hand, control),
            terms: term_table(control),
            info: info_table(control),
        }
    }
}

/// Inputs and outputs of the environments of a hand.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tables {
    /// Columns of an action, by the name of the control mode.
    pub actions: BTreeMap<&'static str, Vec<Column>>,
    /// Columns of the observations, by the name of the control mode: the state includes the last action.
    pub observations: BTreeMap<&'static str, ObservationTables>,
    /// With one decision per episode.
    pub decision: DecisionTables,
    /// With decisions until a scene is cleared.
    pub clear: DecisionTables,
    /// Names of the observations that no sensor of a real robot gives.
    pub privileged: Vec<&'static str>,
    /// Reward terms, in the order of their values.
    pub terms: Vec<TermRow>,
    /// Entries of the info.
    pub info: Vec<InfoTableRow>,
    /// Further entries of the info with one target among several objects.
    pub target_info: Vec<InfoTableRow>,
    /// Observations of sensors that the hand does not have.
    pub absent: Vec<&'static str>,
    /// Names of the failure codes.
    pub failures: Vec<&'static str>,
    /// Seconds between two actions.
    pub control_period: f64,
    /// Corners of the box in which the grasp frame stays, world frame, metres.
    pub workspace: [[f64; 3]; 2],
    /// Net contact force above which the protective stop holds the hand, N.
    pub stop_force: f64,
    /// Presets of the randomization, by name.
    pub randomization: BTreeMap<&'static str, Randomization>,
}

impl Tables {
    /// The tables of a hand.
    ///
    /// ```
    /// use graspbox_agent::{Control, Tables};
    /// use graspbox_hand::Hand;
    ///
    /// let hand = Hand::reflex()?;
    /// let tables = Tables::new(&hand);
    /// let size = |columns: &[graspbox_agent::Column]| columns.iter().map(|column| column.size).sum::<usize>();
    /// assert_eq!(size(&tables.actions["twist"]), Control::Twist.size(&hand));
    /// assert_eq!(size(&tables.observations["twist"]["state"]), 88);
    /// assert_eq!(tables.privileged, ["state"]);
    /// assert!(tables.terms.iter().any(|term| term.name == "reach" && term.low == -1.0));
    /// assert_eq!(tables.failures[0], "");
    /// # Ok::<(), graspbox_hand::HandError>(())
    /// ```
    pub fn new(hand: &Hand) -> Self {
        let closed_loop = Control::CLOSED_LOOP.iter();
        Self {
            actions: closed_loop.clone().map(|c| (c.name(), c.table(hand))).collect(),
            observations: closed_loop.map(|c| (c.name(), observations(hand, *c))).collect(),
            decision: DecisionTables::new(hand, Control::GraspPose),
            clear: DecisionTables::new(hand, Control::Clear),
            privileged: Observation::ALL.iter().filter(|o| o.privileged()).map(|o| o.name()).collect(),
            absent: Observation::ALL.iter().filter(|o| !o.exists(hand, Control::default())).map(|o| o.name()).collect(),
            terms: term_table(Control::default()),
            info: info_table(Control::default()),
            target_info: target_info_table(),
            failures: failure_names(),
            control_period: CONTROL_PERIOD,
            workspace: [WORKSPACE_LOW, WORKSPACE_HIGH],
            stop_force: STOP_FORCE,
            randomization: BTreeMap::from([("standard", Randomization::standard())]),
        }
    }
}

fn observations(hand: &Hand, control: Control) -> ObservationTables {
    let there = Observation::ALL.iter().filter(|o| o.exists(hand, control));
    there.map(|o| (o.name(), o.table(hand, control))).collect()
}

/// The rows of the images of `cameras`.
///
/// * `objects`: most objects of a scene.
///
/// # Errors
/// [`VisionError`] for an image that is unknown or named twice, an invalid camera, or invalid voxel settings.
pub fn image_tables(hand: &Arc<Hand>, cameras: CamerasConfig, objects: usize) -> Result<Vec<ImageTable>, VisionError> {
    Ok(Observer::new(Arc::clone(hand), cameras, Arc::default(), objects)?.tables().to_vec())
}
