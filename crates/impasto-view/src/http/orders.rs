//! Paths, films and exports.

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderValue, header};
use impasto_model::{StyleLayerSpec, StyleLayers};
use impasto_scene::paths::CameraPath;
use serde_json::{Value, json};

use super::reply::{Refusal, json_body, json_reply};
use super::state::{App, Reply, apart};
use crate::gallery::PaintingLibrary;
use crate::jobs::Order;
use crate::message::checked;
use crate::painter::SceneFacts;
use crate::path::cameras;
use crate::workshop::{ExportOrder, ExportRequest, FilmOrder, FilmRequest, Formats, PaintOrder};

pub(super) async fn path(State(studio): App, body: Body) -> Reply {
    let path: CameraPath = json_body(body, studio.limits.body).await?;
    let facts = studio.scene()?;
    let path = apart(move || path_of(&path, &facts)).await?;
    let (_, path) = path.map_err(Refusal::wrong)?;
    let mut response = json_reply(&path);
    response.headers_mut().insert(
        header::CONTENT_DISPOSITION,
        HeaderValue::from_static("attachment; filename=\"camera_path.json\""),
    );
    Ok(response)
}

/// The cameras of a path and nerfstudio's form of it.
fn path_of(
    path: &CameraPath,
    facts: &SceneFacts,
) -> Result<(Vec<impasto_scene::Camera>, Value), String> {
    let cameras = cameras(path)?;
    let text = path.to_nerfstudio(&facts.normalisation);
    let text = text.map_err(|error| error.to_string())?;
    let value = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    Ok((cameras, value))
}

pub(super) async fn film(State(studio): App, body: Body) -> Reply {
    let request: FilmRequest = json_body(body, studio.limits.body).await?;
    let facts = studio.scene()?;
    known(&request.format, &studio.formats.films, &studio.formats)?;
    let job = apart(move || {
        let path = CameraPath {
            size: request.size,
            ..request.path
        };
        let (cameras, nerfstudio) = path_of(&path, &facts)?;
        let paint = paint(request.coats, &studio.shared.library)?;
        studio.shared.jobs.add(|folder| {
            Order::Film(Box::new(FilmOrder {
                cameras,
                path: nerfstudio,
                fps: path.fps,
                paint,
                format: request.format,
                side_by_side: request.side_by_side,
                folder,
            }))
        })
    });
    let job = job.await?.map_err(Refusal::wrong)?;
    Ok(json_reply(&json!({"job": job})))
}

pub(super) async fn export(State(studio): App, body: Body) -> Reply {
    let request: ExportRequest = json_body(body, studio.limits.body).await?;
    studio.scene()?;
    known(&request.kind, &studio.formats.exports, &studio.formats)?;
    let job = apart(move || {
        let paint = paint(request.coats, &studio.shared.library)?;
        studio.shared.jobs.add(|folder| {
            Order::Export(Box::new(ExportOrder {
                paint,
                kind: request.kind,
                folder,
            }))
        })
    });
    let job = job.await?.map_err(Refusal::wrong)?;
    Ok(json_reply(&json!({"job": job})))
}

fn known(wanted: &str, list: &[String], all: &Formats) -> Result<(), Refusal> {
    if list.iter().any(|known| known == wanted) {
        return Ok(());
    }
    let all = [&all.films[..], &all.exports[..]].concat().join(", ");
    let wanted: String = wanted.chars().take(40).collect();
    Err(Refusal::wrong(format!(
        "\"{wanted}\" cannot be made on this machine; it makes {all}"
    )))
}

/// Coats whose paintings there are. They are read when the job's turn comes: many may wait.
fn paint(coats: Vec<StyleLayerSpec>, library: &PaintingLibrary) -> Result<PaintOrder, String> {
    let coats: StyleLayers = checked(coats)?;
    for spec in coats.coats.iter().flat_map(|coat| &coat.paintings) {
        library.file(&spec.painting)?;
    }
    Ok(PaintOrder {
        coats,
        paintings: Vec::new(),
    })
}

pub(super) fn job_number(id: &str) -> Result<u64, Refusal> {
    id.parse().map_err(|_| no_job())
}

pub(super) fn no_job() -> Refusal {
    Refusal::unknown("there is no such job any more; start it again")
}

pub(super) async fn job(State(studio): App, Path(id): Path<String>) -> Reply {
    let state = studio
        .shared
        .jobs
        .state(job_number(&id)?)
        .ok_or_else(no_job)?;
    Ok(json_reply(&state))
}

pub(super) async fn stop_job(State(studio): App, Path(id): Path<String>) -> Reply {
    let id = job_number(&id)?;
    if apart(move || studio.shared.jobs.remove(id)).await? {
        Ok(json_reply(&json!({"job": id})))
    } else {
        Err(no_job())
    }
}
