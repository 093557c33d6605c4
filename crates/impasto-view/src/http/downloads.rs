//! Files that jobs have made.

use std::sync::Arc;

use axum::extract::{Path, State};
use axum::http::{HeaderValue, header};
use axum::response::Response;
use impasto_scene::file::{plainly, read_whole};

use super::orders::no_job;
use super::reply::{Refusal, of_type};
use super::{Studio, apart};

/// Largest file that is handed out, in bytes. It is in memory for as long as that takes.
const MOST: u64 = 2 << 30;

pub(super) async fn job_file(
    State(studio): State<Arc<Studio>>,
    Path(id): Path<String>,
) -> Result<Response, Refusal> {
    let id: u64 = id.parse().map_err(|_| no_job())?;
    let path = studio.jobs.file(id).ok_or_else(no_job)?;
    let name = path
        .file_name()
        .map(|name| name.to_string_lossy().into_owned());
    let name = name.unwrap_or_default();
    let read = apart(move || read_whole(&path, MOST)).await?;
    let bytes =
        read.map_err(|e| Refusal::unknown(format!("the file cannot be read ({})", plainly(&e))))?;
    let mut response = of_type(kind(&name), bytes);
    let plain = |c: char| match c.is_ascii_alphanumeric() || "-_.".contains(c) {
        true => c,
        false => '_',
    };
    let name: String = name.chars().map(plain).collect();
    if let Ok(value) = HeaderValue::from_str(&format!("attachment; filename=\"{name}\"")) {
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_DISPOSITION, value);
    }
    Ok(response)
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
