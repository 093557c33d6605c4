//! Answers and refusals.

use std::future::poll_fn;
use std::pin::Pin;
use std::time::Duration;

use axum::body::{Body, HttpBody, to_bytes};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::json;

/// Largest body of JSON, in bytes.
const JSON: usize = 1 << 20;

/// A request that is refused, with one or two sentences.
#[derive(Debug)]
pub(super) struct Refusal {
    pub(super) status: StatusCode,
    pub(super) message: String,
}

impl Refusal {
    pub(super) fn new(status: StatusCode, message: impl Into<String>) -> Self {
        let message = message.into();
        Self { status, message }
    }

    /// The request makes no sense.
    pub(super) fn wrong(message: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, message)
    }

    /// What it is about is not there.
    pub(super) fn unknown(message: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, message)
    }

    /// Too much is asked for at a time.
    pub(super) fn busy(message: impl Into<String>) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, message)
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let mut response = json_reply(&json!({"error": self.message}));
        *response.status_mut() = self.status;
        response
    }
}

/// An answer in JSON.
pub(super) fn json_reply(value: &impl Serialize) -> Response {
    // Structures with text keys, for which this cannot fail.
    let text = serde_json::to_string(value).unwrap_or_default();
    of_type("application/json", text)
}

/// An answer of some type.
pub(super) fn of_type(kind: &'static str, body: impl Into<Body>) -> Response {
    let mut response = Response::new(body.into());
    let kind = HeaderValue::from_static(kind);
    response.headers_mut().insert(header::CONTENT_TYPE, kind);
    response
}

/// Reads a body of JSON.
pub(super) async fn json_body<T: DeserializeOwned>(
    body: Body,
    time: Duration,
) -> Result<T, Refusal> {
    let bytes = bytes(body, JSON, time).await?;
    serde_json::from_slice(&bytes)
        .map_err(|e| Refusal::wrong(format!("the request is not understood ({e})")))
}

/// Reads a body of at most so many bytes within a time.
pub(super) async fn bytes(
    body: Body,
    most: usize,
    time: Duration,
) -> Result<axum::body::Bytes, Refusal> {
    match tokio::time::timeout(time, to_bytes(body, most)).await {
        Ok(Ok(bytes)) => Ok(bytes),
        Ok(Err(_)) => Err(too_large(most)),
        Err(_) => Err(Refusal::new(
            StatusCode::REQUEST_TIMEOUT,
            format!("the request took longer than {} seconds", time.as_secs()),
        )),
    }
}

/// Takes a body in without keeping it: a browser that is refused while it still sends cannot show why.
pub(super) async fn drain(mut body: Body, time: Duration) {
    let all = async {
        while let Some(Ok(_)) = poll_fn(|context| Pin::new(&mut body).poll_frame(context)).await {}
    };
    // Who takes longer is cut off.
    let _ = tokio::time::timeout(time, all).await;
}

/// The refusal of a body that is too large, or was broken off on the way.
pub(super) fn too_large(most: usize) -> Refusal {
    let size = match most >> 20 {
        0 => format!("{} KiB", most >> 10),
        mebibytes => format!("{mebibytes} MiB"),
    };
    Refusal::new(
        StatusCode::PAYLOAD_TOO_LARGE,
        format!("that is more than {size}, the most that is taken; send something smaller"),
    )
}
