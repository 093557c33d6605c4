//! Names and numbers as a reader sees them.

use crate::consistency::Consistency;
use crate::evaluate::{OURS, PHOTO, REFINED};
use crate::methods::TEMPORAL;
use crate::reconstruct::RECONSTRUCTED;

/// Names as their papers write them.
const WRITTEN: [(&str, &str); 9] = [
    (PHOTO, "Photo"),
    (OURS, "Impasto"),
    (REFINED, "Impasto"),
    ("adain", "AdaIN"),
    ("lst", "LST"),
    ("mccnet", "MCCNet"),
    ("rerevst", "ReReVST"),
    ("tpfr", "TPFR"),
    ("wct", "WCT"),
];

/// A method's name as its paper writes it, and what it does; both to be escaped.
pub(super) fn title(method: &str) -> (String, &'static str) {
    let (base, how) = if let Some(base) = method.strip_suffix(TEMPORAL) {
        (base, "as a video")
    } else if let Some(base) = method.strip_suffix(RECONSTRUCTED) {
        (base, "photos stylised, then reconstructed")
    } else {
        let how = match method {
            PHOTO => "unstylised, the floor",
            OURS => "this model",
            REFINED => "this model, each look refined",
            _ => "frame by frame",
        };
        (method, how)
    };
    let written = WRITTEN.iter().find(|(name, _)| *name == base);
    let written = written.map_or(base, |(_, written)| written);
    (written.to_owned(), how)
}

/// The same in one piece.
pub(super) fn full_title(method: &str) -> String {
    let (name, how) = title(method);
    format!("{name}, {how}")
}

/// A number with so many digits after the point; a dash where there is none.
pub(super) fn number(value: f64, digits: usize) -> String {
    match value.is_finite() {
        true => format!("{value:.digits$}").replace('-', "−"),
        false => "–".to_owned(),
    }
}

/// A share as per cent.
pub(super) fn share(value: f64) -> String {
    match value.is_finite() {
        true => format!("{:.0} %", 100.0 * value),
        false => "–".to_owned(),
    }
}

/// E × 100.
pub(super) fn e100(found: &Consistency) -> String {
    number(found.e100, 3)
}
