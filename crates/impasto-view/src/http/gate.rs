//! Connections: not too many, and none that only waits.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep, sleep, sleep_until};

use crate::options::Limits;

/// Pause after the system refused to accept a connection.
const PAUSE: Duration = Duration::from_millis(100);

/// Lets connections in, as long as there is a place. Others wait in the system's queue.
pub(super) struct Gate {
    listener: TcpListener,
    places: Arc<Semaphore>,
    limits: Limits,
}

impl Gate {
    pub(super) fn new(listener: TcpListener, limits: Limits) -> Self {
        Self {
            listener,
            places: Arc::new(Semaphore::new(limits.connections)),
            limits,
        }
    }
}

impl Listener for Gate {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        loop {
            let place = self.places.clone().acquire_owned().await;
            match (place, self.listener.accept().await) {
                (Ok(place), Ok((stream, address))) => {
                    // Latency is better with it; nothing depends on it.
                    let _ = stream.set_nodelay(true);
                    return (Connection::new(stream, place, self.limits), address);
                }
                // No file handles left, or a client that is gone already.
                _ => sleep(PAUSE).await,
            }
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// Until when the head of the next request has to be there. Nothing while one is answered.
#[derive(Debug, Clone)]
pub(super) struct Pulse {
    due: Arc<Mutex<Option<Instant>>>,
    head: Duration,
}

impl Pulse {
    fn set(&self, due: Option<Instant>) {
        *self.due.lock().unwrap_or_else(PoisonError::into_inner) = due;
    }

    fn due(&self) -> Option<Instant> {
        *self.due.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A request is being answered.
    pub(super) fn busy(&self) {
        self.set(None);
    }

    /// The next request is waited for.
    pub(super) fn idle(&self) {
        self.set(Some(Instant::now() + self.head));
    }
}

impl Connected<IncomingStream<'_, Gate>> for Pulse {
    fn connect_info(stream: IncomingStream<'_, Gate>) -> Self {
        stream.io().pulse.clone()
    }
}

/// A connection that fails when nothing comes that should, or nothing is taken that is sent.
pub(super) struct Connection {
    stream: TcpStream,
    pulse: Pulse,
    reading: Pin<Box<Sleep>>,
    /// Runs while the client takes nothing.
    writing: Option<Pin<Box<Sleep>>>,
    patience: Duration,
    _place: OwnedSemaphorePermit,
}

impl Connection {
    fn new(stream: TcpStream, place: OwnedSemaphorePermit, limits: Limits) -> Self {
        let pulse = Pulse {
            due: Arc::default(),
            head: limits.head,
        };
        pulse.idle();
        Self {
            stream,
            pulse,
            reading: Box::pin(sleep(limits.head)),
            writing: None,
            patience: limits.reading,
            _place: place,
        }
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        // First, since a head that comes byte by byte always has some.
        if let Some(due) = self.pulse.due() {
            if self.reading.deadline() != due {
                self.reading.as_mut().reset(due);
            }
            if self.reading.as_mut().poll(context).is_ready() {
                return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
            }
        }
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Connection {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        if let Poll::Ready(written) = Pin::new(&mut self.stream).poll_write(context, bytes) {
            self.writing = None;
            // As long as an answer is taken in, the next request is not late.
            if self.pulse.due().is_some() {
                self.pulse.idle();
            }
            return Poll::Ready(written);
        }
        let until = Instant::now() + self.patience;
        let timer = self
            .writing
            .get_or_insert_with(|| Box::pin(sleep_until(until)));
        ready!(timer.as_mut().poll(context));
        Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}
