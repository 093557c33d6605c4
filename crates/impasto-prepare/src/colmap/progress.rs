//! What COLMAP's lines say of its progress.

/// One line that matters. Older versions print it as it is, newer ones behind a time stamp.
#[derive(Debug, PartialEq)]
pub(super) enum ProgressLine {
    /// One more photo has been looked at.
    Photo,
    /// It has so many features.
    Features(usize),
    /// So many parts of the comparisons, of so many.
    Matched(usize, usize),
    /// Cameras placed in the present model.
    Registered(usize),
}

/// What a line says, if it matters.
pub(super) fn parse(line: &str) -> Option<ProgressLine> {
    if line.contains("Processed file [") {
        return Some(ProgressLine::Photo);
    }
    if let Some((_, count)) = line.split_once("Features:") {
        return Some(ProgressLine::Features(first_number(count)?));
    }
    if let Some((_, rest)) = line.split_once("block [") {
        let numbers = numbers(rest.split(']').next()?);
        return match numbers[..] {
            // Row i of n, column j of m.
            [i, n, j, m] if i > 0 => Some(ProgressLine::Matched((i - 1) * m + j, n * m)),
            _ => None,
        };
    }
    let (_, image) = ["Matching image [", "Processing image ["]
        .into_iter()
        .find_map(|words| line.split_once(words))
        .or_else(|| {
            let (_, rest) = line.split_once("Registering image #")?;
            // The number in parentheses: "(3)", or "(num_reg_frames=3)".
            Some(("", rest.rsplit_once('(')?.1))
        })?;
    match numbers(image.split([']', ')']).next()?)[..] {
        [done, total] => Some(ProgressLine::Matched(done, total)),
        [count] => Some(ProgressLine::Registered(count)),
        _ => None,
    }
}

/// Whether the mapper's last words mean that it placed nothing, and not that it broke.
pub(super) fn nothing_placed(said: &str) -> bool {
    let said = said.to_lowercase();
    [
        "failed to create",
        "no good initial",
        "elapsed time",
        "no images with matches",
    ]
    .iter()
    .any(|words| said.contains(words))
}

fn first_number(text: &str) -> Option<usize> {
    numbers(text).first().copied()
}

fn numbers(text: &str) -> Vec<usize> {
    text.split(|c: char| !c.is_ascii_digit())
        .filter_map(|digits| digits.parse().ok())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_old_and_new_versions_are_read() {
        let lines = [
            ("Processed file [3/30]", ProgressLine::Photo),
            (
                "I1128 13:40 feature_extraction.cc:258] Processed file [3/30]",
                ProgressLine::Photo,
            ),
            ("Features:        5224", ProgressLine::Features(5224)),
            (
                "Matching block [2/3, 1/3] in 1.2s",
                ProgressLine::Matched(4, 9),
            ),
            (
                "I1128 pairing.cc:168] Processing block [1/1, 1/1]",
                ProgressLine::Matched(1, 1),
            ),
            (
                "Matching image [7/30] in 0.1s",
                ProgressLine::Matched(7, 30),
            ),
            (
                "I1128 pairing.cc:351] Processing image [7/30]",
                ProgressLine::Matched(7, 30),
            ),
            ("Registering image #5 (3)", ProgressLine::Registered(3)),
            (
                "I1128 Registering image #5 (num_reg_frames=3)",
                ProgressLine::Registered(3),
            ),
        ];
        for (line, expected) in lines {
            assert_eq!(parse(line), Some(expected), "{line}");
        }
        for line in [
            "",
            "Dimensions:      1024 x 683",
            "Retriangulation",
            "block [1/1]",
        ] {
            assert_eq!(parse(line), None, "{line}");
        }
    }
}
