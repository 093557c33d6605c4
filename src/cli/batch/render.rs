//! Renders of a batch.

use std::ops::Range;
use std::slice;

use impasto::{Device, StyleLayer, StyledAppearance};
use serde_json::Value;

use super::plan::{ModelWork, StyleSource, ViewGroup};
use super::report::BatchReport;
use crate::cli::CliError;
use crate::cli::painting::PaintingSource;
use crate::cli::progress::FrameProgress;
use crate::cli::render::{KnownModel, Mixture, distinguished_mixtures, views};
use crate::cli::shard::Shard;
use crate::output::{FrameLayout, RenderedFrame, SharedFolder, SharedFrames, Viewpoint};

/// Renders this shard's part of everything that a model is rendered for.
///
/// # Errors
/// When the model cannot be loaded.
pub fn run(
    work: &ModelWork,
    shard: Shard,
    device: &Device,
    report: &mut BatchReport,
) -> Result<(), CliError> {
    let mut renderer = ModelRenderer {
        known: KnownModel::load(&work.path, device)?,
        styles: work.styles.iter().map(KnownStyle::new).collect(),
    };
    for group in &work.groups {
        let model = &renderer.known.model;
        match views(model, &group.views, group.table.size, group.table.frames) {
            Ok(views) => renderer.render(group, &views, shard, report),
            Err(error) => report.all_failed(&group.items, &error),
        }
    }
    Ok(())
}

/// A loaded model, and what is known of the styles so far.
struct ModelRenderer<'a> {
    known: KnownModel,
    styles: Vec<KnownStyle<'a>>,
}

struct KnownStyle<'a> {
    source: &'a StyleSource,
    distinguished: Option<Value>,
    /// Nothing before it is made; then the look, or none for the photos' own.
    look: Option<Option<StyledAppearance>>,
}

impl<'a> KnownStyle<'a> {
    fn new(source: &'a StyleSource) -> Self {
        Self {
            source,
            distinguished: None,
            look: None,
        }
    }

    /// Reads the painting, and tells what distinguishes it from others. Not kept: there may be many.
    fn read(&self) -> Result<(Mixture, Value), CliError> {
        let mixture = match &self.source.painting {
            Some(painting) => Mixture::single(self.source.name.clone(), painting.read()?),
            None => Mixture::photo(),
        };
        let distinguished = distinguished_mixtures(slice::from_ref(&mixture));
        Ok((mixture, distinguished))
    }

    fn distinguished(&mut self) -> Result<Value, CliError> {
        let known = match self.distinguished.take() {
            Some(known) => known,
            None => self.read()?.1,
        };
        Ok(self.distinguished.insert(known).clone())
    }

    /// Computes the look if it is not known yet.
    fn compute(&mut self, known: &KnownModel) -> Result<(), CliError> {
        if self.look.is_none() {
            let (mixture, distinguished) = self.read()?;
            if self.distinguished.as_ref() != Some(&distinguished) {
                return Err(CliError::Refused(format!(
                    "the painting {} was replaced in between; choose another output for the new one",
                    self.source.name
                )));
            }
            self.look = Some(mixture.look(&known.model)?);
        }
        Ok(())
    }
}

/// A render's folder, until something fails there.
struct OpenFolder {
    folder: SharedFolder,
    rendered: usize,
    kept: usize,
}

