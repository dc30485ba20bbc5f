//! A client of environments over one WebSocket: reads commands, writes answers, pings.

use crate::config::{MAX_UNUSED, PING, SESSION_OVER, TOO_LARGE, WRITE_TIMEOUT};
use crate::serving::session::Session;
use crate::serving::session_state::Outgoing;
use crate::serving::sessions::Sessions;
use crate::wire::answer;
use crate::wire::command::{Command, Request};
use crate::wire::decode::decode;
use crate::wire::fault::Fault;
use axum::extract::ws::{CloseFrame, Message, WebSocket};
use bytes::Bytes;
use std::error::Error;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::time::{interval, timeout};

/// A connection and its current session.
struct Connection {
    sessions: Arc<Sessions>,
    session: Arc<Session>,
    number: u64,
    /// Address of the client.
    peer: SocketAddr,
    sender: UnboundedSender<Outgoing>,
}

/// Serves a client until its connection ends.
///
/// * `peer`: its address.
/// * `hello`: the first frame.
pub async fn serve(mut socket: WebSocket, peer: SocketAddr, sessions: Arc<Sessions>, hello: Bytes) {
    let (sender, outgoing) = unbounded_channel();
    let Ok(session) = sessions.blank(peer) else {
        return;
    };
    let number = sessions.number();
    session.attach((number, sender.clone()), 0, None);
    let mut connection = Connection { sessions, session, number, peer, sender };
    let written = timeout(Duration::from_secs(WRITE_TIMEOUT), socket.send(Message::Binary(hello))).await;
    if matches!(written, Ok(Ok(()))) {
        connection.exchange(&mut socket, outgoing).await;
    }
    let session = &connection.session;
    if session.detach(number) {
        connection.sessions.end(session, "the client is gone");
    }
}

impl Connection {
    async fn exchange(&mut self, socket: &mut WebSocket, mut outgoing: UnboundedReceiver<Outgoing>) {
        let mut pings = interval(Duration::from_secs(PING));
        pings.reset();
        let mut unused = 0;
        loop {
            tokio::select! {
                out = outgoing.recv() => match out {
                    Some(Outgoing::Frame(frame)) => {
                        let bytes = frame.len();
                        if !write(socket, Message::Binary(frame)).await {
                            return;
                        }
                        self.sessions.hub.metrics.sent.inc_by(bytes as u64);
                        self.session.wrote(bytes);
                    }
                    Some(Outgoing::Close(why)) => {
                        let frame = CloseFrame { code: SESSION_OVER, reason: why.into() };
                        write(socket, Message::Close(Some(frame))).await;
                        return;
                    }
                    None => return,
                },
                message = socket.recv(), if self.session.has_room() => match message {
                    Some(Ok(Message::Binary(frame))) => self.read(&frame),
                    Some(Ok(Message::Text(_))) => {
                        let fault = Fault::config("", "commands are binary frames of msgpack; this frame is text");
                        self.session.accept(Err((None, fault)));
                    }
                    Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                    Some(Err(error)) => return refuse(socket, &error, self.sessions.hub.config.max_message).await,
                    Some(Ok(Message::Close(_))) | None => return,
                },
                _ = pings.tick() => {
                    // A client without a session would occupy the place of another.
                    unused = if self.session.is_made() { 0 } else { unused + 1 };
                    if unused > MAX_UNUSED || !write(socket, Message::Ping(Bytes::new())).await {
                        return;
                    }
                },
            }
        }
    }

    /// A frame of the client.
    fn read(&mut self, frame: &[u8]) {
        self.sessions.hub.metrics.received.inc_by(frame.len() as u64);
        let request = match decode(frame) {
            Err(error) => Err((None, Fault::config("", error.to_string()))),
            Ok(value) => Request::parse(&value),
        };
        match request {
            Ok(Request { id, command: Command::Resume { session, secret, received }, .. }) => {
                self.resume(id, session, secret, received);
            }
            Ok(Request { id, command: Command::Make { .. }, .. }) if !self.session.is_made() => match self.admit() {
                Ok(()) => self.session.accept(request),
                Err(fault) => self.session.accept(Err((Some(id), fault))),
            },
            other => self.session.accept(other),
        }
    }

    fn admit(&self) -> Result<(), Fault> {
        if self.sessions.hub.draining.load(Ordering::Acquire) {
            return Err(Fault::config("", "this server is stopping; make environments on another one"));
        }
        self.sessions.admit(&self.session)
    }

    /// Switches to another session.
    fn resume(&mut self, id: u64, session: u64, secret: u64, received: u64) {
        let found = self.sessions.find(session, secret).and_then(|found| {
            let lost = "the session has dropped answers that this client has not received";
            let lost = || Fault { kind: "ConnectionLostError".to_owned(), ..Fault::config("received", lost) };
            found.attach((self.number, self.sender.clone()), received, Some(id)).map(|()| found).ok_or_else(lost)
        });
        match found {
            Ok(found) => {
                tracing::info!("session {session} is taken up again, by {}", self.peer);
                // The previous session loses its client, as if its connection had been lost.
                let before = std::mem::replace(&mut self.session, found);
                if !Arc::ptr_eq(&before, &self.session) && before.detach(self.number) {
                    self.sessions.end(&before, "its client took up another session");
                }
            }
            Err(fault) => drop(self.sender.send(Outgoing::Frame(answer::error(Some(id), &fault).into()))),
        }
    }
}

/// Sends a client with too large a frame the reason for closing; other errors of a connection need no answer.
pub async fn refuse(socket: &mut WebSocket, error: &axum::Error, most: usize) {
    let Some(tungstenite::Error::Capacity(_)) = error.source().and_then(|inner| inner.downcast_ref()) else {
        return;
    };
    let reason = format!("a frame has more than {most} bytes; send less, or raise --max-message of the server");
    write(socket, Message::Close(Some(CloseFrame { code: TOO_LARGE, reason: reason.into() }))).await;
}

/// Writes a message; false if the client does not read it in time.
pub async fn write(socket: &mut WebSocket, message: Message) -> bool {
    matches!(timeout(Duration::from_secs(WRITE_TIMEOUT), socket.send(message)).await, Ok(Ok(())))
}
