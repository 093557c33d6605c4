//! The socket of a page.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message as Raw, WebSocket, WebSocketUpgrade};
use tokio::sync::mpsc::Receiver;
use tokio::sync::watch;
use tokio::time::{Instant, interval, timeout};

use super::reply::Refusal;
use super::state::{App, AppState, Reply};
use crate::clients::{Clients, Outgoing};
use crate::message::{LARGEST, Message, problem};

/// Time between two questions whether the page is still there.
const PING: Duration = Duration::from_secs(15);
/// A page that says nothing for so long, not even that it is there, is not.
const SILENCE: Duration = Duration::from_secs(60);
/// Time for a farewell.
const FAREWELL: Duration = Duration::from_millis(500);

const GOING_AWAY: u16 = 1001;
const AGAINST_RULES: u16 = 1008;
const TOO_LARGE: u16 = 1009;
const TRY_LATER: u16 = 1013;

pub(super) async fn open(
    State(studio): App,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Reply {
    let upgrade = upgrade
        .map_err(|e| Refusal::wrong(format!("a page opens a WebSocket here ({e})")))?
        .max_message_size(LARGEST)
        .max_frame_size(LARGEST)
        .write_buffer_size(0);
    // A page cannot read why a socket was not opened, so it is opened to say so.
    Ok(match studio.shared.clients.enter() {
        Some((id, inbox)) => {
            let seat = Seat {
                clients: studio.shared.clients.clone(),
                id,
            };
            upgrade.on_upgrade(move |socket| async move {
                Talk {
                    studio,
                    socket,
                    seat,
                    malformed: 0,
                }
                .go_on(inbox)
                .await;
            })
        }
        None => {
            let most = studio.limits.sockets;
            upgrade.on_upgrade(async move |mut socket| {
                let said = format!("{most} pages are open already; close one and load this again");
                let _ = say(&mut socket, FAREWELL, problem(&said, None)).await;
                close(&mut socket, TRY_LATER, "too many pages").await;
            })
        }
    })
}

/// A page's place, which is free again when this is dropped.
struct Seat {
    clients: Arc<Clients>,
    id: u64,
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.clients.leave(self.id);
    }
}

struct Talk {
    studio: Arc<AppState>,
    socket: WebSocket,
    seat: Seat,
    malformed: u32,
}

/// What ends a talk: the code of its close, and why.
type End = Option<(u16, &'static str)>;

impl Talk {
    async fn go_on(mut self, mut inbox: Receiver<Outgoing>) {
        let mut ping = interval(PING);
        let mut last_sign = Instant::now();
        let mut closing = self.studio.closing.clone();
        let reading = self.studio.limits.reading;
        let end: End = loop {
            let result = tokio::select! {
                outgoing = inbox.recv() => match outgoing {
                    Some(Outgoing::Text(text)) => say(&mut self.socket, reading, text).await,
                    Some(Outgoing::Frame(frame)) => {
                        send(&mut self.socket, reading, Raw::Binary(frame.into())).await
                    }
                    None => Err(None),
                },
                incoming = self.socket.recv() => {
                    last_sign = Instant::now();
                    match incoming {
                        Some(Ok(message)) => self.receive(message).await,
                        Some(Err(error)) => self.refuse(&error).await,
                        None => Err(None),
                    }
                }
                _ = ping.tick() => if last_sign.elapsed() > SILENCE {
                    Err(None)
                } else {
                    send(&mut self.socket, reading, Raw::Ping(Default::default())).await
                },
                _ = is_closing(&mut closing) => {
                    Err(Some((GOING_AWAY, "the studio closes")))
                }
            };
            if let Err(end) = result {
                break end;
            }
        };
        if let Some((code, reason)) = end {
            close(&mut self.socket, code, reason).await;
        }
    }

    async fn receive(&mut self, message: Raw) -> Result<(), End> {
        let heard = match message {
            Raw::Text(text) => Message::read(&text).and_then(|message| {
                let heard = self.seat.clients.receive(self.seat.id, message);
                heard.map_err(|reason| problem(&reason, None))
            }),
            Raw::Binary(_) => Err(problem("messages are text here; see docs/studio.md", None)),
            Raw::Ping(_) | Raw::Pong(_) => return Ok(()),
            Raw::Close(_) => return Err(None),
        };
        let Err(said) = heard else {
            self.malformed = 0;
            return Ok(());
        };
        say(&mut self.socket, self.studio.limits.reading, said).await?;
        self.malformed += 1;
        if self.malformed >= self.studio.limits.malformed {
            return Err(Some((AGAINST_RULES, "too many malformed messages")));
        }
        Ok(())
    }

    /// What a message that cannot be read ends the talk with.
    async fn refuse(&mut self, error: &axum::Error) -> Result<(), End> {
        let text = error.to_string();
        if !text.contains("too long") {
            return Err(None);
        }
        let said = format!(
            "a message may have {} KiB; this one had more",
            LARGEST >> 10
        );
        say(&mut self.socket, FAREWELL, problem(&said, None)).await?;
        Err(Some((TOO_LARGE, "message too large")))
    }
}

/// Returns when the studio closes.
async fn is_closing(closing: &mut watch::Receiver<bool>) {
    // An error says that nobody is left who could close it.
    let _ = closing.wait_for(|closing| *closing).await;
}

async fn say(socket: &mut WebSocket, time: Duration, text: String) -> Result<(), End> {
    send(socket, time, Raw::Text(text.into())).await
}

/// Sends a message; one that is not taken in in time ends the talk.
async fn send(socket: &mut WebSocket, time: Duration, message: Raw) -> Result<(), End> {
    match timeout(time, socket.send(message)).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(_)) | Err(_) => Err(None),
    }
}

/// Says farewell, and waits a moment for the other side's, so that it arrives.
async fn close(socket: &mut WebSocket, code: u16, reason: &'static str) {
    let frame = CloseFrame {
        code,
        reason: reason.into(),
    };
    if send(socket, FAREWELL, Raw::Close(Some(frame)))
        .await
        .is_ok()
    {
        let _ = timeout(FAREWELL, async {
            while let Some(Ok(_)) = socket.recv().await {}
        })
        .await;
    }
}
