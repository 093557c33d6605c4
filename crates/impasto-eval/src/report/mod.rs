//! The report of an evaluation: as JSON for programs, as CSV for spreadsheets, and as one page that
//! needs nothing but itself.

mod csv;
mod heat;
mod pictures;
mod rows;
mod tables;
mod viewer;
mod words;

use crate::html::escaped;
use crate::names::{OURS, PHOTO};
use crate::results::Evaluation;
use image::ImageError;
use impasto_model::{Grain, Quality};
use rows::range_of;
use serde::Serialize;
use std::path::PathBuf;
use words::{e100, number, share};

/// What was evaluated on.
#[derive(Debug, Clone, Serialize)]
pub struct Settings {
    /// The model's folder.
    pub model: PathBuf,
    /// The folder of paintings.
    pub styles: PathBuf,
    /// Paintings in it.
    pub paintings: usize,
    /// Frames of the path.
    pub frames: usize,
    /// Width and height of its frames in pixels; `None` without a path.
    pub frame_size: Option<[u32; 2]>,
    /// Rays along each side of a rendered pixel.
    pub supersampling: u32,
    /// Names of the methods compared with.
    pub against: Vec<String>,
}

/// Everything that a report says. As JSON, the methods' results are keys of the object itself.
#[derive(Debug, Clone, Serialize)]
pub struct EvalReport<'a> {
    /// The results.
    #[serde(flatten)]
    pub evaluation: &'a Evaluation,
    /// How well the model shows the held-out photos.
    pub reconstruction: Quality,
    /// Name of the capture.
    pub scene: &'a str,
    /// Whether its photos were made by a program.
    pub synthetic: bool,
    /// Files of the style folder that are no pictures.
    pub unreadable: &'a [PathBuf],
    /// What was evaluated on.
    pub settings: Settings,
    /// The program's version.
    pub version: &'a str,
    /// The command as it was given.
    pub command: String,
    /// Processor, threads, instructions and system.
    pub machine: String,
    /// Day and time at which it ended.
    pub date: String,
    /// Seconds that it took.
    pub seconds: f64,
}

/// Bytes that a page should not exceed: what is easily mailed and opened on a phone.
const PAGE_BYTES: usize = 15_000_000;

const STYLE: &str = include_str!("style.css");
const GLOSSARY: &str = include_str!("glossary.html");

