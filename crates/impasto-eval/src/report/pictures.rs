//! Pictures side by side, and the pairs of frames that agree least.

use super::heat;
use super::rows::ordered;
use super::words::{full_title, number, portion, share, title};
use crate::consistency::RANGES;
use crate::fidelity::PaintingResult;
use crate::html::{data_url, escaped};
use crate::names::PHOTO;
use crate::record::{ImageRecord, SampleImages, WorstPair};
use crate::results::Evaluation;
use image::{ImageError, RgbImage};

/// JPEG quality of contact sheets, and of pairs, in which fine detail matters.
const SHEET_QUALITY: u8 = 80;
const PAIR_QUALITY: u8 = 88;

fn image(picture: &RgbImage, what: &str, quality: u8) -> Result<String, ImageError> {
    Ok(format!(
        "<img src=\"{}\" width=\"{}\" height=\"{}\" alt=\"{}\">",
        data_url(picture, quality)?,
        picture.width(),
        picture.height(),
        escaped(what),
    ))
}

/// Of every painting: itself, then one view and one frame of the path by every method.
pub(super) fn sheets(evaluation: &Evaluation, record: &ImageRecord) -> Result<String, ImageError> {
    let rows = ordered(evaluation);
    let all = rows.first().map_or(0, |(_, m)| m.fidelity.paintings.len());
    let mut body = String::new();
    for (i, painting) in record.paintings.iter().enumerate() {
        let mut figures = format!(
            "<figure class=\"painting\">{}<figcaption><b>Painting</b></figcaption></figure>\n",
            image(painting, "the painting", SHEET_QUALITY)?
        );
        let mut name = "";
        for (method, result) in &rows {
            let Some(found) = result.fidelity.paintings.get(i) else {
                continue;
            };
            name = &found.name;
            if let Some(sample) = record.of(method, i) {
                figures += &figure(method, sample, found)?;
            }
        }
        body += &format!(
            "<h3>{}</h3>\n<div class=\"sheet\">\n{figures}</div>\n",
            escaped(name)
        );
    }
    let shown = portion(record.paintings.len(), all, "paintings");
    let walk = match evaluation.frames {
        0 => String::new(),
        _ => format!(", and below it frame {} of the walk", record.frame + 1),
    };
    Ok(format!(
        "<section>\n<h2>Contact sheets</h2>\n<p>{shown}. Above, view {} of those held out{walk}.</p>\n\
         {body}</section>\n",
        record.view + 1
    ))
}

fn figure(
    method: &str,
    sample: &SampleImages,
    found: &PaintingResult,
) -> Result<String, ImageError> {
    let mut pictures = image(&sample.view, &full_title(method), SHEET_QUALITY)?;
    if let Some(frame) = &sample.frame {
        let what = format!("{}, in the walk", full_title(method));
        pictures += &image(frame, &what, SHEET_QUALITY)?;
    }
    let (name, how) = title(method);
    let mut facts = vec![how.to_owned()];
    if method != PHOTO {
        facts.push(format!("style gain {}", number(found.style_gain, 2)));
        if let Some(other) = &found.taken_for {
            let share = number(100.0 * (1.0 - found.retrieved), 0);
            facts.push(format!(
                "{share} % of views nearer to another painting, mostly {}",
                escaped(other)
            ));
        }
    }
    if let Some(consistency) = &found.consistency {
        let [short, long] = consistency.each_ref().map(|c| number(c.e100, 2));
        facts.push(format!("E×100 {short} short, {long} long"));
    }
    Ok(format!(
        "<figure>{pictures}<figcaption><b>{}</b><br>{}</figcaption></figure>\n",
        escaped(&name),
        facts.join("<br>"),
    ))
}

/// Of every method, the pairs of largest E at short and at long range.
pub(super) fn worst_pairs(
    evaluation: &Evaluation,
    names: &[&str],
    record: &ImageRecord,
) -> Result<String, ImageError> {
    let mut body = String::new();
    for (range, title) in ["Short range", "Long range"].into_iter().enumerate() {
        let mut pairs = String::new();
        for (method, _) in ordered(evaluation) {
            let worst = record.worst.get(method);
            if let Some(pair) = worst.and_then(|worst| worst[range].as_ref()) {
                pairs += &worst_pair(method, names, pair)?;
            }
        }
        if !pairs.is_empty() {
            let apart = RANGES[range];
            let plural = if apart == 1 { "frame" } else { "frames" };
            body += &format!("<h3>{title}, {apart} {plural} apart</h3>\n{pairs}");
        }
    }
    if body.is_empty() {
        return Ok(body);
    }
    Ok(format!(
        "<section>\n<h2>Worst pairs</h2>\n<p>Of each method the two frames that agree least, of all \
         pairs and paintings.</p>\n{}{body}</section>\n",
        heat::scale()
    ))
}

fn worst_pair(method: &str, names: &[&str], pair: &WorstPair) -> Result<String, ImageError> {
    let painting = pair.painting.and_then(|i| names.get(i));
    let painting = painting.map_or_else(|| "Unstylised".to_owned(), ToString::to_string);
    let [first, second] = pair.frames.map(|frame| frame + 1);
    let [warped, difference] = heat::maps(pair);
    let pictures = [
        (&pair.first, format!("A: frame {first}")),
        (&warped, format!("B: frame {second}, warped onto A")),
        (&difference, "(A − B)²".to_owned()),
    ];
    let mut figures = String::new();
    for (picture, caption) in pictures {
        let caption = escaped(&caption);
        figures += &format!(
            "<figure>{}<figcaption>{caption}</figcaption></figure>\n",
            image(picture, &caption, PAIR_QUALITY)?
        );
    }
    let (name, how) = title(method);
    Ok(format!(
        "<h4>{}<small>{how}</small></h4>\n<p>{}, frames {first} and {second}: E×100 {} over {} of the \
         pixels.</p>\n<div class=\"pair\">\n{figures}</div>\n",
        escaped(&name),
        escaped(&painting),
        number(100.0 * pair.square, 3),
        share(pair.coverage),
    ))
}
