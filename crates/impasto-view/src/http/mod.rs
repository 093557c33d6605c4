//! The network's side of the studio.

mod api;
mod downloads;
mod gate;
mod guard;
mod orders;
mod page;
mod paintings;
mod reply;
mod socket;

use std::sync::{Arc, Mutex, PoisonError};

use axum::extract::Request;
use axum::http::{Method, StatusCode};
use axum::response::Response;
use axum::routing::{delete, get, post, put};
use axum::{Router, middleware};
use tokio::sync::{Semaphore, watch};

pub(crate) use self::guard::Guard;

use self::gate::{Gate, Pulse};
use self::reply::Refusal;
use crate::clients::Clients;
use crate::favourites::Shelf;
use crate::gallery::Gallery;
use crate::jobs::Jobs;
use crate::options::Limits;
use crate::painter::SceneFacts;
use crate::run::Run;
use crate::workshop::Formats;

/// Where pages listen.
const STREAM: &str = "/api/stream";
/// Uploads that are taken at a time.
const UPLOADS: usize = 2;
/// Pictures that are read and shrunk at a time.
const SHRINKING: usize = 2;

/// What all requests share.
pub(crate) struct Studio {
    pub(crate) guard: Guard,
    pub(crate) limits: Limits,
    pub(crate) clients: Arc<Clients>,
    pub(crate) gallery: Arc<Gallery>,
    pub(crate) shelf: Arc<Shelf>,
    pub(crate) jobs: Arc<Jobs>,
    pub(crate) formats: Formats,
    /// What is known of the scene; nothing as long as there is no model.
    pub(crate) facts: Arc<Mutex<Option<Arc<SceneFacts>>>>,
    /// What is known of its training, and whether that goes on.
    pub(crate) run: Arc<Mutex<(Run, bool)>>,
    /// What to call a scene that is not there yet.
    pub(crate) name: String,
    /// Turns true when the studio closes.
    pub(crate) closing: watch::Receiver<bool>,
    uploads: Semaphore,
    shrinking: Semaphore,
}

/// What a [`Studio`] is made from beside what is shared with other threads.
pub(crate) struct Own {
    pub(crate) guard: Guard,
    pub(crate) limits: Limits,
    pub(crate) formats: Formats,
    pub(crate) name: String,
    pub(crate) closing: watch::Receiver<bool>,
}

/// What requests share with other threads.
#[derive(Clone)]
pub(crate) struct Shared {
    pub(crate) clients: Arc<Clients>,
    pub(crate) gallery: Arc<Gallery>,
    pub(crate) shelf: Arc<Shelf>,
    pub(crate) jobs: Arc<Jobs>,
    pub(crate) facts: Arc<Mutex<Option<Arc<SceneFacts>>>>,
    pub(crate) run: Arc<Mutex<(Run, bool)>>,
}

impl Studio {
    pub(crate) fn new(own: Own, shared: Shared) -> Self {
        Self {
            guard: own.guard,
            limits: own.limits,
            formats: own.formats,
            name: own.name,
            closing: own.closing,
            clients: shared.clients,
            gallery: shared.gallery,
            shelf: shared.shelf,
            jobs: shared.jobs,
            facts: shared.facts,
            run: shared.run,
            uploads: Semaphore::new(UPLOADS),
            shrinking: Semaphore::new(SHRINKING),
        }
    }

    fn facts(&self) -> Option<Arc<SceneFacts>> {
        let facts = self.facts.lock().unwrap_or_else(PoisonError::into_inner);
        facts.clone()
    }

    /// The scene, for requests that need one.
    fn scene(&self) -> Result<Arc<SceneFacts>, Refusal> {
        self.facts().ok_or_else(|| {
            Refusal::busy("there is no scene yet: the model is still in training; wait for it")
        })
    }
}

/// Serves until the future is dropped.
pub(crate) async fn serve(
    studio: Arc<Studio>,
    listener: tokio::net::TcpListener,
) -> std::io::Result<()> {
    let gate = Gate::new(listener, studio.limits);
    let service = router(studio).into_make_service_with_connect_info::<Pulse>();
    axum::serve(gate, service).await
}

fn router(studio: Arc<Studio>) -> Router {
    Router::new()
        .route("/api/scene", get(api::scene))
        .route("/api/run", get(api::run))
        .route("/api/preview", get(api::preview))
        .route("/api/formats", get(api::formats))
        .route("/api/favourites", get(api::favourites))
        .route(
            "/api/favourites/{name}",
            put(api::save_favourite).delete(api::remove_favourite),
        )
        .route(
            "/api/paintings",
            get(paintings::list).post(paintings::upload),
        )
        .route("/api/paintings/random", post(paintings::random))
        .route("/api/thumbnail", get(paintings::thumbnail))
        .route("/api/path", post(orders::path))
        .route("/api/films", post(orders::film))
        .route("/api/exports", post(orders::export))
        .route("/api/jobs/{id}", get(orders::job))
        .route("/api/jobs/{id}", delete(orders::stop_job))
        .route("/api/jobs/{id}/file", get(downloads::job_file))
        .route(STREAM, get(socket::open))
        .fallback(other)
        .method_not_allowed_fallback(not_so)
        .layer(middleware::from_fn_with_state(studio.clone(), guard::watch))
        .with_state(studio)
}

/// The page's files, and what is not there.
async fn other(request: Request) -> Result<Response, Refusal> {
    let address = request.uri().path();
    match page::file(address) {
        Some(file) if matches!(*request.method(), Method::GET | Method::HEAD) => Ok(file),
        Some(_) => Err(not_so().await),
        None => Err(Refusal::unknown(
            "there is nothing at this address; the studio is at /",
        )),
    }
}

async fn not_so() -> Refusal {
    Refusal::new(
        StatusCode::METHOD_NOT_ALLOWED,
        "this address is not asked like that; see docs/studio.md",
    )
}

/// Does what takes longer than a moment beside the network.
async fn apart<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, Refusal> {
    tokio::task::spawn_blocking(work).await.map_err(|_| {
        Refusal::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            "the studio made a mistake; please report what you did",
        )
    })
}
