//! `impasto bench`.

use std::fmt::Write;
use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use impasto::paintings::Recipe;
use impasto::{Device, Model, is_cpu};
use impasto_bench::{BenchReport, run as measure, run_on};
use serde_json::json;

use super::device::DeviceArgs;
use super::values::size;
use super::{CliError, CommandOutput, to_json};

/// Time the kernels on this machine, beside its peak and the plain tensor library
#[derive(Debug, Args)]
pub struct BenchArgs {
    #[command(flatten)]
    device: DeviceArgs,
    /// Time how fast this model renders instead
    #[arg(long)]
    model: Option<PathBuf>,
    /// Size of the timed views
    #[arg(long, value_parser = size, default_value = "1920x1080", requires = "model")]
    size: (u32, u32),
}

/// Views timed, after one that makes everything ready.
const VIEWS: usize = 5;

/// Runs the command.
pub fn run(args: &BenchArgs) -> Result<CommandOutput, CliError> {
    let opened = args.device.open_named()?;
    if let Some(path) = &args.model {
        let model = Model::load_on(path, &opened.device)?;
        return render(&model, &opened.device, args.size);
    }
    let report = if is_cpu(&opened.device) {
        measure()
    } else {
        run_on(&opened.device, &opened.name)
    };
    Ok(CommandOutput {
        text: table(&report),
        json: to_json(&report),
    })
}

/// Times views of the first camera, and the change to a style whose code is known.
fn render(model: &Model, device: &Device, size: (u32, u32)) -> Result<CommandOutput, CliError> {
    let (width, height) = size;
    let camera = model.file.scene.photos.first().map(|photo| &photo.camera);
    let camera = camera.ok_or_else(|| CliError::Refused("this model has no cameras".into()))?;
    let camera = camera.resized(width, height);
    let painting = impasto::paintings::paint(&Recipe::random(1), 256, 256);
    let code = model.embedding(&painting)?;
    let styled = model.appearance(&code);
    let (look, what) = match &styled {
        Some(look) => (look.clone(), "stylised"),
        None => (model.photo_appearance(), "unstylised"),
    };
    let frame = fastest(|| model.render(&camera, &[&look]));
    // A look is on its way to the device before it is there.
    let switch = styled
        .is_some()
        .then(|| fastest(|| (model.appearance(&code), device.sync())));
    let text = switch.map_or(String::new(), |s| {
        format!(", another style in {:.1} ms", 1e3 * s)
    });
    Ok(CommandOutput {
        text: format!(
            "{what} views of {width}×{height}: {:.2} a second{text}",
            1.0 / frame
        ),
        json: json!({
            "size": [width, height],
            "look": what,
            "frames_per_second": 1.0 / frame,
            "switch_seconds": switch,
        }),
    })
}

fn fastest<R>(mut f: impl FnMut() -> R) -> f64 {
    drop(f());
    let times = (0..VIEWS).map(|_| {
        let start = Instant::now();
        drop(f());
        start.elapsed().as_secs_f64()
    });
    times.fold(f64::INFINITY, f64::min)
}

fn table(report: &BenchReport) -> String {
    let mut text = format!(
        "{}, peak {:.0} GFLOP/s\n{:56}{:>9}{:>10}{:>9}{:>6}{:>10}{:>8}",
        match &report.device {
            Some(device) => format!("{device} beside {}", report.machine),
            None => report.machine.to_string(),
        },
        report.peak_gflops,
        "",
        "ms",
        "ns each",
        "GFLOP/s",
        "peak",
        "plain ms",
        "faster"
    );
    for kernel in &report.kernels {
        let optional = |value: Option<f64>, digits: usize, unit: &str| {
            value.map_or(String::new(), |v| format!("{v:.digits$}{unit}"))
        };
        let share = kernel.share_of_peak.map(|s| 100.0 * s);
        let faster = kernel.plain_milliseconds.map(|p| p / kernel.milliseconds);
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n{:56}{:9.2}{:10.1}{:>9}{:>6}{:>10}{:>8}",
            kernel.name,
            kernel.milliseconds,
            kernel.nanoseconds_each,
            optional(kernel.gflops, 0, ""),
            optional(share, 0, "%"),
            optional(kernel.plain_milliseconds, 1, ""),
            optional(faster, 1, "×"),
        );
    }
    text
}
