//! Adam over flat buffers (Kingma & Ba 2015), one pass over memory.

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
    /// Leave numbers with zero gradient, and their moments, as they are. For hash tables, of
    /// which a step touches a small part.
    pub sparse: bool,
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
    let t = adam.step.max(1) as i32;
    let rate = adam.rate / (1.0 - adam.beta1.powi(t));
    let root_correction = (1.0 - adam.beta2.powi(t)).sqrt().recip();
    param
        .par_chunks_mut(CHUNK)
        .zip(first.par_chunks_mut(CHUNK))
        .zip(second.par_chunks_mut(CHUNK))
        .zip(grad.par_chunks(CHUNK))
        .for_each(|(((param, first), second), grad)| {
            for (((p, m), v), g) in param.iter_mut().zip(first).zip(second).zip(grad) {
                if (adam.sparse && *g == 0.0) || !g.is_finite() {
                    continue;
                }
                *m = adam.beta1 * *m + (1.0 - adam.beta1) * g;
                *v = adam.beta2 * *v + (1.0 - adam.beta2) * g * g;
                *p -= rate * *m / (v.sqrt() * root_correction + adam.eps);
            }
        });
}
