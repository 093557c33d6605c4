//! Rays in, packed samples out: where density grids expect light ([`occupancy`]), or by the paper's
//! cascade ([`hierarchical`]).

mod expected;
pub mod hierarchical;
pub mod occupancy;
mod pack;
mod samples;

pub use samples::{Samples, VolumeSamples};

use crate::config::SamplingConfig;
use crate::field::Field;
use crate::grids::OccupancyGrids;
use crate::rays::RayBatch;
use occupancy::OccupancySampler;

impl Field {
    /// Samples of rays: where density grids expect light, or the first ones of a cascade, which
    /// needs no grids. With a `seed` at random places and of everything, for learning; without at
    /// fixed ones and, by density grids, only where light is expected.
    ///
    /// # Panics
    /// If sampling goes by density grids and there are none.
    pub fn sample(
        &self,
        rays: &RayBatch,
        grids: Option<&OccupancyGrids>,
        seed: Option<u64>,
    ) -> Samples {
        match (&self.config.sampling, grids) {
            (SamplingConfig::Hierarchical(config), _) => hierarchical::first(rays, config, seed),
            (SamplingConfig::Occupancy(spec), Some(grids)) => {
                let sampler = OccupancySampler::new(spec, grids, seed);
                sampler.with_raw(self.config.wants_raw()).all(rays)
            }
            (SamplingConfig::Occupancy(_), None) => panic!("density grids to sample by"),
        }
    }
}
