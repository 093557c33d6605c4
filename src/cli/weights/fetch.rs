//! `impasto weights --fetch`: the one place in the program that uses a network, through curl.

use std::fs;
use std::io::{self, Read};
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::Duration;

use super::add;
use crate::cli::progress::Bar;
use crate::cli::{CliError, CommandOutput, console};
use crate::output::Staging;

/// torchvision's own file; the digits are the beginning of its SHA-256.
const ADDRESS: &str = "https://download.pytorch.org/models/vgg19-dcbb9e9d.pth";
const NAME: &str = "vgg19-dcbb9e9d.pth";
/// About its length in bytes, for the progress bar.
const LENGTH: f64 = 575e6;
/// Time between two checks how far the download is.
const POLL: Duration = Duration::from_millis(200);
/// What curl exits with when it cannot write.
const WRITE_ERROR: i32 = 23;

/// Runs the command.
pub fn run(folder: &Path) -> Result<CommandOutput, CliError> {
    // Where there is room for what is installed: system-wide temporary folders may be in memory.
    let mut staging = Staging::new(folder)?;
    let file = staging.file(NAME)?;
    console::note(format_args!("downloading {ADDRESS} (575 MB)"));
    let (status, words) = download(&file).map_err(|source| without_curl(&source))?;
    if !status.success() {
        return Err(refused(folder, status, &words));
    }
    add::install(&file, ADDRESS, folder)
}

/// Runs curl; its exit status, and what it complained of.
fn download(file: &Path) -> io::Result<(ExitStatus, String)> {
    let mut curl = Command::new("curl")
        .args(["--fail", "--location", "--silent", "--show-error"])
        .args(["--proto", "=https", "--connect-timeout", "30"])
        // Gives up on a line that has stalled.
        .args(["--speed-limit", "1000", "--speed-time", "60"])
        .arg("--output")
        .arg(file)
        .arg(ADDRESS)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()?;
    let mut bar = Bar::new("download");
    let status = loop {
        if let Some(status) = curl.try_wait()? {
            break status;
        }
        let bytes = fs::metadata(file).map_or(0, |m| m.len()) as f64;
        bar.show((bytes / LENGTH).min(1.0), format!("{:.0} MB", bytes / 1e6));
        sleep(POLL);
    };
    let mut words = Vec::new();
    if let Some(mut stderr) = curl.stderr.take() {
        stderr.read_to_end(&mut words)?;
    }
    Ok((status, String::from_utf8_lossy(&words).into_owned()))
}

fn elsewhere() -> String {
    format!("get {ADDRESS} on a machine that can, and run `impasto weights --add FILE` here")
}

fn without_curl(problem: &io::Error) -> CliError {
    let what = match problem.kind() {
        io::ErrorKind::NotFound => "curl is not installed".to_owned(),
        _ => format!("curl cannot be run ({problem})"),
    };
    CliError::Refused(format!(
        "{what}, which downloads are made by; install it, or {}",
        elsewhere()
    ))
}

fn refused(folder: &Path, status: ExitStatus, words: &str) -> CliError {
    let words = words.lines().last().unwrap_or("curl gave no reason").trim();
    if status.code() == Some(WRITE_ERROR) {
        return CliError::Refused(format!(
            "cannot write the download to {} ({words}); make 600 MB of room there, or set \
             IMPASTO_WEIGHTS to another folder",
            folder.display()
        ));
    }
    CliError::Refused(format!(
        "the download failed ({words}); check the network, or {}",
        elsewhere()
    ))
}
