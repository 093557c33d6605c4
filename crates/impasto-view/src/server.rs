//! The studio as a whole: its threads, from opening to closing.

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::panic::resume_unwind;
use std::sync::{Arc, Mutex};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use impasto_model::Stop;
use tokio::sync::watch;

use crate::clients::Clients;
use crate::error::ViewError;
use crate::favourites::Favourites;
use crate::follow::Follower;
use crate::gallery::PaintingLibrary;
use crate::http::{AccessGuard, AppState, serve};
use crate::jobs::Jobs;
use crate::options::ViewOptions;
use crate::painter::Painter;
use crate::rendering::ViewRenderer;
use crate::shared::Shared;
use crate::workshop::Workshop;

/// How often the network checks whether the studio closes.
const POLL: Duration = Duration::from_millis(50);
/// Time for pages to hear that it does.
const FAREWELL: Duration = Duration::from_millis(100);

/// The painter that shows the scene, and where the next one comes from.
pub struct Opening<P> {
    /// The first; none while the model is in its first training.
    pub first: Option<P>,
    /// Makes another of the model's file, whenever that was written anew. An error is told to all
    /// pages.
    pub again: Box<dyn Fn() -> Result<P, String> + Send>,
}

/// A studio that listens, but does not answer yet.
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    guard: AccessGuard,
    options: ViewOptions,
    library: PaintingLibrary,
}

impl Server {
    /// Takes the port.
    ///
    /// # Errors
    /// If it is taken, the address is none of this machine's, or the paintings cannot be listed.
    pub fn bind(options: ViewOptions) -> Result<Self, ViewError> {
        let library = PaintingLibrary::new(&options).map_err(|source| ViewError::Styles {
            folder: options
                .styles
                .iter()
                .map(|folder| folder.display().to_string())
                .collect(),
            source,
        })?;
        let wanted = SocketAddr::new(options.address, options.port);
        let listener = TcpListener::bind(wanted).map_err(|source| match source.kind() {
            io::ErrorKind::AddrInUse => ViewError::PortTaken(wanted),
            _ => ViewError::Listen {
                address: wanted,
                source,
            },
        })?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        Ok(Self {
            guard: AccessGuard::new(options.token, address.port())?,
            listener,
            address,
            options,
            library,
        })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What to open in a browser; with the token, if one is needed.
    pub fn link(&self) -> String {
        let mut shown = self.address;
        if shown.ip().is_unspecified() {
            shown.set_ip(match shown {
                SocketAddr::V4(_) => std::net::Ipv4Addr::LOCALHOST.into(),
                SocketAddr::V6(_) => std::net::Ipv6Addr::LOCALHOST.into(),
            });
        }
        match self.guard.token() {
            Some(token) => format!("http://{shown}/?token={token}"),
            None => format!("http://{shown}/"),
        }
    }

    /// Answers until it is asked to stop.
    ///
    /// # Errors
    /// If the system gives no threads or timers.
    ///
    /// # Panics
    /// With what the painter or the workshop panicked with.
    pub fn run<P: Painter>(
        self,
        opening: Opening<P>,
        mut workshop: Box<dyn Workshop>,
        stop: &Stop,
    ) -> Result<(), ViewError> {
        let options = &self.options;
        let name = options
            .model
            .file_name()
            .map(|n| n.to_string_lossy().into_owned());
        let facts = opening.first.as_ref().map(|p| Arc::new(p.facts()));
        let shared = Shared {
            clients: Arc::new(Clients::new(options.limits.sockets)),
            library: Arc::new(self.library),
            favourites: Arc::new(Favourites::new(&options.model)),
            jobs: Arc::new(Jobs::new(options.scratch.clone())),
            facts: Arc::new(Mutex::new(facts)),
            run: Arc::default(),
        };
        let (tell, closing) = watch::channel(false);
        let close = Stop::default();
        let arriving = Arc::new(Mutex::new(opening.first));
        shared.clients.call();
        let geometry = options.limits.geometry;
        let (painters, rendered) = (arriving.clone(), shared.clone());
        let follower = Follower::new(&options.model, opening.again, arriving, shared.clone());
        let formats = workshop.formats();
        let work = shared.clone();
        let threads = [
            // What the painter makes stays on its thread.
            spawn("render", &close, move |stop| {
                ViewRenderer::new(rendered, painters, geometry).run(stop);
            })?,
            spawn("follow", &close, move |stop| follower.run(stop))?,
            spawn("workshop", &close, move |stop| {
                let Shared {
                    jobs,
                    clients,
                    library,
                    ..
                } = work;
                jobs.run(workshop.as_mut(), &clients, &library, stop);
            })?,
        ];
        let name = name.unwrap_or_default();
        let state = AppState::new(self.guard, options.limits, formats, name, shared, closing);
        let served = network(Arc::new(state), self.listener, &[stop, &close], &tell);
        close.request();
        for thread in threads {
            if let Err(panic) = thread.join() {
                resume_unwind(panic);
            }
        }
        Ok(served?)
    }
}

/// Requests a stop when it is dropped, also by a panic.
struct Ending(Stop);

impl Drop for Ending {
    fn drop(&mut self) {
        self.0.request();
    }
}

/// A thread without which the studio closes.
fn spawn(
    name: &str,
    close: &Stop,
    work: impl FnOnce(&Stop) + Send + 'static,
) -> io::Result<JoinHandle<()>> {
    let ending = Ending(close.clone());
    Builder::new()
        .name(name.to_owned())
        .spawn(move || work(&ending.0))
}

/// Runs the network on this thread until one of several stops.
fn network(
    state: Arc<AppState>,
    listener: TcpListener,
    stops: &[&Stop],
    tell: &watch::Sender<bool>,
) -> io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let result = runtime.block_on(async {
        let listener = tokio::net::TcpListener::from_std(listener)?;
        let stopped = async {
            while !stops.iter().any(|stop| stop.is_requested()) {
                tokio::time::sleep(POLL).await;
            }
            // Nobody listens any more if there is no page.
            let _ = tell.send(true);
            tokio::time::sleep(FAREWELL).await;
        };
        tokio::select! {
            served = serve(state, listener) => served,
            () = stopped => Ok(()),
        }
    });
    runtime.shutdown_timeout(FAREWELL);
    result
}
