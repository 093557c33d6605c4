//! Rays.

use crate::sphere::dot;
use std::ops::Range;

/// Rays in scene units. Directions have camera-space z = 1, so that a ray parameter is the depth
/// along the camera's axis.
#[derive(Debug, Clone, Default)]
pub struct RayBatch {
    /// Camera centres, inside the unit sphere.
    pub origins: Vec<[f32; 3]>,
    /// Directions, not normalised.
    pub directions: Vec<[f32; 3]>,
    /// Width of the finest touch of a brush at distance 1 from each centre: what the octaves of paint
    /// follow. 0 where nothing is painted.
    pub touches: Vec<f32>,
}

impl RayBatch {
    /// Number of rays.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }

    /// Some of the rays.
    ///
    /// # Panics
    /// If there are not so many.
    #[must_use]
    pub fn part(&self, rays: Range<usize>) -> Self {
        Self {
            origins: self.origins[rays.clone()].to_vec(),
            directions: self.directions[rays.clone()].to_vec(),
            touches: self.touches[rays].to_vec(),
        }
    }

    /// Adds a ray that nothing will be painted along.
    pub fn push(&mut self, origin: [f32; 3], direction: [f32; 3]) {
        self.push_painted(origin, direction, 0.0);
    }

    /// Adds a ray with the width of the finest touch of a brush at distance 1.
    pub fn push_painted(&mut self, origin: [f32; 3], direction: [f32; 3], touch: f32) {
        self.origins.push(origin);
        self.directions.push(direction);
        self.touches.push(touch);
    }

    /// Adds all rays of another batch.
    pub fn extend(&mut self, other: Self) {
        self.origins.extend(other.origins);
        self.directions.extend(other.directions);
        self.touches.extend(other.touches);
    }

    /// Unit view directions, `rays × 3`.
    pub fn views(&self) -> Vec<f32> {
        let unit = |direction: &[f32; 3]| {
            let length = dot(*direction, *direction).sqrt();
            direction.map(|c| c / length)
        };
        self.directions.iter().flat_map(unit).collect()
    }
}

/// Distance along a ray squeezed into `[0, 1)`: `d / (1 + d)`, one scale for both volumes.
#[inline(always)]
pub fn contracted_distance(distance: f32) -> f32 {
    distance / (1.0 + distance)
}

/// A cheap, well-mixed random number in `[0, 1)` for a seed and a ray: where in their parts all the
/// samples of the ray lie; without a seed, in the middle.
#[inline(always)]
pub fn jitter(seed: Option<u64>, ray: usize) -> f32 {
    let Some(seed) = seed else { return 0.5 };
    let mut x = seed ^ (ray as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 40) as f32 / (1u64 << 24) as f32
}
