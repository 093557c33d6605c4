//! The scene, its training, and favourites.

use std::sync::{Arc, PoisonError};

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::Response;
use impasto_scene::file::{plainly, read_whole};
use impasto_train::Coats;
use serde_json::json;

use super::reply::{Refusal, json_body, json_reply, of_type};
use super::{Studio, apart};
use crate::favourites::Unsaved;

/// Largest preview, in bytes.
const PREVIEW: u64 = 64 << 20;

pub(super) async fn scene(State(studio): State<Arc<Studio>>) -> Response {
    match studio.facts() {
        Some(facts) => json_reply(&facts.json()),
        None => json_reply(&json!({"waiting": true, "name": studio.name})),
    }
}

pub(super) async fn run(State(studio): State<Arc<Studio>>) -> Response {
    let run = studio.run.lock().unwrap_or_else(PoisonError::into_inner);
    json_reply(&run.0.json(run.1))
}

pub(super) async fn preview(State(studio): State<Arc<Studio>>) -> Result<Response, Refusal> {
    let path = {
        let run = studio.run.lock().unwrap_or_else(PoisonError::into_inner);
        run.0.preview().map(ToOwned::to_owned)
    };
    let path = path.ok_or_else(|| Refusal::unknown("there is no preview yet"))?;
    let bytes = apart(move || read_whole(&path, PREVIEW)).await?;
    let bytes = bytes
        .map_err(|e| Refusal::unknown(format!("the preview cannot be read ({})", plainly(&e))))?;
    Ok(of_type("image/png", bytes))
}

pub(super) async fn formats(State(studio): State<Arc<Studio>>) -> Response {
    let formats = &studio.formats;
    json_reply(&json!({"films": formats.films, "exports": formats.exports}))
}

pub(super) async fn favourites(State(studio): State<Arc<Studio>>) -> Result<Response, Refusal> {
    let favourites = apart(move || studio.shelf.list()).await?;
    Ok(json_reply(&favourites))
}

pub(super) async fn save_favourite(
    State(studio): State<Arc<Studio>>,
    Path(name): Path<String>,
    body: Body,
) -> Result<Response, Refusal> {
    let coats: Coats = json_body(body, studio.limits.body).await?;
    coats.check().map_err(|e| Refusal::wrong(e.to_string()))?;
    let saved = apart(move || {
        studio
            .shelf
            .save(&name, coats, &studio.gallery)
            .map(|()| name)
    });
    let name = saved.await?.map_err(unsaved)?;
    Ok(json_reply(&json!({"name": name})))
}

pub(super) async fn remove_favourite(
    State(studio): State<Arc<Studio>>,
    Path(name): Path<String>,
) -> Result<Response, Refusal> {
    let removed = apart(move || studio.shelf.remove(&name).map(|()| name));
    let name = removed.await?.map_err(unsaved)?;
    Ok(json_reply(&json!({"name": name})))
}

fn unsaved(reason: Unsaved) -> Refusal {
    match reason {
        Unsaved::Name(message) | Unsaved::Painting(message) => Refusal::wrong(message),
        Unsaved::Unknown(message) => Refusal::unknown(message),
        Unsaved::Disk(message) => Refusal::new(StatusCode::INSUFFICIENT_STORAGE, message),
    }
}
