//! Which samples of a ray are left out: one rule for every device.

/// Weight that a sample must be expected to have where only an image is wanted: less of a ray's
/// light is not worth evaluating.
pub const LEAST_WEIGHT: f32 = 1e-4;
/// Less than any weight: every sample counts, as whatever learns from them needs.
pub const ANY_WEIGHT: f32 = -1.0;
/// Transmittance under which what a density grid holds farther behind no longer matters.
pub const LEAST_TRANSMITTANCE: f32 = 1e-4;
