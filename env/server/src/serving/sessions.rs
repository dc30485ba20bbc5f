//! The sessions of a server, by number.

use crate::serving::environment::random;
use crate::serving::hub::Hub;
use crate::serving::session::Session;
use crate::wire::fault::Fault;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The sessions of a server.
pub struct Sessions {
    /// Their shared state.
    pub hub: Arc<Hub>,
    next: AtomicU64,
    all: Mutex<BTreeMap<u64, Arc<Session>>>,
}

impl Sessions {
    /// No sessions yet.
    pub fn new(hub: Arc<Hub>) -> Self {
        Self { hub, next: AtomicU64::new(1), all: Mutex::default() }
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<u64, Arc<Session>>> {
        self.all.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A number that is unique among sessions and connections.
    pub fn number(&self) -> u64 {
        self.next.fetch_add(1, Ordering::Relaxed)
    }

    /// A session that is not counted yet: its client, at the address `peer`, has no environments.
    ///
    /// # Errors
    /// A system without random numbers.
    pub fn blank(&self, peer: SocketAddr) -> Result<Arc<Session>, Fault> {
        Ok(Session::new(self.number(), random()?, peer, Arc::clone(&self.hub)))
    }

    /// Counts a session that is about to make environments.
    ///
    /// # Errors
    /// A full server.
    pub fn admit(&self, session: &Arc<Session>) -> Result<(), Fault> {
        let mut all = self.lock();
        let most = self.hub.config.max_sessions;
        // A session whose environments could not be made is not counted.
        if all.values().filter(|other| other.is_made()).count() >= most {
            self.hub.metrics.refuse("sessions", &session.peer);
            return Err(Fault::config("", format!("all {most} sessions of this server are in use; try again later")));
        }
        all.insert(session.id, Arc::clone(session));
        Ok(())
    }

    /// The session that a client resumes.
    ///
    /// # Errors
    /// A wrong number or secret, or a session that is over.
    pub fn find(&self, id: u64, secret: u64) -> Result<Arc<Session>, Fault> {
        let found = self.lock().get(&id).filter(|session| session.knows(secret)).cloned();
        found.ok_or_else(|| {
            let message = "there is no session of this number and secret; it may have ended: make environments again";
            Fault { kind: "ConnectionLostError".to_owned(), ..Fault::config("session", message) }
        })
    }

    pub fn end(&self, session: &Session, why: &'static str) {
        session.end(why);
        self.lock().remove(&session.id);
    }

    /// Ends the sessions whose time is over, and continues the others: cancelled steps end without a message, and a command may wait
    /// for them.
    pub fn reap(&self) {
        let idle = Duration::from_secs_f64(self.hub.config.idle_timeout);
        let all: Vec<_> = self.lock().values().cloned().collect();
        for session in all {
            if session.is_over(idle) {
                self.end(&session, "the session was not used for too long");
            } else {
                session.advance();
            }
        }
    }

    /// True while a command of any session runs.
    pub fn are_busy(&self) -> bool {
        self.lock().values().any(|session| session.is_busy())
    }

    /// Ends all sessions.
    pub fn end_all(&self, why: &'static str) {
        let all: Vec<_> = std::mem::take(&mut *self.lock()).into_values().collect();
        all.iter().for_each(|session| session.end(why));
    }
}
