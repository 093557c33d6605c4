//! The colours that a look gives a patch, and the way from a loss of them back to the look.

use burn::tensor::{Gradients, Tensor};
use impasto_field::{Appearance, Canvas, Geometry};

/// A loss of rays that may be more than one graph holds.
///
/// `loss` gets the colours of all rays, `[rays, 6]` as [`Geometry::composite`] gives them, and
/// returns one number; `parts` are the rays' geometry in order. The result has the loss's value
/// and gradients. Of several parts, each goes through a graph of its own, twice: for its colours,
/// then for what their gradient says of the look, so that the graph of one part is enough.
pub fn loss_of(
    parts: &[Geometry],
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
        let rays = part.layout().rays.len();
        let wanted = wanted.clone().slice_dim(0, start..start + rays);
        start += rays;
        let pixels = part.composite_colours(part.colours(&own, Some(colours)));
        let pulled = (pixels * Tensor::from_inner(wanted)).sum();
        add(&mut sums, &own, pulled.backward());
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

fn add(sums: &mut [Option<Tensor<1>>], look: &Appearance, mut gradients: Gradients) {
    for (sum, leaf) in sums.iter_mut().zip(leaves(look)) {
        *sum = match (sum.take(), leaf.grad_remove(&mut gradients)) {
            (Some(sum), Some(own)) => Some(sum + own),
            (sum, own) => sum.or(own),
        };
    }
}
