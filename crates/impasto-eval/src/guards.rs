//! What a consistency is worth nothing without: blur agrees with itself, and so does a frame that
//! nobody painted.

use crate::names::PHOTO;
use crate::results::MethodResult;

/// Sharpness under which a method's frames are called blurred: they have lost half the gradient
/// energy of the unstylised ones.
pub const LEAST_SHARPNESS: f64 = 0.5;
/// Style gain under which a method is called hardly stylised.
pub const LEAST_STYLE_GAIN: f64 = 0.05;

/// What a method fails in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FailedGuard {
    /// Its frames have too little detail; the sharpness.
    Blurred(f64),
    /// Its frames are hardly nearer to the paintings than the unstylised ones; the style gain.
    HardlyStylised(f64),
}

impl FailedGuard {
    /// The guards that the method `name` fails. The unstylised render is the floor and cannot fail.
    pub fn of(name: &str, result: &MethodResult) -> Vec<Self> {
        if name == PHOTO {
            return Vec::new();
        }
        let gain = result.fidelity.style_gain;
        let under = |value: f64, least: f64| value.is_nan() || value < least;
        let blurred = result.sharpness.filter(|s| under(*s, LEAST_SHARPNESS));
        let unstyled = Some(gain).filter(|g| under(*g, LEAST_STYLE_GAIN));
        let failed = [
            blurred.map(Self::Blurred),
            unstyled.map(Self::HardlyStylised),
        ];
        failed.into_iter().flatten().collect()
    }
}

impl std::fmt::Display for FailedGuard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (what, value, least) = match self {
            Self::Blurred(value) => ("blurred (sharpness", value, LEAST_SHARPNESS),
            Self::HardlyStylised(value) => ("hardly stylised (style gain", value, LEAST_STYLE_GAIN),
        };
        write!(f, "{what} {value:.2} < {least})")
    }
}
