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
mod state;

use std::sync::Arc;

use axum::extract::Request;
use axum::http::{Method, StatusCode};
use axum::routing::{delete, get, post, put};
use axum::{Router, middleware};

pub(crate) use self::guard::AccessGuard;
pub(crate) use self::state::AppState;

use self::gate::{Gate, Pulse};
use self::guard::STREAM;
use self::reply::Refusal;
use self::state::Reply;

/// Serves until the future is dropped.
pub(crate) async fn serve(
    studio: Arc<AppState>,
    listener: tokio::net::TcpListener,
) -> std::io::Result<()> {
    let gate = Gate::new(listener, studio.limits);
    let service = router(studio).into_make_service_with_connect_info::<Pulse>();
    axum::serve(gate, service).await
}

fn router(studio: Arc<AppState>) -> Router {
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
        .layer(middleware::from_fn_with_state(
            studio.guard.clone(),
            guard::watch,
        ))
        .with_state(studio)
}

/// The page's files, and what is not there.
async fn other(request: Request) -> Reply {
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
