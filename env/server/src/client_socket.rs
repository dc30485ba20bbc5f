//! A client's WebSocket: blocking, with a bound on each wait.

use crate::config::{SESSION_OVER, TOO_LARGE};
use crate::listener::keep_alive;
use crate::pem::{self, PemError};
use bytes::Bytes;
use rustls::pki_types::ServerName;
use rustls::{CertificateError, ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use socket2::SockRef;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::error::ProtocolError;
use tungstenite::http::header::AUTHORIZATION;
use tungstenite::http::{HeaderValue, Uri};
use tungstenite::protocol::{CloseFrame, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

/// Longest wait of one call.
pub const PATIENCE: Duration = Duration::from_millis(100);
/// Time for which a client polls for an answer before it sleeps: waking on another core takes longer than a short call.
const SPIN: Duration = Duration::from_micros(50);
/// Waits of [`PATIENCE`] after which a server that pings every 20 s counts as lost: a minute.
const SILENT: u32 = 600;
/// Calls after a long one for which a client does not poll.
const PATIENT: u32 = 15;
/// Timeout of a handshake.
const HANDSHAKE: Duration = Duration::from_secs(10);
/// Largest accepted message, bytes.
const MAX_MESSAGE: usize = 1 << 30;

/// Address and credentials of a server.
#[derive(Clone, Debug, Default)]
pub struct ClientOptions {
    /// The token of the server.
    pub token: Option<String>,
    /// Certificates to trust besides those of the public authorities, a PEM file.
    pub ca: Option<String>,
}

/// A server that cannot be reached, or that does not answer the command.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ClientError {
    /// An invalid address.
    #[error("{url:?} is not a server address: {why}; write ws://HOST:PORT or wss://HOST:PORT")]
    Url {
        /// The given address.
        url: String,
        why: String,
    },
    /// The server does not answer, or the connection broke.
    #[error("the server {url} cannot be reached: {why}")]
    Unreachable {
        /// Its address.
        url: String,
        /// The system's error.
        why: String,
    },
    /// The server refuses this client.
    #[error("the server {url} refuses the connection ({status}): {why}")]
    Refused {
        /// Its address.
        url: String,
        /// HTTP status.
        status: u16,
        /// Its answer.
        why: String,
    },
    /// The certificates to trust cannot be used.
    #[error(transparent)]
    Certificates(#[from] PemError),
    /// An untrusted certificate.
    #[error("the certificate of {url} is not accepted: {why}")]
    Untrusted {
        /// The address of the server.
        url: String,
        /// The problem, and the remedy.
        why: String,
    },
    /// A token that does not fit a header.
    #[error("the token for {url} has characters that no header can hold; it must be printable ASCII, on one line")]
    Token {
        /// The address of the server.
        url: String,
    },
    /// A command larger than the server accepts.
    #[error(
        "a command of {bytes} bytes is larger than the {most} that {url} accepts; send less, or raise its --max-message"
    )]
    TooLarge {
        /// Its address.
        url: String,
        /// Size of the frame.
        bytes: usize,
        /// Largest frame that the server reads.
        most: usize,
    },
    /// An invalid answer.
    #[error("the server {url} does not speak this protocol: {why}")]
    Protocol {
        /// Its address.
        url: String,
        /// The received message.
        why: String,
    },
    /// The server ended the session, or forgot it.
    #[error("the session on {url} is over: {why}")]
    SessionLost {
        /// Its address.
        url: String,
        why: String,
    },
}

enum Stream {
    Plain(TcpStream),
    Tls(Box<StreamOwned<ClientConnection, TcpStream>>),
}

impl Read for Stream {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Plain(stream) => stream.read(bytes),
            Self::Tls(stream) => stream.read(bytes),
        }
    }
}

impl Write for Stream {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Plain(stream) => stream.write(bytes),
            Self::Tls(stream) => stream.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Plain(stream) => stream.flush(),
            Self::Tls(stream) => stream.flush(),
        }
    }
}

/// A received message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Incoming {
    Frame(Bytes),
    /// Text: an error of a policy server.
    Text(String),
}

/// An open WebSocket.
pub struct Socket {
    socket: WebSocket<Stream>,
    /// Calls without polling, since an answer took too long.
    patient: u32,
    /// Consecutive waits without any message, not even a ping.
    quiet: u32,
    /// The same connection, to switch between polling and sleeping.
    control: TcpStream,
    url: String,
}

