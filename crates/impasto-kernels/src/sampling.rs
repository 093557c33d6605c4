//! Where density grids send the samples of rays, on every device.

use crate::settings;
use serde::{Deserialize, Serialize};

/// Largest density grid: 256³ cells are 84 MB.
const LARGEST_GRID: usize = 256;

settings! {
    /// Sampling by density grids, one for each volume.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct OccupancySpec {
        /// Samples a ray, in both volumes together.
        pub samples: usize where |v| (2..=4096).contains(v) => "2 to 4096: both volumes need one",
        /// Weight of spreading them evenly, where sending them to the light that the density grids
        /// expect has weight 1.
        pub uniform_fraction: f32 where |v| settings::share(v) => "0 to 1",
        /// Distance between two queries of the inner density grid, scene units.
        pub inner_step: f32 where |v| (1e-4..=1.0).contains(v) => "0.0001 to 1",
        /// Queries of the outer density grid, equal steps of inverse radius.
        pub outer_steps: usize where |v| (1..=4096).contains(v) => "1 to 4096",
        /// Cells along an axis of the inner density grid.
        pub inner_grid: usize where |v| (1..=LARGEST_GRID).contains(v) => "1 to 256",
        /// Cells along an axis of the outer density grid.
        pub outer_grid: usize where |v| (1..=LARGEST_GRID).contains(v) => "1 to 256",
        /// Depth before which nothing is sampled, scene units.
        pub near: f32 where |v| settings::usable(*v) => "finite, not negative",
    }
}

/// Transmittance under which what a density grid holds farther behind no longer matters.
pub const LEAST_TRANSMITTANCE: f32 = 1e-4;
/// Weight that a sample must be expected to have where only an image is wanted.
const LEAST_WEIGHT: f32 = 1e-4;

/// Weight that a sample must be expected to have, or else it is left out: the one rule for every
/// device. Renders leave out an eighth of the samples of real scenes by it, for less than 0.03 dB; what
/// grids take for nothing, less than 0.01 a unit, is nothing then. Training (rays with a seed) keeps
/// all: what is never evaluated is never learned.
pub fn least_weight(seed: Option<u64>) -> f32 {
    match seed {
        None => LEAST_WEIGHT,
        Some(_) => -1.0,
    }
}
