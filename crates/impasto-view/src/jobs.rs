//! Films and exports: made one at a time, kept until there are newer ones.

use std::collections::VecDeque;
use std::fs;
use std::path::PathBuf;
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::Duration;

use impasto_model::Stop;
use impasto_scene::file::plainly;
use serde_json::{Value, json};

use crate::clients::Clients;
use crate::gallery::PaintingLibrary;
use crate::sync::{lock, wait};
use crate::workshop::{ExportOrder, FilmOrder, Made, Workshop};

/// Jobs that may wait.
const WAITING: usize = 8;
/// Jobs whose files are kept.
const KEPT: usize = 16;
/// Most bytes of a job's paintings, decoded.
const PAINTINGS: usize = 1 << 30;
/// How often a sleeping workshop checks whether the studio closes.
const POLL: Duration = Duration::from_millis(200);
/// A job steps back while somebody waits for a picture, so often for so long, between two steps.
const STEP_BACK: Duration = Duration::from_millis(20);
const STEPS_BACK: usize = 50;

/// What is to be made.
#[derive(Debug)]
pub(crate) enum Order {
    Film(Box<FilmOrder>),
    Export(Box<ExportOrder>),
}

impl Order {
    fn folder(&self) -> &PathBuf {
        match self {
            Self::Film(film) => &film.folder,
            Self::Export(export) => &export.folder,
        }
    }

    /// Reads the paintings that it needs.
    fn read_paintings(&mut self, library: &PaintingLibrary) -> Result<(), String> {
        let paint = match self {
            Self::Film(film) => &mut film.paint,
            Self::Export(export) => &mut export.paint,
        };
        let mut bytes = 0;
        for spec in paint.coats.coats.iter().flat_map(|coat| &coat.paintings) {
            if paint.paintings.iter().any(|(id, _)| *id == spec.painting) {
                continue;
            }
            let picture = library.picture(&spec.painting)?;
            bytes += picture.as_raw().len();
            if bytes > PAINTINGS {
                return Err("its paintings are too large all together; use smaller ones".into());
            }
            paint.paintings.push((spec.painting.clone(), picture));
        }
        Ok(())
    }
}

enum State {
    Waiting(Order),
    Running(f64),
    Done(PathBuf),
    Failed(String),
}

struct Job {
    id: u64,
    folder: PathBuf,
    stop: Stop,
    state: State,
}

#[derive(Default)]
struct Queue {
    jobs: VecDeque<Job>,
    next: u64,
}

/// All jobs.
pub(crate) struct Jobs {
    scratch: PathBuf,
    queue: Mutex<Queue>,
    work: Condvar,
}

