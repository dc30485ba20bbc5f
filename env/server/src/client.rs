//! A client of environments: numbers commands, waits for answers, and resumes its session after a lost connection.

use crate::client_socket::{ClientError, ClientOptions, Incoming, PATIENCE, Socket};
use crate::wire::decode::{decode, leading_id};
use crate::wire::encode::Encoder;
use crate::wire::value::Value;
use bytes::Bytes;
use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

/// The server's description of the session, for resuming it.
#[derive(Clone, Copy, Debug)]
struct ResumeInfo {
    session: u64,
    secret: u64,
}

/// A client of environments.
pub struct Client {
    url: String,
    options: ClientOptions,
    /// Time for which to reconnect after the connection was lost.
    grace: Duration,
    socket: Option<Socket>,
    /// The first frame of the server.
    hello: Bytes,
    /// Largest frame accepted by the server, bytes.
    max_message: usize,
    next: u64,
    seen: u64,
    ticket: Option<ResumeInfo>,
    /// Number of the command whose answer holds the ticket.
    making: Option<u64>,
    lost: Option<Instant>,
    /// Commands that may have to be resent.
    unanswered: VecDeque<(u64, Bytes)>,
    answers: BTreeMap<u64, Bytes>,
    /// Commands whose answers are discarded.
    unwanted: Vec<u64>,
    process: u32,
}

impl Client {
    /// Connects, and reads the first frame of the server.
    ///
    /// * `grace`: time for which to resume the session after a lost connection; zero: not at all.
    ///
    /// # Errors
    /// As [`Socket::open`], or a server whose first message is not a frame.
    pub fn connect(url: &str, options: ClientOptions, grace: Duration) -> Result<Self, ClientError> {
        let (socket, hello) = greet(url, &options)?;
        let max_message = max_message(&hello);
        Ok(Self {
            max_message,
            url: url.to_owned(),
            options,
            grace,
            socket: Some(socket),
            hello,
            next: 1,
            seen: 0,
            ticket: None,
            making: None,
            lost: None,
            unanswered: VecDeque::new(),
            answers: BTreeMap::new(),
            unwanted: Vec::new(),
            process: std::process::id(),
        })
    }

    /// The address of the server.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// The first frame of the server.
    pub fn hello(&self) -> &Bytes {
        &self.hello
    }

    /// Sends a command; returns its number.
    ///
    /// * `fields`: number of fields that `write` appends, key and value each.
    ///
    /// # Errors
    /// [`ClientError::TooLarge`] for a frame above the server's limit, and nothing is sent; or a lost connection whose session cannot be
    /// resumed.
    pub fn submit(
        &mut self,
        command: &str,
        fields: usize,
        write: impl FnOnce(&mut Encoder),
    ) -> Result<u64, ClientError> {
        let id = self.next;
        let mut frame = Encoder::default();
        frame.map(fields + 3);
        frame.text("id");
        frame.unsigned(id);
        frame.text("command");
        frame.text(command);
        frame.text("seen");
        frame.unsigned(self.seen);
        write(&mut frame);
        let frame = Bytes::from(frame.into_bytes());
        if frame.len() > self.max_message {
            return Err(ClientError::TooLarge { url: self.url.clone(), bytes: frame.len(), most: self.max_message });
        }
        self.next += 1;
        if command == "make" {
            self.making = Some(id);
        }
        if !self.grace.is_zero() {
            self.unanswered.push_back((id, frame.clone()));
        }
        match &mut self.socket {
            Some(socket) => {
                if let Err(error) = socket.send(frame) {
                    self.lose(error)?;
                }
            }
            // The command is sent after reconnection.
            None if !self.grace.is_zero() => {}
            None => return Err(self.closed()),
        }
        Ok(id)
    }

    /// The answer to command `id`; none within [`PATIENCE`].
    ///
    /// # Errors
    /// A broken connection whose session cannot be resumed within its grace.
    pub fn poll(&mut self, id: u64) -> Result<Option<Bytes>, ClientError> {
        if let Some(answer) = self.answers.remove(&id) {
            return Ok(Some(answer));
        }
        let Some(socket) = &mut self.socket else {
            self.reconnect()?;
            return Ok(None);
        };
        match socket.receive() {
            Ok(None) if socket.is_silent() => {
                let why = "it has been silent for a minute".to_owned();
                self.lose(ClientError::Unreachable { url: self.url.clone(), why })?;
                Ok(None)
            }
            Ok(None) => Ok(None),
            Ok(Some(Incoming::Text(text))) => Err(ClientError::Protocol { url: self.url.clone(), why: text }),
            Ok(Some(Incoming::Frame(frame))) => {
                self.take(frame)?;
                Ok(self.answers.remove(&id))
            }
            Err(error) => {
                self.lose(error)?;
                Ok(None)
            }
        }
    }

    /// Time since the connection was lost, while there is none.
    pub fn lost(&self) -> Option<Duration> {
        self.lost.filter(|_| self.socket.is_none()).map(|since| since.elapsed())
    }

    /// Discards the answer to command `id`.
    pub fn forget(&mut self, id: u64) {
        if self.answers.remove(&id).is_none() {
            self.unwanted.push(id);
        }
    }

    /// Breaks the connection, as a network failure would: for tests of resuming a session.
    pub fn break_off(&mut self) {
        self.socket = None;
        self.lost.get_or_insert_with(Instant::now);
    }

    fn closed(&self) -> ClientError {
        ClientError::Unreachable { url: self.url.clone(), why: "the connection is closed".to_owned() }
    }

