//! Two methods' frames side by side, which shows how they flicker.

use super::words::{full_title, portion};
use crate::html::{data_url, escaped};
use crate::names::{OURS, PHOTO, REFINED};
use crate::record::ImageRecord;
use image::{ImageError, RgbImage};
use serde::Serialize;

/// What plays the frames.
pub(super) const SCRIPT: &str = include_str!("viewer.js");
/// JPEG quality of the frames.
const QUALITY: u8 = 74;

/// How much larger than they are frames are shown where there is room: flicker is small.
const MAGNIFIED: f64 = 1.5;

/// A method's frames as data addresses, one list for each painting; one alone for frames that no
/// painting changes.
#[derive(Serialize)]
struct Films {
    title: String,
    films: Vec<Vec<String>>,
}

/// The viewer with as many paintings' frames as fit into so many bytes, and as many frames as fit
/// of the first; nothing if none were kept.
pub(super) fn viewer(
    names: &[&str],
    record: &ImageRecord,
    budget: usize,
) -> Result<String, ImageError> {
    let methods = record.samples.keys().map(|name| {
        let (title, films) = (full_title(name), Vec::new());
        (name.as_str(), Films { title, films })
    });
    let mut methods: Vec<(&str, Films)> = methods.collect();
    let lengths = record.samples.values().flatten().map(|s| s.film.len());
    let all = lengths.max().unwrap_or(0);
    let (mut used, mut paintings, mut frames) = (0, 0, all);
    while paintings < record.paintings.len() && all > 0 {
        let Some(encoded) = encoded(record, &methods, paintings)? else {
            break;
        };
        let films = encoded.iter().flatten();
        let size: usize = films.flatten().map(String::len).sum();
        if paintings == 0 {
            // At least two, or there is nothing to play.
            frames = frames.min((all * budget / size.max(1)).max(2));
        } else if used + size > budget {
            break;
        }
        used += size;
        for ((_, films), film) in methods.iter_mut().zip(encoded) {
            films.films.extend(film.map(|mut film| {
                film.truncate(frames);
                film
            }));
        }
        paintings += 1;
    }
    if paintings == 0 {
        return Ok(String::new());
    }
    let shown = portion(frames, all, "frames");
    let names = &names[..paintings.min(names.len())];
    let plural = if paintings == 1 { "" } else { "s" };
    let shown = format!("{shown} with the first {paintings} painting{plural}");
    Ok(page(names, record, &methods, frames, &shown))
}

/// Every method's frames of a painting; `None` for a method whose frames do not change with it, and
/// as a whole if no frames of it were kept.
type Encoded = Vec<Option<Vec<String>>>;

fn encoded(
    record: &ImageRecord,
    methods: &[(&str, Films)],
    painting: usize,
) -> Result<Option<Encoded>, ImageError> {
    let film = |(name, _): &(&str, Films)| {
        let sample = record.samples.get(*name)?.get(painting)?;
        Some(sample.film.as_slice()).filter(|film| !film.is_empty())
    };
    let films: Vec<Option<&[RgbImage]>> = methods.iter().map(film).collect();
    if films.iter().all(Option::is_none) {
        return Ok(None);
    }
    let addresses = |film: &[RgbImage]| film.iter().map(|f| data_url(f, QUALITY)).collect();
    let films = films
        .into_iter()
        .map(|film| film.map(addresses).transpose());
    films.collect::<Result<_, _>>().map(Some)
}

/// The viewer's section; `shown` says which frames and paintings.
fn page(
    names: &[&str],
    record: &ImageRecord,
    methods: &[(&str, Films)],
    frames: usize,
    shown: &str,
) -> String {
    let options = |titles: &[&str], chosen: usize| {
        let option = |(i, title): (usize, &&str)| {
            let selected = if i == chosen { " selected" } else { "" };
            format!(
                "<option value=\"{i}\"{selected}>{}</option>",
                escaped(title)
            )
        };
        titles.iter().enumerate().map(option).collect::<String>()
    };
    let titles: Vec<&str> = methods.iter().map(|(_, m)| m.title.as_str()).collect();
    let ours = methods.iter().position(|(name, _)| *name == OURS);
    let other = |(name, _): &(&str, Films)| ![OURS, PHOTO, REFINED].contains(name);
    let other = methods.iter().position(other);
    // Against a compared method if there is one, else against the unstylised frames.
    let photo = methods.iter().position(|(name, _)| *name == PHOTO);
    let [left, right] = [ours, other.or(photo)].map(Option::unwrap_or_default);
    let frame = record
        .samples
        .values()
        .flatten()
        .find_map(|s| s.film.first());
    let (width, height) = frame.map_or((1, 1), RgbImage::dimensions);
    let films: Vec<&Films> = methods.iter().map(|(_, films)| films).collect();
    // Numbers and text under text keys: this cannot fail. No tag can begin inside.
    let films = serde_json::to_string(&films).unwrap_or_default();
    let films = films.replace('<', "\\u003c");
    format!(
        "<section id=\"viewer\">\n<h2>The walk</h2>\n\
         <p>{shown}, {width}×{height} pixels, JPEG quality \
         {QUALITY}.</p>\n<noscript><p class=\"note\">Playing needs scripts; this page brings its \
         own.</p></noscript>\n\
         <div class=\"stage\">\n{}{}</div>\n\
         <div class=\"controls\">\n<button type=\"button\" id=\"play\">Play</button>\n\
         <input type=\"range\" id=\"frame\" min=\"0\" max=\"{}\" value=\"0\" aria-label=\"Frame\">\n\
         <output id=\"place\">1 / {frames}</output>\n\
         <label>Painting <select id=\"painting\">{}</select></label>\n</div>\n\
         <script type=\"application/json\" id=\"films\">{films}</script>\n</section>\n",
        screen("left", &options(&titles, left), width, height),
        screen("right", &options(&titles, right), width, height),
        frames.saturating_sub(1),
        options(names, 0),
    )
}

fn screen(side: &str, options: &str, width: u32, height: u32) -> String {
    format!(
        "<figure><select id=\"{side}\" aria-label=\"Method on the {side}\">{options}</select>\
         <canvas id=\"{side}-screen\" width=\"{width}\" height=\"{height}\" \
         style=\"width:{}px\"></canvas></figure>\n",
        f64::from(width) * MAGNIFIED
    )
}
