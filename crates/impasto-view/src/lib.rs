//! The browser studio: a local server and the page that it serves.
//!
//! [`Server::bind`] takes a port, [`Server::run`] answers until it is stopped. What shows the scene
//! is a [`Painter`], of which [`ModelPainter`] is the real one; what makes films and exports is a
//! [`Workshop`]. `docs/studio.md` describes what page and server say to each other.
//!
//! One thread runs the network, which never waits for a picture; one renders, always a piece of what
//! some page wants to see now; one makes films and exports, and one follows a training.

#![warn(missing_docs)]

mod clients;
mod error;
mod favourites;
mod follow;
mod frame;
mod gallery;
mod http;
mod jobs;
mod message;
mod model_painter;
mod names;
mod options;
mod painter;
mod path;
mod recent;
mod rendering;
mod run;
mod saved_paintings;
mod server;
mod shared;
mod sync;
mod workshop;

pub use error::ViewError;
pub use model_painter::ModelPainter;
pub use options::{Limits, ViewOptions};
pub use painter::{Painter, Pictures, SceneFacts, ViewGeometry};
pub use server::{Opening, Server};
pub use workshop::{ExportOrder, FilmOrder, Formats, Made, PaintOrder, Progress, Workshop};
