//! Volume rendering: weights of samples, their sums along rays, and what is shaded after that.

pub(crate) mod accumulate;
pub(crate) mod gbuffer;
pub(crate) mod weights;
