//! `--interpolate`: what lies between two or four styles, on one picture.

use std::time::Instant;

use image::{Rgb, RgbImage, imageops};
use impasto::{Model, StyleEmbedding, StyleLayer, StyledAppearance};
use serde_json::json;

use super::args::RenderArgs;
use super::styles::Styles;
use super::summary::generated_note;
use super::views::views;
use crate::cli::values::{clock, has_ending};
use crate::cli::{CliError, CommandOutput};
use crate::output::{check_folder, grid, lettering, parent, write_png};

/// Cells at least this wide get larger letters.
const WIDE: u32 = 240;
const INK: Rgb<u8> = Rgb([235, 232, 225]);

/// Renders the first view in `count` looks from one style to the other, or in `count × count`
/// between four.
pub fn run(args: &RenderArgs, count: usize, start: Instant) -> Result<CommandOutput, CliError> {
    let styles = read(args)?;
    let names = styles.names();
    check_folder(&parent(&args.output))?;
    let model = Model::load_on(&args.model, &args.device.open()?)?;
    let corners = styles.paintings().map(|painting| model.embedding(painting));
    let corners = corners.collect::<Result<Vec<_>, _>>()?;
    let rows = if corners.len() == 2 { 1 } else { count };
    let looks = looks(&model, &corners, rows, count)?;
    let views = views(&model, &args.views, args.size, None)?;
    let Some(view) = views.first() else {
        return Err(CliError::Refused("there is no such view".into()));
    };
    let coats = looks
        .into_iter()
        .map(|look| Ok([args.settings.coat(&model, look)?]));
    let coats = coats.collect::<Result<Vec<_>, CliError>>()?;
    let lists: Vec<&[StyleLayer]> = coats.iter().map(<[StyleLayer; 1]>::as_slice).collect();
    let rendered = model.render_layers(&view.camera, &lists, args.settings.supersampling);
    let pictures: Vec<RgbImage> = (0..rows * count).map(|i| rendered.image(i)).collect();
    let sheet = labelled(&pictures, count, &names);
    write_png(&args.output, &sheet)?;

    let steps = steps(&rendered.pixels, count);
    let largest = steps.iter().copied().fold(0.0, f64::max);
    let mean = steps.iter().sum::<f64>() / steps.len().max(1) as f64;
    let seconds = start.elapsed().as_secs_f64();
    Ok(CommandOutput {
        text: format!(
            "{rows}×{count} looks between {} in {}, neighbours {:.3} apart, at most {:.3} (root mean \
             square of colours): {}{}",
            names.join(", "),
            clock(seconds),
            mean,
            largest,
            args.output.display(),
            generated_note(&styles.generated)
        ),
        json: json!({
            "outputs": [args.output],
            "views": 1,
            "styles": names,
            "generated": styles.generated,
            "rows": rows,
            "columns": count,
            "mean_step": mean,
            "largest_step": largest,
            "synthetic": model.file.scene.synthetic,
            "seconds": seconds,
        }),
    })
}

/// The styles, if they are as many as a row or a square has corners.
fn read(args: &RenderArgs) -> Result<Styles, CliError> {
    let refuse = |problem: &str| Err(CliError::Usage(problem.into()));
    if args.styles.iter().any(|style| style.weight.is_some()) {
        return refuse("--interpolate takes styles without weights");
    }
    if ![2, 4].contains(&args.styles.len()) {
        return refuse(&format!(
            "--interpolate goes between two styles (a row) or four (a square), not {}",
            args.styles.len()
        ));
    }
    if !has_ending(&args.output, "png") {
        return refuse("--interpolate makes one picture: give -o FILE.png");
    }
    Styles::read(&args.styles)
}

