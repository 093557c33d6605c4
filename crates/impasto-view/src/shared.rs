//! What the studio's threads share.

use std::sync::{Arc, Mutex};

use crate::clients::Clients;
use crate::favourites::Favourites;
use crate::gallery::PaintingLibrary;
use crate::jobs::Jobs;
use crate::painter::SceneFacts;
use crate::run::TrainingRun;
use crate::sync::lock;

#[derive(Clone)]
pub(crate) struct Shared {
    pub(crate) clients: Arc<Clients>,
    pub(crate) library: Arc<PaintingLibrary>,
    pub(crate) favourites: Arc<Favourites>,
    pub(crate) jobs: Arc<Jobs>,
    /// What is known of the scene; nothing as long as there is no model.
    pub(crate) facts: Arc<Mutex<Option<Arc<SceneFacts>>>>,
    /// What is known of its training.
    pub(crate) run: Arc<Mutex<TrainingRun>>,
}

impl Shared {
    pub(crate) fn facts(&self) -> Option<Arc<SceneFacts>> {
        lock(&self.facts).clone()
    }
}
