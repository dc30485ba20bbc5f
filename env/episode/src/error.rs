//! What can be wrong with a scene, a trial or a batch; each variant is a sentence about the input.

/// What can be wrong with a scene, a trial or a batch.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EpisodeError {
    /// The world could not be built.
    #[error("object `{object}`: {source}")]
    Sim {
        /// Name of the object.
        object: String,
        /// What the simulation said.
        source: graspbox_sim::SimError,
    },
    /// The mesh could not be used.
    #[error("object `{object}`: {source}")]
    Mesh {
        /// Name of the object.
        object: String,
        /// What the mesh code said.
        source: graspbox_mesh::MeshError,
    },
    /// The planner refused.
    #[error("object `{object}`: {source}")]
    Plan {
        /// Name of the object.
        object: String,
        /// What the planner said.
        source: graspbox_plan::PlanError,
    },
    /// A setting is out of its range.
    #[error("`{field}` is {value}, but it must be {expected}")]
    BadConfig {
        /// Name of the setting.
        field: &'static str,
        /// What was given.
        value: f64,
        /// What would be accepted.
        expected: &'static str,
    },
    /// The object does not come to rest on the table.
    #[error("object `{object}` does not come to rest on the table: {why}; choose another world_from_object")]
    NoRest {
        /// Name of the object.
        object: String,
        /// What happened instead.
        why: &'static str,
    },
    /// The batch was told to stop.
    #[error("stopped after {done} of {total}")]
    Cancelled {
        /// Trials, or steps, that were finished.
        done: usize,
        /// Those that were asked for.
        total: usize,
    },
}
