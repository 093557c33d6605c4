//! The thread that renders: one piece of one page's view at a time.

mod easel;
mod pace;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use impasto_train::Stop;

use self::easel::Easel;
use self::pace::Pace;
use crate::clients::{Clients, Wanted};
use crate::frame::{Head, encode, picture};
use crate::gallery::Gallery;
use crate::message::{painted, picked, problem};
use crate::painter::Painter;

/// A painter on its way to the thread.
pub(crate) type Arriving<P> = Mutex<Option<P>>;

/// The thread's work.
pub(crate) struct Rendering<P: Painter> {
    pub(crate) clients: Arc<Clients>,
    pub(crate) gallery: Arc<Gallery>,
    /// Takes the place of the one before, here and on all easels.
    pub(crate) arriving: Arc<Arriving<P>>,
    /// Most bytes of geometry that are kept.
    pub(crate) geometry: usize,
}

impl<P: Painter> Rendering<P> {
    /// Works until the studio closes.
    pub(crate) fn run(self, stop: &Stop) {
        let mut studio = Atelier {
            with: self,
            painter: None,
            easels: BTreeMap::new(),
            pace: Pace::default(),
        };
        while let Some(turn) = studio.with.clients.turn(stop) {
            for id in turn.gone {
                studio.easels.remove(&id);
            }
            studio.welcome();
            if let Some((id, wanted, room)) = turn.client {
                studio.serve(id, wanted, room);
            }
        }
    }
}

struct Atelier<P: Painter> {
    with: Rendering<P>,
    painter: Option<P>,
    easels: BTreeMap<u64, Easel<P>>,
    pace: Pace,
}

impl<P: Painter> Atelier<P> {
    /// Lets a new painter take over.
    fn welcome(&mut self) {
        let mut arriving = (self.with.arriving.lock()).unwrap_or_else(PoisonError::into_inner);
        let Some(painter) = arriving.take() else {
            return;
        };
        drop(arriving);
        self.painter = Some(painter);
        let pages: Vec<u64> = self.easels.keys().copied().collect();
        for id in pages {
            self.mix(id, None);
            if let Some(easel) = self.easels.get_mut(&id) {
                easel.forget();
                easel.plan(&self.pace);
                self.with.clients.set_unfinished(id, !easel.is_done());
            }
        }
    }

    /// Does what a page wants, and then one piece of its view.
    fn serve(&mut self, id: u64, wanted: Wanted, room: bool) {
        let easel = self.easels.entry(id).or_insert_with(Easel::new);
        for pick in wanted.picks {
            let said = match easel.pick(pick.x, pick.y) {
                Some(found) => picked(pick.id, &found),
                None => problem("there is no picture there yet", Some(pick.id.into())),
            };
            self.with.clients.send_text(id, said);
        }
        if !room {
            return;
        }
        if let Some((view, since)) = wanted.view {
            easel.look(view, since, &self.pace);
        }
        if let Some((number, coats, since)) = wanted.coats {
            let before = (easel.coats.0, easel.coats.1.clone(), easel.coats.2);
            easel.coats = (number, *coats, since);
            match self.mix(id, Some(since)) {
                true => {
                    if let Some(easel) = self.easels.get_mut(&id) {
                        easel.plan(&self.pace);
                    }
                }
                false => {
                    if let Some(easel) = self.easels.get_mut(&id) {
                        easel.coats = before;
                    }
                }
            }
        }
        self.paint(id);
        self.tidy(id);
    }

    /// Makes a page's coats ready; whether they are. It is told, if it asked for them.
    fn mix(&mut self, id: u64, asked: Option<Instant>) -> bool {
        let (Some(painter), Some(easel)) = (&mut self.painter, self.easels.get_mut(&id)) else {
            // They are made ready when there is a painter.
            return true;
        };
        let (number, coats, _) = &easel.coats;
        let gallery = &self.with.gallery;
        let mixed = match coats.coats.is_empty() {
            true => Ok(None),
            false => painter
                .mix(coats, &|painting| gallery.picture(painting))
                .map(Some),
        };
        match mixed {
            Ok(paint) => {
                easel.paint = paint;
                if let Some(since) = asked {
                    let seconds = since.elapsed().as_secs_f64();
                    self.with.clients.send_text(id, painted(*number, seconds));
                }
                true
            }
            Err(reason) => {
                let said = problem(&reason, Some((*number).into()));
                self.with.clients.send_text(id, said);
                if asked.is_none() {
                    easel.paint = None;
                }
                false
            }
        }
    }

    /// Paints the next piece of a page's view and sends it.
    fn paint(&mut self, id: u64) {
        let (Some(painter), Some(easel)) = (&self.painter, self.easels.get_mut(&id)) else {
            return;
        };
        let (Some((view, since)), coats) = (easel.view, (easel.coats.0, easel.coats.2)) else {
            self.with.clients.set_unfinished(id, false);
            return;
        };
        let start = Instant::now();
        // Taken out, so that the piece can be borrowed.
        let paint = easel.paint.take();
        let sent = easel.next().map(|(piece, last)| {
            let (width, height) = piece.size();
            let rays = width as usize * height as usize;
            let is_new = piece.geometry.is_none();
            let geometry = &*piece
                .geometry
                .get_or_insert_with(|| painter.view(&piece.camera));
            let colours = painter.paint(geometry, paint.as_ref());
            let took = start.elapsed();
            if is_new {
                self.pace.note(rays, took);
            }
            let picture = picture(&colours, width, height);
            let head = Head {
                view: view.id,
                coats: coats.0,
                rows: piece.rows,
                size: (view.camera.intrinsics.width, view.camera.intrinsics.height),
                level: piece.level,
                last,
                milliseconds: since.max(coats.1).elapsed().as_millis(),
                rays_per_second: rays as f64 / took.as_secs_f64().max(1e-6),
            };
            let frame = encode(&head, &picture);
            piece.keep(picture);
            frame
        });
        easel.paint = paint;
        let done = easel.is_done();
        self.with.clients.set_unfinished(id, !done);
        match sent {
            Some(Ok(frame)) => self.with.clients.send_frame(id, frame),
            Some(Err(reason)) => {
                let said = problem(&reason, Some(view.id.into()));
                self.with.clients.send_text(id, said);
            }
            None => {}
        }
    }

    /// Lets go of geometry beyond what may be kept, others' first.
    fn tidy(&mut self, served: u64) {
        let mut bytes: usize = self.easels.values().map(Easel::bytes).sum();
        let others = self.easels.keys().copied().filter(|id| *id != served);
        let order: Vec<u64> = others.chain([served]).collect();
        for id in order {
            if bytes <= self.with.geometry {
                return;
            }
            if let Some(easel) = self.easels.get_mut(&id) {
                bytes -= easel.bytes();
                easel.forget();
            }
        }
    }
}
