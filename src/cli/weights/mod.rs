//! `impasto weights`.

mod add;
mod fetch;

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use impasto::weights::{
    SHIPPED, Shipped, VGG_LICENCE, VGG_SOURCE, VGG19_FILE, folder, inspect_vgg19,
};
use serde_json::{Value, json};

use super::{CliError, CommandOutput, to_json};

/// List the networks' weights and check them, or install VGG-19
#[derive(Debug, Args)]
pub struct WeightsArgs {
    /// Install VGG-19 from a file: torchvision's checkpoint or one normalised for style transfer,
    /// as .pth or .safetensors. Code in it is refused, never run
    #[arg(long, value_name = "FILE")]
    add: Option<PathBuf>,
    /// Download a network (575 MB, by the installed curl) and install it; nothing else in Impasto
    /// uses a network
    #[arg(long, value_enum, value_name = "NETWORK", conflicts_with = "add")]
    fetch: Option<Network>,
}

/// What can be downloaded.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Network {
    /// torchvision's VGG-19
    Vgg19,
}

/// Runs the command.
pub fn run(args: &WeightsArgs) -> Result<CommandOutput, CliError> {
    let folder = folder()?;
    match (&args.add, args.fetch) {
        (Some(file), _) => add::run(file, &folder),
        (None, Some(Network::Vgg19)) => fetch::run(&folder),
        (None, None) => Ok(list(&folder)),
    }
}

fn list(folder: &Path) -> CommandOutput {
    let path = folder.join(VGG19_FILE);
    let (vgg19, line) = installed(&path);
    let mut text = String::from("shipped with the program\n");
    let mut shipped = Vec::new();
    for weights in &SHIPPED {
        shipped.push(describe(weights));
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "  {} ({})\n    {}, {}\n    SHA-256 {}\n    {}, {}",
            weights.what,
            if weights.is_whole() {
                "whole"
            } else {
                "damaged"
            },
            weights.file,
            size(weights.bytes.len() as u64),
            weights.sha256,
            weights.source,
            weights.licence,
        );
    }
    let _ = write!(
        text,
        "installed in {}\n  VGG-19, conv1_1 to conv4_1 ({line}\n    {VGG_SOURCE}, {VGG_LICENCE}",
        folder.display()
    );
    let json = json!({"folder": folder.display().to_string(), "shipped": shipped, "vgg19": vgg19});
    CommandOutput { text, json }
}

fn describe(weights: &Shipped) -> Value {
    json!({
        "file": weights.file,
        "what": weights.what,
        "source": weights.source,
        "licence": weights.licence,
        "bytes": weights.bytes.len(),
        "sha256": weights.sha256,
        "whole": weights.is_whole(),
    })
}

/// What is to be said of the installed VGG-19, for programs and for people.
fn installed(path: &Path) -> (Value, String) {
    let mut facts =
        json!({"path": path.display().to_string(), "source": VGG_SOURCE, "licence": VGG_LICENCE});
    if !path.exists() {
        facts["state"] = "missing".into();
        let how = "not there)\n    `impasto weights --fetch vgg19` downloads it, --add FILE takes \
                   one that you have";
        return (facts, how.into());
    }
    match inspect_vgg19(path) {
        Ok(found) => {
            let bytes = fs::metadata(path).map_or(0, |m| m.len());
            facts["state"] = "whole".into();
            facts["bytes"] = bytes.into();
            facts["sha256"] = found.sha256.clone().into();
            facts["made_from"] = to_json(&found.made_from);
            let size = size(bytes);
            let line = format!(
                "whole)\n    {VGG19_FILE}, {size}, SHA-256 of its numbers {}",
                found.sha256
            );
            (facts, line)
        }
        Err(problem) => {
            facts["state"] = "damaged".into();
            facts["problem"] = problem.to_string().into();
            (facts, format!("unusable)\n    {problem}"))
        }
    }
}

fn size(bytes: u64) -> String {
    match bytes {
        0..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        _ => format!("{:.1} MB", bytes as f64 / 1e6),
    }
}
