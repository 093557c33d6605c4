//! Files of weights: those that are shipped, those that users bring, and where the latter lie.

mod file;
mod installed;
mod normalise;
pub(crate) mod number;
mod pickle;
mod source;
mod torch;
mod vgg19;
mod zip;

pub use file::{FileFormat, WeightsFile};
pub use installed::{Vgg19Facts, inspect_vgg19};
pub use normalise::normalise;
pub use vgg19::Scheme;

use crate::{StyleError, perceptual, vae};
use sha2::{Digest, Sha256};
use std::ffi::OsString;
use std::io::{self, Read};
use std::path::PathBuf;

/// Name of the installed VGG-19 within [`folder`].
pub const VGG19_FILE: &str = "vgg19.safetensors";

/// Where the user's weights lie: `$IMPASTO_WEIGHTS`, else `impasto/weights` below
/// `$XDG_DATA_HOME`, else below `.local/share` in the home folder.
///
/// # Errors
/// If there is not even a home folder.
pub fn folder() -> Result<PathBuf, StyleError> {
    folder_from(|name| std::env::var_os(name), std::env::home_dir())
}

fn folder_from(
    variable: impl Fn(&str) -> Option<OsString>,
    home: Option<PathBuf>,
) -> Result<PathBuf, StyleError> {
    let set = |name| {
        variable(name)
            .filter(|value| !value.is_empty())
            .map(PathBuf::from)
    };
    if let Some(folder) = set("IMPASTO_WEIGHTS") {
        return Ok(folder);
    }
    // A relative one counts as unset, says the XDG base directory specification.
    set("XDG_DATA_HOME")
        .filter(|folder| folder.is_absolute())
        .or_else(|| home.map(|home| home.join(".local/share")))
        .map(|data| data.join("impasto/weights"))
        .ok_or(StyleError::NoFolder)
}

/// A file of weights that is part of the program.
#[derive(Debug, Clone, Copy)]
pub struct Shipped {
    /// Its name in the sources' `assets` folder.
    pub file: &'static str,
    /// What it is.
    pub what: &'static str,
    /// Who made it.
    pub source: &'static str,
    /// Its licence.
    pub licence: &'static str,
    /// Its contents.
    pub bytes: &'static [u8],
    /// Their SHA-256 as published, hexadecimal.
    pub sha256: &'static str,
}

impl Shipped {
    /// Whether the contents are what was published.
    pub fn is_whole(&self) -> bool {
        hexadecimal(&Sha256::digest(self.bytes)) == self.sha256
    }
}

/// Who made VGG's filters.
pub const VGG_SOURCE: &str = "Visual Geometry Group, University of Oxford";
/// Their licence.
pub const VGG_LICENCE: &str = "CC BY 4.0";
const OWN_SOURCE: &str = "this project";
const OWN_LICENCE: &str = "MIT OR Apache-2.0";

/// All weights that are part of the program. A static: every use of a constant could bring a copy of them.
pub static SHIPPED: [Shipped; 3] = [
    Shipped {
        file: perceptual::VGG16_FILE,
        what: "VGG-16, conv1_1 to conv4_1",
        source: VGG_SOURCE,
        licence: VGG_LICENCE,
        bytes: &perceptual::VGG16,
        sha256: "40f68049d829834ecffdf3f7ea332fdc40782dabcd6f4640c4a47032a4dcbe5f",
    },
    Shipped {
        file: perceptual::MEANS_FILE,
        what: "mean activations of VGG-16",
        source: OWN_SOURCE,
        licence: OWN_LICENCE,
        bytes: &perceptual::MEANS,
        sha256: "099486498ee190bf909a4c5d903449e3c205eff2b85541bace47244b558f2786",
    },
    Shipped {
        file: "style_vae_f16.safetensors",
        what: "style-VAE",
        source: OWN_SOURCE,
        licence: OWN_LICENCE,
        bytes: &vae::SHIPPED,
        sha256: "99ed2daca0a35c4854b02aef81a6cde2a2f983f78078650e35068ea05927ac12",
    },
];

/// SHA-256 of all that `reader` gives, hexadecimal.
///
/// # Errors
/// If it cannot be read.
pub fn sha256(mut reader: impl Read) -> io::Result<String> {
    let mut hash = Sha256::new();
    let mut block = vec![0; 1 << 18];
    loop {
        match reader.read(&mut block) {
            Ok(0) => return Ok(hexadecimal(&hash.finalize())),
            Ok(length) => hash.update(&block[..length]),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_is_the_users_choice_then_the_systems() {
        let from = |set: &[(&str, &str)], home: Option<&str>| {
            let find = |name: &str| set.iter().find(|(n, _)| *n == name).map(|(_, v)| v.into());
            folder_from(find, home.map(PathBuf::from))
                .map(|f| f.display().to_string())
                .ok()
        };
        let all = [("IMPASTO_WEIGHTS", "w"), ("XDG_DATA_HOME", "/data")];
        assert_eq!(from(&all, Some("/home/me")).as_deref(), Some("w"));
        assert_eq!(
            from(&all[1..], None).as_deref(),
            Some("/data/impasto/weights")
        );
        let home = Some("/home/me/.local/share/impasto/weights");
        assert_eq!(from(&[], Some("/home/me")).as_deref(), home);
        let useless = [("IMPASTO_WEIGHTS", ""), ("XDG_DATA_HOME", "here")];
        assert_eq!(from(&useless, Some("/home/me")).as_deref(), home);
        assert_eq!(from(&useless, None), None);
    }

    #[test]
    fn what_is_shipped_is_whole() {
        for shipped in &SHIPPED {
            assert!(shipped.is_whole(), "{}", shipped.file);
        }
        let bytes = SHIPPED[2].bytes;
        assert!(
            !Shipped {
                bytes: &bytes[1..],
                ..SHIPPED[2]
            }
            .is_whole()
        );
    }

    #[test]
    fn sha256_is_the_standards() {
        // FIPS 180-4, example of one block.
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(sha256(&b"abc"[..]).unwrap(), abc);
    }
}
