//! Paintings: what there is, more of them, and small pictures of them.

use std::time::Duration;

use axum::body::Body;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::Response;
use serde::Deserialize;
use tokio::time::timeout;

use super::reply::{Refusal, bytes, drain, json_reply, of_type, too_large};
use super::state::{App, Reply, apart};
use crate::gallery::Untaken;

/// Times the largest upload that is taken in to be refused.
const DRAINED: u64 = 4;
/// How long an upload may wait for those before it.
const PATIENCE: Duration = Duration::from_secs(30);

#[derive(Debug, Deserialize)]
pub(super) struct Named {
    #[serde(default)]
    name: String,
}

#[derive(Debug, Deserialize)]
pub(super) struct Identified {
    id: String,
}

fn asked<T>(query: Result<Query<T>, QueryRejection>) -> Result<T, Refusal> {
    let query = query.map(|Query(asked)| asked);
    query.map_err(|e| Refusal::wrong(format!("the address is not understood ({e})")))
}

pub(super) async fn list(State(studio): App) -> Reply {
    let list = apart(move || studio.shared.library.list()).await?;
    Ok(json_reply(&list))
}

pub(super) async fn upload(
    State(studio): App,
    query: Result<Query<Named>, QueryRejection>,
    headers: HeaderMap,
    body: Body,
) -> Reply {
    let Named { name } = asked(query)?;
    let most = studio.limits.upload;
    let length = headers.get(header::CONTENT_LENGTH);
    let length = length.and_then(|l| l.to_str().ok()?.parse::<u64>().ok());
    if let Some(length) = length.filter(|length| *length > most as u64) {
        if length <= DRAINED * most as u64 {
            drain(body, studio.limits.body).await;
        }
        return Err(too_large(most));
    }
    let permit = timeout(PATIENCE, studio.uploads.acquire()).await;
    let permit = permit.map_err(|_| {
        Refusal::busy("other paintings are being uploaded; try again when they are there")
    })?;
    let body = bytes(body, most, studio.limits.body).await?;
    let library = studio.shared.library.clone();
    let taken = apart(move || library.take(&name, &body)).await?;
    drop(permit);
    match taken {
        Ok(painting) => Ok(json_reply(&painting)),
        Err(Untaken::NoPicture(problem)) => Err(Refusal::new(
            StatusCode::UNSUPPORTED_MEDIA_TYPE,
            format!(
                "not a usable painting ({problem}); give a JPEG, PNG, WebP, TIFF or GIF picture"
            ),
        )),
        Err(Untaken::Full(message) | Untaken::Disk(message)) => {
            Err(Refusal::new(StatusCode::INSUFFICIENT_STORAGE, message))
        }
    }
}

pub(super) async fn random(State(studio): App) -> Response {
    json_reply(&studio.shared.library.generate())
}

pub(super) async fn thumbnail(
    State(studio): App,
    query: Result<Query<Identified>, QueryRejection>,
) -> Reply {
    let Identified { id } = asked(query)?;
    // Closed only with the studio.
    let permit = studio.shrinking.acquire().await;
    let library = studio.shared.library.clone();
    let made = apart(move || library.thumbnail(&id)).await?;
    drop(permit);
    let made = made.map_err(Refusal::unknown)?;
    Ok(of_type("image/jpeg", made.as_ref().clone()))
}
