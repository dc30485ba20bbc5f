//! A saved state, and the checks of one of unknown origin: a checksum shows damage, not the author.

use serde::{Deserialize, Serialize};

use super::{ObjectState, Solver, State};
use crate::contact::{Contact, Side};
use crate::error::{FARTHEST, StateError, is_place, is_pose, is_unit, is_within};
use crate::model::{BodyKind, Model};
use crate::problem::newton::FactoredDerivative;
use crate::search::SavedSearch;

/// Greatest velocity, m/s and rad/s, a thousand times that at which a world counts as diverged.
const FASTEST: f64 = 3e4;
/// Greatest coordinate of a joint, rad or m.
const OPENED: f64 = 1e3;
/// Greatest force, N.
const STRONGEST: f64 = 1e9;
/// Least and greatest factor on friction or mass.
const FACTORS: [f64; 2] = [1e-6, 1e6];
/// A count that leaves room for more.
const MOST_STEPS: u64 = 1 << 53;

/// A saved state: with the starting points of the search for contacts and of Newton's method.
#[derive(Serialize, Deserialize)]
pub struct SavedState {
    state: State,
    search: SavedSearch,
    newton: Vec<FactoredDerivative>,
    contacts: Vec<Contact>,
    rested: Vec<Contact>,
}

impl Solver {
    /// The state to be saved.
    #[must_use]
    pub fn save(&self) -> SavedState {
        let mut contacts = Vec::new();
        self.contacts(|_, _| true, |contact| contacts.push(*contact));
        let (search, newton) = (self.searcher.save(), self.newton.save());
        SavedState { state: self.state.clone(), search, newton, contacts, rested: self.rested.clone() }
    }

    /// Takes a saved state.
    ///
    /// # Errors
    /// [`StateError`] for a state of another model, or one that no world can be in; nothing changes then.
    pub fn load(&mut self, saved: SavedState) -> Result<(), StateError> {
        let (new, old) = (&saved.state, &self.state);
        let fits = new.positions.len() == old.positions.len()
            && new.rates.len() == old.rates.len()
            && new.cable_forces.len() == old.cable_forces.len();
        if !fits {
            return Err(StateError::OtherModel { what: "coordinates" });
        }
        if new.objects.len() != old.objects.len() {
            return Err(StateError::OtherModel { what: "objects" });
        }
        new.check()?;
        saved.search.check(&self.model)?;
        if !saved.contacts.iter().chain(&saved.rested).all(|contact| contact_is_possible(contact, &self.model)) {
            return Err(StateError::Impossible { what: "contacts" });
        }
        self.newton.load(&self.model, saved.newton)?;
        self.searcher.load(saved.search);
        self.state = saved.state;
        (self.loaded, self.rested) = (saved.contacts, saved.rested);
        self.sources.clear();
        Ok(())
    }
}

impl State {
    fn check(&self) -> Result<(), StateError> {
        self.objects.iter().try_for_each(ObjectState::check)?;
        possible(&[
            ("joint positions", is_within(&self.positions, OPENED)),
            ("joint rates", is_within(&self.rates, FASTEST)),
            ("cable forces", is_within(&self.cable_forces, STRONGEST)),
            ("unconverged steps", self.unconverged_steps <= MOST_STEPS),
        ])
    }
}

impl ObjectState {
    fn check(&self) -> Result<(), StateError> {
        let factor = |x: f64| (FACTORS[0]..=FACTORS[1]).contains(&x);
        possible(&[
            ("object's pose", is_pose(&self.base_from_object)),
            ("object's velocity", is_within(self.linear.iter().chain(&self.angular), FASTEST)),
            ("friction factor", factor(self.friction_factor)),
            ("mass factor", factor(self.mass_factor)),
            ("sleep", is_within([&self.slow_for], FASTEST)),
            ("sleep", self.asleep.as_ref().is_none_or(is_pose)),
        ])
    }
}

fn possible(checks: &[(&'static str, bool)]) -> Result<(), StateError> {
    match checks.iter().find(|(_, possible)| !possible) {
        Some((what, _)) => Err(StateError::Impossible { what }),
        None => Ok(()),
    }
}

fn contact_is_possible(contact: &Contact, model: &Model) -> bool {
    let side = |side: &Side| {
        let known = match model.kind(side.body) {
            BodyKind::Hand(body) => usize::from(side.shape) < model.shapes_of[body].len(),
            BodyKind::Object(_) => true,
            BodyKind::Scenery => side.body == model.scenery_body(),
        };
        known && is_place(&side.point) && is_unit(&side.normal)
    };
    contact.sides.iter().all(side)
        && is_place(&contact.point)
        && is_unit(&contact.normal)
        && (0.0..=FACTORS[1]).contains(&contact.friction)
        && is_within([&contact.distance], FARTHEST)
        && is_within([&contact.force], STRONGEST)
}
