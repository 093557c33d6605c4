//! The pages that look at the scene: what each wants next, and what is on its way to it.
//!
//! Nothing here queues views: a page has one place for the view that it wants and one for the
//! coats, and what is newer takes the place of what is older.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use impasto_model::{Stop, StyleLayers};
use tokio::sync::mpsc::{self, Receiver, Sender};

use crate::frame;
use crate::message::{Message, PickMessage, ViewMessage};
use crate::sync::{lock, wait};

/// Frames that may be on their way to a page.
const AHEAD: u32 = 2;
/// Messages that may wait for a page; one that takes in none of them is closed.
const WAITING: usize = 64;
/// Picks that may wait for the painter.
const PICKS: usize = 8;
/// How often a sleeping painter checks whether the studio closes.
const POLL: Duration = Duration::from_millis(100);

/// Something for a page.
#[derive(Debug)]
pub(crate) enum Outgoing {
    Text(String),
    Frame(Vec<u8>),
}

/// What a page wants, each with the time at which it said so.
#[derive(Debug, Default)]
pub(crate) struct Requests {
    pub(crate) view: Option<(ViewMessage, Instant)>,
    pub(crate) coats: Option<(u32, Box<StyleLayers>, Instant)>,
    pub(crate) picks: VecDeque<PickMessage>,
}

impl Requests {
    fn is_nothing(&self) -> bool {
        self.view.is_none() && self.coats.is_none() && self.picks.is_empty()
    }
}

struct Seat {
    requests: Requests,
    /// Whether the painter is not done with the last view.
    unfinished: bool,
    watches: bool,
    sent: u32,
    acknowledged: u32,
    outbox: Sender<Outgoing>,
}

impl Seat {
    fn has_room(&self) -> bool {
        self.sent - self.acknowledged < AHEAD
    }

    fn can_be_served(&self) -> bool {
        !self.requests.picks.is_empty()
            || self.has_room() && (self.unfinished || !self.requests.is_nothing())
    }
}

#[derive(Default)]
struct State {
    seats: BTreeMap<u64, Seat>,
    next: u64,
    served: u64,
    gone: Vec<u64>,
    /// Whether the painter has something to do that no page asked for.
    called: bool,
}

/// All pages.
pub(crate) struct Clients {
    most: usize,
    state: Mutex<State>,
    work: Condvar,
}

/// What the painter does next.
#[derive(Debug, Default)]
pub(crate) struct Turn {
    /// Pages that have left.
    pub(crate) gone: Vec<u64>,
    /// Whose turn it is, what it wants, and whether frames may be sent to it.
    pub(crate) client: Option<(u64, Requests, bool)>,
}

impl Clients {
    pub(crate) fn new(most: usize) -> Self {
        Self {
            most,
            state: Mutex::default(),
            work: Condvar::new(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        lock(&self.state)
    }

    /// Seats a page: its number, and what is on its way to it. `None` if there is no seat left.
    pub(crate) fn enter(&self) -> Option<(u64, Receiver<Outgoing>)> {
        let mut state = self.lock();
        if state.seats.len() >= self.most {
            return None;
        }
        let (outbox, inbox) = mpsc::channel(WAITING);
        state.next += 1;
        let id = state.next;
        let seat = Seat {
            requests: Requests::default(),
            unfinished: false,
            watches: false,
            sent: 0,
            acknowledged: 0,
            outbox,
        };
        state.seats.insert(id, seat);
        Some((id, inbox))
    }

    /// Frees a page's seat.
    pub(crate) fn leave(&self, id: u64) {
        let mut state = self.lock();
        if state.seats.remove(&id).is_some() {
            state.gone.push(id);
        }
        drop(state);
        self.work.notify_all();
    }

    /// Takes note of what a page says.
    pub(crate) fn receive(&self, id: u64, message: Message) -> Result<(), String> {
        let mut state = self.lock();
        let Some(seat) = state.seats.get_mut(&id) else {
            return Ok(());
        };
        let now = Instant::now();
        match message {
            Message::View(view) => seat.requests.view = Some((view, now)),
            Message::StyleLayers(id, coats) => seat.requests.coats = Some((id, coats, now)),
            Message::Pick(pick) => {
                if seat.requests.picks.len() >= PICKS {
                    seat.requests.picks.pop_front();
                }
                seat.requests.picks.push_back(pick);
            }
            Message::Watch(on) => seat.watches = on,
            Message::Ack(frame) => {
                if frame > seat.sent {
                    return Err(format!("frame {frame} was not sent yet"));
                }
                seat.acknowledged = seat.acknowledged.max(frame);
            }
        }
        drop(state);
        self.work.notify_all();
        Ok(())
    }

    /// Waits for something to do; pages are served in turn. Returns nothing to do when it was
    /// [`Self::call`]ed, and `None` when the studio closes.
    pub(crate) fn turn(&self, stop: &Stop) -> Option<Turn> {
        let mut state = self.lock();
        loop {
            if stop.is_requested() {
                return None;
            }
            let gone = std::mem::take(&mut state.gone);
            let called = std::mem::take(&mut state.called);
            let served = state.served;
            let ready = |(id, seat): (&u64, &Seat)| seat.can_be_served().then_some(*id);
            let after = state.seats.range(served + 1..).find_map(ready);
            let next = after.or_else(|| state.seats.iter().find_map(ready));
            let client = next.and_then(|id| {
                state.served = id;
                let seat = state.seats.get_mut(&id)?;
                let room = seat.has_room();
                let requests = if room {
                    std::mem::take(&mut seat.requests)
                } else {
                    Requests {
                        picks: std::mem::take(&mut seat.requests.picks),
                        ..Requests::default()
                    }
                };
                Some((id, requests, room))
            });
            if client.is_some() || called || !gone.is_empty() {
                return Some(Turn { gone, client });
            }
            state = wait(&self.work, state, POLL);
        }
    }

    /// Whether a page waits for a picture: long work waits meanwhile.
    pub(crate) fn are_waiting(&self) -> bool {
        self.lock().seats.values().any(Seat::can_be_served)
    }

    /// Wakes the painter.
    pub(crate) fn call(&self) {
        self.lock().called = true;
        self.work.notify_all();
    }

    /// Takes note whether the painter is done with a page's view.
    pub(crate) fn set_unfinished(&self, id: u64, unfinished: bool) {
        if let Some(seat) = self.lock().seats.get_mut(&id) {
            seat.unfinished = unfinished;
        }
    }

    /// Sends a page its next frame.
    pub(crate) fn send_frame(&self, id: u64, mut bytes: Vec<u8>) {
        let mut state = self.lock();
        if let Some(seat) = state.seats.get_mut(&id) {
            seat.sent += 1;
            frame::number(&mut bytes, seat.sent);
            // Room for two frames is always there, unless the page is about to be closed.
            let _ = seat.outbox.try_send(Outgoing::Frame(bytes));
        }
    }

    /// Sends a page a message.
    pub(crate) fn send_text(&self, id: u64, text: String) {
        if let Some(seat) = self.lock().seats.get_mut(&id) {
            // A page that has let this many wait is about to be closed.
            let _ = seat.outbox.try_send(Outgoing::Text(text));
        }
    }

    /// Sends all pages a message, or those that watch the training.
    pub(crate) fn send_all(&self, text: &str, only_watching: bool) {
        for seat in self.lock().seats.values() {
            if seat.watches || !only_watching {
                let _ = seat.outbox.try_send(Outgoing::Text(text.to_owned()));
            }
        }
    }
}
