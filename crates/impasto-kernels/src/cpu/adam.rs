//! Adam over flat buffers (Kingma & Ba 2015), one pass over memory.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Settings of one Adam step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdamStep {
    /// Learning rate.
    pub rate: f32,
    /// Decay of the first moment.
    pub beta1: f32,
    /// Decay of the second moment.
    pub beta2: f32,
    /// Added to the root of the second moment.
    pub eps: f32,
    /// 1 for the first step.
    pub step: u32,
    /// For hash tables.
    pub sparse: Option<Sparse>,
}

/// Steps of a hash table, of which each touches a small part: numbers with zero gradient, and their
/// moments, stay as they are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sparse {
    /// That many times the number itself is added to the gradient of each number that has one: the
    /// less a step says of an entry, the closer it is kept to zero (Barron et al. 2023, "Zip-NeRF",
    /// decays tables in this way, by level).
    pub decay: f32,
}

const CHUNK: usize = 1 << 14;

/// Moves `param` against `grad` and updates both moments in place.
///
/// A gradient that is not finite leaves its parameter and moments untouched, so that one bad ray
/// cannot destroy a model.
///
/// # Panics
/// If the slices differ in length.
pub fn update(
    param: &mut [f32],
    first: &mut [f32],
    second: &mut [f32],
    grad: &[f32],
    adam: &AdamStep,
) {
    assert!(
        param.len() == grad.len() && first.len() == grad.len() && second.len() == grad.len(),
        "Adam's buffers have one length"
    );
    param
        .par_chunks_mut(CHUNK)
        .zip(first.par_chunks_mut(CHUNK))
        .zip(second.par_chunks_mut(CHUNK))
        .zip(grad.par_chunks(CHUNK))
        .for_each(|(((param, first), second), grad)| {
            Arch::new().dispatch(Update {
                param,
                first,
                second,
                grad,
                adam,
            });
        });
}

struct Update<'a> {
    param: &'a mut [f32],
    first: &'a mut [f32],
    second: &'a mut [f32],
    grad: &'a [f32],
    adam: &'a AdamStep,
}

/// Numbers looked at together: where none has a gradient, a sparse step reads nothing else.
const GROUP: usize = 16;

impl WithSimd for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let adam = self.adam;
        let (sparse, decay) = (adam.sparse.is_some(), adam.sparse.map_or(0.0, |s| s.decay));
        let t = adam.step.max(1) as i32;
        let rate = adam.rate / (1.0 - adam.beta1.powi(t));
        let root_correction = (1.0 - adam.beta2.powi(t)).sqrt().recip();
        let params = self.param.chunks_mut(GROUP).zip(self.grad.chunks(GROUP));
        let moments = self
            .first
            .chunks_mut(GROUP)
            .zip(self.second.chunks_mut(GROUP));
        for ((param, grad), (first, second)) in params.zip(moments) {
            if sparse && grad.iter().all(|g| *g == 0.0) {
                continue;
            }
            let numbers = param.iter_mut().zip(grad).zip(first.iter_mut().zip(second));
            for ((p, g), (m, v)) in numbers {
                let counts = (!sparse || *g != 0.0) && g.is_finite();
                let g = g + decay * *p;
                let next_m = adam.beta1 * *m + (1.0 - adam.beta1) * g;
                let next_v = adam.beta2 * *v + (1.0 - adam.beta2) * g * g;
                let next_p = *p - rate * next_m / (next_v.sqrt() * root_correction + adam.eps);
                // Choosing between numbers instead of branching keeps the loop in vectors.
                *m = if counts { next_m } else { *m };
                *v = if counts { next_v } else { *v };
                *p = if counts { next_p } else { *p };
            }
        }
    }
}
