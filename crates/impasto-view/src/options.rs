//! Where the studio opens and what it allows.

use std::net::IpAddr;
use std::path::PathBuf;
use std::time::Duration;

/// Where the studio opens.
#[derive(Debug, Clone)]
pub struct ViewOptions {
    /// Address to listen on. Any but this machine's own (loopback) needs a token.
    pub address: IpAddr,
    /// Port; 0 takes any that is free.
    pub port: u16,
    /// Whether a token is needed, which [`crate::Server::link`] shows.
    pub token: bool,
    /// Folder of paintings to choose from.
    pub styles: Option<PathBuf>,
    /// Folder of the model: its training is followed, and favourites are saved, there.
    pub model: PathBuf,
    /// An empty folder for uploads, films and exports; whoever made it removes it.
    pub scratch: PathBuf,
    /// What is allowed.
    pub limits: Limits,
}

/// What clients may take.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Open sockets of pages.
    pub sockets: usize,
    /// Open connections, sockets among them.
    pub connections: usize,
    /// Bytes of an upload.
    pub upload: usize,
    /// Pixels of an uploaded picture.
    pub pixels: u64,
    /// Uploaded paintings that are kept.
    pub uploads: usize,
    /// Bytes of them all.
    pub upload_bytes: u64,
    /// Bytes of geometry that is kept for views that are being looked at.
    pub geometry: usize,
    /// Time for the head of a request, from its first byte or from the last request on.
    pub head: Duration,
    /// Time for the body of a request.
    pub body: Duration,
    /// Time for which a client may take in nothing of what is sent to it.
    pub reading: Duration,
    /// Malformed messages in a row.
    pub malformed: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            sockets: 64,
            connections: 256,
            upload: 32 << 20,
            pixels: 50_000_000,
            uploads: 200,
            upload_bytes: 1 << 30,
            geometry: 1 << 30,
            head: Duration::from_secs(20),
            body: Duration::from_secs(60),
            reading: Duration::from_secs(20),
            malformed: 20,
        }
    }
}
