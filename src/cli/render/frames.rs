//! From views to frames.

use std::path::PathBuf;

use impasto::{Coat, Model, Stop};

use super::Variant;
use crate::cli::CliError;
use crate::output::{Frame, Layout, Sink, View};

/// How frames are made of views.
pub struct Rendering<'a> {
    model: &'a Model,
    /// What each picture of a frame is painted with, from the left.
    coats: Vec<&'a [Coat]>,
    layout: &'a Layout,
    supersampling: u32,
}

impl<'a> Rendering<'a> {
    /// Frames that show all variants; side by side, after the scene as photographed.
    pub fn new(
        model: &'a Model,
        variants: &'a [Variant],
        layout: &'a Layout,
        supersampling: u32,
    ) -> Self {
        let coats = variants.iter().map(|variant| variant.coats.as_slice());
        Self::of_coats(model, coats, layout, supersampling)
    }

    /// The same of lists of coats.
    pub fn of_coats(
        model: &'a Model,
        coats: impl IntoIterator<Item = &'a [Coat]>,
        layout: &'a Layout,
        supersampling: u32,
    ) -> Self {
        let original: Option<&[Coat]> = match layout {
            Layout::Each(_) => None,
            Layout::SideBySide(_) => Some(&[]),
        };
        Self {
            model,
            coats: original.into_iter().chain(coats).collect(),
            layout,
            supersampling,
        }
    }

    /// Renders a view and hands its frame on.
    pub fn one(
        &self,
        view: &View,
        take: impl FnOnce(Frame<'_>) -> Result<(), CliError>,
    ) -> Result<(), CliError> {
        let rendered = self
            .model
            .render_coats(&view.camera, &self.coats, self.supersampling);
        let pictures = (0..self.coats.len()).map(|i| rendered.image(i)).collect();
        take(Frame {
            view,
            pictures: self.layout.frames(pictures),
            depth: &rendered.depth,
        })
    }

    /// Renders views one after the other into `sink`, and names the files or folders that it made.
    /// `done` is told after each how many are done.
    ///
    /// # Errors
    /// What the sink says, and [`CliError::Stopped`], after which nothing is left.
    pub fn all(
        &self,
        views: &[View],
        mut sink: Box<dyn Sink>,
        done: &mut dyn FnMut(usize),
        stop: &Stop,
    ) -> Result<Vec<PathBuf>, CliError> {
        let made = (|| {
            for (i, view) in views.iter().enumerate() {
                if stop.is_requested() {
                    return Err(CliError::Stopped);
                }
                self.one(view, |frame| sink.add(frame))?;
                done(i + 1);
            }
            sink.finish()
        })();
        // An interruption ends ffmpeg as well, and is not ffmpeg's failure.
        made.map_err(|error| match stop.is_requested() {
            true => CliError::Stopped,
            false => error,
        })
    }
}