impl ModelRenderer<'_> {
    /// Renders a shard's block of a group's pictures. They are in the order of frames, and in each
    /// of styles, so that most of a block's frames are in all styles and computed at once.
    fn render(
        &mut self,
        group: &ViewGroup,
        views: &[Viewpoint],
        shard: Shard,
        report: &mut BatchReport,
    ) {
        let styles = group.items.len();
        let block = shard.block(views.len() * styles, group.turn);
        if block.is_empty() {
            return;
        }
        let mut open: Vec<Option<OpenFolder>> = (0..styles)
            .map(|i| meets(&block, i, styles).then(|| self.open(group, i, views)))
            .zip(&group.items)
            .map(|(opened, item)| opened?.map_err(|error| report.failed(item, &error)).ok())
            .collect();
        let frames = block.start / styles..block.end.div_ceil(styles);
        let title = format!("{} {}", self.known.model.file.scene.name, group.name);
        let mut progress = FrameProgress::new(&title, frames.len());
        for frame in frames {
            let own = |i: &usize| block.contains(&(frame * styles + i));
            let missing = self.missing(group, frame, (0..styles).filter(own), &mut open, report);
            if let Err(error) = self.frame(group, frame, &views[frame], &missing, &mut open, report)
            {
                for &i in &missing {
                    report.failed(&group.items[i], &error);
                    open[i] = None;
                }
            }
            progress.tick();
        }
        drop(progress);
        for (item, open) in group.items.iter().zip(open) {
            let Some(open) = open else { continue };
            match open.folder.finish() {
                Ok(complete) => {
                    let painting = &self.styles[item.style].source.painting;
                    let label = painting.as_ref().and_then(PaintingSource::label);
                    report.rendered(item, [open.rendered, open.kept], complete, label.as_deref());
                }
                Err(error) => report.failed(item, &error),
            }
        }
    }

    /// Those of a group's items whose frame is missing; their looks are known then.
    fn missing(
        &mut self,
        group: &ViewGroup,
        frame: usize,
        items: impl Iterator<Item = usize>,
        open: &mut [Option<OpenFolder>],
        report: &mut BatchReport,
    ) -> Vec<usize> {
        let mut missing = Vec::new();
        for i in items {
            let Some(opened) = open[i].as_mut() else {
                continue;
            };
            if !opened.folder.lacks(frame) {
                opened.kept += 1;
                continue;
            }
            let item = &group.items[i];
            match self.styles[item.style].compute(&self.known) {
                Ok(()) => missing.push(i),
                Err(error) => {
                    report.failed(item, &error);
                    open[i] = None;
                }
            }
        }
        missing
    }

    /// Renders a frame in those styles where it is missing.
    ///
    /// # Errors
    /// When none of them can be put on.
    fn frame(
        &self,
        group: &ViewGroup,
        number: usize,
        view: &Viewpoint,
        missing: &[usize],
        open: &mut [Option<OpenFolder>],
        report: &mut BatchReport,
    ) -> Result<(), CliError> {
        if missing.is_empty() {
            return Ok(());
        }
        let (model, settings) = (&self.known.model, group.table.settings());
        let coats = missing.iter().map(|&i| {
            let look = self.styles[group.items[i].style].look.clone().flatten();
            look.map(|look| settings.coat(model, look)).transpose()
        });
        let coats = coats.collect::<Result<Vec<Option<StyleLayer>>, _>>()?;
        let original: Option<&[StyleLayer]> = group.table.side_by_side.then_some(&[]);
        let painted = coats.iter().map(Option::as_slice);
        let lists: Vec<&[StyleLayer]> = original.into_iter().chain(painted).collect();
        let first = lists.len() - coats.len();
        let rendered = model.render_layers(&view.camera, &lists, group.table.supersampling);
        for (look, &i) in missing.iter().enumerate() {
            let Some(opened) = open[i].as_mut() else {
                continue;
            };
            let shown = (0..first).chain([first + look]);
            let pictures = shown.map(|i| rendered.image(i)).collect();
            let frame = RenderedFrame {
                view,
                pictures: self.layout(group, i).frames(pictures),
                depth: &rendered.depth,
            };
            match opened.folder.add(number, &frame) {
                Ok(()) => opened.rendered += 1,
                Err(error) => {
                    report.failed(&group.items[i], &error);
                    open[i] = None;
                }
            }
        }
        Ok(())
    }

    /// What the frames of a group's item show.
    fn layout(&self, group: &ViewGroup, item: usize) -> FrameLayout {
        let style = &self.styles[group.items[item].style].source.name;
        if group.table.side_by_side {
            FrameLayout::side_by_side(vec![style.clone()])
        } else {
            FrameLayout::Each(Vec::new())
        }
    }

    fn open(
        &mut self,
        group: &ViewGroup,
        index: usize,
        views: &[Viewpoint],
    ) -> Result<OpenFolder, CliError> {
        let item = &group.items[index];
        let style = self.styles[item.style].distinguished()?;
        let layout = self.layout(group, index);
        let (cameras, job) = (self.known).job(
            &style,
            views,
            &group.table.settings(),
            &layout,
            group.table.depth,
        );
        let contents = SharedFrames {
            layout: &layout,
            frames: views.len(),
            depth: group.table.depth,
            cameras: &cameras,
            job: &job,
        };
        Ok(OpenFolder {
            folder: SharedFolder::open(&item.output, &contents)?,
            rendered: 0,
            kept: 0,
        })
    }
}

/// Whether a block holds a picture in the `i`-th of so many styles.
fn meets(block: &Range<usize>, i: usize, styles: usize) -> bool {
    (i + styles - block.start % styles) % styles < block.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_meets_the_styles_of_its_pictures() {
        for block in [0..1, 2..4, 5..6, 3..9, 1..3] {
            for i in 0..3 {
                assert_eq!(
                    meets(&block, i, 3),
                    block.clone().any(|picture| picture % 3 == i)
                );
            }
        }
    }
}
