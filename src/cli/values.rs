//! Values of arguments that are more than a word or a number.

use std::path::Path;
use std::time::Duration;

use impasto::{ColorPreservation, MaskShape, MaskSpec, STROKE_SIZES};

/// Longest side that can be asked for, in pixels.
const LONGEST_SIDE: u32 = 16_384;

/// Reads `90s`, `10m`, `1.5h` or `1h30m`: at least a second.
pub fn duration(text: &str) -> Result<Duration, String> {
    let seconds = seconds(text)?;
    // The upper end keeps the conversion from overflowing: more than a century.
    if !(1.0..4e9).contains(&seconds) {
        return Err(format!(
            "\"{text}\" is not a usable duration; give at least 1s"
        ));
    }
    Ok(Duration::from_secs_f64(seconds))
}

/// Reads what [`duration`] does, and shorter ones down to `0s`.
pub fn interval(text: &str) -> Result<Duration, String> {
    let seconds = seconds(text)?;
    if seconds >= 4e9 {
        return Err(format!("\"{text}\" is too long"));
    }
    Ok(Duration::from_secs_f64(seconds))
}

fn seconds(text: &str) -> Result<f64, String> {
    if text.is_empty() {
        return Err("give a duration like 90s, 10m or 1h30m".into());
    }
    let wrong = || format!("\"{text}\" is not a duration; write it like 90s, 10m or 1h30m");
    let mut seconds = 0.0;
    let mut rest = text;
    while !rest.is_empty() {
        let digits = rest
            .find(|c: char| !c.is_ascii_digit() && c != '.')
            .ok_or_else(wrong)?;
        let number: f64 = rest[..digits].parse().map_err(|_| wrong())?;
        let unit = match rest.as_bytes()[digits] {
            b'h' => 3600.0,
            b'm' => 60.0,
            b's' => 1.0,
            _ => return Err(wrong()),
        };
        seconds += number * unit;
        rest = &rest[digits + 1..];
    }
    Ok(seconds)
}

/// Seconds as `m:ss` or `h:mm:ss`; `–` when unknown.
pub fn clock(seconds: f64) -> String {
    if !seconds.is_finite() || seconds < 0.0 {
        return "–".into();
    }
    let whole = seconds.round() as u64;
    let (h, m, s) = (whole / 3600, whole / 60 % 60, whole % 60);
    if h > 0 {
        format!("{h}:{m:02}:{s:02}")
    } else {
        format!("{m}:{s:02}")
    }
}

/// Reads `640x360`.
pub fn size(text: &str) -> Result<(u32, u32), String> {
    let side = |text: &str| {
        text.parse()
            .ok()
            .filter(|side| (1..=LONGEST_SIDE).contains(side))
    };
    text.split_once(['x', 'X', '×'])
        .and_then(|(width, height)| Some((side(width)?, side(height)?)))
        .ok_or_else(|| {
            format!("\"{text}\" is not a size; write WIDTHxHEIGHT in pixels, each from 1 to {LONGEST_SIDE}")
        })
}

/// Reads frames a second, above 0.
pub fn fps(text: &str) -> Result<f64, String> {
    let number = text
        .parse()
        .ok()
        .filter(|n| (0.0..1e4).contains(n) && *n > 0.0);
    number.ok_or_else(|| {
        format!("\"{text}\" is no number of frames a second; write one like 24 or 12.5")
    })
}

/// Reads a number from 0 to 1.
pub fn share(text: &str) -> Result<f32, String> {
    let number = text.parse().ok().filter(|n| (0.0..=1.0).contains(n));
    number.ok_or_else(|| format!("\"{text}\" is not a number from 0 to 1"))
}

/// Reads how large strokes are.
pub fn stroke_size(text: &str) -> Result<f32, String> {
    let number = text.parse().ok().filter(|n| STROKE_SIZES.contains(n));
    number.ok_or_else(|| format!("\"{text}\" is not a number from 0.5 to 2"))
}

/// Reads whose colours a coat keeps.
pub fn keep(text: &str) -> Result<ColorPreservation, String> {
    match text {
        "none" => Ok(ColorPreservation::None),
        "luminance" => Ok(ColorPreservation::Luminance),
        "palette" => Ok(ColorPreservation::Palette),
        _ => Err(format!("\"{text}\" is neither luminance nor palette")),
    }
}

/// How near in colour a surface's neighbours have to be, if nothing is said.
const TOLERANCE: f32 = 0.15;

/// Reads a mask: `near`, `far`, `depth:0.2..0.8`, `box:0,0,0,1,1,1`, `sphere:0,0,0,0.5`,
/// `surface:0,0,0`, `surface:0,0,0,0.2`, and `not:` before one of them.
pub fn mask(text: &str) -> Result<MaskSpec, String> {
    let shape = text.strip_prefix("not:");
    let mask = MaskSpec {
        inverted: shape.is_some(),
        shape: mask_shape(shape.unwrap_or(text)).ok_or_else(|| {
            format!(
                "\"{text}\" is not a mask; write near, far, depth:FROM..TO, box:X,Y,Z,X,Y,Z, \
                 sphere:X,Y,Z,RADIUS or surface:X,Y,Z[,TOLERANCE], or not: before one of them"
            )
        })?,
    };
    mask.check()?;
    Ok(mask)
}

