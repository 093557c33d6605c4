//! `impasto demo`: all of it, on a place and paintings that were made by code.

mod clip;
mod sheet;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;
use std::time::Instant;

use clap::Args;
use image::RgbImage;
use impasto::paintings::{Family, PALETTES, Recipe, label, paint};
use impasto::scene::builtin::{BuiltinOptions, write_capture};
use impasto::scene::{Format, LoadOptions, MaskUse, load};
use impasto::{
    Device, Inspiration, Look, Model, Recovery, Stages, TrainConfig, TrainOptions, TrainSummary,
    Unfinished, cache_folder,
};
use serde_json::json;

use super::device::DeviceArgs;
use super::train::{BudgetArgs, describe, watched};
use super::values::size;
use super::{Answer, CliError, console, to_json};
use crate::output::{check_folder, picture, write_file};

/// First seed of the styles; all are below those that training paints from.
const HELD_OUT_SEEDS: u64 = 9_000;
const _: () = assert!(HELD_OUT_SEEDS + STYLES.len() as u64 <= impasto_train::FIRST_GENERATED);
/// Families and palettes that look unlike each other.
const STYLES: [(Family, &str); 5] = [
    (Family::Swirl, "starry cobalt"),
    (Family::Mosaic, "Byzantine gold"),
    (Family::Woodblock, "ukiyo-e indigo"),
    (Family::Pointillism, "southern sun"),
    (Family::Fauvist, "fauve riot"),
];
/// Side of a style image in pixels.
const STYLE_SIDE: u32 = 256;

/// With rendering, four minutes on two cores.
const TRAINING: Duration = Duration::from_secs(190);
/// Of so short a time, geometry needs more than its usual share.
const GEOMETRY_SHARE: f64 = 0.4;

/// Make photos, train, and repaint: everything on a built-in synthetic scene, without downloads
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Folder for everything that is made
    #[arg(long, value_name = "DIR", default_value = "demo-out")]
    out: PathBuf,
    #[command(flatten)]
    budget: BudgetArgs,
    /// Size of the photos in pixels; smaller ones make a quicker, coarser demo
    #[arg(long, value_name = "WxH", default_value = "384x288", value_parser = size)]
    size: (u32, u32),
    /// Start of the random numbers
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    device: DeviceArgs,
}

/// A generated painting that was not trained on.
struct Style {
    family: &'static str,
    label: String,
    file: PathBuf,
    picture: RgbImage,
    inspiration: Inspiration,
    look: Look,
}

/// Runs the command.
pub fn run(args: &DemoArgs) -> Result<Answer, CliError> {
    let start = Instant::now();
    let out = &args.out;
    check_folder(out)?;
    console::note("photographing the built-in synthetic scene");
    let (width, height) = args.size;
    let capture = BuiltinOptions {
        width,
        height,
        ..BuiltinOptions::default()
    };
    write_capture(&out.join("scene"), &capture)?;
    let device = args.device.open()?;
    let summary = trained(args, device.clone())?;

    let model = Model::load_on(&summary.model, device)?;
    let styles = styles(&model, &out.join("styles"))?;
    let photos = load(&out.join("scene"), &LoadOptions::default())?;
    let sheet = out.join("contact_sheet.png");
    write_file(&sheet, |path| {
        picture::save_png(&sheet::compose(&model, &photos, &styles), path)
    })?;
    let clip = clip::film(&model, &styles, &out.join("clip.gif"))?;

    let painted = |style: &Style| json!({"file": style.file, "label": style.label});
    let json = json!({
        "synthetic": true,
        "note": "scene and paintings were made by code; no real place or artist is shown",
        "training": to_json(&summary),
        "styles": styles.iter().map(painted).collect::<Vec<_>>(),
        "contact_sheet": sheet,
        "clip": clip,
        "seconds": start.elapsed().as_secs_f64(),
    });
    write_file(&out.join("summary.json"), |path| {
        fs::write(path, format!("{json:#}\n")).map_err(CliError::write(path))
    })?;
    Ok(Answer {
        text: format!(
            "{}\nsynthetic paintings, not trained on: {}\npictures: {} and {}",
            describe(&summary),
            styles
                .iter()
                .map(|style| style.family)
                .collect::<Vec<_>>()
                .join(", "),
            sheet.display(),
            clip.display(),
        ),
        json,
    })
}

fn trained(args: &DemoArgs, device: Device) -> Result<TrainSummary, CliError> {
    watched(&TrainOptions {
        scene: args.out.join("scene"),
        output: args.out.join("model"),
        styles: None,
        encoder: None,
        cache: cache_folder(),
        stages: Stages::All,
        config: TrainConfig {
            geometry_share: GEOMETRY_SHARE,
            ..TrainConfig::fast()
        },
        budget: args.budget.get_or(TRAINING),
        downscale: 1,
        format: Some(Format::Transforms),
        masks: MaskUse::Off,
        seed: args.seed,
        device,
        recovery: Recovery {
            // Minutes of a scene that anybody can have again.
            unfinished: Unfinished::Discard,
            ..Recovery::default()
        },
    })
}

/// Paints the held-out styles, saves them and works out their looks.
fn styles(model: &Model, folder: &Path) -> Result<Vec<Style>, CliError> {
    STYLES
        .iter()
        .zip(HELD_OUT_SEEDS..)
        .map(|(&(family, palette), seed)| {
            let recipe = Recipe {
                palette: PALETTES.iter().position(|p| p.name == palette).unwrap_or(0),
                ..Recipe::nth_of(family, seed)
            };
            let painting = paint(&recipe, STYLE_SIDE, STYLE_SIDE);
            let file = folder.join(format!("{}.png", family.name().replace(' ', "-")));
            write_file(&file, |path| picture::save_png(&painting, path))?;
            let inspiration = model.inspiration(&painting)?;
            Ok(Style {
                family: family.name(),
                label: label(&recipe),
                file,
                look: model.look(&inspiration).ok_or(CliError::Unstyled)?,
                picture: painting,
                inspiration,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_palette_exists() {
        for (_, name) in STYLES {
            assert!(
                PALETTES.iter().any(|palette| palette.name == name),
                "{name}"
            );
        }
    }
}
