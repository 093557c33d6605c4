//! The thread that renders: one part of one page's view at a time.

mod easel;
mod pace;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use impasto_model::Stop;

use self::easel::Easel;
use self::pace::Pace;
use crate::clients::Requests;
use crate::frame::{Head, encode, picture};
use crate::message::{painted, picked, problem};
use crate::painter::Painter;
use crate::shared::Shared;
use crate::sync::lock;

/// A painter on its way to the thread.
pub(crate) type Arriving<P> = Mutex<Option<P>>;

/// The thread's work.
pub(crate) struct ViewRenderer<P: Painter> {
    shared: Shared,
    /// Takes the place of the one before, here and on all easels.
    arriving: Arc<Arriving<P>>,
    /// Most bytes of geometry that are kept.
    geometry: usize,
    painter: Option<P>,
    easels: BTreeMap<u64, Easel<P>>,
    pace: Pace,
}

impl<P: Painter> ViewRenderer<P> {
    pub(crate) fn new(shared: Shared, arriving: Arc<Arriving<P>>, geometry: usize) -> Self {
        Self {
            shared,
            arriving,
            geometry,
            painter: None,
            easels: BTreeMap::new(),
            pace: Pace::default(),
        }
    }

    /// Works until the studio closes.
    pub(crate) fn run(mut self, stop: &Stop) {
        while let Some(turn) = self.shared.clients.turn(stop) {
            for id in turn.gone {
                self.easels.remove(&id);
            }
            self.welcome();
            if let Some((id, requests, room)) = turn.client {
                self.serve(id, requests, room);
            }
        }
    }

    /// Lets a new painter take over.
    fn welcome(&mut self) {
        let Some(painter) = lock(&self.arriving).take() else {
            return;
        };
        self.painter = Some(painter);
        let pages: Vec<u64> = self.easels.keys().copied().collect();
        for id in pages {
            self.mix(id, None);
            if let Some(easel) = self.easels.get_mut(&id) {
                easel.forget();
                easel.plan(&self.pace);
                self.shared.clients.set_unfinished(id, !easel.is_done());
            }
        }
    }

    /// Does what a page wants, and then one part of its view.
    fn serve(&mut self, id: u64, requests: Requests, room: bool) {
        let easel = self.easels.entry(id).or_insert_with(Easel::new);
        for pick in requests.picks {
            let said = match easel.pick(pick.x, pick.y) {
                Some(found) => picked(pick.id, &found),
                None => problem("there is no picture there yet", Some(pick.id.into())),
            };
            self.shared.clients.send_text(id, said);
        }
        if !room {
            return;
        }
        if let Some((view, since)) = requests.view {
            easel.set_view(view, since, &self.pace);
        }
        if let Some((number, coats, since)) = requests.coats {
            let before = (easel.coats.0, easel.coats.1.clone(), easel.coats.2);
            easel.coats = (number, *coats, since);
            let is_mixed = self.mix(id, Some(since));
            if let Some(easel) = self.easels.get_mut(&id) {
                if is_mixed {
                    easel.plan(&self.pace);
                } else {
                    easel.coats = before;
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
        let library = &self.shared.library;
        let mixed = if coats.coats.is_empty() {
            Ok(None)
        } else {
            let mixed = painter.mix(coats, &|painting| library.picture(painting));
            mixed.map(Some)
        };
        match mixed {
            Ok(paint) => {
                easel.paint = paint;
                if let Some(since) = asked {
                    let seconds = since.elapsed().as_secs_f64();
                    self.shared.clients.send_text(id, painted(*number, seconds));
                }
                true
            }
            Err(reason) => {
                let said = problem(&reason, Some((*number).into()));
                self.shared.clients.send_text(id, said);
                if asked.is_none() {
                    easel.paint = None;
                }
                false
            }
        }
    }

    /// Paints the next part of a page's view and sends it.
    fn paint(&mut self, id: u64) {
        let (Some(painter), Some(easel)) = (&self.painter, self.easels.get_mut(&id)) else {
            return;
        };
        let (Some((view, since)), coats) = (easel.view, (easel.coats.0, easel.coats.2)) else {
            self.shared.clients.set_unfinished(id, false);
            return;
        };
        let start = Instant::now();
        // Taken out, so that the part can be borrowed.
        let paint = easel.paint.take();
        let sent = easel.next().map(|(part, last)| {
            let (width, height) = part.size();
            let rays = width as usize * height as usize;
            let is_new = part.geometry.is_none();
            let geometry = &*part
                .geometry
                .get_or_insert_with(|| painter.view(&part.camera));
            let colours = painter.paint(geometry, paint.as_ref());
            let took = start.elapsed();
            if is_new {
                self.pace.note(rays, took);
            }
            let picture = picture(&colours, width, height);
            let head = Head {
                view: view.id,
                coats: coats.0,
                rows: part.rows,
                size: (view.camera.intrinsics.width, view.camera.intrinsics.height),
                level: part.level,
                last,
                milliseconds: since.max(coats.1).elapsed().as_millis(),
                rays_per_second: rays as f64 / took.as_secs_f64().max(1e-6),
            };
            let frame = encode(&head, &picture);
            part.keep(picture);
            frame
        });
        easel.paint = paint;
        let done = easel.is_done();
        self.shared.clients.set_unfinished(id, !done);
        match sent {
            Some(Ok(frame)) => self.shared.clients.send_frame(id, frame),
            Some(Err(reason)) => {
                let said = problem(&reason, Some(view.id.into()));
                self.shared.clients.send_text(id, said);
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
            if bytes <= self.geometry {
                return;
            }
            if let Some(easel) = self.easels.get_mut(&id) {
                bytes -= easel.bytes();
                easel.forget();
            }
        }
    }
}