fn mask_shape(text: &str) -> Option<MaskShape> {
    let (name, values) = text.split_once(':').unwrap_or((text, ""));
    let number = |text: &str| text.trim().parse::<f32>().ok();
    let numbers: Option<Vec<f32>> = values.split(',').map(number).collect();
    Some(match (name, numbers.as_deref()) {
        ("near", _) if values.is_empty() => MaskShape::Near,
        ("far", _) if values.is_empty() => MaskShape::Far,
        ("depth", _) => {
            let (from, to) = values.split_once("..")?;
            MaskShape::Depth {
                from: number(from)?,
                to: match to.trim() {
                    "" => None,
                    to => Some(number(to)?),
                },
            }
        }
        ("box", Some(&[a, b, c, d, e, f])) => MaskShape::Box {
            min: [a.min(d), b.min(e), c.min(f)],
            max: [a.max(d), b.max(e), c.max(f)],
        },
        ("sphere", Some(&[x, y, z, radius])) => MaskShape::Sphere {
            centre: [x, y, z],
            radius,
        },
        ("surface", Some(&[x, y, z, ref tolerance @ ..])) if tolerance.len() < 2 => {
            MaskShape::Surface {
                point: [x, y, z],
                tolerance: tolerance.first().copied().unwrap_or(TOLERANCE),
            }
        }
        _ => return None,
    })
}

/// Whether `path` is or would be a file with this ending, in small or capital letters.
pub fn has_ending(path: &Path, ending: &str) -> bool {
    let found = path.extension();
    !path.is_dir() && found.is_some_and(|found| found.eq_ignore_ascii_case(ending))
}

/// The line of a text that an error is about, from 1, where that is known.
pub fn line_of(error: &toml::de::Error, text: &str) -> Option<usize> {
    let before = text.get(..error.span()?.start).unwrap_or_default();
    Some(1 + before.matches('\n').count())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_are_shapes_or_all_but_a_shape() {
        let shape = |text: &str| mask(text).map(|mask| (mask.shape, mask.inverted));
        assert_eq!(shape("not:near"), Ok((MaskShape::Near, true)));
        assert_eq!(
            shape("depth:0.5.."),
            Ok((
                MaskShape::Depth {
                    from: 0.5,
                    to: None
                },
                false
            ))
        );
        let sphere = MaskShape::Sphere {
            centre: [-1.0, 0.0, 0.5],
            radius: 0.25,
        };
        assert_eq!(shape("sphere:-1, 0, .5, .25"), Ok((sphere, false)));
        let corners = MaskShape::Box {
            min: [0.0; 3],
            max: [1.0, 2.0, 3.0],
        };
        assert_eq!(shape("box:1,0,3,0,2,0"), Ok((corners, false)));
        let surface = MaskShape::Surface {
            point: [0.0; 3],
            tolerance: TOLERANCE,
        };
        assert_eq!(shape("surface:0,0,0"), Ok((surface, false)));
        for wrong in [
            "",
            "sky",
            "near:1",
            "depth:2..1",
            "depth:1",
            "sphere:0,0,0",
            "sphere:0,0,0,0",
            "box:1",
            "not:not:far",
            "surface:0,0,nan",
        ] {
            assert!(mask(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn durations_have_units() {
        let seconds = |text| duration(text).map(|d| d.as_secs_f64());
        assert_eq!(seconds("90s"), Ok(90.0));
        assert_eq!(seconds("10m"), Ok(600.0));
        assert_eq!(seconds("1h30m"), Ok(5400.0));
        assert_eq!(seconds("1.5m"), Ok(90.0));
        for wrong in [
            "",
            "10",
            "m",
            "10 m",
            "-5s",
            "5d",
            "0s",
            "1.2.3s",
            "1e9h",
            "99999999999h",
        ] {
            assert!(duration(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn intervals_may_be_nothing() {
        let seconds = |text| interval(text).map(|d| d.as_secs_f64());
        assert_eq!(seconds("0s"), Ok(0.0));
        assert_eq!(seconds("0.25s"), Ok(0.25));
        assert_eq!(seconds("2m"), Ok(120.0));
        for wrong in ["", "2", "-1s", "1e9h", "99999999999h"] {
            assert!(interval(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn clocks_read_like_clocks() {
        assert_eq!(clock(59.6), "1:00");
        assert_eq!(clock(3725.0), "1:02:05");
        assert_eq!(clock(f64::INFINITY), "–");
    }

    #[test]
    fn sizes_are_positive_and_bounded() {
        assert_eq!(size("640x360"), Ok((640, 360)));
        for wrong in ["640", "0x3", "3x-1", "axb", "99999x2"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn films_have_frames() {
        assert_eq!((fps("24"), fps("12.5")), (Ok(24.0), Ok(12.5)));
        for wrong in ["0", "-3", "NaN", "inf", "fast", ""] {
            assert!(fps(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn shares_end_at_one() {
        assert_eq!(share("0.5"), Ok(0.5));
        assert!(share("1.1").is_err() && share("NaN").is_err());
    }
}
