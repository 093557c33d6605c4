//! Why the studio could not open.

use std::io;
use std::net::SocketAddr;

use impasto_scene::file::plainly;

/// Why the studio could not open, or had to close.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// Somebody else listens there.
    #[error(
        "port {} is taken, maybe by another studio; close that one, or choose another with --port \
         (0 takes any that is free)",
        .0.port()
    )]
    PortTaken(SocketAddr),
    /// The address is none of this machine's, or may not be used.
    #[error(
        "cannot listen on {address}: {}; choose another --host or --port",
        plainly(source)
    )]
    Listen {
        /// Where.
        address: SocketAddr,
        /// The system's reason.
        source: io::Error,
    },
    /// The folder of paintings cannot be listed.
    #[error("style folder {folder}: cannot be read ({})", plainly(source))]
    Styles {
        /// The folder.
        folder: String,
        /// The system's reason.
        source: io::Error,
    },
    /// The system gave no random numbers, threads or timers.
    #[error("the studio cannot be opened: {}", plainly(.0))]
    System(#[from] io::Error),
}
