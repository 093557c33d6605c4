//! Losses of the style stage (PAPER §8).

use crate::perceptual::{Features, Statistics};
use burn::tensor::{Tensor, TensorData};

/// Content and style loss of a traced feature vector.
///
/// Content: mean squared difference of relu4_1 to the photo's. Style: mean squared difference of
/// the 1,920 statistics to the painting's (the reference's form, which weighs layers by width).
///
/// # Shapes
/// `traced`: the result of [`crate::Perceptual::traced`]; results: one number each.
pub fn content_and_style(
    traced: &Tensor<1>,
    photo: &Features,
    painting: &Statistics,
) -> (Tensor<1>, Tensor<1>) {
    let device = traced.device();
    let constant = |data: &[f32]| {
        Tensor::<1>::from_data(TensorData::new(data.to_vec(), [data.len()]), &device)
    };
    let split = photo.content.len();
    let content = traced.clone().slice(0..split) - constant(&photo.content);
    let style = traced.clone().slice(split..split + Statistics::LEN) - constant(&painting.0);
    (content.square().mean(), style.square().mean())
}
