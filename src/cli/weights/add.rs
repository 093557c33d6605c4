//! `impasto weights --add`: from a checkpoint to an installed network.

use std::fs::{self, File};
use std::path::Path;

use image::RgbImage;
use impasto::paintings::{Recipe, paint};
use impasto::scene::builtin::{BuiltinOptions, cameras, render};
use impasto::scene::file::check_regular;
use impasto::weights::{
    FileFormat, Scheme, VGG19_FILE, WeightsFile, inspect_vgg19, normalise, sha256,
};
use serde_json::json;

use crate::cli::{CliError, CommandOutput, console, to_json};
use crate::output::{check_folder, write_file};

/// Generated paintings that activations are measured on.
const PAINTINGS: u64 = 48;
/// Their side in pixels.
const SIDE: u32 = 160;
/// Synthetic photos beside them.
const PHOTOS: BuiltinOptions = BuiltinOptions {
    photos: 12,
    width: 192,
    height: 144,
    field_of_view: 1.05,
};
/// Least hexadecimal digits in a name that are taken for the beginning of a checksum.
const LEAST_DIGITS: usize = 8;

/// Runs the command.
pub fn run(file: &Path, folder: &Path) -> Result<CommandOutput, CliError> {
    check_folder(folder)?;
    install(file, &file.display().to_string(), folder)
}

/// Installs the checkpoint in `file`, which messages call `name`.
pub fn install(file: &Path, name: &str, folder: &Path) -> Result<CommandOutput, CliError> {
    // A pipe would wait for ever.
    check_regular(file).map_err(CliError::read(file))?;
    let open = || File::open(file).map_err(CliError::read(file));
    check_named_digest(name, || sha256(open()?).map_err(CliError::read(file)))?;
    let mut checkpoint = WeightsFile::read(name, open()?)?;
    let (form, tensors) = (checkpoint.format(), checkpoint.len());
    // A copy from another machine's folder is installed as it is.
    let copied = (form == FileFormat::Safetensors).then(|| inspect_vgg19(file).ok());
    let (bytes, facts, pictures) = match copied.flatten() {
        Some(facts) => {
            console::note(format_args!("{name}: an installed VGG-19"));
            let bytes = fs::read(file).map_err(CliError::read(file))?;
            (bytes, facts, 0)
        }
        None => {
            let scheme = Scheme::of(&checkpoint)?;
            let kind = match scheme {
                Scheme::Torchvision => "torchvision's VGG-19",
                Scheme::Normalised => "a VGG-19 normalised for style transfer",
            };
            console::note(format_args!("{name}: {form}, {tensors} tensors, {kind}"));
            let pictures = pictures_for(scheme);
            let (bytes, facts) = normalise(&mut checkpoint, &pictures)?;
            (bytes, facts, pictures.len())
        }
    };
    let path = folder.join(VGG19_FILE);
    write_file(&path, &bytes)?;
    Ok(CommandOutput {
        text: format!("VGG-19 is installed: {}", path.display()),
        json: json!({
            "network": "vgg19",
            "from": name,
            "form": form.to_string(),
            "tensors": tensors,
            "made_from": to_json(&facts.made_from),
            "pictures": pictures,
            "path": path.display().to_string(),
            "bytes": bytes.len(),
            "sha256": facts.sha256,
        }),
    })
}

/// What a checkpoint's activations have to be measured on: paintings and photos that need no
/// download and are the same on every machine.
fn pictures_for(scheme: Scheme) -> Vec<RgbImage> {
    if scheme == Scheme::Normalised {
        return Vec::new();
    }
    console::note(format_args!(
        "measuring activations on {PAINTINGS} generated paintings and {} photos of the built-in \
         synthetic scene",
        PHOTOS.photos
    ));
    let paintings = (0..PAINTINGS).map(|seed| paint(&Recipe::random(seed), SIDE, SIDE));
    let photos = cameras(&PHOTOS)
        .into_iter()
        .map(|camera| render(&camera).pixels);
    paintings.chain(photos).collect()
}

/// The beginning of a file's SHA-256 in its name, as PyTorch names files: `vgg19-dcbb9e9d.pth`.
fn digest_in(name: &str) -> Option<&str> {
    let stem = Path::new(name).file_stem()?.to_str()?;
    let (_, digits) = stem.rsplit_once('-')?;
    let hexadecimal = |b: u8| matches!(b, b'0'..=b'9' | b'a'..=b'f');
    (digits.len() >= LEAST_DIGITS && digits.bytes().all(hexadecimal)).then_some(digits)
}

fn check_named_digest(
    name: &str,
    digest: impl FnOnce() -> Result<String, CliError>,
) -> Result<(), CliError> {
    let Some(expected) = digest_in(name) else {
        return Ok(());
    };
    let found = digest()?;
    if found.starts_with(expected) {
        return Ok(());
    }
    Err(CliError::Refused(format!(
        "{name}: the file is damaged, its SHA-256 begins with {}, its name says {expected}; copy or \
         download it again",
        &found[..expected.len().min(found.len())]
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_may_hold_a_digest() {
        assert_eq!(digest_in("models/vgg19-dcbb9e9d.pth"), Some("dcbb9e9d"));
        for name in [
            "vgg19.pth",
            "vgg-19.pth",
            "vgg_normalised-original.pth",
            "-",
            "",
        ] {
            assert_eq!(digest_in(name), None, "{name}");
        }
    }

    #[test]
    fn a_named_digest_must_be_the_files() {
        let check = |name: &str| check_named_digest(name, || Ok("dcbb9e9d00".into()));
        assert!(check("vgg19-dcbb9e9d.pth").is_ok() && check("vgg19.pth").is_ok());
        let problem = check("vgg19-00bb9e9d.pth").unwrap_err().to_string();
        assert!(
            problem.contains("begins with dcbb9e9d, its name says 00bb9e9d"),
            "{problem}"
        );
    }
}
