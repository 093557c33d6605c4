//! The three ways to do the same: `reference` by plain tensor operations, the slow obvious twin of
//! the others; `cpu` over slices, for fields of hash grids; `gpu` (feature `gpu`) for the same fields
//! without ever coming back from the device.
//!
//! Each does the same steps under the same names: rays are sampled, samples evaluated, and then
//! either shaded at once or accumulated into a [`GBuffer`], which can be shaded any number of times.

pub(crate) mod cpu;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
pub(crate) mod reference;

use crate::appearance::{Appearance, Ground};
use crate::config::AppearanceConfig;
use crate::rays::RayBatch;
use crate::volrend::gbuffer::GBuffer;
use burn::tensor::Tensor;

/// What a G-buffer is made for.
#[derive(Clone, Copy)]
pub(crate) struct BufferSpec<'a> {
    /// Of the appearances to come.
    pub(crate) config: &'a AppearanceConfig,
    /// Samples with less weight are left out, where samples are shaded; see
    /// [`crate::volrend::weights::visibility_mask`].
    pub(crate) least_weight: f32,
    /// What is painted on.
    pub(crate) ground: &'a Ground,
    /// The rays.
    pub(crate) rays: &'a RayBatch,
}

/// How rays become pixels. All without gradients.
pub(crate) trait Backend: Sync {
    /// Samples of rays.
    type Samples;
    /// Their features, densities and weights.
    type Evaluated;
    /// An appearance, made ready for shading samples.
    type Shader: Sync;

    /// Rays that go through together, where `most` have room, as far as that is reasonable.
    fn rays_together(&self, most: usize) -> usize;

    /// Whether chunks of rays are for one thread each.
    fn on_host(&self) -> bool;

    /// Where samples of rays lie: with a seed at random and wherever something could be learned,
    /// without where light is expected.
    fn sample(&self, rays: &RayBatch, seed: Option<u64>) -> Self::Samples;

    /// What the field says of samples: level by level, of which the last is rendered.
    fn evaluate(
        &self,
        rays: &RayBatch,
        samples: Self::Samples,
        seed: Option<u64>,
    ) -> Vec<Self::Evaluated>;

    /// Median depth of the rays, along the camera's axis, scene units, `[rays]`.
    fn depth(&self, evaluated: &Self::Evaluated) -> Tensor<1>;

    /// All that the appearances of a configuration need of the rays.
    fn accumulate(&self, evaluated: &Self::Evaluated, spec: BufferSpec<'_>) -> GBuffer;

    /// Makes an appearance that is shaded at samples ready.
    fn shader(&self, appearance: &Appearance) -> Self::Shader;

    /// Shades every sample of at least a weight, as [`BufferSpec::least_weight`], and composites:
    /// `[rays, 3 or more]`, colours first.
    fn shade(
        &self,
        evaluated: &Self::Evaluated,
        shader: &Self::Shader,
        least_weight: f32,
    ) -> Tensor<2>;
}