impl EvalReport<'_> {
    /// One row for each method and painting and one for each method's mean, after a row of names;
    /// RFC 4180. The columns are explained in the page.
    pub fn csv(&self) -> String {
        csv::table(self.evaluation)
    }

    /// One page with all tables and, where the evaluation kept some, pictures: HTML that refers to
    /// nothing outside of itself.
    ///
    /// # Errors
    /// If a recorded picture has no pixels.
    pub fn html(&self) -> Result<String, ImageError> {
        let mut body = self.head() + &tables::all(self.evaluation);
        let mut script = String::new();
        if let Some(record) = &self.evaluation.record {
            let names = self.names();
            let sheets = pictures::sheets(self.evaluation, record)?;
            let worst = pictures::worst_pairs(self.evaluation, &names, record)?;
            let used = body.len() + sheets.len() + worst.len() + GLOSSARY.len();
            let films = viewer::viewer(&names, record, PAGE_BYTES.saturating_sub(used))?;
            if !films.is_empty() {
                script = format!("<script>\n{}</script>\n", viewer::SCRIPT);
            }
            body += &(films + &sheets + &worst);
        }
        // The policy makes browsers refuse what would reach out of the page.
        Ok(format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; \
             img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n\
             <title>Evaluation of {}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n\
             {body}{GLOSSARY}{}</main>\n{script}</body>\n</html>\n",
            escaped(self.scene),
            csv::legend(),
        ))
    }

    /// Names of all paintings.
    fn names(&self) -> Vec<&str> {
        let paintings = self.evaluation.methods.values().next();
        let paintings = paintings.iter().flat_map(|m| &m.fidelity.paintings);
        paintings.map(|painting| painting.name.as_str()).collect()
    }

    /// Names, values and notes of what was measured without paint.
    fn of_reconstruction(&self) -> Vec<(&'static str, String, String)> {
        let quality = &self.reconstruction;
        let (psnr, fitted) = (quality.psnr, quality.fitted_psnr);
        let mut figures = vec![
            (
                "PSNR",
                format!("{psnr:.2} dB"),
                format!(
                    "held-out views: {}; {fitted:.2} dB after an affine fit of colours",
                    quality.views
                ),
            ),
            (
                "SSIM",
                number(quality.ssim, 3),
                "of the reconstruction".to_owned(),
            ),
        ];
        if let Some(aligned) = quality.aligned_psnr {
            let below = "poses of held-out views refined, as those of training photos were";
            figures.push((
                "PSNR, aligned",
                format!("{aligned:.2} dB"),
                below.to_owned(),
            ));
        }
        if let Some(grain) = quality.grain {
            let Grain {
                colour,
                depth,
                wrong_pixels,
            } = grain;
            let below = format!("depth {depth:.2} ×, single wrong pixels {wrong_pixels:.2} ×");
            figures.push(("Grain between photos", format!("{colour:.2} ×"), below));
        }
        figures
    }

    fn head(&self) -> String {
        let synthetic = if self.synthetic {
            "<p class=\"note\">The scene is synthetic: its photos were made by a program.</p>\n"
        } else {
            ""
        };
        let mut figures = self.of_reconstruction();
        if let Some(ours) = self.evaluation.methods.get(OURS) {
            let retrieval = format!("retrieval {}", share(ours.fidelity.retrieval));
            figures.push(("Style gain", number(ours.fidelity.style_gain, 3), retrieval));
            let floor = self.evaluation.methods.get(PHOTO);
            for (range, name) in ["E×100, short", "E×100, long"].into_iter().enumerate() {
                let floor = floor.and_then(|floor| range_of(floor, range));
                if let Some(found) = range_of(ours, range) {
                    let floor = floor.map_or_else(String::new, |f| format!("floor {}", e100(f)));
                    figures.push((name, e100(found), floor));
                }
            }
        }
        let figures = figures.into_iter().map(|(name, value, below)| {
            format!("<div><dt>{name}</dt><dd>{value}<small>{below}</small></dd></div>\n")
        });
        format!(
            "<header>\n<p class=\"kicker\">Impasto, evaluation</p>\n<h1>{}</h1>\n{synthetic}\
             <dl class=\"figures\">\n{}</dl>\n{}</header>\n",
            escaped(self.scene),
            figures.collect::<String>(),
            self.facts(),
        )
    }

    /// How it was measured, by what, when.
    fn facts(&self) -> String {
        let Settings {
            paintings,
            frames,
            frame_size,
            supersampling,
            ..
        } = &self.settings;
        let views = self.evaluation.methods.values().next();
        let views = views.map_or(0, |method| method.fidelity.views);
        let walk = frame_size.map_or_else(
            || "no walk".to_owned(),
            |[width, height]| {
                format!(
                    "a walk of {frames} frames of {width}×{height}, {supersampling}×{supersampling} \
                     rays a pixel, flow {}",
                    self.evaluation.flow
                )
            },
        );
        let unreadable = match self.unreadable.len() {
            0 => String::new(),
            count => format!("; {count} files of the folder are no readable pictures"),
        };
        let rows = [
            (
                "Measured on",
                format!("{paintings} paintings × {views} views, {walk}{unreadable}"),
            ),
            ("Paintings", self.settings.styles.display().to_string()),
            ("Model", self.settings.model.display().to_string()),
            (
                "Date",
                format!("{}, after {:.0} seconds", self.date, self.seconds),
            ),
            ("Machine", self.machine.clone()),
            ("Version", self.version.to_owned()),
            ("Command", self.command.clone()),
        ];
        let rows = rows.into_iter().map(|(name, value)| {
            let value = match name {
                "Command" => format!("<code>{}</code>", escaped(&value)),
                _ => escaped(&value),
            };
            format!("<dt>{name}</dt><dd>{value}</dd>\n")
        });
        format!("<dl class=\"facts\">\n{}</dl>\n", rows.collect::<String>())
    }
}

#[cfg(test)]
mod tests;