    /// Keeps an answer.
    fn take(&mut self, frame: Bytes) -> Result<(), ClientError> {
        let wrong = |why: String| ClientError::Protocol { url: self.url.clone(), why };
        let Some(id) = leading_id(&frame) else {
            let value = decode(&frame).map_err(|error| wrong(error.to_string()))?;
            let why = value.get("error").and_then(|error| error.get("message"));
            return Err(wrong(match why {
                Some(Value::Text(message)) => (*message).to_owned(),
                _ => "an answer has no number".to_owned(),
            }));
        };
        if self.making == Some(id) {
            self.making = None;
            let value = decode(&frame).map_err(|error| wrong(error.to_string()))?;
            let number = |name| match value.get(name) {
                Some(Value::Integer(number)) => u64::try_from(*number).ok(),
                _ => None,
            };
            self.ticket =
                number("session").zip(number("secret")).map(|(session, secret)| ResumeInfo { session, secret });
        }
        self.seen = self.seen.max(id);
        self.lost = None;
        self.unanswered.retain(|(sent, _)| *sent != id);
        match self.unwanted.iter().position(|unwanted| *unwanted == id) {
            Some(index) => drop(self.unwanted.swap_remove(index)),
            None => drop(self.answers.insert(id, frame)),
        }
        Ok(())
    }

    /// The connection is lost.
    fn lose(&mut self, error: ClientError) -> Result<(), ClientError> {
        self.socket = None;
        let over = matches!(error, ClientError::SessionLost { .. });
        if over || self.ticket.is_none() || self.grace.is_zero() {
            return Err(error);
        }
        self.lost.get_or_insert_with(Instant::now);
        Ok(())
    }

    /// Tries once to resume the session.
    fn reconnect(&mut self) -> Result<(), ClientError> {
        let Some(ticket) = self.ticket else {
            return Err(self.closed());
        };
        let since = *self.lost.get_or_insert_with(Instant::now);
        match self.resume(ticket) {
            Ok(()) => {
                // Resent commands may break the connection again; only their answers show that it holds.
                if self.unanswered.is_empty() {
                    self.lost = None;
                }
                Ok(())
            }
            Err(error @ ClientError::Unreachable { .. }) => {
                if since.elapsed() > self.grace {
                    return Err(error);
                }
                std::thread::sleep(PATIENCE);
                Ok(())
            }
            Err(error) => Err(error),
        }
    }

    fn resume(&mut self, ticket: ResumeInfo) -> Result<(), ClientError> {
        let (mut socket, _) = greet(&self.url, &self.options)?;
        let mut frame = Encoder::default();
        frame.map(5);
        frame.text("id");
        // Numbers of commands begin with 1, so answers cannot be confused.
        frame.unsigned(0);
        frame.text("command");
        frame.text("resume");
        for (name, number) in [("session", ticket.session), ("secret", ticket.secret), ("received", self.seen)] {
            frame.text(name);
            frame.unsigned(number);
        }
        socket.send(frame.into_bytes().into())?;
        let answer = first(&mut socket, &self.url)?;
        let value = decode(&answer).map_err(|error| self.wrong(error.to_string()))?;
        let received = match value.get("received") {
            Some(Value::Integer(received)) => u64::try_from(*received).unwrap_or_default(),
            _ => {
                let why = match value.get("error").and_then(|error| error.get("message")) {
                    Some(Value::Text(why)) => (*why).to_owned(),
                    _ => "the server did not take it up".to_owned(),
                };
                return Err(ClientError::SessionLost { url: self.url.clone(), why });
            }
        };
        for (_, frame) in self.unanswered.iter().filter(|(id, _)| *id > received) {
            socket.send(frame.clone())?;
        }
        self.socket = Some(socket);
        Ok(())
    }

    fn wrong(&self, why: String) -> ClientError {
        ClientError::Protocol { url: self.url.clone(), why }
    }
}

impl Drop for Client {
    /// Ends the session, so that its environments do not wait for an absent client. A forked process leaves this to its parent.
    fn drop(&mut self) {
        if self.ticket.is_some() && std::process::id() == self.process {
            drop(self.submit("close", 0, |_| ()));
        }
    }
}

/// Connects, and reads the first frame.
///
/// # Errors
/// As [`Client::connect`].
pub fn greet(url: &str, options: &ClientOptions) -> Result<(Socket, Bytes), ClientError> {
    let mut socket = Socket::open(url, options)?;
    let hello = first(&mut socket, url)?;
    Ok((socket, hello))
}

/// Largest frame accepted by a server, from its first frame; unlimited if that has none.
fn max_message(hello: &[u8]) -> usize {
    let Ok(value) = decode(hello) else {
        return usize::MAX;
    };
    match value.get("limits").and_then(|limits| limits.get("max_message")) {
        Some(Value::Integer(most)) => usize::try_from(*most).unwrap_or(usize::MAX),
        _ => usize::MAX,
    }
}

/// The next frame, within ten seconds.
fn first(socket: &mut Socket, url: &str) -> Result<Bytes, ClientError> {
    let started = Instant::now();
    while started.elapsed() < Duration::from_secs(10) {
        match socket.receive()? {
            Some(Incoming::Frame(frame)) => return Ok(frame),
            Some(Incoming::Text(why)) => return Err(ClientError::Protocol { url: url.to_owned(), why }),
            None => {}
        }
    }
    Err(ClientError::Unreachable { url: url.to_owned(), why: "it sends nothing".to_owned() })
}
