//! Values of arguments that are more than a word or a number.

use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

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

/// Reads a number from 0 to 1.
pub fn share(text: &str) -> Result<f32, String> {
    let number = text.parse().ok().filter(|n| (0.0..=1.0).contains(n));
    number.ok_or_else(|| format!("\"{text}\" is not a number from 0 to 1"))
}

/// A style image, `IMAGE` or `IMAGE:WEIGHT`.
#[derive(Debug, Clone, PartialEq)]
pub struct StyleArg {
    /// The image's file.
    pub path: PathBuf,
    /// Its share in a mix.
    pub weight: Option<f32>,
}

impl FromStr for StyleArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let split = text
            .rsplit_once(':')
            .and_then(|(path, weight)| Some((path, weight.parse().ok()?)));
        match split {
            // A file may really be called like that.
            Some(_) if Path::new(text).is_file() => {}
            Some((_, weight)) if !f32::is_finite(weight) || weight < 0.0 => {
                return Err(format!(
                    "the weight in \"{text}\" must be a number that is not negative"
                ));
            }
            Some((path, weight)) => {
                return Ok(Self {
                    path: path.into(),
                    weight: Some(weight),
                });
            }
            None => {}
        }
        Ok(Self {
            path: text.into(),
            weight: None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn shares_end_at_one() {
        assert_eq!(share("0.5"), Ok(0.5));
        assert!(share("1.1").is_err() && share("NaN").is_err());
    }

    #[test]
    fn a_style_may_carry_a_weight() {
        let style = |text: &str| text.parse::<StyleArg>().map(|s| (s.path, s.weight));
        assert_eq!(style("a.png:0.5"), Ok(("a.png".into(), Some(0.5))));
        assert_eq!(style("C:\\a.png"), Ok(("C:\\a.png".into(), None)));
        assert!(style("a.png:-1").is_err() && style("a.png:inf").is_err());
    }
}
