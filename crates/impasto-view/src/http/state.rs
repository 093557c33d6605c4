//! What all requests share.

use std::sync::Arc;

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use tokio::sync::{Semaphore, watch};

use super::guard::AccessGuard;
use super::reply::Refusal;
use crate::options::Limits;
use crate::painter::SceneFacts;
use crate::shared::Shared;
use crate::workshop::Formats;

/// Uploads that are taken at a time.
const UPLOADS: usize = 2;
/// Pictures that are read and shrunk at a time.
const SHRINKING: usize = 2;

/// How a request gets it.
pub(super) type App = State<Arc<AppState>>;
/// How a request is answered.
pub(super) type Reply = Result<Response, Refusal>;

/// What all requests share.
pub(crate) struct AppState {
    pub(super) guard: Arc<AccessGuard>,
    pub(super) limits: Limits,
    pub(super) formats: Formats,
    /// What to call a scene that is not there yet.
    pub(super) name: String,
    pub(super) shared: Shared,
    /// Turns true when the studio closes.
    pub(super) closing: watch::Receiver<bool>,
    pub(super) uploads: Semaphore,
    pub(super) shrinking: Semaphore,
}

impl AppState {
    pub(crate) fn new(
        guard: AccessGuard,
        limits: Limits,
        formats: Formats,
        name: String,
        shared: Shared,
        closing: watch::Receiver<bool>,
    ) -> Self {
        Self {
            guard: Arc::new(guard),
            limits,
            formats,
            name,
            shared,
            closing,
            uploads: Semaphore::new(UPLOADS),
            shrinking: Semaphore::new(SHRINKING),
        }
    }

    /// The scene, for requests that need one.
    pub(super) fn scene(&self) -> Result<Arc<SceneFacts>, Refusal> {
        self.shared.facts().ok_or_else(|| {
            Refusal::busy("there is no scene yet: the model is still in training; wait for it")
        })
    }
}

/// Does what takes longer than a moment beside the network.
pub(super) async fn apart<T: Send + 'static>(
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Refusal> {
    tokio::task::spawn_blocking(work).await.map_err(|_| {
        Refusal::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            "the studio made a mistake; please report what you did",
        )
    })
}
