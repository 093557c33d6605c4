//! Names and numbers as a report writes them.

use crate::consistency::Consistency;
use crate::names::{OURS, PHOTO, RECONSTRUCTED, REFINED, TEMPORAL};

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
pub(super) fn number(value: impl Into<Option<f64>>, digits: usize) -> String {
    match value.into() {
        Some(value) if value.is_finite() => format!("{value:.digits$}").replace('-', "−"),
        _ => "–".to_owned(),
    }
}

/// A share as per cent; a dash where there is none.
pub(super) fn share(value: f64) -> String {
    if value.is_finite() {
        format!("{:.0} %", 100.0 * value)
    } else {
        "–".to_owned()
    }
}

/// How many of all things are shown, the first ones.
pub(super) fn portion(shown: usize, all: usize, things: &str) -> String {
    if shown < all {
        format!("The first {shown} of {all} {things}")
    } else {
        format!("All {all} {things}")
    }
}

/// E × 100.
pub(super) fn e100(found: &Consistency) -> String {
    number(found.e100, 3)
}
