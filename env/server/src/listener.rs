//! Accepts connections, with TLS or without, and serves HTTP on them. [`keep_alive`] also serves the client's sockets.

use crate::config::{HANDSHAKE, ServerConfig};
use crate::error::ServerError;
use crate::metrics::Metrics;
use crate::pem;
use axum::{Extension, Router};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use socket2::{SockRef, TcpKeepalive};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Runtime;
use tokio::sync::Semaphore;
use tokio::time::{sleep, timeout};
use tokio_rustls::TlsAcceptor;

/// Largest header of a request, bytes.
const MAX_HEAD: usize = 16 << 10;
/// Idle time of a connection before the first probe of its peer.
const IDLE: Duration = Duration::from_secs(20);
/// Time between two probes.
const INTERVAL: Duration = Duration::from_secs(10);
/// Unanswered probes after which a connection is closed: 50 s after its peer was last heard.
const PROBES: u32 = 3;
/// Time without an acknowledgement of sent bytes after which a connection is closed.
#[cfg(target_os = "linux")]
const UNACKNOWLEDGED: Duration = Duration::from_secs(60);

/// Lets the kernel find a peer that vanished without closing its connection: a host that lost power, a cable, a firewall that forgets. The peer's
/// kernel answers, so a client need not read while it computes. A system without one of the limits goes without it.
pub fn keep_alive(socket: &SockRef<'_>) {
    let keepalive = TcpKeepalive::new().with_time(IDLE).with_interval(INTERVAL).with_retries(PROBES);
    drop(socket.set_tcp_keepalive(&keepalive));
    #[cfg(target_os = "linux")]
    drop(socket.set_tcp_user_timeout(Some(UNACKNOWLEDGED)));
}

/// TLS settings of a config; none without files.
///
/// # Errors
/// Only one of both files, a file that cannot be read, or a mismatched pair.
pub fn tls(config: &ServerConfig) -> Result<Option<TlsAcceptor>, ServerError> {
    let (cert, key) = match (&config.tls_cert, &config.tls_key) {
        (Some(cert), Some(key)) => (cert, key),
        (None, None) => return Ok(None),
        _ => return Err(ServerError::HalfTls),
    };
    let (chain, private) = (pem::certificates(cert)?, pem::private_key(key)?);
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let made = rustls::ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .and_then(|builder| builder.with_no_client_auth().with_single_cert(chain, private))
        .map_err(|error| pem::wrong(cert, format!("it cannot be used with {key}: {error}")))?;
    Ok(Some(TlsAcceptor::from(Arc::new(made))))
}

/// Listens at the address of a config.
///
/// # Errors
/// An address that cannot be used.
pub fn bind(runtime: &Runtime, config: &ServerConfig) -> Result<(TcpListener, SocketAddr), ServerError> {
    let address = format!("{}:{}", config.host, config.port);
    let refused = |source| ServerError::Listen { address: address.clone(), source };
    let listener = runtime.block_on(TcpListener::bind((config.host.as_str(), config.port))).map_err(refused)?;
    let bound = listener.local_addr().map_err(refused)?;
    Ok((listener, bound))
}

/// Accepts connections in an endless loop.
///
/// * `most`: most open connections; more are closed at once.
pub async fn accept<F>(listener: TcpListener, tls: Option<TlsAcceptor>, router: Router, most: usize, metrics: F)
where
    F: Fn() -> Arc<Metrics>,
{
    let slots = Arc::new(Semaphore::new(most));
    loop {
        let Ok((stream, peer)) = listener.accept().await else {
            // The process has no free file descriptor, or the client has left already.
            sleep(Duration::from_millis(20)).await;
            continue;
        };
        let metrics = metrics();
        let Ok(slot) = Arc::clone(&slots).try_acquire_owned() else {
            metrics.refuse("connections", &peer);
            continue;
        };
        // Handlers log the address.
        let (tls, router) = (tls.clone(), router.clone().layer(Extension(peer)));
        tokio::spawn(async move {
            metrics.connections.inc();
            serve(stream, tls, router).await;
            metrics.connections.dec();
            drop(slot);
        });
    }
}

async fn serve(stream: TcpStream, tls: Option<TlsAcceptor>, router: Router) {
    // Frames are written whole; waiting for more would cost 40 ms.
    drop(stream.set_nodelay(true));
    keep_alive(&SockRef::from(&stream));
    match tls {
        None => http(stream, router).await,
        Some(tls) => {
            if let Ok(Ok(stream)) = timeout(Duration::from_secs(HANDSHAKE), tls.accept(stream)).await {
                http(stream, router).await;
            }
        }
    }
}

async fn http<S: AsyncRead + AsyncWrite + Unpin + Send + 'static>(stream: S, router: Router) {
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(Duration::from_secs(HANDSHAKE))
        .max_buf_size(MAX_HEAD)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router))
        .with_upgrades();
    // A broken connection is not an error.
    drop(connection.await);
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::net;

    #[test]
    fn limits_of_a_connection_are_set() {
        let listener = net::TcpListener::bind("127.0.0.1:0").unwrap();
        let stream = net::TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        assert!(!SockRef::from(&stream).keepalive().unwrap());
        let socket = SockRef::from(&stream);
        keep_alive(&socket);
        assert!(socket.keepalive().unwrap());
        #[cfg(target_os = "linux")]
        {
            assert_eq!(socket.tcp_keepalive_time().unwrap(), IDLE);
            assert_eq!(socket.tcp_user_timeout().unwrap(), Some(UNACKNOWLEDGED));
        }
    }
}