/// Row by row. Corners are in reading order.
fn looks(
    model: &Model,
    corners: &[StyleEmbedding],
    rows: usize,
    columns: usize,
) -> Result<Vec<StyledAppearance>, CliError> {
    let share = |i: usize, of: usize| i as f32 / (of - 1).max(1) as f32;
    let mut looks = Vec::with_capacity(rows * columns);
    for (row, column) in (0..rows).flat_map(|r| (0..columns).map(move |c| (r, c))) {
        let (down, across) = (share(row, rows), share(column, columns));
        let weights = [
            (1.0 - across) * (1.0 - down),
            across * (1.0 - down),
            (1.0 - across) * down,
            across * down,
        ];
        let weighed: Vec<_> = corners.iter().cloned().zip(weights).collect();
        let look = StyleEmbedding::mix(&weighed).and_then(|between| model.appearance(&between));
        looks.push(look.ok_or(CliError::Unstyled)?);
    }
    Ok(looks)
}

/// Root mean square differences between neighbours in a row or in a column.
fn steps(pictures: &[Vec<f32>], columns: usize) -> Vec<f64> {
    let apart = |a: &[f32], b: &[f32]| {
        let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        (sum / a.len().max(1) as f64).sqrt()
    };
    let mut steps = Vec::new();
    for (i, one) in pictures.iter().enumerate() {
        let right = (i % columns + 1 < columns).then_some(i + 1);
        let below = (i + columns < pictures.len()).then_some(i + columns);
        for other in [right, below].into_iter().flatten() {
            steps.push(apart(one, &pictures[other]));
        }
    }
    steps
}

/// The grid with the styles' names at its corners, above and (of four styles) below it.
fn labelled(pictures: &[RgbImage], columns: usize, names: &[String]) -> RgbImage {
    let cells = grid::grid(pictures, columns);
    let wide = pictures.first().is_some_and(|p| p.width() >= WIDE);
    let scale = if wide { 2 } else { 1 };
    let band = (lettering::HEIGHT + 4) * scale;
    let bands = names.len().div_ceil(2) as u32;
    let (width, height) = (cells.width(), cells.height() + bands * band);
    let mut sheet = RgbImage::from_pixel(width, height, grid::GROUND);
    imageops::replace(&mut sheet, &cells, 0, i64::from(band));
    let room = (width / 2 / lettering::width("x", scale)) as usize;
    for (i, name) in names.iter().enumerate() {
        let name: String = name.chars().take(room.saturating_sub(2)).collect();
        let x = if i % 2 == 0 {
            grid::GAP
        } else {
            width.saturating_sub(grid::GAP + lettering::width(&name, scale))
        };
        let y = if i < 2 {
            2 * scale
        } else {
            height - band + 2 * scale
        };
        lettering::draw(&mut sheet, [x, y], &name, scale, INK);
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_compared_along_rows_and_columns() {
        let shades = [0.0, 0.1, 0.3, 0.6];
        let pictures: Vec<Vec<f32>> = shades.iter().map(|s| vec![*s; 6]).collect();
        let rounded = |columns| -> Vec<i64> {
            let steps = steps(&pictures, columns);
            steps.iter().map(|s| (s * 100.0).round() as i64).collect()
        };
        assert_eq!(rounded(4), [10, 20, 30]);
        assert_eq!(rounded(2), [10, 30, 50, 30]);
    }

    #[test]
    fn names_stand_at_the_corners() {
        let names = ["L", "L", "L", "L"].map(String::from);
        let cells: Vec<RgbImage> = (0..4).map(|_| RgbImage::new(30, 20)).collect();
        let inked = |count: usize| -> Vec<(u32, u32)> {
            let sheet = labelled(&cells, 2, &names[..count]);
            let (w, h) = sheet.dimensions();
            let inked = sheet.enumerate_pixels().filter(|(_, _, p)| **p == INK);
            let mut quarters: Vec<_> = inked.map(|(x, y, _)| (2 * x / w, 2 * y / h)).collect();
            quarters.sort_unstable();
            quarters.dedup();
            quarters
        };
        assert_eq!(inked(2), [(0, 0), (1, 0)]);
        assert_eq!(inked(4), [(0, 0), (0, 1), (1, 0), (1, 1)]);
    }
}
