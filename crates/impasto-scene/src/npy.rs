//! NumPy's array files.

/// A `height × width` array of `values` (row by row) as a NumPy 1.0 file: magic, header padded to
/// 64 bytes, little-endian float32.
pub fn encode(values: &[f32], width: u32, height: u32) -> Vec<u8> {
    let mut header =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}");
    const PREFIX: usize = 10;
    while !(PREFIX + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    // The shape's two numbers keep the header far below the 64 KiB that its length field allows.
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

/// Shape and numbers, row by row, of a NumPy file of little-endian float32 or float64.
///
/// # Errors
/// What is wrong with the file, as a sentence: no NumPy file, another type or order, cut off.
pub fn decode(bytes: &[u8]) -> Result<(Vec<usize>, Vec<f64>), String> {
    let cut = || "the file is cut off".to_owned();
    let rest = bytes
        .strip_prefix(b"\x93NUMPY")
        .ok_or("this is no NumPy file; save it with numpy.save")?;
    let (start, length): (usize, usize) = match rest {
        [1, _, a, b, ..] => (4, usize::from(u16::from_le_bytes([*a, *b]))),
        [2 | 3, _, a, b, c, d, ..] => (6, u32::from_le_bytes([*a, *b, *c, *d]) as usize),
        [] | [1..=3, ..] => return Err(cut()),
        [version, ..] => return Err(format!("NumPy files of version {version} are unknown")),
    };
    let header = rest
        .get(start..start.saturating_add(length))
        .ok_or_else(cut)?;
    let header = std::str::from_utf8(header).map_err(|_| "its header is not text")?;
    let value = |key: &str| {
        let (_, after) = header.split_once(key)?;
        Some(after.trim_start_matches(['\'', '"', ':', ' ']))
    };
    if !value("fortran_order").is_some_and(|v| v.starts_with("False")) {
        return Err("its numbers are not stored row by row".into());
    }
    let shape = value("shape")
        .and_then(|v| v.strip_prefix('(')?.split_once(')'))
        .and_then(|(inside, _)| {
            let sides = inside.split(',').map(str::trim).filter(|s| !s.is_empty());
            sides
                .map(|s| s.parse().ok())
                .collect::<Option<Vec<usize>>>()
        })
        .ok_or("its header states no shape")?;
    let count = shape
        .iter()
        .try_fold(1usize, |n, side| n.checked_mul(*side));
    let data = &rest[start + length..];
    let numbers: Vec<f64> = match value("descr") {
        Some(v) if v.starts_with("<f8") => {
            let (numbers, _) = data.as_chunks::<8>();
            numbers.iter().map(|b| f64::from_le_bytes(*b)).collect()
        }
        Some(v) if v.starts_with("<f4") => {
            let (numbers, _) = data.as_chunks::<4>();
            numbers
                .iter()
                .map(|b| f32::from_le_bytes(*b).into())
                .collect()
        }
        _ => return Err("its numbers are neither float32 nor float64".into()),
    };
    if count != Some(numbers.len()) {
        return Err(cut());
    }
    Ok((shape, numbers))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_encoded_is_decoded() {
        let values = [1.5, -2.0, 3.25, 0.0, 7.0, 1e9];
        let bytes = encode(&values, 3, 2);
        let (shape, numbers) = decode(&bytes).unwrap();
        assert_eq!(shape, [2, 3]);
        assert_eq!(numbers, values.map(f64::from));
    }

    #[test]
    fn poisoned_files_are_refused_at_every_length() {
        let bytes = encode(&[1.0; 6], 3, 2);
        for length in 0..bytes.len() {
            decode(&bytes[..length]).unwrap_err();
        }
        let with = |from: &str, to: &str| {
            let at = bytes.windows(from.len()).position(|w| w == from.as_bytes());
            let mut other = bytes.clone();
            other[at.unwrap()..][..to.len()].copy_from_slice(to.as_bytes());
            decode(&other).unwrap_err()
        };
        assert!(with("<f4", ">f4").contains("float32"));
        assert!(with("False", "True ").contains("row by row"));
        assert!(with("(2, 3)", "(9, 9)").contains("cut off"));
        assert!(with("(2, 3)", "(a, 3)").contains("no shape"));
    }
}
