//! The demo's contact sheet: a row per held-out view, a column per look.

use image::imageops::{FilterType, resize};
use image::{Rgb, RgbImage, imageops};
use impasto::scene::{Scene, Split, metrics};
use impasto::{Model, StyledAppearance};
use impasto_style::picture;

use super::styles::HeldOutStyle;
use crate::cli::progress::FrameProgress;
use crate::output::{grid, lettering};

/// Height of a cell in pixels.
const CELL: u32 = 240;
/// Scale of the captions.
const SCALE: u32 = 2;
const INK: Rgb<u8> = Rgb([235, 232, 225]);

/// Photo, reconstruction and every style, for each held-out view; the paintings on top.
pub fn compose(model: &Model, photos: &Scene, styles: &[HeldOutStyle]) -> RgbImage {
    let photo_appearance = model.photo_appearance();
    let looks: Vec<&StyledAppearance> = std::iter::once(&photo_appearance)
        .chain(styles.iter().map(|style| &style.look))
        .collect();
    let photographed = model.file.scene.photos.iter();
    let views: Vec<_> = photographed
        .filter(|photo| photo.split == Split::Test)
        .collect();
    let mut progress = FrameProgress::new("render", views.len());
    let mut rows = Vec::new();
    for view in views {
        let Some(photo) = photos.photos.iter().find(|photo| photo.name == view.name) else {
            continue;
        };
        let rendered = model.render(&view.camera, &looks);
        let psnr = rendered.pixels.first().map_or(f64::NAN, |reconstruction| {
            metrics::psnr(reconstruction, &picture(&photo.pixels))
        });
        rows.push(captioned(
            &photo.pixels,
            &format!("{} synthetic", photo_name(&view.name)),
        ));
        for i in 0..looks.len() {
            let caption = match i {
                0 => format!("reconstruction {psnr:.1} dB"),
                _ => String::new(),
            };
            rows.push(captioned(&rendered.image(i), &caption));
        }
        progress.tick();
    }
    let mut cells = header(styles, rows.first());
    cells.append(&mut rows);
    grid::grid(&cells, looks.len() + 1)
}

/// The top row: what this is, and the paintings.
fn header(styles: &[HeldOutStyle], like: Option<&RgbImage>) -> Vec<RgbImage> {
    let width = like.map_or(CELL, RgbImage::width);
    let blank = || RgbImage::from_pixel(width, CELL + band(), grid::GROUND);
    let mut title = blank();
    for (i, line) in [
        "impasto demo",
        "synthetic scene,",
        "synthetic paintings",
        "not trained on",
    ]
    .iter()
    .enumerate()
    {
        let y = CELL / 3 + i as u32 * (lettering::HEIGHT + 4) * SCALE;
        lettering::draw(&mut title, [8, y], line, SCALE, INK);
    }
    let mut cells = vec![title, blank()];
    cells.extend(
        styles
            .iter()
            .map(|style| captioned(&style.picture, style.family)),
    );
    cells
}

fn band() -> u32 {
    (lettering::HEIGHT + 4) * SCALE
}

/// A picture at the cells' height over its caption.
fn captioned(image: &RgbImage, caption: &str) -> RgbImage {
    let width =
        (f64::from(image.width()) * f64::from(CELL) / f64::from(image.height())).round() as u32;
    let small = resize(image, width.max(1), CELL, FilterType::Lanczos3);
    let mut cell = RgbImage::from_pixel(small.width(), CELL + band(), grid::GROUND);
    imageops::replace(&mut cell, &small, 0, 0);
    let left = small
        .width()
        .saturating_sub(lettering::width(caption, SCALE))
        / 2;
    lettering::draw(&mut cell, [left, CELL + 2 * SCALE], caption, SCALE, INK);
    cell
}

/// A photo's name without folder and ending.
fn photo_name(name: &str) -> &str {
    let file = name.rsplit('/').next().unwrap_or(name);
    file.split('.').next().unwrap_or(file)
}
