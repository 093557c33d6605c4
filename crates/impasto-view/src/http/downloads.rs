//! Files that jobs have made.

use std::fs::File;
use std::io::{self, Read};
use std::path::PathBuf;
use std::pin::Pin;
use std::task::{Context, Poll};

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderValue, header};
use futures_core::Stream;
use impasto_scene::file::plainly;
use tokio::sync::mpsc::{Receiver, channel};

use super::orders::{job_number, no_job};
use super::reply::{Refusal, of_type};
use super::state::{App, Reply, apart};
use crate::names::plain_name;

/// Bytes that are read at a time.
const PIECE: usize = 1 << 17;
/// Pieces that wait for somebody who takes them slowly.
const AHEAD: usize = 2;

pub(super) async fn job_file(State(studio): App, Path(id): Path<String>) -> Reply {
    let path = studio
        .shared
        .jobs
        .file(job_number(&id)?)
        .ok_or_else(no_job)?;
    let name = path.file_name().unwrap_or_default();
    let name = name.to_string_lossy().into_owned();
    let opened = apart(move || open(path)).await?;
    let (file, length) = opened
        .map_err(|e| Refusal::unknown(format!("the file cannot be read ({})", plainly(&e))))?;
    let mut response = of_type(kind(&name), Body::from_stream(pieces(file, length)));
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_LENGTH, length.into());
    let name = plain_name(&name);
    if let Ok(value) = HeaderValue::from_str(&format!("attachment; filename=\"{name}\"")) {
        headers.insert(header::CONTENT_DISPOSITION, value);
    }
    Ok(response)
}

/// The file and its length.
fn open(path: PathBuf) -> io::Result<(File, u64)> {
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    Ok((file, length))
}

/// A file in pieces, of which few are in memory however large it is. Ends with who takes it: a
/// connection that takes nothing is closed.
fn pieces(file: File, length: u64) -> Pieces {
    let (sender, receiver) = channel(AHEAD);
    tokio::spawn(async move {
        let mut file = file.take(length);
        loop {
            let read = apart(move || {
                let mut piece = Vec::with_capacity(PIECE);
                let read = file.by_ref().take(PIECE as u64).read_to_end(&mut piece);
                (file, read.map(|_| piece))
            });
            let Ok((rest, piece)) = read.await else {
                return;
            };
            file = rest;
            let is_last = match &piece {
                Ok(piece) if piece.is_empty() => return,
                piece => piece.is_err(),
            };
            if sender.send(piece).await.is_err() || is_last {
                return;
            }
        }
    });
    Pieces(receiver)
}

struct Pieces(Receiver<io::Result<Vec<u8>>>);

impl Stream for Pieces {
    type Item = io::Result<Vec<u8>>;

    fn poll_next(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<io::Result<Vec<u8>>>> {
        self.0.poll_recv(context)
    }
}

fn kind(name: &str) -> &'static str {
    match name.rsplit('.').next() {
        Some("gif") => "image/gif",
        Some("mp4") => "video/mp4",
        Some("webm") => "video/webm",
        Some("zip") => "application/zip",
        _ => "application/octet-stream",
    }
}