impl Socket {
    /// Connects.
    ///
    /// # Errors
    /// An invalid address, a server that cannot be reached or refuses, or unreadable certificates.
    pub fn open(url: &str, options: &ClientOptions) -> Result<Self, ClientError> {
        let bad = |why: &str| ClientError::Url { url: url.to_owned(), why: why.to_owned() };
        let uri: Uri = url.parse().map_err(|error| bad(&format!("{error}")))?;
        let host = uri.host().ok_or_else(|| bad("it names no host"))?.trim_matches(['[', ']']);
        let (secure, default) = match uri.scheme_str() {
            Some("ws") => (false, 80),
            Some("wss") => (true, 443),
            _ => return Err(bad("it does not begin with ws:// or wss://")),
        };
        let named = uri
            .authority()
            .is_some_and(|authority| authority.as_str().rsplit(']').next().is_some_and(|s| s.contains(':')));
        if named && uri.port_u16().is_none() {
            return Err(bad("its port is none from 1 to 65535"));
        }
        let mut request = url.into_client_request().map_err(|error| bad(&error.to_string()))?;
        if let Some(token) = &options.token {
            let wrong = || ClientError::Token { url: url.to_owned() };
            let value = HeaderValue::from_str(&format!("Bearer {token}")).ok();
            // A header may have bytes outside ASCII, but no graspbox server has such a token.
            let value = value.filter(|value| value.to_str().is_ok()).ok_or_else(wrong)?;
            request.headers_mut().insert(AUTHORIZATION, value);
        }
        let failed = |why: io::Error| ClientError::Unreachable { url: url.to_owned(), why: why.to_string() };
        let tcp = connect(host, uri.port_u16().unwrap_or(default)).map_err(failed)?;
        tcp.set_nodelay(true).map_err(failed)?;
        keep_alive(&SockRef::from(&tcp));
        tcp.set_read_timeout(Some(HANDSHAKE)).map_err(failed)?;
        let control = tcp.try_clone().map_err(failed)?;
        let stream = if secure { Stream::Tls(Box::new(tls(tcp, host, options, url)?)) } else { Stream::Plain(tcp) };
        let config = WebSocketConfig::default().max_message_size(Some(MAX_MESSAGE)).max_frame_size(Some(MAX_MESSAGE));
        let socket = match tungstenite::client::client_with_config(request, stream, Some(config)) {
            Ok((socket, _)) => socket,
            Err(tungstenite::HandshakeError::Failure(error)) => return Err(refusal(url, error)),
            Err(tungstenite::HandshakeError::Interrupted(_)) => {
                return Err(failed(io::Error::new(ErrorKind::TimedOut, "it does not answer the handshake")));
            }
        };
        control.set_read_timeout(Some(PATIENCE)).map_err(failed)?;
        Ok(Self { socket, patient: 0, quiet: 0, control, url: url.to_owned() })
    }

    fn lost(&self, error: &Error) -> ClientError {
        ClientError::Unreachable { url: self.url.clone(), why: error.to_string() }
    }

    /// True if no message came for so long that a server that pings must be lost.
    pub fn is_silent(&self) -> bool {
        self.quiet >= SILENT
    }

    /// Sends a frame.
    ///
    /// # Errors
    /// A broken connection.
    pub fn send(&mut self, frame: Bytes) -> Result<(), ClientError> {
        self.socket.send(Message::Binary(frame)).map_err(|error| self.lost(&error))
    }

    /// The next message; none if none comes within [`PATIENCE`].
    ///
    /// # Errors
    /// A broken or closed connection; the error has the reason.
    pub fn receive(&mut self) -> Result<Option<Incoming>, ClientError> {
        let failed = |url: &str, why: io::Error| ClientError::Unreachable { url: url.to_owned(), why: why.to_string() };
        if self.patient > 0 {
            self.patient -= 1;
        } else {
            self.control.set_nonblocking(true).map_err(|why| failed(&self.url, why))?;
            let started = Instant::now();
            let mut found = self.next();
            while matches!(found, Ok(None)) && started.elapsed() < SPIN {
                std::hint::spin_loop();
                found = self.next();
            }
            self.control.set_nonblocking(false).map_err(|why| failed(&self.url, why))?;
            if !matches!(found, Ok(None)) {
                return found;
            }
            self.patient = PATIENT;
        }
        let found = self.next();
        if matches!(found, Ok(None)) {
            self.quiet += 1;
        }
        found
    }

