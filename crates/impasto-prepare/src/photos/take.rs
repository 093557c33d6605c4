//! Takes the usable photos over, and says which are not.

use std::path::Path;

use super::{LEAST, LeftOut, PhotoSource, Taken, check, place};
use crate::error::PrepareError;
use crate::event::{Phase, Sink, progress, warning};

/// How many names a sentence has.
const NAMED: usize = 5;

/// Checks the photos and takes those that are usable to the folder `images`. Files that are not,
/// and copies of other photos, are added to `left_out`.
pub(crate) fn take(
    input: &Path,
    sources: &[PhotoSource],
    images: &Path,
    left_out: &mut Vec<LeftOut>,
    events: Sink<'_>,
) -> Result<Vec<Taken>, PrepareError> {
    let checked = check::all(sources, left_out, &mut |done| {
        progress(events, Phase::Photos, done, sources.len());
    })?;
    left_out.sort_by(|a, b| a.file.cmp(&b.file));
    if !left_out.is_empty() {
        warning(events, describe(left_out));
    }
    if checked.len() < LEAST {
        return Err(too_few(input, checked.len(), sources.len(), left_out));
    }
    place::all(&checked, images, &mut |done| {
        progress(events, Phase::Taking, done, checked.len());
    })
}

/// Not enough photos, and why.
pub(crate) fn too_few(
    path: &Path,
    usable: usize,
    given: usize,
    left_out: &[LeftOut],
) -> PrepareError {
    PrepareError::TooFewPhotos {
        path: path.to_owned(),
        usable,
        given: given.max(left_out.len()),
        reasons: if left_out.is_empty() {
            String::new()
        } else {
            format!(" ({})", describe(left_out))
        },
    }
}

fn describe(left_out: &[LeftOut]) -> String {
    let parts: Vec<String> = left_out
        .iter()
        .map(|file| format!("{}: {}", file.file, file.reason))
        .collect();
    format!("{} file(s) left out: {}", left_out.len(), few(&parts, "; "))
}

/// The first few of many words, and how many there are.
pub(crate) fn few(words: &[impl AsRef<str>], between: &str) -> String {
    let shown: Vec<&str> = words.iter().take(NAMED).map(AsRef::as_ref).collect();
    let more = words.len() - shown.len();
    let rest = if more > 0 {
        format!("{between}and {more} more")
    } else {
        String::new()
    };
    shown.join(between) + &rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lists_are_cut_and_counted() {
        assert_eq!(few(&["a", "b"], ", "), "a, b");
        let many = ["a", "b", "c", "d", "e", "f", "g"];
        assert_eq!(few(&many, ", "), "a, b, c, d, e, and 2 more");
    }
}
