//! What a step of many environments showed, as flat arrays.

use crate::env::Outcome;
use crate::env_spec::EnvSpec;
use crate::reward::TERMS;
use graspbox_vision::Pixels;

/// One row an environment; every array is C-contiguous.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Batch {
    /// Index of each row's environment.
    pub envs: Vec<usize>,
    /// One array an observation, in the order of the config.
    pub observations: Vec<Vec<f32>>,
    /// One array an image, in the order of the config.
    pub images: Vec<Pixels>,
    /// Reward terms, (rows, terms).
    pub terms: Vec<f32>,
    /// Ended by success or loss.
    pub terminated: Vec<bool>,
    /// Cut off.
    pub truncated: Vec<bool>,
    /// A new episode began instead of a step.
    pub reset: Vec<bool>,
    /// See [`Info::is_success`](crate::Info).
    pub is_success: Vec<bool>,
    /// See [`Info::is_secure`](crate::Info).
    pub is_secure: Vec<bool>,
    /// See [`Info::failure`](crate::Info).
    pub failure: Vec<u8>,
    /// See [`Info::lift`](crate::Info).
    pub lift: Vec<f64>,
    /// See [`Info::object`](crate::Info).
    pub object: Vec<i64>,
    /// See [`Info::resting`](crate::Info).
    pub resting: Vec<i64>,
    /// See [`Info::touches`](crate::Info).
    pub touches: Vec<bool>,
    /// See [`Info::protective_stop`](crate::Info).
    pub protective_stop: Vec<bool>,
}

impl Batch {
    /// No rows, with room for `rows`.
    pub fn new(spec: &EnvSpec, rows: usize) -> Self {
        let size = |fields: &[crate::Field]| fields.iter().map(|f| f.size).sum::<usize>();
        Self {
            observations: spec.tables.iter().map(|(_, f)| Vec::with_capacity(rows * size(f))).collect(),
            images: spec.observer.blank(rows),
            terms: Vec::with_capacity(rows * TERMS),
            ..Self::default()
        }
    }

    /// Adds a row.
    pub fn push(&mut self, spec: &EnvSpec, env: usize, outcome: &Outcome) {
        self.envs.push(env);
        let mut rest = outcome.observations.as_slice();
        for ((_, fields), array) in spec.tables.iter().zip(&mut self.observations) {
            let size = fields.iter().map(|f| f.size).sum::<usize>().min(rest.len());
            let (own, others) = rest.split_at(size);
            array.extend_from_slice(own);
            rest = others;
        }
        for (array, image) in self.images.iter_mut().zip(&outcome.images) {
            array.extend(image);
        }
        self.terms.extend_from_slice(&outcome.terms);
        self.terminated.push(outcome.terminated);
        self.truncated.push(outcome.truncated);
        self.reset.push(outcome.reset);
        let info = &outcome.info;
        self.is_success.push(info.is_success);
        self.is_secure.push(info.is_secure);
        self.failure.push(info.failure);
        self.lift.push(info.lift);
        self.object.push(info.object as i64);
        self.resting.push(info.resting);
        self.touches.push(info.touches);
        self.protective_stop.push(info.protective_stop);
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
        self.is_success.append(&mut other.is_success);
        self.is_secure.append(&mut other.is_secure);
        self.failure.append(&mut other.failure);
        self.lift.append(&mut other.lift);
        self.object.append(&mut other.object);
        self.resting.append(&mut other.resting);
        self.touches.append(&mut other.touches);
        self.protective_stop.append(&mut other.protective_stop);
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.envs.len()
    }

    /// True without rows.
    pub fn is_empty(&self) -> bool {
        self.envs.is_empty()
    }
}
