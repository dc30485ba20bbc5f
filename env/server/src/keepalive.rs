//! Detection of peers that vanish without closing their connection: power loss, unplugged cables, firewall timeouts.
//!
//! The kernel probes the peer, so that a client need not read while it computes.

use socket2::{SockRef, TcpKeepalive};
use std::time::Duration;

/// Idle time before the first probe.
const IDLE: Duration = Duration::from_secs(20);
/// Time between two probes.
const INTERVAL: Duration = Duration::from_secs(10);
/// Unanswered probes after which the connection is closed: 50 s after the peer was last heard.
const PROBES: u32 = 3;
/// Time without an acknowledgement of sent bytes after which the connection is closed.
#[cfg(target_os = "linux")]
const UNACKNOWLEDGED: Duration = Duration::from_secs(60);

/// Sets both limits of a connection. A limit that the system lacks is skipped.
#[cfg(unix)]
pub fn set(stream: &impl std::os::fd::AsFd) {
    apply(&SockRef::from(stream));
}

/// Sets both limits of a connection. A limit that the system lacks is skipped.
#[cfg(windows)]
pub fn set(stream: &impl std::os::windows::io::AsSocket) {
    apply(&SockRef::from(stream));
}

fn apply(socket: &SockRef<'_>) {
    let keepalive = TcpKeepalive::new().with_time(IDLE).with_interval(INTERVAL).with_retries(PROBES);
    drop(socket.set_tcp_keepalive(&keepalive));
    #[cfg(target_os = "linux")]
    drop(socket.set_tcp_user_timeout(Some(UNACKNOWLEDGED)));
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::net::{TcpListener, TcpStream};

    #[test]
    fn limits_are_set() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let stream = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        assert!(!SockRef::from(&stream).keepalive().unwrap());
        set(&stream);
        let socket = SockRef::from(&stream);
        assert!(socket.keepalive().unwrap());
        #[cfg(target_os = "linux")]
        {
            assert_eq!(socket.tcp_keepalive_time().unwrap(), IDLE);
            assert_eq!(socket.tcp_user_timeout().unwrap(), Some(UNACKNOWLEDGED));
        }
    }
}
