//! Renders of a batch.

use std::collections::BTreeSet;
use std::ops::Range;

use impasto::{Coat, Device, Look};
use serde_json::Value;

use super::Report;
use super::plan::{Group, ModelWork, StyleSource};
use crate::cli::CliError;
use crate::cli::painting::PaintingSource;
use crate::cli::progress::Frames;
use crate::cli::render::{KnownModel, Styles, distinguished, views};
use crate::cli::shard::Shard;
use crate::output::{Contents, Frame, Layout, SharedFolder, View};

/// Renders this shard's part of everything that a model is rendered for.
pub fn run(work: &ModelWork, shard: Shard, device: Device, report: &mut Report) {
    let mut studio = match KnownModel::load(&work.path, device) {
        Ok(known) => Studio {
            known,
            styles: work.styles.iter().map(Painted::new).collect(),
        },
        Err(error) => {
            for group in &work.groups {
                report.all_failed(&group.items, &error);
            }
            return;
        }
    };
    for group in &work.groups {
        let known = &studio.known.model;
        match views(known, &group.views, group.size, group.frames) {
            Ok(views) => studio.render(group, &views, shard, report),
            Err(error) => report.all_failed(&group.items, &error),
        }
    }
}

/// A loaded model, and what is known of the styles so far.
struct Studio<'a> {
    known: KnownModel,
    styles: Vec<Painted<'a>>,
}

struct Painted<'a> {
    source: &'a StyleSource,
    distinguished: Option<Value>,
    /// Nothing before it is made; then the look, or none for the photos' own.
    look: Option<Option<Look>>,
}

impl<'a> Painted<'a> {
    fn new(source: &'a StyleSource) -> Self {
        Self {
            source,
            distinguished: None,
            look: None,
        }
    }

    /// Reads the painting. Not kept: there may be many.
    fn read(&self) -> Result<Styles, CliError> {
        Ok(match &self.source.painting {
            Some(painting) => Styles::Each(vec![(self.source.name.clone(), painting.read()?)]),
            None => Styles::Photo,
        })
    }

    fn distinguished(&mut self) -> Result<Value, CliError> {
        if self.distinguished.is_none() {
            self.distinguished = Some(distinguished(&self.read()?));
        }
        Ok(self.distinguished.clone().unwrap_or_default())
    }

    /// Works the look out if it is not known yet.
    fn make(&mut self, known: &KnownModel) -> Result<(), CliError> {
        if self.look.is_none() {
            let styles = self.read()?;
            if self.distinguished.as_ref() != Some(&distinguished(&styles)) {
                return Err(CliError::Refused(format!(
                    "the painting {} was replaced in between; choose another output for the new one",
                    self.source.name
                )));
            }
            let looks = styles.looks(&known.model, None)?;
            self.look = looks.into_iter().next().map(|(_, look)| look);
        }
        Ok(())
    }
}

/// A render's folder, until something fails there.
struct Open {
    folder: SharedFolder,
    rendered: usize,
    kept: usize,
}

impl Studio<'_> {
    /// Renders a shard's block of a group's pictures. They are in the order of frames, and in each
    /// of styles, so that most of a block's frames are in all styles and computed at once.
    fn render(&mut self, group: &Group, views: &[View], shard: Shard, report: &mut Report) {
        let styles = group.items.len();
        let block = shard.block(views.len() * styles, group.turn);
        if block.is_empty() {
            return;
        }
        let mut open: Vec<Option<Open>> = (0..styles)
            .map(|i| meets(&block, i, styles).then(|| self.open(group, i, views)))
            .zip(&group.items)
            .map(|(opened, item)| opened?.map_err(|error| report.failed(item, &error)).ok())
            .collect();
        let frames = block.start / styles..block.end.div_ceil(styles);
        let title = format!("{} {}", self.known.model.file.scene.name, group.name);
        let mut progress = Frames::titled(&title, frames.len());
        for frame in frames {
            let mut missing = BTreeSet::new();
            for (i, opened) in open.iter_mut().enumerate() {
                let Some(open) = opened.as_mut() else {
                    continue;
                };
                if !block.contains(&(frame * styles + i)) {
                    continue;
                }
                if !open.folder.lacks(frame) {
                    open.kept += 1;
                    continue;
                }
                let item = &group.items[i];
                match self.styles[item.style].make(&self.known) {
                    Ok(()) => {
                        missing.insert(i);
                    }
                    Err(error) => {
                        report.failed(item, &error);
                        *opened = None;
                    }
                }
            }
            self.frame(group, (frame, &views[frame]), &missing, &mut open, report);
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

    /// Renders a frame in those styles where it is missing.
    fn frame(
        &self,
        group: &Group,
        (number, view): (usize, &View),
        missing: &BTreeSet<usize>,
        open: &mut [Option<Open>],
        report: &mut Report,
    ) {
        if missing.is_empty() {
            return;
        }
        let model = &self.known.model;
        let coats = missing.iter().map(|&i| {
            let look = self.styles[group.items[i].style].look.clone().flatten();
            look.map(|look| group.settings.coat(model, look))
                .transpose()
        });
        let coats: Vec<Option<Coat>> = match coats.collect::<Result<_, _>>() {
            Ok(coats) => coats,
            Err(error) => {
                for &i in missing {
                    report.failed(&group.items[i], &error);
                    open[i] = None;
                }
                return;
            }
        };
        let original: Option<&[Coat]> = group.side_by_side.then_some(&[]);
        let painted = coats.iter().map(Option::as_slice);
        let lists: Vec<&[Coat]> = original.into_iter().chain(painted).collect();
        let first = lists.len() - coats.len();
        let rendered = model.render_coats(&view.camera, &lists, group.settings.supersampling);
        for (look, &i) in missing.iter().enumerate() {
            let Some(opened) = open[i].as_mut() else {
                continue;
            };
            let shown = (0..first).chain([first + look]);
            let pictures = shown.map(|i| rendered.image(i)).collect();
            let frame = Frame {
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
    }

    /// What the frames of a group's item show.
    fn layout(&self, group: &Group, item: usize) -> Layout {
        let style = &self.styles[group.items[item].style].source.name;
        match group.side_by_side {
            true => Layout::side_by_side(vec![style.clone()]),
            false => Layout::Each(Vec::new()),
        }
    }

    fn open(&mut self, group: &Group, index: usize, views: &[View]) -> Result<Open, CliError> {
        let item = &group.items[index];
        let style = self.styles[item.style].distinguished()?;
        let shown = (&self.layout(group, index), group.depth);
        let (cameras, job) = self.known.job(&style, views, &group.settings, shown);
        let contents = Contents {
            variants: &[],
            frames: views.len(),
            depth: group.depth,
            cameras: &cameras,
            job: &job,
        };
        Ok(Open {
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
