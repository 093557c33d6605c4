//! `impasto demo`: all of it, on a place and paintings that were made by code.

mod clip;
mod sheet;
mod styles;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use impasto::scene::builtin::{BuiltinOptions, write_capture};
use impasto::scene::{Format, LoadOptions, MaskUse, load};
use impasto::{Device, Model, Recovery, TrainOptions, TrainSummary, Unfinished};
use serde_json::json;

use self::styles::HeldOutStyle;
use super::device::DeviceArgs;
use super::train::{BudgetArgs, describe, usual_options, watched};
use super::values::size;
use super::{CliError, CommandOutput, console, to_json};
use crate::output::{check_folder, write_file, write_png};

/// With rendering, less than three minutes on two cores.
const TRAINING: Duration = Duration::from_secs(120);

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

/// Runs the command.
pub fn run(args: &DemoArgs) -> Result<CommandOutput, CliError> {
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

    let model = Model::load_on(&summary.model, &device)?;
    let styles = styles::styles(&model, &out.join("styles"))?;
    let photos = load(&out.join("scene"), &LoadOptions::default())?;
    let sheet = out.join("contact_sheet.png");
    write_png(&sheet, &sheet::compose(&model, &photos, &styles))?;
    let clip = clip::film(&model, &styles, &out.join("clip.gif"))?;

    let painted = |style: &HeldOutStyle| json!({"file": style.file, "label": style.label});
    let json = json!({
        "synthetic": true,
        "note": "scene and paintings were made by code; no real place or artist is shown",
        "training": to_json(&summary),
        "styles": styles.iter().map(painted).collect::<Vec<_>>(),
        "contact_sheet": sheet,
        "clip": clip,
        "seconds": start.elapsed().as_secs_f64(),
    });
    write_file(&out.join("summary.json"), format!("{json:#}\n"))?;
    let families: Vec<&str> = styles.iter().map(|style| style.family).collect();
    Ok(CommandOutput {
        text: format!(
            "{}\nsynthetic paintings, not trained on: {}\npictures: {} and {}",
            describe(&summary),
            families.join(", "),
            sheet.display(),
            clip.display(),
        ),
        json,
    })
}

fn trained(args: &DemoArgs, device: Device) -> Result<TrainSummary, CliError> {
    watched(&TrainOptions {
        budget: args.budget.get_or(TRAINING),
        load: LoadOptions {
            format: Some(Format::Transforms),
            masks: MaskUse::Off,
            ..LoadOptions::default()
        },
        seed: args.seed,
        recovery: Recovery {
            // Minutes of a scene that anybody can have again.
            unfinished: Unfinished::Discard,
            ..Recovery::default()
        },
        ..usual_options(&args.out.join("scene"), &args.out.join("model"), device)
    })
}
