//! Adam over flat buffers, one unit a number.

use super::launch::{argument, cube, cubes_for, is_finite};
use crate::AdamStep;
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;

#[cube(launch_unchecked)]
fn update_kernel(
    param: &mut [f32],
    first: &mut [f32],
    second: &mut [f32],
    grad: &[f32],
    rate: f32,
    root_correction: f32,
    beta1: f32,
    beta2: f32,
    eps: f32,
    decay: f32,
    #[comptime] sparse: bool,
) {
    let i = ABSOLUTE_POS;
    if i < grad.len() {
        let g = grad[i];
        let mut counts = is_finite(g);
        if sparse {
            counts = counts && g != 0.0;
        }
        if counts {
            let g = g + decay * param[i];
            let m = beta1 * first[i] + (1.0 - beta1) * g;
            let v = beta2 * second[i] + (1.0 - beta2) * g * g;
            first[i] = m;
            second[i] = v;
            param[i] -= rate * m / (f32::sqrt(v) * root_correction + eps);
        }
    }
}

/// Moves the contents of `param` against `grad` and updates both moments, in place. All are whole
/// and of one length.
pub(crate) fn update([param, first, second]: [&CubeTensor; 3], grad: &CubeTensor, step: &AdamStep) {
    let t = step.step.max(1) as i32;
    let length = grad.meta.num_elements();
    if length == 0 {
        return;
    }
    // SAFETY: every unit looks at one number, inside the buffers, which have one length.
    unsafe {
        update_kernel::launch_unchecked(
            &grad.client,
            cubes_for(length),
            cube(),
            argument(param),
            argument(first),
            argument(second),
            argument(grad),
            step.rate / (1.0 - step.beta1.powi(t)),
            (1.0 - step.beta2.powi(t)).sqrt().recip(),
            step.beta1,
            step.beta2,
            step.eps,
            step.sparse.map_or(0.0, |sparse| sparse.decay),
            step.sparse.is_some(),
        );
    }
}
