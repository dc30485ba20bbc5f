//! Results of many environments, as flat arrays.

use crate::observations::info::{INFO, InfoArray};
use crate::pool::env_spec::EnvSpec;
use crate::pool::step_result::StepResult;
use crate::rewards::reward::TERM_COUNT;
use graspbox_render::Pixels;

/// One row per environment; every array is C-contiguous.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// Index of the environment of each row.
    pub envs: Vec<usize>,
    /// One array per observation, in the order of the config.
    pub observations: Vec<Vec<f32>>,
    /// One array per image, in the order of the config.
    pub images: Vec<Pixels>,
    /// Reward terms, (rows, terms).
    pub terms: Vec<f32>,
    /// Ended by success or loss.
    pub terminated: Vec<bool>,
    /// Cut off.
    pub truncated: Vec<bool>,
    /// A new episode began instead of a step.
    pub reset: Vec<bool>,
    /// One array per entry of the info, in the order of [`INFO`].
    pub info: Vec<InfoArray>,
}

impl Batch {
    /// An empty batch with capacity for `rows`.
    pub fn new(spec: &EnvSpec, rows: usize) -> Self {
        Self {
            envs: Vec::with_capacity(rows),
            observations: spec.observations.iter().map(|o| Vec::with_capacity(rows * o.size)).collect(),
            images: spec.observer.blank(rows),
            terms: Vec::with_capacity(rows * TERM_COUNT),
            terminated: Vec::with_capacity(rows),
            truncated: Vec::with_capacity(rows),
            reset: Vec::with_capacity(rows),
            info: INFO.iter().map(|row| InfoArray::with_capacity(row, rows)).collect(),
        }
    }

    /// Adds a row.
    pub fn push(&mut self, spec: &EnvSpec, env: usize, result: &StepResult) {
        self.envs.push(env);
        let mut rest = result.observations.as_slice();
        for (observation, array) in spec.observations.iter().zip(&mut self.observations) {
            let (own, others) = rest.split_at(observation.size.min(rest.len()));
            array.extend_from_slice(own);
            rest = others;
        }
        for (array, image) in self.images.iter_mut().zip(&result.images) {
            array.extend(image);
        }
        self.terms.extend_from_slice(&result.terms);
        self.terminated.push(result.terminated);
        self.truncated.push(result.truncated);
        self.reset.push(result.reset);
        for (array, value) in self.info.iter_mut().zip(result.info) {
            array.push(value);
        }
    }

    /// Adds the rows of another batch of the same pool.
    pub fn append(&mut self, mut other: Self) {
        self.envs.append(&mut other.envs);
        for (array, more) in self.observations.iter_mut().zip(&mut other.observations) {
            array.append(more);
        }
        for (array, more) in self.images.iter_mut().zip(&other.images) {
            array.extend(more);
        }
        self.terms.append(&mut other.terms);
        self.terminated.append(&mut other.terminated);
        self.truncated.append(&mut other.truncated);
        self.reset.append(&mut other.reset);
        for (array, more) in self.info.iter_mut().zip(&mut other.info) {
            array.append(more);
        }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.envs.len()
    }

    /// True without rows.
    pub fn is_empty(&self) -> bool {
        self.envs.is_empty()
    }

    /// The entry `name` of the infos; `None` if there is no such entry.
    pub fn info(&self, name: &str) -> Option<&InfoArray> {
        INFO.iter().position(|row| row.name == name).and_then(|index| self.info.get(index))
    }
}
