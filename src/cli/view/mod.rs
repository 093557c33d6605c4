//! `impasto view`.

mod workshop;

use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError};
use std::time::Instant;

use clap::Args;
use impasto::view::{Limits, ModelPainter, Opening, Server, ViewOptions};
use impasto::{Device, Model};
use impasto_model::MODEL_FILE;
use serde_json::json;

use self::workshop::{ModelWorkshop, Shown};
use super::device::DeviceArgs;
use super::ffmpeg::FfmpegArgs;
use super::{CliError, CommandOutput, console, interrupt};
use crate::output::FfmpegProgram;

/// Open the studio: walk through a scene and paint it, in a browser
///
/// The page is served on this machine only, and asks for nothing from elsewhere. A model that is
/// still in training is followed and shown as soon as it is there. Ctrl-C closes the studio.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct ViewArgs {
    /// The model's folder
    model: PathBuf,
    /// A folder of paintings to choose from
    #[arg(long, value_name = "DIR")]
    styles: Option<PathBuf>,
    /// Port to listen on; 0 takes any that is free
    #[arg(long, value_name = "PORT", default_value_t = 7007)]
    port: u16,
    /// Let other machines in, through this address of this one (0.0.0.0 for all of its addresses);
    /// the page then asks for the token that is printed, and is not encrypted on its way
    #[arg(long, value_name = "ADDRESS")]
    host: Option<IpAddr>,
    #[command(flatten)]
    ffmpeg: FfmpegArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Runs the command.
pub fn run(args: &ViewArgs) -> Result<CommandOutput, CliError> {
    let start = Instant::now();
    let device = args.device.open()?;
    let shown = Shown::default();
    let first = if is_in_training(&args.model) {
        None
    } else {
        Some(painter(&args.model, &device, &shown)?)
    };
    let scratch = tempfile::tempdir().map_err(CliError::write(&tempfile::env::temp_dir()))?;
    let server = Server::bind(ViewOptions {
        address: args.host.unwrap_or(std::net::Ipv4Addr::LOCALHOST.into()),
        port: args.port,
        token: args.host.is_some(),
        styles: args.styles.clone(),
        model: args.model.clone(),
        scratch: scratch.path().to_owned(),
        limits: Limits::default(),
    })?;
    let stop = interrupt::stop("closing the studio; once more leaves at once");
    if first.is_none() {
        console::note("there is no model yet; the page follows its training");
    }
    console::note(format_args!(
        "the studio is open at {} (Ctrl-C closes it)",
        server.link()
    ));
    let workshop = ModelWorkshop::new(Arc::clone(&shown), FfmpegProgram::new(&args.ffmpeg.program));
    let model = args.model.clone();
    let opening = Opening {
        first,
        again: Box::new(move || painter(&model, &device, &shown).map_err(|e| e.to_string())),
    };
    let address = server.address();
    server.run(opening, Box::new(workshop), &stop)?;
    Ok(CommandOutput {
        text: "the studio is closed".into(),
        json: json!({
            "address": address.to_string(),
            "seconds": start.elapsed().as_secs_f64(),
        }),
    })
}

fn painter(model: &Path, device: &Device, shown: &Shown) -> Result<ModelPainter, CliError> {
    let model = Arc::new(Model::load_on(model, device)?);
    let mut slot = shown.lock().unwrap_or_else(PoisonError::into_inner);
    *slot = Some(Arc::clone(&model));
    drop(slot);
    Ok(ModelPainter::new(model))
}

/// Whether a folder is that of a run which has not written its model yet.
fn is_in_training(model: &Path) -> bool {
    model.is_dir() && !model.join(MODEL_FILE).exists() && model.join("log.jsonl").exists()
}
