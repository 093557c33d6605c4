//! From views to frames.

use std::path::PathBuf;

use impasto::{Model, Stop, StyleLayer};

use crate::cli::CliError;
use crate::output::{FrameLayout, RenderedFrame, Sink, Viewpoint};

/// How frames are made of views.
pub struct FrameRenderer<'a> {
    model: &'a Model,
    /// What each picture of a frame is painted with, from the left.
    coats: Vec<&'a [StyleLayer]>,
    layout: &'a FrameLayout,
    supersampling: u32,
}

impl<'a> FrameRenderer<'a> {
    /// Frames that show all variants, each of which is painted with its coats; side by side, after
    /// the scene as photographed.
    pub fn new(
        model: &'a Model,
        variants: impl IntoIterator<Item = &'a [StyleLayer]>,
        layout: &'a FrameLayout,
        supersampling: u32,
    ) -> Self {
        let original: Option<&[StyleLayer]> = match layout {
            FrameLayout::Each(_) => None,
            FrameLayout::SideBySide(_) => Some(&[]),
        };
        Self {
            model,
            coats: original.into_iter().chain(variants).collect(),
            layout,
            supersampling,
        }
    }

    /// Renders a view and hands its frame on.
    pub fn one(
        &self,
        view: &Viewpoint,
        take: impl FnOnce(RenderedFrame<'_>) -> Result<(), CliError>,
    ) -> Result<(), CliError> {
        let rendered = self
            .model
            .render_layers(&view.camera, &self.coats, self.supersampling);
        let pictures = (0..self.coats.len()).map(|i| rendered.image(i)).collect();
        take(RenderedFrame {
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
        views: &[Viewpoint],
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
        made.map_err(|error| {
            if stop.is_requested() {
                CliError::Stopped
            } else {
                error
            }
        })
    }
}
