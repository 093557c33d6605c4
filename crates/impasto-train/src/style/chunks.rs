//! The colours that a look gives a patch, and the way from a loss of them back to the look.

use burn::tensor::{Gradients, Tensor};
use impasto_field::{Appearance, Canvas, Paintable};

/// A loss of rays that may be more than one graph holds.
///
/// `loss` gets the colours of all rays, `[rays, 6]` as [`Paintable::composite`] gives them, and
/// returns one number; `parts` are the rays in order. The result has the loss's value
/// and gradients. Of several parts, each goes through a graph of its own, twice: for its colours,
/// then for what their gradient says of the look, so that the graph of one part is enough.
pub fn loss_of(
    parts: &[Paintable],
    look: &Appearance,
    loss: impl FnOnce(Tensor<2>) -> Tensor<1>,
) -> Tensor<1> {
    if let [all] = parts {
        return loss(all.composite(look));
    }
    let fixed = mapped(look, Tensor::detach);
    let colours: Vec<_> = parts
        .iter()
        .map(|part| part.colours(&fixed, None))
        .collect();
    let pixels = parts.iter().zip(&colours);
    let pixels = pixels.map(|(part, colours)| part.composite_colours(colours.clone()));
    let pixels = Tensor::cat(pixels.collect(), 0).detach().require_grad();
    let loss = loss(pixels.clone());
    let value = loss.clone().detach();
    let Some(wanted) = pixels.grad(&loss.backward()) else {
        return value;
    };
    let mut sums: Vec<Option<Tensor<1>>> = vec![None; leaves(look).len()];
    let mut start = 0;
    for (part, colours) in parts.iter().zip(&colours) {
        let own = mapped(look, |weights| weights.detach().require_grad());
        let rays = part.rays();
        let wanted = wanted.clone().slice_dim(0, start..start + rays);
        start += rays;
        let pixels = part.composite_colours(part.colours(&own, Some(colours)));
        let pulled = (pixels * Tensor::from_inner(wanted)).sum();
        add_gradients(&mut sums, &leaves(&own), pulled.backward());
    }
    // Zero, but with the gradients that were found.
    let pulled = leaves(look)
        .into_iter()
        .zip(sums)
        .filter_map(|(leaf, sum)| {
            let pull = leaf.clone() - leaf.clone().detach();
            Some((pull * Tensor::from_inner(sum?)).sum())
        });
    pulled.fold(value, |sum, pull| sum + pull)
}

/// What a look learns.
fn leaves(look: &Appearance) -> Vec<&Tensor<1>> {
    let canvas = look.canvas.iter().flat_map(|c| [&c.inner, &c.outer]);
    [&look.inner, &look.outer]
        .into_iter()
        .chain(canvas)
        .collect()
}

fn mapped(look: &Appearance, f: impl Fn(Tensor<1>) -> Tensor<1>) -> Appearance {
    Appearance {
        config: look.config.clone(),
        inner: f(look.inner.clone()),
        outer: f(look.outer.clone()),
        canvas: look.canvas.as_ref().map(|canvas| Canvas {
            inner: f(canvas.inner.clone()),
            outer: f(canvas.outer.clone()),
        }),
        latent: look.latent.clone(),
    }
}

/// Adds the gradients of leaves to sums of them, as far as there are any.
pub(crate) fn add_gradients(
    sums: &mut [Option<Tensor<1>>],
    leaves: &[&Tensor<1>],
    mut gradients: Gradients,
) {
    for (sum, leaf) in sums.iter_mut().zip(leaves) {
        *sum = match (sum.take(), leaf.grad_remove(&mut gradients)) {
            (Some(sum), Some(own)) => Some(sum + own),
            (sum, own) => sum.or(own),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::TrainConfig;
    use burn::tensor::Device;
    use impasto_field::render::host;
    use impasto_field::{EncodingConfig, Field, RayBatch, prepare_rays};
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    /// Value and gradients of a loss that mixes all rays.
    fn value_and_gradients(parts: &[Paintable], look: &Appearance) -> Vec<Vec<f32>> {
        let own = mapped(look, |weights| Tensor::from_inner(weights).require_grad());
        let loss = loss_of(parts, &own, |colours| {
            let mean = colours.clone().mean();
            ((colours - mean.unsqueeze()).square().sum() + 1.0).log()
        });
        let mut all = vec![host(loss.clone().inner())];
        let gradients = loss.backward();
        let own = leaves(&own).into_iter().map(|leaf| leaf.grad(&gradients));
        all.extend(own.map(|grad| grad.map(host).unwrap_or_default()));
        all
    }

    #[test]
    fn parts_have_the_value_and_the_gradients_of_the_whole() {
        let mut config = TrainConfig::fast();
        for volume in [&mut config.field.inner, &mut config.field.outer] {
            volume.encoding = EncodingConfig::Frequency { bands: 2 };
        }
        config.field.sampling.inner_grid = 8;
        config.field.sampling.outer_grid = 8;
        config.style_app.canvas = Some(EncodingConfig::HashGrid {
            levels: 2,
            features: 2,
            log2_entries: 8,
            coarsest: 4.0,
            finest: 8.0,
        });
        let (field, device) = (Field::new(config.field.clone()), Device::flex());
        let mut rng = Pcg64::seed_from_u64(1);
        let (weights, grids) = (field.init(&mut rng, &device), field.grids(1.0, None));
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
        let parts = |turn| {
            let settings = (&look.config, 0.0, turn);
            let prepared = prepare_rays((&field, &weights, &grids), None, settings, &rays, 5);
            let level = prepared.levels.into_iter().next_back();
            level
                .into_iter()
                .flatten()
                .map(Paintable::lifted)
                .collect::<Vec<_>>()
        };
        let whole = value_and_gradients(&parts(300), &look);
        let several = parts(128);
        assert_eq!((several.len(), whole.len()), (3, 5));
        for (one, other) in whole.iter().zip(value_and_gradients(&several, &look)) {
            let size = one.iter().map(|g| g.abs()).fold(0.0, f32::max);
            assert!(size > 0.0 && one.len() == other.len());
            for (a, b) in one.iter().zip(&other) {
                assert!((a - b).abs() < 1e-4 * size, "{a} {b}");
            }
        }
    }
}
