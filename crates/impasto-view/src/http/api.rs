//! The scene, its training, and favourites.

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::Response;
use impasto_model::StyleLayers;
use impasto_scene::file::{plainly, read_whole};
use serde_json::json;

use super::reply::{Refusal, json_body, json_reply, of_type};
use super::state::{App, Reply, apart};
use crate::favourites::Unsaved;
use crate::sync::lock;

/// Largest preview, in bytes.
const PREVIEW: u64 = 64 << 20;

pub(super) async fn scene(State(studio): App) -> Response {
    match studio.shared.facts() {
        Some(facts) => json_reply(&facts.json()),
        None => json_reply(&json!({"waiting": true, "name": studio.name})),
    }
}

pub(super) async fn run(State(studio): App) -> Response {
    json_reply(&lock(&studio.shared.run).json())
}

pub(super) async fn preview(State(studio): App) -> Reply {
    let path = (lock(&studio.shared.run).preview()).map(ToOwned::to_owned);
    let path = path.ok_or_else(|| Refusal::unknown("there is no preview yet"))?;
    let bytes = apart(move || read_whole(&path, PREVIEW)).await?;
    let bytes = bytes
        .map_err(|e| Refusal::unknown(format!("the preview cannot be read ({})", plainly(&e))))?;
    Ok(of_type("image/png", bytes))
}

pub(super) async fn formats(State(studio): App) -> Response {
    let formats = &studio.formats;
    json_reply(&json!({"films": formats.films, "exports": formats.exports}))
}

pub(super) async fn favourites(State(studio): App) -> Reply {
    let favourites = apart(move || studio.shared.favourites.list()).await?;
    Ok(json_reply(&favourites))
}

pub(super) async fn save_favourite(
    State(studio): App,
    Path(name): Path<String>,
    body: Body,
) -> Reply {
    let coats: StyleLayers = json_body(body, studio.limits.body).await?;
    coats.check().map_err(|e| Refusal::wrong(e.to_string()))?;
    let saved = apart(move || {
        let shared = &studio.shared;
        let saved = shared.favourites.save(&name, coats, &shared.library);
        saved.map(|()| name)
    });
    let name = saved.await?.map_err(unsaved)?;
    Ok(json_reply(&json!({"name": name})))
}

pub(super) async fn remove_favourite(State(studio): App, Path(name): Path<String>) -> Reply {
    let removed = apart(move || studio.shared.favourites.remove(&name).map(|()| name));
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
