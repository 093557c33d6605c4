//! Names that are safe wherever they go.

use sha2::{Digest, Sha256};

/// A name in which only letters, digits, `-`, `_` and `.` are left; `_` stands for the rest.
pub(crate) fn plain_name(name: &str) -> String {
    name.replace(
        |c: char| !c.is_ascii_alphanumeric() && !"-_.".contains(c),
        "_",
    )
}

/// The beginning of the bytes' SHA-256, 16 digits.
pub(crate) fn short_hash(bytes: &[u8]) -> String {
    let digest = Sha256::digest(bytes);
    digest.iter().take(8).map(|b| format!("{b:02x}")).collect()
}
