//! The tables of all inputs and outputs of environments, from which spaces, infos and documentation are made.

use crate::actions::control::{ActionSpec, Control, Fingers};
use crate::actions::workspace::{WORKSPACE_HIGH, WORKSPACE_LOW};
use crate::config::Randomization;
use crate::observations::column::Column;
use crate::observations::info::{InfoTableRow, failure_names, goal_info_table, info_table, target_info_table};
use crate::observations::observation::Observation;
use crate::rewards::goal_terms::goal_term_table;
use crate::rewards::reward::{TermRow, term_table};
use graspbox_episode::approach::STOP_FORCE;
use graspbox_hand::Hand;
use graspbox_render::{CamerasConfig, ImageTable, Observer, RenderError};
use serde::Serialize;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Columns of each observation, by its name.
pub type ObservationTables = BTreeMap<&'static str, Vec<Column>>;

/// A value by the names of control mode and fingers.
pub type ByAction<T> = BTreeMap<&'static str, BTreeMap<&'static str, T>>;

/// Inputs and outputs of environments whose steps are decisions.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DecisionTables {
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
        let action = ActionSpec { control, ..ActionSpec::default() };
        Self {
            actions: action.table(hand),
            observations: observations(hand, action),
            terms: term_table(control),
            info: info_table(control, hand.carrier.is_some()),
        }
    }
}

/// What environments with goals have besides the actions and observations of closed-loop control.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GoalTables {
    /// Columns of the observations of the goal.
    pub observations: ObservationTables,
    /// Reward terms, the first of their values.
    pub terms: Vec<TermRow>,
    /// Entries of the info.
    pub info: Vec<InfoTableRow>,
}

/// Inputs and outputs of the environments of a hand.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tables {
    /// Columns of an action, by the names of control mode and fingers.
    pub actions: ByAction<Vec<Column>>,
    /// Columns of the observations, by the same names: the state includes the last action.
    pub observations: ByAction<ObservationTables>,
    /// With one decision per episode.
    pub decision: DecisionTables,
    /// The same, about a point.
    pub point: DecisionTables,
    /// With decisions until a scene is cleared.
    pub clear: DecisionTables,
    /// With goals.
    pub goal: GoalTables,
    /// Names of the observations that no sensor of a real robot measures.
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
    /// use graspbox_gym::{ActionSpec, Tables};
    /// use graspbox_hand::Hand;
    ///
    /// let hand = Hand::reflex()?;
    /// let tables = Tables::new(&hand);
    /// let size = |columns: &[graspbox_gym::Column]| columns.iter().map(|column| column.size).sum::<usize>();
    /// assert_eq!(size(&tables.actions["twist"]["synergy"]), ActionSpec::default().size(&hand));
    /// assert_eq!(size(&tables.observations["twist"]["each"]["state"]), 88);
    /// assert_eq!(tables.privileged, ["state"]);
    /// assert!(tables.terms.iter().any(|term| term.name == "reach" && term.low == -1.0));
    /// assert_eq!(tables.failures[0], "");
    /// # Ok::<(), graspbox_hand::HandError>(())
    /// ```
    pub fn new(hand: &Hand) -> Self {
        Self {
            actions: by_action(hand, |action| action.table(hand)),
            observations: by_action(hand, |action| observations(hand, action)),
            decision: DecisionTables::new(hand, Control::GraspPose),
            point: DecisionTables::new(hand, Control::GraspPoint),
            clear: DecisionTables::new(hand, Control::Clear),
            goal: GoalTables {
                observations: Observation::GOAL.map(|o| (o.name(), o.table(hand, ActionSpec::default()))).into(),
                terms: goal_term_table(),
                info: goal_info_table(hand.carrier.is_some()),
            },
            privileged: Observation::ALL.iter().filter(|o| o.privileged()).map(|o| o.name()).collect(),
            absent: Observation::ALL
                .iter()
                .filter(|o| !o.exists(hand, ActionSpec::default()))
                .map(|o| o.name())
                .collect(),
            terms: term_table(Control::default()),
            info: info_table(Control::default(), hand.carrier.is_some()),
            target_info: target_info_table(),
            failures: failure_names(),
            workspace: [WORKSPACE_LOW, WORKSPACE_HIGH],
            stop_force: STOP_FORCE,
            randomization: BTreeMap::from([("standard", Randomization::standard())]),
        }
    }
}

fn by_action<T>(hand: &Hand, of: impl Fn(ActionSpec) -> T) -> ByAction<T> {
    let by_fingers = |control: Control| {
        Fingers::ALL.iter().map(|&fingers| (fingers.name(), of(ActionSpec { control, fingers }))).collect()
    };
    Control::closed_loops(hand).map(|control| (control.name(), by_fingers(control))).collect()
}

fn observations(hand: &Hand, action: ActionSpec) -> ObservationTables {
    let there = Observation::ALL.iter().filter(|o| o.exists(hand, action));
    there.map(|o| (o.name(), o.table(hand, action))).collect()
}

/// The rows of the images of `cameras`.
///
/// * `objects`: most objects of a scene.
///
/// # Errors
/// [`RenderError`] for an image that is unknown or named twice, an invalid camera, or invalid voxel settings.
pub fn image_tables(hand: &Arc<Hand>, cameras: CamerasConfig, objects: usize) -> Result<Vec<ImageTable>, RenderError> {
    Ok(Observer::new(Arc::clone(hand), cameras, Arc::default(), objects)?.tables().to_vec())
}