impl Jobs {
    pub(crate) fn new(scratch: PathBuf) -> Self {
        Self {
            scratch,
            queue: Mutex::default(),
            work: Condvar::new(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, Queue> {
        lock(&self.queue)
    }

    /// Queues a job that `order` makes from its folder; its number.
    pub(crate) fn add(&self, order: impl FnOnce(PathBuf) -> Order) -> Result<u64, String> {
        let mut queue = self.lock();
        let waits = |job: &&Job| matches!(job.state, State::Waiting(_));
        if queue.jobs.iter().filter(waits).count() >= WAITING {
            return Err(format!(
                "{WAITING} films and exports are waiting already; wait until one is done, or stop one"
            ));
        }
        queue.next += 1;
        let id = queue.next;
        let folder = self.scratch.join(format!("job-{id}"));
        fs::create_dir(&folder)
            .map_err(|e| format!("there is no place to make it ({})", plainly(&e)))?;
        let job = Job {
            id,
            folder: folder.clone(),
            stop: Stop::default(),
            state: State::Waiting(order(folder)),
        };
        queue.jobs.push_back(job);
        while queue.jobs.len() > KEPT + WAITING {
            let over = |job: &Job| matches!(job.state, State::Done(_) | State::Failed(_));
            let Some(index) = queue.jobs.iter().position(over) else {
                break;
            };
            if let Some(old) = queue.jobs.remove(index) {
                remove_folder(&old.folder);
            }
        }
        drop(queue);
        self.work.notify_all();
        Ok(id)
    }

    /// How a job stands, as `GET /api/jobs/ID` answers.
    pub(crate) fn state(&self, id: u64) -> Option<Value> {
        let queue = self.lock();
        let job = queue.jobs.iter().find(|job| job.id == id)?;
        let (state, progress, error, file) = match &job.state {
            State::Waiting(_) => ("waiting", 0.0, None, None),
            State::Running(progress) => ("running", *progress, None, None),
            State::Done(_) => ("done", 1.0, None, Some(format!("/api/jobs/{id}/file"))),
            State::Failed(reason) => ("failed", 0.0, Some(reason), None),
        };
        Some(json!({"state": state, "progress": progress, "error": error, "file": file}))
    }

    /// The file that a job has made.
    pub(crate) fn file(&self, id: u64) -> Option<PathBuf> {
        let queue = self.lock();
        let job = queue.jobs.iter().find(|job| job.id == id)?;
        match &job.state {
            State::Done(path) => Some(path.clone()),
            _ => None,
        }
    }

    /// Ends a job and forgets it; whether there was one.
    pub(crate) fn remove(&self, id: u64) -> bool {
        let mut queue = self.lock();
        let index = queue.jobs.iter().position(|job| job.id == id);
        let Some(job) = index.and_then(|index| queue.jobs.remove(index)) else {
            return false;
        };
        job.stop.request();
        // The workshop itself removes what it is at work on.
        if !matches!(job.state, State::Running(_)) {
            remove_folder(&job.folder);
        }
        true
    }

    /// Works until the studio closes.
    pub(crate) fn run(
        &self,
        workshop: &mut dyn Workshop,
        clients: &Clients,
        library: &PaintingLibrary,
        stop: &Stop,
    ) {
        while let Some((id, mut order, stopped)) = self.next(stop) {
            let mut progress = |part: f64| {
                self.set(id, State::Running(part.clamp(0.0, 1.0)));
                for _ in 0..STEPS_BACK {
                    if stop.is_requested() {
                        stopped.request();
                    }
                    if stopped.is_requested() || !clients.are_waiting() {
                        break;
                    }
                    std::thread::sleep(STEP_BACK);
                }
            };
            let read = order.read_paintings(library);
            let made = read.and_then(|()| match &order {
                Order::Film(film) => workshop.film(film, &mut progress, &stopped),
                Order::Export(export) => workshop.export(export, &mut progress, &stopped),
            });
            let is_kept = self.set(id, finished(&order, made));
            if !is_kept {
                remove_folder(order.folder());
            }
        }
    }

    fn next(&self, stop: &Stop) -> Option<(u64, Order, Stop)> {
        let mut queue = self.lock();
        loop {
            if stop.is_requested() {
                return None;
            }
            let waits = |job: &&mut Job| matches!(job.state, State::Waiting(_));
            if let Some(job) = queue.jobs.iter_mut().find(waits) {
                let state = std::mem::replace(&mut job.state, State::Running(0.0));
                if let State::Waiting(order) = state {
                    return Some((job.id, order, job.stop.clone()));
                }
            }
            queue = wait(&self.work, queue, POLL);
        }
    }

    /// Takes note of how a job stands; whether it is still wanted.
    fn set(&self, id: u64, state: State) -> bool {
        let mut queue = self.lock();
        let Some(job) = queue.jobs.iter_mut().find(|job| job.id == id) else {
            return false;
        };
        job.state = state;
        true
    }
}

/// Only what lies in the job's own folder is handed out.
fn finished(order: &Order, made: Made) -> State {
    match made {
        Ok(path) if path.parent() == Some(order.folder()) && path.is_file() => State::Done(path),
        Ok(_) => State::Failed("nothing was made".into()),
        Err(reason) => State::Failed(reason),
    }
}

fn remove_folder(folder: &PathBuf) {
    // What cannot be removed now goes with the whole temporary folder.
    let _ = fs::remove_dir_all(folder);
}
