//! The colours that an appearance gives a patch, and the way from a loss of them back to it.

use crate::optimizer::add_gradients;
use burn::tensor::Tensor;
use impasto_field::{Appearance, GBuffer, Parameters};

/// A loss of rays that may be more than one graph holds.
///
/// `loss` gets the colours of all rays, `[rays, 6]` as [`GBuffer::shade`] gives them, and
/// returns one number; `parts` are the rays in order. The result has the loss's value
/// and gradients. Of several parts, each goes through a graph of its own, twice: for its colours,
/// then for what their gradient says of the appearance, so that the graph of one part is enough.
///
/// # Errors
/// Those of `loss`.
pub fn loss_of<E>(
    parts: &[GBuffer],
    appearance: &Appearance,
    loss: impl FnOnce(Tensor<2>) -> Result<Tensor<1>, E>,
) -> Result<Tensor<1>, E> {
    if let [all] = parts {
        return loss(all.shade(appearance));
    }
    let fixed = appearance.map(|_, weights| weights.clone().detach());
    let colours: Vec<_> = parts
        .iter()
        .map(|part| part.colours(&fixed, None))
        .collect();
    let pixels = parts.iter().zip(&colours);
    let pixels = pixels.map(|(part, colours)| part.composite(colours.clone()));
    let pixels = Tensor::cat(pixels.collect(), 0).detach().require_grad();
    let loss = loss(pixels.clone())?;
    let value = loss.clone().detach();
    let Some(wanted) = pixels.grad(&loss.backward()) else {
        return Ok(value);
    };
    let mut sums: Vec<Option<Tensor<1>>> = Vec::new();
    let mut start = 0;
    for (part, colours) in parts.iter().zip(&colours) {
        let own = appearance.map(|_, weights| weights.clone().detach().require_grad());
        let rays = part.rays();
        let wanted = wanted.clone().slice_dim(0, start..start + rays);
        start += rays;
        let pixels = part.composite(part.colours(&own, Some(colours)));
        let pulled = (pixels * Tensor::from_inner(wanted)).sum();
        add_gradients(&mut sums, &own, pulled.backward());
    }
    // Zero, but with the gradients that were found.
    let pulled = appearance
        .named()
        .into_iter()
        .zip(sums)
        .filter_map(|((_, leaf), sum)| {
            let pull = leaf.clone() - leaf.clone().detach();
            Some((pull * Tensor::from_inner(sum?)).sum())
        });
    Ok(pulled.fold(value, |sum, pull| sum + pull))
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;
    use impasto_field::{
        DistilledFeatures, EncodingConfig, Field, GBufferOptions, Ground, OccupancyGrids, RayBatch,
        Renderer, host,
    };
    use impasto_model::TrainConfig;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    /// Value and gradients of a loss that mixes all rays.
    fn value_and_gradients(parts: &[GBuffer], look: &Appearance) -> Vec<Vec<f32>> {
        let own = look.map(|_, weights| Tensor::from_inner(weights.clone()).require_grad());
        let Ok::<_, std::convert::Infallible>(loss) = loss_of(parts, &own, |colours| {
            let mean = colours.clone().mean();
            Ok(((colours - mean.unsqueeze()).square().sum() + 1.0).log())
        });
        let mut all = vec![host(loss.clone().inner())];
        let gradients = loss.backward();
        let own = own
            .named()
            .into_iter()
            .map(|(_, leaf)| leaf.grad(&gradients));
        all.extend(own.map(|grad| grad.map(host).unwrap_or_default()));
        all
    }

    #[test]
    fn parts_have_the_value_and_the_gradients_of_the_whole() {
        let mut config = TrainConfig::fast();
        for volume in [&mut config.field.inner, &mut config.field.outer] {
            volume.encoding = EncodingConfig::Frequency { bands: 2 };
        }
        let spec = config.field.occupancy_mut().expect("the preset has grids");
        (spec.inner_grid, spec.outer_grid) = (8, 8);
        let grids = OccupancyGrids::uniform(spec, 1.0);
        let (field, device) = (Field::new(config.field.clone()), Device::flex());
        let mut rng = Pcg64::seed_from_u64(1);
        let weights = field.init(&mut rng, &device);
        let mut rays = RayBatch::default();
        for i in 0..300u16 {
            rays.push([0.1, 0.0, -0.2], [f32::from(i) / 300.0 - 0.5, 0.2, 1.0]);
        }
        let look = Appearance::init(
            config.style_appearance(),
            field.features(),
            &mut rng,
            &device,
        );
        let photo = config.photo_appearance();
        let photo = Appearance::init(photo, field.features(), &mut rng, &device);
        let spec = config.style.shading.paint().expect("the preset paints");
        let features = DistilledFeatures::init(spec.distilled, &mut rng, &device);
        let ground = Ground {
            photo,
            features: Some(features),
        };
        let renderer = Renderer::reference(field, weights, Some(grids), ground);
        let parts = |turn| {
            let options = GBufferOptions {
                config: &look.config,
                photo: None,
                seed: Some(5),
                least_weight: 0.0,
                rays_at_once: Some(turn),
            };
            let mut buffers = renderer.gbuffer(&rays, &options);
            let level = buffers.levels.pop().unwrap_or_default();
            level.into_iter().map(GBuffer::lifted).collect::<Vec<_>>()
        };
        let whole = value_and_gradients(&parts(300), &look);
        let several = parts(128);
        assert_eq!((several.len(), whole.len()), (3, 4));
        for (one, other) in whole.iter().zip(value_and_gradients(&several, &look)) {
            let size = one.iter().map(|g| g.abs()).fold(0.0, f32::max);
            assert!(size > 0.0 && one.len() == other.len());
            for (a, b) in one.iter().zip(&other) {
                assert!((a - b).abs() < 1e-4 * size, "{a} {b}");
            }
        }
    }
}
