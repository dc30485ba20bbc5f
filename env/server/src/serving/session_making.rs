//! Making the environments of a session: bounds first, then Python, then the answer.

use crate::serving::environment::{Environment, MadeEnvironments};
use crate::serving::hub::MakeJob;
use crate::serving::session::Session;
use crate::serving::session_state::State;
use crate::wire::answer;
use crate::wire::command::SessionOptions;
use crate::wire::fault::Fault;
use graspbox_gym::pool::env_pool::MOST_ENVS;
use graspbox_mesh::in_range;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

impl Session {
    pub(crate) fn make(
        self: &Arc<Self>,
        state: &mut State,
        id: u64,
        request: serde_json::Value,
        asked: SessionOptions,
    ) {
        let (grace, most) = (asked.grace, self.hub.config.max_grace);
        if !(0.0..=most).contains(&grace) {
            let message = format!("grace is {grace}; this server lets a session wait for 0 to {most} s");
            return self.answer(state, Some(id), Err(Fault::config("grace", message)));
        }
        if state.lease.is_some() {
            let message = "this session has environments already; open another connection for more";
            return self.answer(state, Some(id), Err(Fault::config("command", message)));
        }
        let count = asked.num_envs;
        if let Err(error) = in_range("num_envs", count as f64, 1.0..=MOST_ENVS as f64, "") {
            return self.answer(state, Some(id), Err(Fault::config("num_envs", error.to_string())));
        }
        match self.hub.lease(count, self.peer) {
            Ok(lease) => state.lease = Some(lease),
            Err(fault) => return self.answer(state, Some(id), Err(fault)),
        }
        let stop = Arc::new(AtomicBool::new(false));
        state.running = Some(Arc::clone(&stop));
        let session = Arc::clone(self);
        self.hub.make(MakeJob::new(request, stop, move |made| {
            let frame = made.and_then(|made| session.made(id, made, asked));
            let mut state = session.lock();
            if frame.is_err() {
                state.lease = None;
            } else {
                state.grace = Duration::from_secs_f64(grace);
            }
            drop(state);
            session.finish(id, frame);
        }));
    }

    /// Stores the new environments; the answer describes them.
    fn made(&self, id: u64, made: MadeEnvironments, asked: SessionOptions) -> Result<Vec<u8>, Fault> {
        // An answer may hold the end of an episode and the beginning of the next.
        let bytes = 2 * made.pool.len() * answer::row_bytes(made.pool.spec());
        let most = self.hub.config.max_message;
        if bytes > most {
            let message = format!(
                "the answers of these environments would have up to {bytes} bytes; this server sends {most}: \
                 make fewer, or with smaller images"
            );
            return Err(Fault::config("num_envs", message));
        }
        let description = made.description.clone();
        let environment = Environment::new(made, asked, bytes, most, self.hub.classify)?;
        let mut frame = answer::begin(id, 4, 0);
        frame.text("session");
        frame.unsigned(self.id);
        frame.text("secret");
        if asked.grace > 0.0 {
            frame.unsigned(self.lock().secret)
        } else {
            frame.nil()
        }
        frame.text("description");
        frame.json(&description);
        frame.text("segment");
        match environment.segment() {
            Some(name) => frame.text(name),
            None => frame.nil(),
        }
        tracing::info!("session {} begins, of {}: {} environments", self.id, self.peer, environment.pool.len());
        self.lock().environment = Some(Arc::new(environment));
        Ok(frame.into_bytes())
    }
}