    /// Meaning of a close frame: the end of the session if the server says so; the close of a proxy does not end it.
    fn closed(&self, frame: Option<CloseFrame>) -> ClientError {
        let url = self.url.clone();
        match frame {
            Some(frame) if u16::from(frame.code) == SESSION_OVER => {
                ClientError::SessionLost { url, why: frame.reason.to_string() }
            }
            Some(frame) if u16::from(frame.code) == TOO_LARGE => {
                ClientError::Protocol { url, why: frame.reason.to_string() }
            }
            Some(frame) => {
                let why = format!("the connection was closed ({} {})", u16::from(frame.code), frame.reason);
                ClientError::Unreachable { url, why: why.replace(" )", ")") }
            }
            None => ClientError::Unreachable { url, why: "the connection was closed".to_owned() },
        }
    }

    /// The next message; none if reading times out.
    fn next(&mut self) -> Result<Option<Incoming>, ClientError> {
        loop {
            let read = self.socket.read();
            if read.is_ok() {
                self.quiet = 0;
            }
            match read {
                Ok(Message::Binary(frame)) => return Ok(Some(Incoming::Frame(frame))),
                Ok(Message::Text(text)) => return Ok(Some(Incoming::Text(text.to_string()))),
                Ok(Message::Close(frame)) => return Err(self.closed(frame)),
                Ok(_) => {}
                Err(Error::Io(error)) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    return Ok(None);
                }
                Err(error) => return Err(self.lost(&error)),
            }
        }
    }
}

/// Connects to the first address of a host that answers.
fn connect(host: &str, port: u16) -> io::Result<TcpStream> {
    let mut last = io::Error::new(ErrorKind::NotFound, "the host has no address");
    for address in (host, port).to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, HANDSHAKE) {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn tls(
    tcp: TcpStream,
    host: &str,
    options: &ClientOptions,
    url: &str,
) -> Result<StreamOwned<ClientConnection, TcpStream>, ClientError> {
    let mut roots = RootCertStore { roots: webpki_roots::TLS_SERVER_ROOTS.to_vec() };
    if let Some(path) = &options.ca {
        for certificate in pem::certificates(path)? {
            roots.add(certificate).map_err(|error| pem::wrong(path, error))?;
        }
    }
    let failed = |why: String| ClientError::Unreachable { url: url.to_owned(), why };
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(|error| failed(error.to_string()))?
        .with_root_certificates(roots)
        .with_no_client_auth();
    let name = ServerName::try_from(host.to_owned()).map_err(|error| failed(error.to_string()))?;
    let connection = ClientConnection::new(Arc::new(config), name).map_err(|error| failed(error.to_string()))?;
    Ok(StreamOwned::new(connection, tcp))
}

fn refusal(url: &str, error: Error) -> ClientError {
    let url = url.to_owned();
    let unreachable = |why: &str| ClientError::Unreachable { url: url.clone(), why: why.to_owned() };
    match error {
        Error::Http(response) => {
            let status = response.status();
            let body = response.body().as_deref().map(String::from_utf8_lossy).unwrap_or_default();
            let why = match (body.trim(), status.as_u16()) {
                (_, 401) => "give its token: token_file, --token-file or GRASPBOX_TOKEN",
                ("", 400 | 404) => "it has no such page; give only ws://HOST:PORT",
                ("", _) => status.canonical_reason().unwrap_or("it gives no reason"),
                (why, _) => why,
            };
            ClientError::Refused { url: url.clone(), status: status.as_u16(), why: why.to_owned() }
        }
        Error::Io(error) => match error.get_ref().and_then(|inner| inner.downcast_ref::<rustls::Error>()) {
            Some(rustls::Error::InvalidCertificate(why)) => ClientError::Untrusted { url, why: untrusted(why) },
            Some(rustls::Error::InvalidMessage(_)) => {
                unreachable("it does not answer with TLS; try ws:// instead of wss://")
            }
            _ => unreachable(&error.to_string()),
        },
        // A server with TLS answers plain text with an alert, which is not HTTP.
        Error::Protocol(ProtocolError::HttparseError(_)) => {
            unreachable("it does not answer with HTTP; try wss:// instead of ws://")
        }
        other => unreachable(&other.to_string()),
    }
}

/// Describes an untrusted certificate, and the remedy.
fn untrusted(why: &CertificateError) -> String {
    match why {
        CertificateError::UnknownIssuer => "its issuer is unknown; give the issuer's certificate as ca_file".to_owned(),
        CertificateError::Expired | CertificateError::ExpiredContext { .. } => "it has expired; renew it".to_owned(),
        CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. } => {
            "it is for another host name; connect by a name in its subjectAltName".to_owned()
        }
        CertificateError::Other(other) if other.to_string().contains("CaUsedAsEndEntity") => {
            "it is a certificate authority, not a server certificate; sign a server certificate with it".to_owned()
        }
        other => format!("{other:?}"),
    }
}
